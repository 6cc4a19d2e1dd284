"""Malformed input gets a typed error that names the argument, the node and the time."""

import math

import numpy as np
import pytest

from cip import Grid, InputError, LeftDomain, NotFinite, NotSupported, Solver, State, Velocity


def line(**more):
    return Solver(Grid((0, 1), 8, periodic=True), 1.0, **more)


def wave(x):
    return np.sin(2 * np.pi * x)


def with_nan():
    solver = line()
    state = solver.state(wave)
    state.data[1, 3] = np.nan
    return solver.step(state, 0.1)


def stepped(dt):
    solver = line()
    return solver.step(solver.state(wave), dt)


def moved(velocity, grid=None, boundary=None):
    solver = Solver(grid or Grid((0, 1), 8, periodic=True), velocity, boundary=boundary)
    return solver.step(solver.state(wave), 0.1)


def ran(**more):
    solver = line()
    return solver.run(solver.state(wave), 1.0, **more)


CASES = {
    "cells": (lambda: Grid((0, 1), 3), "shape: expected at least 4"),
    "fractional cells": (lambda: Grid((0, 1), 8.0), "shape"),
    "reversed bounds": (lambda: Grid((1, 0), 8), "bounds"),
    "bounds with NaN": (lambda: Grid((0, np.nan), 8), "bounds"),
    "bounds missing": (lambda: Grid([(0, 1)], (8, 8)), "bounds: expected 2 pairs"),
    "periodic": (lambda: Grid((0, 1), 8, periodic=1), "periodic"),
    "decreasing coordinates": (
        lambda: Grid.from_coordinates([0, 1, 0.5, 2, 3, 4]),
        "spacing after node 1 is -0.5",
    ),
    "few coordinates": (lambda: Grid.from_coordinates([0, 1, 2]), "x: expected at least 5"),
    "z without y": (lambda: Grid.from_coordinates(np.arange(6), z=np.arange(6)), "z: given"),
    "formula": (lambda: Velocity.from_expression("x1 +"), "is not a formula"),
    "unknown name": (lambda: Velocity.from_expression("foo"), "'foo'"),
    "unknown function": (lambda: Velocity.from_expression("gamma(x1)"), "'gamma'"),
    "attribute": (lambda: Velocity.from_expression("x1.real"), "is not arithmetic"),
    "number beyond the range": (lambda: Velocity.from_expression("10**400*x1"), "not finite"),
    "long number": (lambda: Velocity.from_expression("1" + "0" * 400), "too large"),
    "infinite power": (lambda: Velocity.from_expression("x1**1e999"), "not finite"),
    "root of a negative number": (lambda: Velocity.from_expression("(-8)**(1/3)"), "not finite"),
    "division by zero": (lambda: Velocity.from_expression("x1/(2 - 2)"), "not finite"),
    "deep formula": (lambda: Velocity.from_expression("-" * 3000 + "x1"), "3002 characters"),
    "text for c": (lambda: Velocity("x1"), "from_expression"),
    "array of wrong shape": (lambda: Solver(Grid((0, 1), 8), np.ones(5)), r"shape \(9,\)"),
    "array with NaN": (lambda: Solver(Grid((0, 1), 8), np.full(9, np.nan)), "node"),
    "complex array": (lambda: Solver(Grid((0, 1), 8), np.ones(9) * 1j), "complex128"),
    "components": (lambda: Solver(Grid([(0, 1)] * 2, (8, 8)), 1.0), "1 components"),
    "profile": (lambda: line(profile="septic"), "profile: expected one of"),
    "plane profile on a line": (lambda: line(profile="adini"), "two-dimensional"),
    "form": (lambda: line(form="diffusion"), "form"),
    "csl for transport": (lambda: line(profile="csl2"), "advection"),
    "limiter": (lambda: line(limiter="minmod"), "limiter: expected"),
    "limiter of another profile": (lambda: line(limiter="bounds"), "does not fit 'cubic'"),
    "no splitting": (
        lambda: Solver(Grid([(0, 1)] * 2, (8, 8)), ["x2", "x1"], profile="cubic"),
        "splitting='strang'",
    ),
    "backend": (lambda: line(backend="tpu"), "backend"),
    "dtype": (lambda: line(dtype=np.int32), "dtype"),
    "bounds of the limiter": (lambda: line(bounds=(1, 0)), "low must be below high"),
    "wall": (lambda: Solver(Grid((0, 1), 8), 1.0, boundary={"left": 0}), "'left' is no wall"),
    "wall of a periodic direction": (lambda: line(boundary={"x-": 0}), "periodic there"),
    "source that is no number": (lambda: line(source=True), "source: .*, got True"),
    "decay that is no number": (lambda: line(decay=False), "decay: .*, got False"),
    "grid": (lambda: Solver(np.linspace(0, 1), 1.0), "grid: expected a Grid"),
    "velocity of t that is not said to be": (
        lambda: moved(lambda x, t: np.cos(t) + 0 * x),
        r"c1: called with the arrays x1 it raised TypeError.*steady=False",
    ),
    "complex velocity": (lambda: moved(lambda x: 1j * x), "c1: .*real values .*complex128"),
    "velocity of numbers only": (lambda: moved(math.sin), "c1: .*TypeError"),
    "components of a callable": (lambda: moved(lambda x: (x, x)), "returned 2 components"),
    "wall data without a place": (
        lambda: moved(1.0, Grid((0, 1), 8), {"x-": lambda t: t}),
        "boundary 'x-': called with the arrays x1, t",
    ),
    "complex function": (lambda: line().state(lambda x: 1j * x), "f: .*real values"),
    "function of wrong shape": (
        lambda: line().state(lambda x: np.ones(7)),
        r"f: .*of shape \(8,\), got float64 of shape \(7,\)",
    ),
    "values of wrong shape": (lambda: line().state(np.ones(7)), r"f: .*shape \(8,\)"),
    "values with NaN": (lambda: line().state(np.full(8, np.nan)), r"f: NaN .*node \(0,\)"),
    "NaN in the state": (with_nan, r"moment 'u_x' is nan at node \(3,\) at \(0.375\) at t = 0"),
    "function with NaN": (lambda: line().state(lambda x: np.sqrt(x - 0.5)), "f: moment 'u' is nan"),
    "unknown derivative": (lambda: line().state(wave, {"u_y": wave}), "u_y"),
    "state of another profile": (
        lambda: line().step(line(profile="linear").state(wave), 0.1),
        "linear",
    ),
    "state of another grid": (
        lambda: line().step(State.from_function(wave, Grid((0, 1), 9, periodic=True)), 0.1),
        "it lives on",
    ),
    "no state": (lambda: line().step(np.ones(8), 0.1), "expected a State"),
    "dt = 0": (lambda: stepped(0.0), "dt: expected a positive"),
    "negative dt": (lambda: stepped(-0.1), "dt: expected a positive"),
    "dt NaN": (lambda: stepped(np.nan), "dt: expected a positive"),
    "dt a text": (lambda: stepped("fast"), "dt: expected a positive"),
    "dt and cfl": (lambda: ran(dt=0.1, cfl=1), "either dt or cfl"),
    "neither": (lambda: ran(), "either dt or cfl"),
    "snapshots": (lambda: ran(dt=0.1, snapshots=[0.5, 0.2]), "increasing"),
    "snapshots beyond": (lambda: ran(dt=0.1, snapshots=[2.0]), "snapshots"),
    "t_end": (lambda: line().run(line().state(wave), 0.0, dt=0.1), "t_end"),
    "callback": (lambda: ran(dt=0.1, callback=3), "callback: expected a callable"),
    "dt lost in the rounding of t": (
        lambda: line().run(line().state(wave, t=1e17), 1e17 + 64, dt=0.1),
        "dt: 0.1 is lost in the rounding of t = 1e.17",
    ),
    "time": (lambda: line().state(wave, t=np.nan), "f: expected a finite time"),
    "limiters": (lambda: line(limiter=["clamp"]), "limiter: expected one of"),
    "dtype that is none": (lambda: line(dtype="single-ish"), "dtype: expected"),
    "tolerance of the bounds": (lambda: line(bounds_tolerance="a"), "bounds_tolerance"),
    "bounds one apart": (lambda: Grid((1, 1 + 1e-15), 8), "cannot be divided"),
    "bounds too far apart": (lambda: Grid((-1e308, 1e308), 8), "cannot be divided"),
    "complex points": (lambda: ran(dt=0.5).sample([1j]), "points: .*complex"),
    "points that are words": (lambda: ran(dt=0.5).sample("here"), "points: expected real"),
    "moment": (lambda: line().state(wave)["v"], "'v' is none of u, u_x"),
    "points": (lambda: ran(dt=0.5).sample([np.nan]), "points"),
}


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    attempt, message = CASES[case]
    with pytest.raises(InputError, match=message):
        attempt()


