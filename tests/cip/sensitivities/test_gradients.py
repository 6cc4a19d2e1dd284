"""Gradients by compiled transposes and feet in reverse: random flows, many parameters, threads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cip import Grid, Solver, SplineVelocity, Velocity
from cip.sensitivities import path_adjoint

LINES = {
    "steady": (True, ("a + b*sin(2*pi*x1) + d*cos(4*pi*x1)",)),
    "unsteady": (True, ("a + b*sin(2*pi*x1 + 3*t) + d*exp(sin(2*pi*x1))",)),
    # It leaves the interval (-1, 1) at both ends.
    "leaving": (False, ("x1*(1.5 + a) + b*sin(x1) + d*x1**3*cos(t)",)),
}
PLANES = {
    "steady": (True, ("a + b*sin(2*pi*x2)", "d*cos(2*pi*x1) + 0.3")),
    "unsteady": (True, ("a + b*sin(2*pi*x2 + 3*t)", "d*cos(2*pi*x1)*cos(t) + a*b")),
    "leaving": (False, ("x1*(1.5 + a) + b*sin(x2)*x1", "x2*(1.5 + b*x1) + d*x2*cos(t)")),
}
SCHEMES = [
    (1, "cubic", "advection"),
    (1, "quintic", "transport"),
    (2, "adini", "advection"),
    (2, "bicubic", "transport"),
]
CASES = [
    pytest.param(
        dim, profile, form, flow, id=f"{profile}, {name}",
        marks=[pytest.mark.slow] * (name != "unsteady" and profile in ("quintic", "bicubic")),
    )
    for dim, profile, form in SCHEMES
    for name, flow in (LINES if dim == 1 else PLANES).items()
]  # fmt: skip
FIELDS = {1: "sin(2*pi*x1)", 2: "sin(2*pi*x1)*cos(2*pi*x2)"}
amplitude = st.floats(-0.4, 0.4)


def dot_test(solver, run, rng):
    """The largest difference of the products, relative to the sum of the magnitudes.

    Moments differ by powers of 1 / length, so random ones are scaled with those of the run.
    """
    tangent, adjoint = solver.tangent(run), solver.adjoint(run)
    data, size, worst = run[0].data, run[0].data.size, 0.0
    largest = np.abs(data).max(axis=tuple(range(1, data.ndim)), keepdims=True)
    scale = np.broadcast_to(largest, data.shape).ravel()
    scales = np.append(scale, np.ones(tangent.shape[1] - size))
    for only in (slice(0, None), slice(size, None)):
        x, y = np.zeros(tangent.shape[1]), rng.standard_normal(size) / scale
        x[only] = (rng.standard_normal(scales.size) * scales)[only]
        forward, backward = tangent @ x, adjoint @ y
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        worst = max(worst, abs(y @ forward - x @ backward) / bound)
    return worst


@pytest.mark.parametrize(("dim", "profile", "form", "flow"), CASES)
@settings(max_examples=8)
@given(a=amplitude, b=amplitude, d=amplitude, dt=st.floats(0.01, 0.09), seed=st.integers(0, 99))
def test_the_adjoint_is_the_transpose(dim, profile, form, flow, a, b, d, dt, seed):
    periodic, texts = flow
    n, ends = (31, 26)[:dim], (0, 1) if periodic else (-1, 1)
    values = {"a": a, "b": b, "d": d}
    velocity = Velocity.from_expression(*texts, parameters=values)
    solver = Solver(Grid([ends] * dim, n, periodic=periodic), velocity, form, profile)
    rng = np.random.default_rng(seed)
    run = solver.run(solver.state(FIELDS[dim]), 0.2, dt=dt)
    assert dot_test(solver, run, rng) <= 1e-13


@pytest.mark.parametrize("stream", [False, True])
def test_many_coefficients_of_splines(stream):
    grid = Grid([(0, 1)] * 2, (14, 13), periodic=True)
    start = (lambda x, y: np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y) / 6) if stream else 0.5
    velocity = SplineVelocity(grid, (7, 6), start=start, stream=stream)
    solver = Solver(grid, velocity, profile="adini")
    run = solver.run(solver.state(FIELDS[2]), 0.1, dt=0.04)
    assert len(velocity.names) == (42 if stream else 84)
    assert dot_test(solver, run, np.random.default_rng(7)) <= 1e-13


@pytest.mark.parametrize("form", ["transport", "advection"])
def test_compiled_code_and_numpy_agree(form):
    """The same stages, sub-steps and formulas, in two ways."""
    velocity = Velocity.from_expression(
        "a + b*sin(2*pi*x2 + t)*exp(a*x1)",
        "b*cos(2*pi*x1)/(2 + a)",
        parameters={"a": 0.4, "b": 0.2},
    )
    grid = Grid([(-1, 1), (0, 1)], (9, 8), periodic=(False, True))
    solver = Solver(grid, velocity, form, "bicubic", boundary=0.0)
    (stage,) = solver._stages
    feet = solver.feet(stage, 0.3, 0.05)
    g = np.random.default_rng(8).standard_normal((len(stage.jets), grid.size))
    points = [x.ravel() for x in stage.points(0)]
    found = path_adjoint._by_numba(stage, feet, points, g)
    np.testing.assert_allclose(found, path_adjoint._by_numpy(stage, feet, points, g), rtol=1e-12)
    assert np.abs(found).min() > 0


@pytest.mark.parametrize(("shape", "profile"), [((100_000,), "cubic"), ((300, 300), "adini")])
def test_threads_give_the_same_bits(shape, profile, monkeypatch):
    texts = ("a + b*sin(2*pi*x1 + t)", "b*cos(2*pi*x1)")[: len(shape)]
    velocity = Velocity.from_expression(*texts, parameters={"a": 0.4, "b": 0.2})
    grid = Grid([(0, 1)] * len(shape), shape, periodic=True)
    solver = Solver(grid, velocity, profile=profile)
    dt = 1.3 / max(shape)
    run = solver.run(solver.state("sin(2*pi*x1)"), 2 * dt, dt=dt)
    weight = np.random.default_rng(9).standard_normal(run.final.data.size)
    found = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        found.append(solver.adjoint(run) @ weight)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
