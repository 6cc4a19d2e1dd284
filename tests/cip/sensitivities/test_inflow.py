"""Tangent-linear and adjoint where characteristics enter through walls."""

import numpy as np
import pytest
from derivative_checks import dot_test, few_examples, parameter_error, scales, taylor_order
from hypothesis import given
from hypothesis import strategies as st

from cip import Covariance, Grid, Sensors, Solver, Velocity, four_d_var, identify_velocity
from cip.sensitivities import wall_derivatives


def opaque(x, t):
    """Data that cannot be traced."""
    return np.where(x > 9, x, np.sin(3 * t + 0.4))


LINES = {
    "steady": ("a + b*sin(2*pi*x1)", {"x-": "sin(3*t) + 0.4"}),
    "unsteady": ("a + b*sin(2*pi*x1 + 3*t)*exp(b*x1)", {"x-": 0.7}),
    "both ends": ("a*sin(5*(x1 - 0.53)) + b*cos(t)", opaque),
    "values": ("-a - b*x1*(1 - x1)", {"x+": opaque}),
}
PLANES = {
    "steady": (("a + b*x2", "1.6*a*b - 0.5*b*x1"), "sin(3*t + x1)*cos(x2)"),
    "unsteady": (("a + b*sin(x2 + 3*t)", "b*cos(2*x1) - a"), "sin(3*t + x1)*cos(x2)"),
}
FIELD = "sin(2*pi*x1) + 0.5"


def solved(grid, texts, profile, form, boundary, dt, a=0.9, b=0.3, t_end=0.2):
    texts = (texts,) if isinstance(texts, str) else texts
    velocity = Velocity.from_expression(*texts, parameters={"a": a, "b": b})
    solver = Solver(grid, velocity, form, profile, boundary=boundary)
    return solver, solver.run(solver.state(FIELD), t_end, dt=dt)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("case", LINES)