def test_feet_that_leave_name_node_time_and_wall():
    solver = Solver(Grid((0, 1), 10), 1.0)
    state = solver.state(wave, t=2.0)
    with pytest.raises(LeftDomain, match=r"node \(0,\) at \(0\) at t = 2.05 .*'x-' at \(0\)"):
        solver.step(state, 0.05)


def test_wall_data_that_are_not_finite():
    with pytest.raises(NotFinite, match="boundary data"):
        moved(1.0, Grid((0, 1), 8), {"x-": lambda x, t: np.sqrt(t - 1)})


def test_velocity_that_overflows_names_node_and_time():
    solver = Solver(Grid((0, 4), 10, periodic=True), Velocity(lambda x: np.exp(x**8)))
    with pytest.raises(NotFinite, match=r"node \(\d+,\) at \(.*\) is not finite at t = "):
        solver.step(solver.state(wave), 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"), [("sqrt(0.3 - t)", r"is not finite at t = "), ("1e25*t", "1e.09 cells")]
)
@pytest.mark.parametrize("dim", [1, 2])
def test_unsteady_velocity_that_overflows_later(text, message, dim):
    """In the kernels that compute the feet too, and at the step where it happens."""
    grid = Grid((0, 1), (8,) * dim, periodic=True)
    solver = Solver(grid, Velocity.from_expression(text, "0") if dim == 2 else
                    Velocity.from_expression(text))  # fmt: skip
    with pytest.raises(NotFinite, match=message) as caught:
        solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.03, snapshots=10)
    assert caught.value.trajectory.final.t <= 0.3


