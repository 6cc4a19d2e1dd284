"""Derivatives of runs with sources, decay, and data on walls, in the parameters of all of these."""

import numpy as np
import pytest
from derivative_checks import dot_test, few_examples, parameter_error, scales, taylor_order
from hypothesis import given
from hypothesis import strategies as st

from cip import Covariance, Grid, InputError, Sensors, Solver, Source, Velocity, four_d_var

SOURCE = "q*exp(-40*(x1 - m)**2)*sin(3*t + 0.4)"
STEADY = "q*exp(-40*(x1 - m)**2)"
# `a` is a parameter of the velocity too.
DECAY = "k*(1.2 + l*sin(2*pi*x1 + t)) + 0.3*a"
WALL = "g*sin(w*t + 0.2) + 0.1*a"
VALUES = {"a": 0.9, "b": 0.3, "q": 1.3, "m": 0.4, "k": 0.7, "l": 0.4, "g": 0.8, "w": 3.0}


def solver_of(profile, periodic, dim=1, source=SOURCE, split=None, **changed):
    values = {**VALUES, **changed}
    grid = Grid([(0, 1)] * dim, (21, 9, 6)[:dim], periodic=periodic)
    texts = ("a + b*sin(2*pi*x1)", "b*cos(2*pi*x1)", "0.2")[:dim]
    velocity = Velocity.from_expression(*texts, parameters={"a": values["a"], "b": values["b"]})
    form = "advection" if profile.startswith("csl") else "transport"
    boundary = None
    if not periodic:
        wall = Source.from_expression(WALL, {name: values[name] for name in ("g", "w", "a")})
        boundary = dict.fromkeys(("x-", *(("y-", "y+") if dim > 1 else ())), wall)
    return Solver(
        grid, velocity, form, profile, boundary=boundary, splitting=split,
        source=Source.from_expression(source, {name: values[name] for name in ("q", "m")}),
        decay=Source.from_expression(DECAY, {name: values[name] for name in ("k", "l", "a")}),
    )  # fmt: skip


def solved(*arguments, dt=0.083, **changed):
    solver = solver_of(*arguments, **changed)
    # In no direction constant, or a moment would be zero, and so the scale of its changes.
    field = "sin(2*pi*x1)" + "".join(f"*cos(2*pi*x{d})" for d in range(2, solver.grid.dim + 1))
    return solver, solver.run(solver.state(f"{field} + 0.5"), 0.2, dt=dt)


@pytest.mark.sampled(16)
@pytest.mark.parametrize("source", [SOURCE, STEADY], ids=["unsteady", "steady"])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
@few_examples
@given(
    a=st.floats(0.5, 1.5), b=st.floats(-0.4, 0.4), k=st.floats(0.0, 2.0), m=st.floats(0, 1),
    w=st.floats(-5, 5), dt=st.floats(0.03, 0.21), seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose_on_lines(profile, periodic, source, dt, seed, **values):
    if periodic:
        del values["w"]
    solver, run = solved(profile, periodic, 1, source, dt=dt, **values)
    assert list(solver.parameters) == ["a", "b", "q", "m", "k", "l", *([] if periodic else "gw")]
    assert dot_test(solver, run, np.random.default_rng(seed)) <= 1e-13


@pytest.mark.sampled(8)
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
def test_all_parameters_against_differences_on_lines(profile, periodic, equal_substeps):
    solver, run = solved(profile, periodic)
    # Rounding of slopes and curvatures, 1e-15 / e times h^-1 or h^-2.
    assert parameter_error(solver, run) < 5e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("profile", "periodic", "dim"),
    [
        *(("adini", False, 2), ("bicubic", False, 2), ("bicubic", True, 2), ("cubic", True, 3)),
        *(("csl2", True, 3), ("csl4", True, 2)),
    ],
)
def test_planes_and_space(profile, periodic, dim, equal_substeps):
    split = None if profile in ("adini", "bicubic") else "strang"
    solver, run = solved(profile, periodic, dim, SOURCE, split)
    assert dot_test(solver, run, np.random.default_rng(1)) <= 1e-13
    assert parameter_error(solver, run) < 5e-9