@pytest.mark.parametrize(("profile", "form"), [("cubic", "advection"), ("quintic", "transport")])
@few_examples
@given(
    a=st.floats(0.5, 1.5), b=st.floats(-0.4, 0.4), dt=st.floats(0.01, 0.09),
    n=st.integers(9, 40), seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose_on_lines(profile, form, case, a, b, dt, n, seed):
    grid = Grid((0, 1), n)
    solver, run = solved(grid, LINES[case][0], profile, form, LINES[case][1], dt, a, b)
    assert dot_test(solver, run, np.random.default_rng(seed)) <= 1e-13


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("profile", "form", "case"),
    [
        ("adini", "advection", "steady"),
        ("adini", "transport", "unsteady"),
        ("bicubic", "transport", "steady"),
        ("bicubic", "advection", "unsteady"),
    ],
)
@few_examples
@given(
    a=st.floats(0.5, 1.5), b=st.floats(-0.4, 0.4), dt=st.floats(0.04, 0.21),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose_in_planes(profile, form, case, a, b, dt, seed):
    texts, boundary = PLANES[case]
    grid = Grid([(0, 1), (0, 1)], (11, 13))
    solver, run = solved(grid, texts, profile, form, boundary, dt, a, b)
    assert dot_test(solver, run, np.random.default_rng(seed)) <= 1e-13


CASES = [
    (1, "cubic", "advection", *LINES["steady"]),
    (1, "quintic", "transport", *LINES["both ends"]),
    (2, "adini", "advection", *PLANES["steady"]),
    (1, "cubic", "transport", *LINES["unsteady"]),
    (1, "quintic", "advection", *LINES["steady"]),
    (2, "adini", "transport", *PLANES["unsteady"]),
    (2, "bicubic", "advection", *PLANES["steady"]),
]


@pytest.mark.sampled(7)
@pytest.mark.parametrize(("dim", "profile", "form", "texts", "boundary"), CASES)
def test_the_parameters_part_against_differences(
    dim, profile, form, texts, boundary, equal_substeps
):
    grid = Grid([(0, 1)] * dim, (15, 12)[:dim])
    # No foot passes an edge and no path another wall.
    assert parameter_error(*solved(grid, texts, profile, form, boundary, 0.083)) < 2e-9


@pytest.mark.parametrize("profile", ["cubic", "quintic"])
def test_the_state_part_does_not_see_the_data(profile):
    """The run of a changed state minus the run: data on walls cancel."""
    solver, run = solved(Grid((0, 1), 20), LINES["steady"][0], profile, "advection", 3.0, 0.05)
    change = np.random.default_rng(2).standard_normal(run[0].data.size) * scales(run)
    other = solver.state(FIELD)
    other.data[:] += change.reshape(other.data.shape)
    difference = solver.run(other, 0.2, dt=0.05).final.data - run.final.data
    found = solver.tangent(run) @ np.append(change, [0, 0])
    error = np.abs(found - difference.ravel()) / scales(run)
    assert error.max() < 1e-12


@pytest.mark.turns(3)
def test_formulas_of_walls_are_derived_once_for_all_steps(monkeypatch):
    derived, along = [], wall_derivatives._along
    monkeypatch.setattr(wall_derivatives, "_along", lambda *of: derived.append(of) or along(*of))
    counts = []
    for dt in (0.1, 0.02):
        derived.clear()
        solver, run = solved(
            Grid((0, 1), 12), *LINES["unsteady"][:1], "cubic", "advection", 0.7, dt
        )
        gradient = solver.adjoint(run) @ np.ones(run.final.data.size)
        assert np.any(gradient[-2:])
        counts.append(len(derived))
    assert counts[0] == counts[1] > 0


def test_the_closed_form_of_a_wave_that_enters():
    """u = f(t - x / a) at constant speed a: its derivative in a is x / a^2 f'(t - x / a)."""
    grid, t, a = Grid((0, 1), 80), 0.6, 0.8
    velocity = Velocity.from_expression("a", parameters={"a": a})
    solver = Solver(grid, velocity, profile="quintic", boundary={"x-": "sin(4*t)"})
    run = solver.run(solver.state(f"sin(-4*x1/{a})"), t, dt=0.03)
    # The start does not change with the speed, so only what entered is compared.
    x = grid.coordinates[0]
    found = (solver.tangent(run) @ np.eye(3 * x.size + 1)[-1])[: x.size]
    entered = x < a * t - 0.1
    exact = 4 * x / a**2 * np.cos(4 * (t - x / a))
    assert entered.sum() > 20
    np.testing.assert_allclose(found[entered], exact[entered], rtol=0, atol=2e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["cubic", "quintic"])
def test_the_taylor_remainder_is_of_order_two(profile, equal_substeps):
    grid = Grid((0, 1), 40)
    arguments = (grid, LINES["steady"][0], profile, "transport", {"x-": "sin(3*t) + 0.4"}, 0.05)
    solver, run = solved(*arguments)
    sizes = 2e-3 * 0.5 ** np.arange(5)
    assert abs(taylor_order(solver, run, {"a": 0.6, "b": -0.8}, sizes) - 2.0) <= 0.05


def test_a_speed_is_identified_from_what_enters():
    """Truth: the wave that enters a field at rest, in closed form."""
    grid, truth, times = Grid((0, 1), 60), 0.9, [0.3, 0.6]
    x = grid.coordinates[0]
    seen = {
        t: np.ma.masked_where(
            np.abs(x - truth * t) < 0.1, np.where(x < truth * t, (t - x / truth) ** 6, 0.0)
        )
        for t in times
    }
    velocity = Velocity.from_expression("a", parameters={"a": 0.7})
    solver = Solver(grid, velocity, profile="quintic", boundary={"x-": "t**6"})
    found = identify_velocity(solver, solver.state(0.0), seen, dt=0.03, noise=0)
    assert abs(found.parameters["a"] - truth) < 1e-5


def test_analyses_with_inflow_are_best_linear_unbiased_estimates():
    """Against the dense formula; the data on the wall move the reports but not the operator."""
    grid = Grid((0, 1), 20)
    solver = Solver(grid, Velocity.from_expression("0.8 + 0.3*x1"), boundary={"x-": "1 + sin(4*t)"})
    background = solver.state("1 + x1**2")
    covariance = Covariance.diffusion(grid, "cubic", deviation=0.5, length=0.2)
    plan = Sensors([0.3, 0.55, 0.9], [0.1, 0.25, 0.3], deviations=0.1)
    values = np.random.default_rng(3).standard_normal((3, 3))
    sensors = plan.with_values(values)
    found = four_d_var(solver, background, covariance, sensors, dt=0.05)
    rows, misfits, root = [], [], covariance.root @ np.eye(covariance.root.shape[1])
    operator = sensors.rows(grid, "cubic")
    for seen, t in zip(values, plan.times, strict=True):
        run = solver.run(background, t, dt=0.05, snapshots=[u for u in plan.times if u <= t])
        rows.append(operator @ (solver.tangent(run) @ root))
        misfits.append(seen - operator @ run.final.data.ravel())
    A, d = np.concatenate(rows) / 0.1, np.concatenate(misfits) / 0.1
    control = A.T @ np.linalg.solve(A @ A.T + np.eye(9), d)
    expected = background.data + (root @ control).reshape(background.data.shape)
    np.testing.assert_allclose(found.states[0].data, expected, rtol=0, atol=1e-8)
