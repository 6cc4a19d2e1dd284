"""Gradients by compiled transposes and feet in reverse: random flows, many parameters, threads."""

import numpy as np
import pytest
from derivative_checks import dot_test, few_examples, run_again, scales
from hypothesis import given
from hypothesis import strategies as st

from cip import Grid, Solver, SplineVelocity, Velocity
from cip.sensitivities import path_adjoint, path_tangent
from cip.sensitivities.blocks import blocks_of

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
    pytest.param(dim, profile, form, flow, id=f"{profile}, {name}")
    for dim, profile, form in SCHEMES
    for name, flow in (LINES if dim == 1 else PLANES).items()
]
FIELDS = {1: "sin(2*pi*x1)", 2: "sin(2*pi*x1)*cos(2*pi*x2)"}
amplitude = st.floats(-0.4, 0.4)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("dim", "profile", "form", "flow"), CASES)
@few_examples
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


@pytest.mark.parametrize("speed", [1e-16, 1e-9, 1e-5, -1e-5, 1e-3])
def test_the_adjoint_of_a_flow_that_almost_rests(speed):
    """Feet next to a node, on either side: second derivatives of a quintic lost digits on one."""
    velocity = Velocity.from_expression("a + b*sin(2*pi*x1)", parameters={"a": speed, "b": 0.0})
    solver = Solver(Grid([(0, 1)], (31,), periodic=True), velocity, "transport", "quintic")
    run = solver.run(solver.state(FIELDS[1]), 0.2, dt=0.01)
    assert dot_test(solver, run, np.random.default_rng(8)) <= 1e-14


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("stream", "profile"), [(False, "adini"), (True, "adini"), (True, "csl4")])
def test_many_coefficients_of_splines(stream, profile):
    grid = Grid([(0, 1)] * 2, (14, 13), periodic=True)
    start = (lambda x, y: np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y) / 6) if stream else 0.5
    velocity = SplineVelocity(grid, (7, 6), start=start, stream=stream)
    split = {"splitting": "strang", "form": "advection"} if profile == "csl4" else {}
    solver = Solver(grid, velocity, profile=profile, **split)
    run = solver.run(solver.state(FIELDS[2]), 0.1, dt=0.04)
    assert len(velocity.names) == (42 if stream else 84)
    assert dot_test(solver, run, np.random.default_rng(7)) <= 1e-13


def test_sums_of_splines_at_lines_that_broadcast_and_one_by_one():
    grid = Grid([(0, 1), (0, 2)], (9, 8), periodic=(True, False))
    formula = SplineVelocity(grid, (7, 2), start=lambda x, y: np.sin(6 * x) * y**2).on(grid)[0]
    basis, orders = formula.basis, (1, 2, 0, 0)
    weights = np.array(list(formula.numbers.values()))[: basis.size]
    x, y, zero = np.linspace(0.1, 0.9, 5)[:, None], np.linspace(0.2, 1.8, 4), np.zeros(())
    found = basis.sum(weights.reshape(basis.counts), orders)(x, y, zero, 0.0)
    parts = [basis.function(k, orders)(x, y, zero, 0.0) for k in range(basis.size)]
    expected = np.tensordot(weights, np.array(parts), 1)
    assert found.shape == (5, 4)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("periodic", [True, False])
def test_nodal_values_of_a_velocity(periodic):
    """As many splines as nodes, or nearly, of both components; with inflow through walls."""
    grid = Grid([(0, 1)] * 2, (16, 15), periodic=periodic)
    x, y = grid.mesh()
    start = [0.5 + 0.2 * np.sin(2 * np.pi * x + y), 0.3 + 0.2 * np.cos(2 * np.pi * y) * x]
    velocity = SplineVelocity(grid, (16, 15) if periodic else (12, 11), start=start)
    assert len(velocity.names) == 2 * (240 if periodic else 17 * 16)
    boundary = None if periodic else "1 + sin(3*t)*cos(x2 - x1)"
    solver = Solver(grid, velocity, profile="bicubic", boundary=boundary)
    run = solver.run(solver.state(FIELDS[2]), 0.1, dt=0.04)
    rng, size, e = np.random.default_rng(5), run.final.data.size, 1e-5
    assert dot_test(solver, run, rng) <= 1e-13
    direction = rng.standard_normal(len(velocity.names))
    found = solver.tangent(run) @ np.concatenate([np.zeros(size), direction])
    values = np.array(list(velocity.parameters.values()))
    ends = []
    for side in (1, -1):
        new = dict(zip(velocity.names, values + side * e * direction, strict=True))
        ends.append(run_again(solver, run, **new))
    quotient, scale = (ends[0] - ends[1]) / (2 * e), scales(run)
    assert np.abs(quotient / scale).max() > 0.01
    np.testing.assert_allclose(found / scale, quotient / scale, rtol=0, atol=2e-6)