def test_the_taylor_remainder_is_of_order_two(equal_substeps):
    solver, run = solved("cubic", False)
    direction = {"q": 0.7, "m": -0.3, "k": 0.5, "l": 0.4, "g": -0.6, "w": 0.9}
    order = taylor_order(solver, run, direction, 0.02 * 0.5 ** np.arange(5))
    assert abs(order - 2.0) <= 0.05


def test_closed_forms_at_rest():
    """u = u0 exp(-k t) and u = u0 + q t s: derivatives -t u and t s of all moments."""
    grid = Grid((0, 1), 20, periodic=True)
    start, shape, t = "2 + sin(2*pi*x1)", "cos(2*pi*x1)", 0.3
    for more, exact in (
        ({"decay": Source.from_expression("k", {"k": 0.8})}, f"-0.3*exp(-0.24)*({start})"),
        ({"source": Source.from_expression(f"q*{shape}", {"q": 1.7})}, f"0.3*{shape}"),
    ):
        solver = Solver(grid, 0.0, **more)
        run = solver.run(solver.state(start), t, dt=0.07)
        found = solver.tangent(run) @ np.append(np.zeros(40), 1.0)
        expected = solver.state(exact).data.ravel()
        np.testing.assert_allclose(found / scales(run), expected / scales(run), rtol=0, atol=1e-13)


def test_the_closed_form_of_what_enters():
    """u = g sin(w (t - x / c)) has the derivatives sin(..) in g and g (t - x / c) cos(..) in w."""
    grid, t, c, g, w = Grid((0, 1), 80), 0.6, 0.8, 1.3, 4.0
    wave = Source.from_expression("g*sin(w*t)", {"g": g, "w": w})
    solver = Solver(grid, c, profile="cubic", boundary={"x-": wave})
    run = solver.run(solver.state(0.0), t, dt=0.03)
    x, tangent = grid.coordinates[0], solver.tangent(run)
    entered, age = x < c * t - 0.1, t - x / c
    exact = [np.sin(w * age), g * age * np.cos(w * age)]
    assert entered.sum() > 20
    for q, expected in enumerate(exact):
        found = (tangent @ np.eye(2 * x.size + 2)[2 * x.size + q])[: x.size]
        np.testing.assert_allclose(found[entered], expected[entered], rtol=0, atol=1e-4)
        assert np.all(found[x > c * t + 0.1] == 0.0)


def test_checkpoints_change_nothing():
    solver, run = solved("cubic", False)
    weight = np.random.default_rng(3).standard_normal(run[0].data.size)
    expected = solver.adjoint(run) @ weight
    for checkpoints in (1, 2):
        np.testing.assert_array_equal(solver.adjoint(run, checkpoints) @ weight, expected)


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


def test_parameters_of_a_solver():
    solver = solver_of("cubic", False)
    assert solver.parameters == {name: VALUES[name] for name in solver.parameters}
    moved = solver.with_parameters(a=1.1, w=2.0)
    assert moved.parameters == {**VALUES, "a": 1.1, "w": 2.0}
    assert moved.velocity.parameters["a"] == moved.decay.parameters["a"] == 1.1
    assert solver.parameters["a"] == 0.9
    with pytest.raises(InputError, match="z: no parameter of this solver; known: a, b, q"):
        solver.with_parameters(z=1.0)
    with pytest.raises(InputError, match=r"source: its parameter 'a' is 2, that of velocity 0\.9"):
        Solver(
            solver.grid, solver.velocity, source=Source.from_expression("a", {"a": 2.0})
        )  # fmt: skip
    with pytest.raises(InputError, match="boundary 'x-': expected a number, a formula or a call"):
        Solver(solver.grid, solver.velocity, boundary={"x-": Source(np.ones(22))})
