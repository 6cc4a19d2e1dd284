"""Tangent-linear and adjoint of runs: transposes, differences, closed forms, Taylor remainders."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize

from cip import Grid, InputError, NotSupported, Solver, State, Velocity
from cip.stages.stage import Stage

PERIODIC = Grid((0, 1), 40, periodic=True)
LINE = np.linspace(0, 1, 37)
UNEVEN = Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), periodic=True)
OPEN = Grid((-1, 1), 40)  # the flow leaves it at both ends
CASES = [
    (PERIODIC, "a + b*sin(2*pi*x1)"),
    (PERIODIC, "a + b*sin(2*pi*x1 + t)"),
    (UNEVEN, "a*exp(b*cos(2*pi*x1))"),
    (OPEN, "a*x1 + b*sin(3*x1)*cos(2*t)"),
]
VALUES = {"a": 0.7, "b": 0.3}
FIELD = "sin(2*pi*x1) + 0.3*cos(4*pi*x1)"
SCHEMES = list(product(("cubic", "quintic"), ("transport", "advection")))
RUNS = [
    pytest.param(*case, *scheme, id="-".join((*scheme, case[1])))
    for case, scheme in product(CASES, SCHEMES)
]


def every_run(test):
    """Each velocity is compiled anew for each scheme: two pairs in the fast lane, by turns."""
    return pytest.mark.sampled(8)(
        pytest.mark.parametrize(("grid", "text", "profile", "form"), RUNS)(test)
    )


def solved(grid, text, profile="cubic", form="transport", start=None, dt=0.03, **values):
    velocity = Velocity.from_expression(text, parameters=VALUES).with_parameters(**values)
    solver = Solver(grid, velocity, form, profile)
    state = solver.state(FIELD) if start is None else State(grid, profile, start)
    return solver, solver.run(state, 0.4, dt=dt, snapshots=[0.2])


def scales(run):
    """The largest entry of each moment, for every entry: they differ by powers of 1 / h."""
    data = run[0].data
    return np.broadcast_to(np.abs(data).max(axis=1, keepdims=True), data.shape).ravel()


@every_run
def test_the_adjoint_is_the_transpose(grid, text, profile, form):
    solver, run = solved(grid, text, profile, form)
    tangent, adjoint = solver.tangent(run), solver.adjoint(run)
    size = run[0].data.size
    assert tangent.shape == (size, size + 2)
    assert adjoint.shape == (size + 2, size)
    rng = np.random.default_rng(1)
    for _ in range(5):
        x = rng.standard_normal(size + 2) * np.append(scales(run), [1, 1])
        y = rng.standard_normal(size) / scales(run)
        forward, backward = tangent @ x, adjoint @ y
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        assert abs(y @ forward - x @ backward) <= 1e-14 * bound
        only = x * (np.arange(size + 2) >= size)  # the parameters alone
        bound = np.abs(y) @ np.abs(tangent @ only) + np.abs(only) @ np.abs(backward)
        assert abs(y @ (tangent @ only) - only @ backward) <= 1e-13 * bound


@every_run
def test_the_state_part_is_the_run_itself(grid, text, profile, form):
    """The scheme is linear in the state, so the run of a perturbation is its tangent."""
    solver, run = solved(grid, text, profile, form)
    size = run[0].data.size
    change = np.random.default_rng(2).standard_normal(size) * scales(run)
    _, other = solved(grid, text, profile, form, start=change.reshape(run[0].data.shape))
    found = (solver.tangent(run) @ np.append(change, [0, 0])).reshape(run[0].data.shape)
    scale = np.abs(other.final.data).max(axis=1, keepdims=True)
    # Rounding of second derivatives from random data, h^-2 times that of the values.
    assert np.max(np.abs(found - other.final.data) / scale) < 1e-12


@every_run
def test_the_parameters_part_against_differences(grid, text, profile, form, monkeypatch):
    # Between two runs the numbers of sub-steps may change, and with them the feet by 1e-8 cells.
    monkeypatch.setattr(Stage, "substeps", lambda self, t, dt: 32)
    # Steps below a cell: if a foot passed a node, where the profile's highest derivative jumps,
    # the difference quotient would mix the derivatives of both sides.
    solver, run = solved(grid, text, profile, form, dt=0.019)
    tangent, size = solver.tangent(run), run[0].data.size
    for q, name in enumerate(VALUES):

        def end(step, name=name):
            return solved(grid, text, profile, form, dt=0.019, **{name: VALUES[name] + step})[
                1
            ].final.data

        e = 2e-4  # of order four: truncation e^4, rounding 1e-15 / e
        quotient = (8 * (end(e) - end(-e)) - (end(2 * e) - end(-2 * e))) / (12 * e)
        found = (tangent @ np.eye(size + 2)[size + q]).reshape(quotient.shape)
        scale = np.abs(quotient).max(axis=1, keepdims=True)
        assert np.max(np.abs(found - quotient) / scale) < 1e-9


def test_the_taylor_remainder_is_of_order_two():
    solver, run = solved(PERIODIC, CASES[1][1], "quintic")
    size = run[0].data.size
    direction = np.append(np.zeros(size), [0.6, -0.8])
    slope = solver.tangent(run) @ direction
    sizes, errors = 0.01 * 0.5 ** np.arange(5), []
    for e in sizes:
        other = solved(PERIODIC, CASES[1][1], "quintic", a=0.7 + 0.6 * e, b=0.3 - 0.8 * e)[1]
        remainder = other.final.data.ravel() - run.final.data.ravel() - e * slope
        errors.append(np.abs(remainder[:40]).max())
    order = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 1.95 <= order <= 2.05


@pytest.mark.parametrize("form", ["transport", "advection"])
def test_the_closed_form_of_a_shift_and_of_a_growth(form):
    """c = a + b x: X = (x + a / b) exp(-b t) - a / b, and for advection times exp(-b t)."""
    grid, t, a, b = Grid((-1, 1), 160), 0.4, 0.1, 0.8
    velocity = Velocity.from_expression("a + b*x1", parameters={"a": a, "b": b})
    solver = Solver(grid, velocity, form, "quintic")
    run = solver.run(solver.state("exp(-9*x1**2)"), t, dt=0.02)
    tangent, size = solver.tangent(run), run[0].data.size
    x, decay = grid.coordinates[0], np.exp(-b * t)
    foot = (x + a / b) * decay - a / b
    u, slope = np.exp(-9 * foot**2), -18 * foot * np.exp(-9 * foot**2)
    by_a = slope * (decay - 1) / b
    by_b = slope * (a / b**2 * (1 - decay) - t * (x + a / b) * decay)
    if form == "advection":
        by_a, by_b = decay * by_a, decay * by_b - t * decay * u
    for q, exact in enumerate((by_a, by_b)):
        found = (tangent @ np.eye(size + 2)[size + q])[: x.size]
        # The quintic's error on 160 nodes is below 1e-7 times the derivatives.
        np.testing.assert_allclose(found, exact, rtol=0, atol=2e-6)


@pytest.mark.parametrize("checkpoints", [1, 3, 100])
def test_checkpoints_change_nothing(checkpoints):
    solver, run = solved(PERIODIC, CASES[1][1])
    weight = np.random.default_rng(3).standard_normal(run[0].data.size)
    expected = solver.adjoint(run) @ weight
    np.testing.assert_array_equal(solver.adjoint(run, checkpoints) @ weight, expected)


def test_the_adjoint_keeps_few_states(monkeypatch):
    """With k checkpoints at most k states and the steps between two of them; all, if they fit."""
    from cip.sensitivities import window
    from cip.sensitivities.window import Window

    kept, original = [], Window._states

    def counted(self, state, first, last):
        found = original(self, state, first, last)
        kept.append(len(found))
        return found

    monkeypatch.setattr(Window, "_states", counted)
    solver, run = solved(PERIODIC, CASES[0][1])  # 14 steps
    solver.adjoint(run) @ run.final.data.ravel()
    assert kept == [1] * 14
    kept.clear()
    monkeypatch.setattr(window, "KEPT", 14 * run.final.data.nbytes - 1)
    solver.adjoint(run) @ run.final.data.ravel()
    assert kept == [2, 4, 4, 4]
    kept.clear()
    solver.adjoint(run, checkpoints=2) @ run.final.data.ravel()
    assert kept == [7, 7]


def test_a_velocity_without_parameters_has_the_states_alone():
    for velocity in (0.7, lambda x: np.where(x > 2, x, 0.7)):
        solver = Solver(PERIODIC, velocity)
        run = solver.run(solver.state(FIELD), 0.2, dt=0.03)
        tangent = solver.tangent(run)
        assert tangent.shape == (80, 80)
        change = np.random.default_rng(4).standard_normal(80)
        other = solver.run(State(PERIODIC, "cubic", change.reshape(2, 40)), 0.2, dt=0.03)
        np.testing.assert_allclose(tangent @ change, other.final.data.ravel(), rtol=0, atol=1e-11)
        for operator in (tangent, tangent.T):
            with pytest.raises(InputError, match="x: expected real values instead of complex128"):
                operator @ (1j * change)


def test_parameters_are_found_from_snapshots():
    """Truth: the closed form for c = a + b x; quasi-Newton steps with gradients of the adjoint."""
    grid, t, truth = Grid((-1, 1), 80), 0.3, (0.1, 0.8)
    velocity = Velocity.from_expression("a + b*x1", parameters={"a": 0.0, "b": 0.5})
    x, (a, b) = grid.coordinates[0], truth
    seen = np.exp(-9 * ((x + a / b) * np.exp(-b * t) - a / b) ** 2)

    def misfit(p):
        solver = Solver(grid, velocity.with_parameters(a=p[0], b=p[1]), profile="quintic")
        run = solver.run(solver.state("exp(-9*x1**2)"), t, dt=0.03)
        weight = np.zeros_like(run.final.data)
        weight[0] = run.final["u"] - seen
        return 0.5 * np.sum(weight**2), (solver.adjoint(run) @ weight.ravel())[-2:]

    # Within these bounds the flow leaves both ends.
    bounds = [(-0.35, 0.35), (0.4, 1.5)]
    options = {"gtol": 1e-9, "ftol": 1e-15}
    start = (0.0, 0.5)
    found = minimize(misfit, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    np.testing.assert_allclose(found.x, truth, rtol=0, atol=1e-6)
    assert found.nfev < 40


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"profile": "piecewise_linear"}, "profile: 'piecewise_linear' is not differentiable"),
        ({"profile": "linear"}, "profile: 'linear' is not differentiable"),
        ({"limiter": "clamp"}, "limiter: 'clamp' is not differentiable"),
        ({"limiter": "rational"}, "limiter: 'rational' is not differentiable"),
        (
            {"profile": "csl2", "form": "advection", "limiter": "bounds", "bounds": (-2, 2)},
            "limiter: 'bounds' is not differentiable",
        ),
    ],
)
def test_schemes_without_derivatives_are_refused(options, message):
    solver = Solver(PERIODIC, 1.0, **options)
    run = solver.run(solver.state(FIELD), 0.2, dt=0.03)
    with pytest.raises(NotSupported, match=message):
        solver.tangent(run)
    with pytest.raises(NotSupported, match=message):
        solver.adjoint(run)


def test_bad_runs_are_refused():
    solver, run = solved(PERIODIC, CASES[0][1])
    with pytest.raises(InputError, match=r"run: expected what solver\.run returned"):
        solver.tangent(run.final)
    with pytest.raises(InputError, match="run: it is not a run of this solver"):
        solved(PERIODIC, CASES[0][1], a=0.8)[0].tangent(run)
    with pytest.raises(InputError, match="state: it carries the moments of 'cubic'"):
        solved(PERIODIC, CASES[0][1], "quintic")[0].adjoint(run)
    for wrong in (0, -1, 1.5, True):
        with pytest.raises(InputError, match="checkpoints: expected a positive number"):
            solver.adjoint(run, checkpoints=wrong)
    single = Solver(PERIODIC, 1.0, dtype=np.float32)
    with pytest.raises(InputError, match="dtype: derivatives need"):
        single.tangent(single.run(single.state(FIELD), 0.1, dt=0.1))
