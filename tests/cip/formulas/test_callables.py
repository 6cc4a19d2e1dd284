"""Callables: functions of the place alone are taken, and what they say of time."""

import numpy as np
import pytest

from cip import Grid, InputError, Solver, State, Velocity

RANDOM = np.random.default_rng(3)


def wave(x):
    return 1.5 + np.sin(2 * np.pi * x)


COMPANY = {
    "mean": lambda x: wave(x) - np.mean(wave(x)),
    "slight mean": lambda x: wave(x) - 1e-6 * np.mean(wave(x)),
    "median": lambda x: wave(x) - np.median(wave(x)),
    "largest": lambda x: wave(x) / np.max(wave(x)),
    "norm": lambda x: wave(x) / np.linalg.norm(x),
    "roll": lambda x: np.roll(wave(x), 1),
    "flip": lambda x: np.flip(wave(x)),
    "sort": lambda x: np.sort(wave(x)),
    "cumsum": lambda x: np.cumsum(wave(x)) / 50,
    "method": lambda x: np.asarray(x) - np.asarray(x).mean(),
    "ravel": lambda x: wave(x) + np.ravel(x)[0],
    "item": lambda x: wave(x) + np.asarray(x).flat[0],
    "size": lambda x: wave(x) / np.size(x),
    "fixed array": lambda x: np.linspace(1, 2, 33),
    "fixed value of an array": lambda x: 0 * x + np.linspace(1, 2, np.size(x)),
    "chance": lambda x: wave(x) + RANDOM.random(np.shape(x)),
    "interpolated from what came": lambda x: np.interp(x, np.sort(x), np.arange(np.size(x)) * 1.0),
}


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("kind", COMPANY)
def test_refused(kind, periodic):
    f = COMPANY[kind]
    grid = Grid((0, 1), 33 - (not periodic), periodic=periodic)
    assert not Velocity(f).exact
    for attempt in (
        lambda: Solver(grid, f),
        lambda: Solver(grid, [f]),
        lambda: Solver(grid, lambda x, t: f(x) * np.cos(t), boundary=0.0),
        lambda: Solver(grid, Velocity(lambda x, t: f(x) * np.cos(t), steady=False)),
        lambda: State.from_function(f, grid),
        lambda: State.from_function("x1", grid, derivatives={"u_x": f}),
    ):
        with pytest.raises(InputError, match=r"no function of the place|must return|it raised"):
            attempt()


def test_refused_in_planes_and_on_walls():
    grid = Grid([(0, 1)] * 2, (16, 12))
    with pytest.raises(InputError, match=r"c1: .* no function of the place"):
        Solver(grid, lambda x, y: (y - np.mean(y), x), boundary=0.0)
    with pytest.raises(InputError, match=r"c2: .* no function of the place"):
        Solver(grid, [lambda x, y: y, lambda x, y: x - np.mean(x)], boundary=0.0)
    with pytest.raises(InputError, match=r"f: .* no function of the place"):
        State.from_function(lambda x, y: np.roll(np.sin(x) * y, 1, axis=1), grid)
    with pytest.raises(InputError, match=r"boundary 'x-': .* no function of the place"):
        Solver(grid, (1.0, 0.5), boundary={"x-": lambda x, y, t: y - np.mean(y), "y-": 0.0})


PLACE = {
    "where": lambda x: np.where(x > 0.4, np.sin(x), x),
    "comparison": lambda x: (x > 0.4) * np.cos(x),
    "interpolation": lambda x: np.interp(x, [0, 0.3, 1], [1, 2, 1.0]),
    "search": lambda x: np.searchsorted([0.2, 0.5], x) * 0.5,
    "sum over components": lambda x: np.sum([np.sin(x), np.cos(x)], axis=0),
    "polynomial": lambda x: np.polyval([1.0, 2.0, 3.0], x),
    "constant": lambda x: 2.0,
    "filled mask": lambda x: np.ma.masked_where(x > 0.5, x).filled(0.5),
    "mask of nothing": lambda x: np.ma.masked_where(x > 5, x),
}


