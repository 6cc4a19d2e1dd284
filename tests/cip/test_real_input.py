"""Numbers that are not real, finite or there at all get a typed error, wherever they come in."""

import numpy as np
import pytest

from cip import Grid, InputError, Solver, State, Velocity

GRID = Grid((0, 1), 8, periodic=True)
HIDDEN = np.ma.masked_greater(np.linspace(0.1, 0.8, 8), 0.5)


def wave(x):
    return np.sin(2 * np.pi * x)


def solver(**more):
    return Solver(GRID, 1.0, **more)


def state(**more):
    return solver().state(wave, **more)


def of_data(data, t=0.0):
    return solver().step(State(GRID, "cubic", data, t), 0.1)


def run(**more):
    return solver().run(state(), 1.0, **more)


COMPLEX = np.complex128(1.0)  # float() would drop its imaginary part with a warning
CASES = {
    "coordinates": lambda: Grid.from_coordinates(np.arange(6) * 1j),
    "coordinates with NaN": lambda: Grid.from_coordinates([0, 1, np.nan, 3, 4, 5]),
    "no coordinates": lambda: Grid.from_coordinates(None),
    "empty coordinates": lambda: Grid.from_coordinates([]),
    "masked coordinates": lambda: Grid.from_coordinates(HIDDEN),
    "bounds": lambda: Grid((0, 1j), 8),
    "ragged bounds": lambda: Grid([(0, 1), (0,)], (8, 8)),
    "no cells": lambda: Grid((0, 1), []),
    "cells None": lambda: Grid((0, 1), None),
    "negative cells": lambda: Grid((0, 1), -8),
    "more cells than memory": lambda: Grid((0, 1), 10**15),
    "ragged periods": lambda: Grid((0, 1), 8, periodic=[[True], [True, False]]),
    "dt": lambda: solver().step(state(), COMPLEX),
    "two dt": lambda: solver().step(state(), np.array([0.1, 0.2])),
    "dt None": lambda: solver().step(state(), None),
    "infinite dt": lambda: solver().step(state(), np.inf),
    "cfl NaN": lambda: run(cfl=np.nan),
    "negative cfl": lambda: run(cfl=-1.0),
    "t_end": lambda: solver().run(state(), COMPLEX, dt=0.1),
    "t_end NaN": lambda: solver().run(state(), np.nan, dt=0.1),
    "snapshots": lambda: run(dt=0.1, snapshots=[0.5j]),
    "snapshots with NaN": lambda: run(dt=0.1, snapshots=[0.1, np.nan]),
    "masked snapshots": lambda: run(dt=0.1, snapshots=HIDDEN),
    "no snapshots": lambda: run(dt=0.1, snapshots=0),
    "two and a half snapshots": lambda: run(dt=0.1, snapshots=2.5),
    "snapshots before": lambda: run(dt=0.1, snapshots=[-1.0]),
    "velocity": lambda: Solver(GRID, COMPLEX),
    "velocity in a list": lambda: Solver(GRID, [1j]),
    "velocity NaN": lambda: Solver(GRID, np.nan),
    "infinite velocity": lambda: Solver(GRID, np.inf),
    "velocity None": lambda: Solver(GRID, [None]),
    "no velocity": lambda: Solver(GRID, []),
    "ragged velocity": lambda: Solver(
        Grid([(0, 1)] * 2, (8, 8), periodic=True), [np.ones((8, 8)), np.ones(4)]
    ),
    "velocity of objects": lambda: Solver(GRID, np.array([None] * 8)),
    "formula": lambda: Velocity.from_expression(1j),
    "wall": lambda: Solver(Grid((0, 1), 8), 1.0, boundary=COMPLEX),
    "wall NaN": lambda: Solver(Grid((0, 1), 8), 1.0, boundary=np.nan),
    "wall of values": lambda: Solver(Grid((0, 1), 8), 1.0, boundary=np.ones(3)),
    "field": lambda: solver().state(COMPLEX),
    "field None": lambda: solver().state(None),
    "masked field": lambda: solver().state(HIDDEN),
    "time": lambda: solver().state(wave, t=1j),
    "time as a word": lambda: solver().state(wave, t="noon"),
    "derivatives": lambda: solver().state(wave, derivatives=[1]),
    "beyond single precision": lambda: solver(dtype=np.float32).state(1e300),
    "moments": lambda: of_data(np.zeros((2, 8), complex)),
    "whole moments": lambda: of_data(np.zeros((2, 8), int)),
    "masked moments": lambda: of_data(np.ma.masked_equal(np.zeros((2, 8)), 0.0)),
    "moments of a list": lambda: of_data([[0.0] * 8] * 2),
    "moments without time": lambda: of_data(np.zeros((2, 8)), None),
    "moments at NaN": lambda: of_data(np.zeros((2, 8)), np.nan),
    "no grid": lambda: State.from_function(wave, None),
    "moments on no grid": lambda: solver().step(State(None, "cubic", np.zeros((2, 8))), 0.1),
    "profile": lambda: solver(profile=["cubic"]),
    "splitting": lambda: solver(splitting=["strang"]),
    "backend": lambda: solver(backend=["cpu"]),
    "limits": lambda: solver(bounds=(0, COMPLEX)),
    "limits with NaN": lambda: solver(bounds=(0, np.nan)),
    "three limits": lambda: solver(bounds=(0, 1, 2)),
    "tolerance": lambda: solver(bounds_tolerance=np.nan),
    "store_feet": lambda: solver(store_feet="no"),
    "points": lambda: run(dt=0.5).sample(HIDDEN),
    "no points": lambda: run(dt=0.5).sample(None),
}


@pytest.mark.parametrize("case", CASES)
def test_typed(case):
    with pytest.raises(InputError):
        CASES[case]()


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_other_real_numbers_are_taken(kind):
    values = np.array([0, 1, 1, 0, 1, 0, 0, 1], dtype=kind)
    found = State.from_function(values.astype(float), GRID)["u"]
    np.testing.assert_array_equal(State.from_function(values, GRID)["u"], found)
    (made,) = Solver(GRID, [values]).velocity.on(GRID)
    at_nodes = made.derivative((0, 0, 0, 0), (1.0,) * 4)(GRID.coordinates[0], 0.0, 0.0, 0.0)
    np.testing.assert_allclose(at_nodes, values, atol=1e-12)
