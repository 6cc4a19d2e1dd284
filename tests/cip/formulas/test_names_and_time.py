"""What callables say of time, and the names of the two equations."""

import numpy as np
import pytest

from cip import Grid, InputError, Solver, State, Velocity


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


def test_said_to_be_steady():
    assert Velocity(default, steady=True).steady
    assert Velocity(lambda x, k=2.0: k * x).steady
    assert Velocity(lambda x: x).steady


def test_parts_with_and_without_time():
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


@pytest.mark.parametrize("form", ["diffusion", None, ["transport"], 3])
def test_no_form(form):
    with pytest.raises(InputError, match="conservative"):
        Solver(Grid((0, 1), 8), 1.0, form)