@pytest.mark.sampled(2)
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
    arguments = stage, feet, feet.substeps[0], points, g
    found = path_adjoint._by_numba(*arguments)
    np.testing.assert_allclose(found, path_adjoint._by_numpy(*arguments), rtol=1e-12)
    assert np.abs(found).min() > 0


@pytest.mark.parametrize(("shape", "profile"), [((60,), "quintic"), ((9, 8), "bicubic")])
def test_changes_of_feet_compiled_and_by_numpy_agree(shape, profile, monkeypatch):
    """Feet and, of the plane, the logarithm of their determinant; along two parameters at once."""
    phase = "2*pi*x1" + " + 2*pi*x2" * (len(shape) - 1)
    texts = (f"a + b*sin({phase} + t)*exp(a*x1)", f"b*cos({phase})/(2 + a)")[: len(shape)]
    velocity = Velocity.from_expression(*texts, parameters={"a": 0.4, "b": 0.2})
    grid = Grid([(-1, 1), (0, 1)][: len(shape)], shape, periodic=(False, True)[: len(shape)])
    solver = Solver(grid, velocity, "advection", profile, boundary=0.0)
    (stage,) = solver._stages
    feet, found = solver.feet(stage, 0.3, 0.05), []
    for least in (0, 10**9):
        monkeypatch.setattr(path_tangent, "_COMPILE_FROM", least)
        tangent = path_tangent.PathTangent(stage)
        found.append(tangent.along(blocks_of(stage), feet, np.array([0.7, -1.3])))
    assert feet.bounded
    assert not found[0][:, ~feet.interior(grid.size)].any()
    scale = np.abs(found[1]).max(axis=1, keepdims=True)
    assert scale.min() > 0
    np.testing.assert_allclose(found[0] / scale, found[1] / scale, rtol=0, atol=1e-13)


def test_a_tangent_of_many_nodes_is_the_difference_quotient():
    """Of so many that the changes of feet are compiled; steps of a steady flow share them."""
    values = np.array([0.6, 0.2])

    def final(a, b):
        flow = Velocity.from_expression("a + b*sin(2*pi*x1)", parameters={"a": a, "b": b})
        solver = Solver(Grid([(0, 1)], (30_000,), periodic=True), flow, profile="cubic")
        return solver, solver.run(solver.state("sin(2*pi*x1)"), 3e-4, dt=1e-4)

    solver, run = final(*values)
    direction, size = np.array([0.3, -0.8]), run[0].data.size
    change = solver.tangent(run) @ np.concatenate([np.zeros(size), direction])
    ends = [final(*(values + side * 1e-4 * direction))[1].final.data for side in (1, -1)]
    expected = ((ends[0] - ends[1]) / 2e-4)[0]
    bound = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(change.reshape(2, -1)[0], expected, rtol=0, atol=bound)
    assert dot_test(solver, run, np.random.default_rng(3)) <= 1e-13


@pytest.mark.sampled(2)
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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("feet", [0, 2**16])
def test_feet_that_are_not_kept_are_computed_again(feet, monkeypatch):
    """One set of feet has 3 x 31 x 8 bytes: none but the last is kept, or all."""
    from cip.solver import derivatives

    found, computed = [], []
    original = Solver.feet

    def counted(self, *arguments):
        computed.append(arguments)
        return original(self, *arguments)

    monkeypatch.setattr(Solver, "feet", counted)
    velocity = Velocity.from_expression(
        *LINES["unsteady"][1], parameters={"a": 1, "b": 0.2, "d": 0.1}
    )
    solver = Solver(Grid((0, 1), 31, periodic=True), velocity, "advection", "cubic")
    run = solver.run(solver.state(FIELDS[1]), 0.2, dt=0.03)  # seven steps
    weight = np.random.default_rng(3).standard_normal(run.final.data.size)
    found.append(solver.adjoint(run) @ weight)
    assert computed == []
    monkeypatch.setattr(derivatives, "KEPT", feet)
    found.append(solver.adjoint(run) @ weight)
    assert len(computed) == (6 if feet == 0 else 0)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12, atol=1e-12)
