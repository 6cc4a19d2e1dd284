"""Tangent-linear and adjoint of steps split into sweeps, in planes and in space."""

import numpy as np
import pytest
from derivative_checks import dot_test, few_examples, parameter_error, scales, taylor_order
from hypothesis import given
from hypothesis import strategies as st

from cip import Grid, Solver, State, Velocity

LINE = np.linspace(0, 1, 9)
PLANE = Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), LINE**1.1, periodic=True)
OPEN = Grid([(0, 1), (0, 1)], (8, 7), periodic=(False, True))
SPACE = Grid([(0, 1)] * 3, (6, 5, 7), periodic=(True, True, False))
FLOWS = {
    "plane": (PLANE, ("a + b*sin(2*pi*x2 + t)", "b*cos(2*pi*x1) + 0.7*a")),
    "walls": (OPEN, ("a + b*sin(2*pi*x2 + t)*x1", "b*cos(3*x1) - a")),
    "space": (
        SPACE,
        ("a + b*sin(2*pi*x2)", "b*cos(2*pi*x1 + 0.3) + a*x3", "a + 0.5*b*sin(2*pi*x1)"),
    ),
}
CASES = [
    ("plane", "cubic", "transport"),
    ("space", "cubic", "transport"),
    ("walls", "cubic", "transport"),
    ("plane", "quintic", "advection"),
    ("walls", "cubic", "advection"),
    ("space", "cubic", "advection"),
    ("space", "quintic", "transport"),
    ("plane", "csl2", "advection"),
    ("plane", "csl4", "advection"),
    ("walls", "csl2", "advection"),
    ("walls", "csl4", "advection"),
    ("space", "csl2", "advection"),
    ("space", "csl4", "advection"),
]


def every_case(test):
    """Each case is compiled anew: one in the fast lane, another one each turn."""
    return pytest.mark.sampled(13)(
        pytest.mark.parametrize(("flow", "profile", "form"), CASES)(test)
    )


def solved(flow, profile, form, start=None, a=0.6, b=0.3, dt=0.083):
    grid, texts = FLOWS[flow]
    velocity = Velocity.from_expression(*texts, parameters={"a": a, "b": b})
    value = 0.0 if form == "advection" else 0.8
    boundary = None if all(grid.periodic) else value
    solver = Solver(grid, velocity, form, profile, splitting="strang", boundary=boundary)
    state = solver.state("sin(2*pi*x1)*cos(2*pi*x2) + 0.5")
    state = state if start is None else State(grid, profile, start)
    return solver, solver.run(state, 0.2, dt=dt)


@every_case
@few_examples
@given(
    a=st.floats(0.3, 0.9), b=st.floats(-0.4, 0.4), dt=st.floats(0.04, 0.21),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose(flow, profile, form, a, b, dt, seed):
    solver, run = solved(flow, profile, form, a=a, b=b, dt=dt)
    assert dot_test(solver, run, np.random.default_rng(seed)) <= 1e-13


@every_case
def test_the_parameters_part_against_differences(flow, profile, form, equal_substeps):
    assert parameter_error(*solved(flow, profile, form)) < 1e-8


@every_case
def test_the_taylor_remainder_is_of_order_two(flow, profile, form, equal_substeps):
    solver, run = solved(flow, profile, form)
    sizes = 5e-4 * 0.5 ** np.arange(5)
    assert abs(taylor_order(solver, run, {"a": 0.6, "b": -0.8}, sizes) - 2.0) <= 0.05


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", [("plane", "cubic", "transport"), ("plane", "csl4", "advection")])
def test_the_state_part_is_the_run_itself(case):
    run = solved(*case)[1]
    change = np.random.default_rng(6).standard_normal(run[0].data.shape)
    solver, other = solved(*case, change)
    found = solver.tangent(other) @ np.append(change, [0, 0])
    assert np.max(np.abs(found - other.final.data.ravel()) / scales(other)) < 1e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_the_integral_does_not_change_with_the_flow(profile):
    solver, run = solved("plane", profile, "advection")
    size, volume = run[0].data.size, np.multiply.outer(*PLANE.widths)
    for direction in np.eye(2):
        new = solver.tangent(run) @ np.append(np.zeros(size), direction)
        moved = new.reshape(run[0].data.shape)[-1] * volume
        assert np.abs(moved).max() > 1e-3
        assert abs(moved.sum()) < 1e-14
