"""Tangent-linear and adjoint of conservative profiles on lines: transposes, differences, mass."""

import numpy as np
import pytest
from derivative_checks import dot_test, few_examples, parameter_error, taylor_order
from hypothesis import given
from hypothesis import strategies as st

from cip import Grid, Solver, State, Velocity

LINE = np.linspace(0, 1, 24)
GRIDS = {
    "periodic": Grid((0, 1), 25, periodic=True),
    "uneven": Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), periodic=True),
    "walls": Grid((0, 1), 21),
}
TEXTS = ("a + b*sin(2*pi*x1)", "0.8*a*sin(2*pi*(x1 - 0.53)) + b*cos(3*t)")
every_profile = pytest.mark.parametrize("profile", ["csl2", "csl4"])


def every_scheme(test):
    """Each is compiled anew: one in the fast lane, another one each turn."""
    return pytest.mark.sampled(6)(pytest.mark.parametrize("grid", GRIDS)(every_profile(test)))


def solved(grid, text, profile, dt, a=0.9, b=0.3, start=None):
    velocity = Velocity.from_expression(text, parameters={"a": a, "b": b})
    grid = GRIDS[grid]
    boundary = None if grid.periodic[0] else "0.4 + sin(3*t)"
    solver = Solver(grid, velocity, "advection", profile, boundary=boundary)
    first = solver.state("sin(2*pi*x1) + 0.5") if start is None else State(grid, profile, start)
    return solver, solver.run(first, 0.2, dt=dt)


@every_scheme
@few_examples
@given(
    text=st.sampled_from(TEXTS), a=st.floats(0.5, 1.5), b=st.floats(-0.4, 0.4),
    dt=st.floats(0.01, 0.21), seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose(grid, profile, text, a, b, dt, seed):
    solver, run = solved(grid, text, profile, dt, a, b)
    assert dot_test(solver, run, np.random.default_rng(seed)) <= 1e-13


@every_scheme
def test_the_parameters_part_against_differences(grid, profile, equal_substeps):
    # Rounding is 1e-15 / e, and more for slopes.
    assert parameter_error(*solved(grid, TEXTS[0], profile, 0.083)) < 1e-8


@every_scheme
def test_the_taylor_remainder_is_of_order_two(grid, profile, equal_substeps):
    solver, run = solved(grid, TEXTS[0], profile, 0.083)
    sizes = 5e-4 * 0.5 ** np.arange(5)
    assert abs(taylor_order(solver, run, {"a": 0.6, "b": -0.8}, sizes) - 2.0) <= 0.05


@pytest.mark.sampled(2)
@every_profile
def test_the_state_part_is_the_run_and_the_integral_is_kept(profile):
    solver, run = solved("periodic", TEXTS[0], profile, 0.07)
    shape = run[0].data.shape
    change = np.random.default_rng(2).standard_normal(shape)
    other = solved("periodic", TEXTS[0], profile, 0.07, start=change)[1]
    tangent = solver.tangent(run)
    found = (tangent @ np.append(change, [0, 0])).reshape(shape)
    np.testing.assert_allclose(found, other.final.data, rtol=0, atol=1e-11)
    for direction in np.eye(2):  # no parameter of the velocity changes the integral
        moved = (tangent @ np.append(np.zeros(change.size), direction)).reshape(shape)
        assert np.abs(moved[-1]).max() > 0.1
        assert abs(moved[-1].sum()) < 1e-12