@pytest.mark.parametrize("kind", PLACE)
def test_functions_of_the_place_are_taken(kind):
    grid = Grid((0, 1), 33, periodic=True)
    x, f = grid.coordinates[0], PLACE[kind]
    (formula,) = Velocity(f).on(grid)
    values = formula.derivative((0, 0, 0, 0), (1.0,) * 4)(x, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(values, np.broadcast_to(f(x), x.shape), rtol=1e-15)
    np.testing.assert_allclose(State.from_function(f, grid)["u"], values, rtol=1e-15)


def test_masks_that_callables_return_are_not_dropped():
    grid, f = Grid((0, 1), 32), lambda x, *t: np.ma.masked_where(x > 0.5, x)
    for attempt in (
        lambda: Solver(grid, f),
        lambda: State.from_function(f, grid),
        lambda: Solver(grid, 1.0, boundary=lambda x, t: np.ma.masked_where(t < 9, t + x)),
    ):
        with pytest.raises(InputError, match="masked"):
            attempt()


def test_formulas_stay_formulas():
    assert Velocity(lambda x: x - x**3).exact
    assert Velocity(lambda x: np.array([1 + np.zeros_like(x)])).exact
    assert all(
        c.exact for c in Velocity(lambda x, y: np.array([-y, x])).on(Grid([(0, 1)] * 2, (8, 8)))
    )
    assert Velocity(lambda x: np.sqrt(1e6 + x**0.5) / 3 - 1000 / 3).exact


@pytest.mark.parametrize(
    "c",
    [
        lambda x: np.sinc(x),
        lambda x: np.where(x == 0, 1.0, 1.5 + np.sin(x)),
        lambda x: 2.0 * (x != 0.5),
        np.vectorize(lambda x: 0.0 if x == 0 else np.cos(x)),
    ],
)
def test_a_comparison_is_not_decided_once_for_all_points(c):
    grid = Grid((-1, 1), 8, periodic=True)
    (formula,) = Velocity(c).on(grid)
    assert not formula.exact
    x = grid.coordinates[0]
    np.testing.assert_array_equal(formula.derivative((0, 0, 0, 0), (1.0,) * 4)(x, 0, 0, 0.0), c(x))


def shifted(velocity):
    """The field after a turn of cos t from 0 to 1, by quintic profiles."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, velocity, profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.1)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - np.sin(1.0)))
    return np.abs(run.final["u"] - exact).max()


def default(x, t=0.0):
    return np.cos(t) + 0 * x


def third(x, strength=1.0, t=0.0):
    return strength * np.cos(t) + 0 * x


def by_name(x, *, time=0.0):
    return np.cos(time) + 0 * np.where(x > 3, x, 1.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("c", [default, third, by_name, [default]])
@pytest.mark.parametrize("steady", [None, False])
def test_a_default_for_t_is_no_steady_velocity(c, steady):
    velocity = Velocity(c, steady=steady)
    assert not velocity.steady
    assert shifted(velocity) < 1e-6


def test_steadiness_of_callables_and_of_parts():
    assert Velocity(default, steady=True).steady
    assert Velocity(lambda x, k=2.0: k * x).steady
    assert Velocity(lambda x: x).steady
    velocity = Velocity([lambda x, y, t=0.0: np.cos(t) + 0 * x, lambda x, y: 0 * y])
    found = velocity.on(Grid([(0, 1)] * 2, (8, 8)))
    assert not velocity.steady
    assert found[0].derivative((0, 0, 0, 0), (1.0,) * 4)(0.1, 0.2, 0.0, 2.0) == np.cos(2.0)


def test_fields_and_walls_with_a_default_for_t():
    """A field is one of the place: what it binds to t stays bound."""
    grid = Grid((0, 1), 8)
    state = State.from_function(lambda x, t=3.0: x + t, grid, t=2.0)
    np.testing.assert_allclose(state["u"], grid.coordinates[0] + 3.0)
    solver = Solver(grid, 1.0, boundary={"x-": lambda x, k=3.0, t=0.0: k * t + 0 * x})
    end = solver.step(solver.state(0.0), 0.5)
    np.testing.assert_allclose(end["u"][0], 1.5)


@pytest.mark.parametrize(
    ("name", "same"), [("conservative", "advection"), ("advective", "transport")]
)
def test_common_names_of_the_equations(name, same):
    grid = Grid((0, 1), 32, periodic=True)
    found = []
    for form in (name, same):
        solver = Solver(grid, lambda x: 1 + 0.5 * np.sin(2 * np.pi * x), form)
        assert solver.form == same
        found.append(solver.step(solver.state(1.0), 0.1).data)
    np.testing.assert_array_equal(found[0], found[1])
    # Only the conservative form changes a constant where the velocity does.
    assert (np.ptp(found[0][0]) > 0.01) == (same == "advection")