@pytest.mark.parametrize("text", ["1e25", "1e25*sin(2*pi*x1)"])
def test_velocity_beyond_what_can_be_counted(text):
    solver = Solver(Grid((0, 1), 8, periodic=True), Velocity.from_expression(text))
    with pytest.raises(NotFinite, match=r"node \(\d,\).* goes more than 1e.09 cells"):
        solver.step(solver.state(wave), 0.1)


def test_formula_that_is_singular_at_the_start():
    """Python would raise at 1 / t for its own number t = 0."""
    solver = Solver(Grid((0, 1), 8, periodic=True), Velocity.from_expression("1/t"))
    with pytest.raises(NotFinite, match="at t = 0 "):
        solver.run(solver.state(wave), 1.0, dt=0.1)


def test_field_that_overflows_keeps_what_was_computed():
    """Compression by exp(10) a unit of time: float64 overflows before t = 100."""
    solver = Solver(Grid((-1, 1), 8), Velocity(lambda x: -10 * x), "advection", boundary=1.0)
    with pytest.raises(NotFinite, match="moment") as caught:
        solver.run(solver.state(1.0), 100.0, dt=1.0, snapshots=100)
    assert len(caught.value.trajectory) > 10


def test_splitting_with_unsteady_data_is_refused():
    with pytest.raises(NotSupported, match="splitting"):
        Solver(
            Grid([(0, 1)] * 2, (8, 8)), Velocity.from_expression("1", "1"), profile="cubic",
            splitting="strang", boundary="sin(t)",
        )  # fmt: skip
