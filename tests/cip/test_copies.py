"""An object of every public class is pickled, copied and deep-copied with all that it holds."""

import copy
import inspect
import pickle

import numpy as np
import pytest

import cip
from cip import Grid, Solver, Velocity

COPIES = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}
PUBLIC = [value for name in cip.__all__ if inspect.isclass(value := getattr(cip, name))]


def run():
    solver = Solver(
        Grid.from_coordinates([0.0, 0.3, 0.5, 0.7, 0.8, 1.0]), lambda x: 1 + x, boundary="sin(t)"
    )
    return solver.run(solver.state("x1**2"), 0.2, dt=0.1, snapshots=2)


def identified():
    grid = Grid((0, 1), 48, periodic=True)
    solver = Solver(grid, cip.SplineVelocity(grid, 6, 1.0))
    start = solver.state("sin(2*pi*x1) + cos(4*pi*x1)")
    seen = Solver(grid, 1.1).run(start, 0.3, dt=0.03).final["u"]
    return cip.identify_velocity(solver, start, {0.3: seen}, dt=0.03, noise=0.01)


def sensors():
    return cip.Sensors([0.3, 0.6], [0.1, 0.3], [[0.9, np.nan], [0.2, 0.9]], 0.1)


def covariance():
    grid = Grid((0, 1), 32, periodic=True)
    return cip.Covariance.diffusion(grid, "cubic", deviation=1.0, length=0.15)


def analysis():
    solver = Solver(Grid((0, 1), 32, periodic=True), 1.0)
    return cip.four_d_var(solver, solver.state(0.0), covariance(), sensors(), dt=0.05)


def placement():
    solver, places = Solver(Grid((0, 1), 32, periodic=True), 1.0), [0.1, 0.35, 0.6]
    plan = cip.Sensors(places, [0.1], deviations=0.1)
    return cip.place_sensors(solver, solver.state(0.0), covariance(), plan, budget=2, dt=0.05)


MAKE = {
    "Analysis": analysis,
    "Covariance": covariance,
    "Diagnostics": lambda: run().diagnostics,
    "Identifiability": lambda: identified().identifiability,
    "IdentifiedVelocity": identified,
    "Placement": placement,
    "Sensors": sensors,
    "SplineVelocity": lambda: cip.SplineVelocity(Grid((0, 1), 16, periodic=True), 6, 1.0),
    "Grid": lambda: Grid([(0, 1), (0, 2)], (4, 5), periodic=(True, False)),
    "Solver": lambda: run().solver,
    "Source": lambda: cip.Source(lambda x: 1 + x**2),
    "State": lambda: run().final,
    "Trajectory": run,
    "Velocity": lambda: Velocity(lambda x: 1 + x**2),
}


def same(one, other, depth=0):
    """Whether all that the objects hold is equal; what cannot be compared has equal types."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, str | int | float | complex | bool | None):
        assert one == other
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            same(*pair, depth + 1)
    elif isinstance(one, cip.Grid | cip.State | cip.Diagnostics):
        assert vars(one).keys() == vars(other).keys()
        for name, value in vars(one).items():
            same(value, vars(other)[name], depth + 1)


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("kind", PUBLIC)
def test_every_public_class(kind, again):
    if issubclass(kind, Exception):
        one = kind("velocity: of 3 numbers")
        one.note = np.arange(3)
        other = again(one)
        assert (str(other), type(other)) == (str(one), kind)
        np.testing.assert_array_equal(other.note, one.note)
        return
    one = MAKE[kind.__name__]()
    assert isinstance(one, kind)
    other = again(one)
    same(one, other)
    assert repr(other) == repr(one) or " at 0x" in repr(one)
    if kind is cip.Trajectory:
        same(list(one), list(other))
        same(one.times, other.times)
    if kind is cip.Solver:
        start = one.state("x1**2")
        same(one.step(start, 0.1), other.step(again(start), 0.1))
