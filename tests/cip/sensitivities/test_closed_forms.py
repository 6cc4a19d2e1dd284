"""Derivatives in closed form, and what is found by them: speeds, starts and sources."""

import numpy as np
import pytest
from derivative_checks import along, equal_substeps, scales, taylor_order

import cip
from cip import Covariance, Grid, Sensors, Solver, Source, Velocity, four_d_var, identify_velocity


def nodal(solver, run, name):
    return along(solver, run, name).reshape(run.final.data.shape)[0]


@pytest.mark.parametrize("form", ["transport", "advection"])
def test_a_shift_and_a_growth(form):
    """c = a + b x: X = (x + a / b) exp(-b t) - a / b, and for advection times exp(-b t)."""
    grid, t, a, b = Grid((-1, 1), 160), 0.4, 0.1, 0.8
    velocity = Velocity.from_expression("a + b*x1", parameters={"a": a, "b": b})
    solver = Solver(grid, velocity, form, "quintic")
    run = solver.run(solver.state("exp(-9*x1**2)"), t, dt=0.02)
    x, decay = grid.coordinates[0], np.exp(-b * t)
    foot = (x + a / b) * decay - a / b
    u, slope = np.exp(-9 * foot**2), -18 * foot * np.exp(-9 * foot**2)
    by_a = slope * (decay - 1) / b
    by_b = slope * (a / b**2 * (1 - decay) - t * (x + a / b) * decay)
    if form == "advection":
        by_a, by_b = decay * by_a, decay * by_b - t * decay * u
    # The quintic's error on 160 nodes is below 1e-7 times the derivatives.
    np.testing.assert_allclose(nodal(solver, run, "a"), by_a, rtol=0, atol=2e-6)
    np.testing.assert_allclose(nodal(solver, run, "b"), by_b, rtol=0, atol=2e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("form", ["transport", "advection"])
@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_a_spiral(profile, form):
    """In complex numbers dz/dt = (a + ib) z: the foot is z exp(-(a + ib) t); det = exp(-2 a t)."""
    grid, t, a, b = Grid([(-1, 1)] * 2, (48, 48)), 0.2, 0.5, 0.3
    texts = "a*x1 - b*x2", "b*x1 + a*x2"
    velocity = Velocity.from_expression(*texts, parameters={"a": a, "b": b})
    solver = Solver(grid, velocity, form, profile)
    run = solver.run(solver.state("exp(-4*((x1-0.2)**2 + x2**2))"), t, dt=0.05)
    x, y = grid.mesh()
    foot = (x + 1j * y) * np.exp(-(a + 1j * b) * t)
    u = np.exp(-4 * ((foot.real - 0.2) ** 2 + foot.imag**2))
    slope = -8 * u * (foot - 0.2)
    exact = [(slope * np.conj(change)).real for change in (-t * foot, -1j * t * foot)]
    if form == "advection":
        exact = [np.exp(-2 * a * t) * part for part in exact]
        exact[0] = exact[0] - 2 * t * np.exp(-2 * a * t) * u
    for name, expected in zip("ab", exact, strict=True):
        # Profiles of order three on cells of 1/24; derivatives of u up to 30.
        bound = 2e-3 * np.abs(expected).max()
        np.testing.assert_allclose(nodal(solver, run, name), expected, rtol=0, atol=bound)


def test_a_wave_that_enters():
    """u = g sin(w (t - x / a)), and its derivatives in the speed, the amplitude and the rate."""
    grid, t, a, g, w = Grid((0, 1), 80), 0.6, 0.8, 1.3, 4.0
    velocity = Velocity.from_expression("a", parameters={"a": a})
    wave = Source.from_expression("g*sin(w*t)", {"g": g, "w": w})
    solver = Solver(grid, velocity, profile="quintic", boundary={"x-": wave})
    run = solver.run(solver.state(f"{g}*sin(-{w}*x1/{a})"), t, dt=0.03)
    # The start does not change with the parameters, so only what entered is compared.
    x = grid.coordinates[0]
    entered, age = x < a * t - 0.1, t - x / a
    assert entered.sum() > 20
    by_speed, by_rate = g * w * x / a**2 * np.cos(w * age), g * age * np.cos(w * age)
    for name, exact in (("a", by_speed), ("g", np.sin(w * age)), ("w", by_rate)):
        found = nodal(solver, run, name)
        np.testing.assert_allclose(found[entered], exact[entered], rtol=0, atol=2e-6)
        assert name == "a" or np.all(found[x > a * t + 0.1] == 0.0)


def test_sources_and_decay_at_rest():
    """u = u0 exp(-k t) and u = u0 + q t s: derivatives -t u and t s of all moments."""
    grid = Grid((0, 1), 20, periodic=True)
    start, shape, t = "2 + sin(2*pi*x1)", "cos(2*pi*x1)", 0.3
    for name, more, exact in (
        ("k", {"decay": Source.from_expression("k", {"k": 0.8})}, f"-0.3*exp(-0.24)*({start})"),
        ("q", {"source": Source.from_expression(f"q*{shape}", {"q": 1.7})}, f"0.3*{shape}"),
    ):
        solver = Solver(grid, 0.0, **more)
        run = solver.run(solver.state(start), t, dt=0.07)
        expected = solver.state(exact).data.ravel()
        found = along(solver, run, name)
        np.testing.assert_allclose(found / scales(run), expected / scales(run), rtol=0, atol=1e-13)


def test_a_velocity_without_parameters_has_the_states_alone():
    ring = Grid((0, 1), 40, periodic=True)
    for velocity in (0.7, lambda x: np.where(x > 2, x, 0.7)):
        solver = Solver(ring, velocity)
        run = solver.run(solver.state("sin(2*pi*x1)"), 0.2, dt=0.03)
        tangent = solver.tangent(run)
        assert tangent.shape == (80, 80)
        change = np.random.default_rng(4).standard_normal(80)
        other = solver.run(cip.State(ring, "cubic", change.reshape(2, 40)), 0.2, dt=0.03)
        np.testing.assert_allclose(tangent @ change, other.final.data.ravel(), rtol=0, atol=1e-11)


LINE, PLANE = Grid((0, 1), 16, periodic=True), Grid([(0, 1), (0, 1)], (9, 8), periodic=True)
EDGES = {
    "cubic": (LINE, ["a"], {"a": 0.0}),
    "quintic": (LINE, ["a"], {"a": 0.0}),
    "csl2": (LINE, ["a"], {"a": 0.0}),
    "csl4": (LINE, ["a"], {"a": 0.0}),
    "whole cells": (LINE, ["a"], {"a": 0.625}),  # one cell a step
    "backward": (LINE, ["a*cos(t)"], {"a": 0.0}),
    "some feet": (LINE, ["a*sin(2*pi*x1)"], {"a": 0.7}),  # those of two nodes at rest
    "walls": (Grid((0, 1), 12), ["a*x1*(1 - x1)"], {"a": 0.0}),
    "adini": (PLANE, ["a", "b"], {"a": 0.0, "b": 0.0}),
    "bicubic": (PLANE, ["a", "b"], {"a": 0.0, "b": 0.0}),
    "shear": (PLANE, ["a*sin(2*pi*x2)", "0"], {"a": 1.0}),  # never moved across: one side there
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", EDGES)
def test_where_feet_lie_on_edges_of_cells_the_mean_of_both_sides(name):
    """Difference quotients of the scheme itself, taken from both sides, are the oracle."""
    grid, texts, values = EDGES[name]
    profile = name if name in ("quintic", "csl2", "csl4", "adini", "bicubic") else "cubic"
    profile = "adini" if name == "shear" else profile
    form = "advection" if profile.startswith("csl") else "transport"
    solver = Solver(grid, Velocity.from_expression(*texts, parameters=values), form, profile)
    field = "exp(sin(2*pi*x1) + 0.3)" if grid.dim == 1 else "exp(sin(2*pi*x1) + cos(2*pi*x2 + 1))"
    run = solver.run(solver.state(field), 0.2, dt=0.1)
    adjoint, size, e = solver.adjoint(run), run[0].data.size, 1e-5
    for q, (parameter, value) in enumerate(values.items()):
        behind, ahead = (
            solver.with_parameters(**{parameter: value + k * e}).run(run[0], 0.2, dt=0.1).final.data
            for k in (-1, 1)
        )
        quotient, found = (ahead - behind) / (2 * e), along(solver, run, parameter)
        scale = np.abs(quotient).max(axis=tuple(range(1, quotient.ndim)), keepdims=True)
        error = (found.reshape(quotient.shape) - quotient) / np.where(scale > 0, scale, 1.0)
        # The quotient's error: e times a jump of second derivatives; one side is 1e-2 off.
        assert np.max(np.abs(error)) < 2e-5
        weight = np.random.default_rng(q).standard_normal(size)
        products = weight * found
        assert abs((adjoint @ weight)[size + q] - products.sum()) <= 1e-13 * np.abs(products).sum()


@pytest.mark.parametrize(("a", "feet"), [(0.0, 32), (0.625, 32), (0.6, 0)])
def test_results_say_how_many_feet_lie_on_edges(a, feet, tmp_path):
    velocity = Velocity.from_expression("a", parameters={"a": a})
    solver = Solver(LINE, velocity)
    start = solver.state("exp(sin(2*pi*x1))")
    run = solver.run(start, 0.2, dt=0.1)
    assert solver.tangent(run).feet_on_edges() == feet
    found = identify_velocity(solver, start, {0.2: run.final["u"]}, dt=0.1, noise=0.01)
    assert found.parameters["a"] == a
    assert found.feet_on_edges == feet
    found.save(tmp_path / "found.json")
    assert cip.IdentifiedVelocity.load(tmp_path / "found.json", velocity).feet_on_edges == feet


def test_remainders_of_all_kinds_of_parameters():
    """Large changes of the place of a source and of the rates, where the tangent is not exact."""
    names = {"q": 1.3, "m": 0.4}, {"k": 0.7, "l": 0.4}, {"g": 0.8, "w": 3.0}
    puff, rate, wave = map(
        Source.from_expression,
        ("q*exp(-40*(x1 - m)**2)*sin(3*t + 0.4)", "k*(1.2 + l*sin(2*pi*x1 + t))", "g*sin(w*t)"),
        names,
    )
    solver = Solver(Grid((0, 1), 21), 0.9, boundary={"x-": wave}, source=puff, decay=rate)
    run = solver.run(solver.state("sin(2*pi*x1) + 0.5"), 0.2, dt=0.083)
    direction = {"q": 0.7, "m": -0.3, "k": 0.5, "l": 0.4, "g": -0.6, "w": 0.9}
    with equal_substeps():
        order = taylor_order(solver, run, direction, 0.02 * 0.5 ** np.arange(5))
    assert abs(order - 2.0) <= 0.05


def test_a_speed_is_identified_from_what_enters():
    """Truth: the wave that enters a field at rest, in closed form."""
    grid, truth = Grid((0, 1), 60), 0.9
    x, seen = grid.coordinates[0], {}
    for t in (0.3, 0.6):
        wave = np.where(x < truth * t, (t - x / truth) ** 6, 0.0)
        seen[t] = np.ma.masked_where(np.abs(x - truth * t) < 0.1, wave)
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
    found = four_d_var(solver, background, covariance, plan.with_values(values), dt=0.05)
    rows, misfits, root = [], [], covariance.root @ np.eye(covariance.root.shape[1])
    operator = plan.rows(grid, "cubic")
    for seen, t in zip(values, plan.times, strict=True):
        run = solver.run(background, t, dt=0.05, snapshots=[u for u in plan.times if u <= t])
        rows.append(operator @ (solver.tangent(run) @ root))
        misfits.append(seen - operator @ run.final.data.ravel())
    A, d = np.concatenate(rows) / 0.1, np.concatenate(misfits) / 0.1
    control = A.T @ np.linalg.solve(A @ A.T + np.eye(9), d)
    expected = background.data + (root @ control).reshape(background.data.shape)
    np.testing.assert_allclose(found.states[0].data, expected, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_where_when_and_how_much_was_emitted():
    """A puff of unknown place, time and strength at known speed; truth: an integral over time."""
    grid, speed, noise = Grid((0, 1), 40, periodic=True), 0.5, 0.01
    truth = {"q": 3.0, "m": 0.42, "s": 0.21}
    guess = {"q": 2.0, "m": 0.5, "s": 0.3}

    def emitted(x, s):  # periodic up to rounding
        away = (x - truth["m"] + 0.5) % 1.0 - 0.5
        return truth["q"] * np.exp(-80 * away**2 - 100 * (s - truth["s"]) ** 2)

    places, times = np.arange(8) / 8, [0.3, 0.5, 0.7]
    abscissae, weights = np.polynomial.legendre.leggauss(60)
    values = []
    for t in times:
        s, part = 0.5 * t * (1 + abscissae), 0.5 * t * weights
        values.append(emitted(places[:, None] - speed * (t - s), s) @ part)
    seen = Sensors(places, times, np.array(values), noise).perturbed(seed=4)
    puff = "q*exp(-80*(sin(pi*(x1 - m))/pi)**2 - 100*(t - s)**2)"
    solver = Solver(grid, speed, source=Source.from_expression(puff, guess))
    known = Covariance.diffusion(grid, "cubic", deviation=1e-3, length=0.3)
    spreads = {"q": 1.0, "m": 0.1, "s": 0.1}
    found = four_d_var(
        solver, solver.state(0.0), known, seen, dt=0.025, parameters=spreads, tol=1e-6
    )
    for name, value in truth.items():
        assert found.parameter_deviations[name] < 0.2 * spreads[name]
        assert abs(found.parameters[name] - value) < 4 * found.parameter_deviations[name]
