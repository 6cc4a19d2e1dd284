"""Tangents and adjoints of all schemes, and what they are made of: memory, threads, kernels."""

from functools import reduce

import numpy as np
import pytest
from derivative_checks import (
    along,
    dot_test,
    equal_substeps,
    few_examples,
    parameter_error,
    run_again,
    scales,
    state_error,
    taylor_order,
)
from hypothesis import given
from hypothesis import strategies as st
from schemes import FAMILIES, FLOWS, field_of, form_of, solved, solver_of

from cip import Grid, InputError, Solver, Source, SplineVelocity, Velocity
from cip.sensitivities import path_adjoint, path_tangent, window
from cip.solver import derivatives


@few_examples
@given(
    a=st.floats(0.4, 1.2), b=st.floats(-0.4, 0.4), k=st.floats(0.0, 2.0), m=st.floats(0, 1),
    w=st.floats(-5, 5), dt=st.floats(0.01, 0.21), seed=st.integers(0, 99),
)  # fmt: skip
def check_transpose(scheme, dt, seed, **values):
    solver, run = solved(*scheme, dt=dt, **values)
    assert max(dot_test(solver, run, np.random.default_rng(seed))) <= 1e-13


def check(scheme, bound, e=2e-5):
    """`bound`: of rounding, 1e-15 over the step `e` of differences and powers of cells' widths."""
    check_transpose(scheme)
    rng = np.random.default_rng(1)
    with equal_substeps():  # no foot passes an edge and no path another wall
        solver, run = solved(*scheme)
        assert dot_test(solver, run, rng)[0] <= 1e-14
        assert state_error(solver, run, rng) < 1e-12
        assert parameter_error(solver, run, e) < bound
        direction = dict(zip(solver.parameters, rng.uniform(-1, 1, 8), strict=False))
        order = taylor_order(solver, run, direction, 5e-4 * 0.5 ** np.arange(5))
        assert abs(order - 2.0) <= 0.05
        grid, profile = solver.grid, solver.profile
        if profile.startswith("csl") and all(grid.periodic) and solver.source is None:
            volumes = reduce(np.multiply.outer, grid.widths)
            for name in "ab":  # no parameter of the velocity changes the integral
                moved = along(solver, run, name).reshape(run[0].data.shape)[-1] * volumes
                assert np.abs(moved).max() > 1e-3
                assert abs(moved.sum()) < 4e-14


def family(name, every, *bounds):
    """Each scheme is compiled anew: a few in the fast lane, others each turn."""

    @pytest.mark.sampled(every)
    @pytest.mark.parametrize("scheme", FAMILIES[name], ids=", ".join)
    def test(scheme):
        check(scheme, *bounds)

    return test


test_lines = family("lines", 8, 1e-9, 6e-5)
test_inflow = family("inflow", 8, 2e-9)
test_csl2 = family("csl2", 4, 1e-8)
test_csl4 = family("csl4", 4, 1e-8)
test_planes = family("planes", 10, 2e-9)
test_sweeps = family("sweeps", 15, 1e-8)
test_reactions = family("reactions", 8, 5e-9)
test_reactions_in_planes_and_space = pytest.mark.slow(
    family("reactions in planes and space", 1, 5e-9)
)


# Memory, threads, compiled code, splines.


PLANE = Grid([(0, 1)] * 2, (14, 13), periodic=True)
WAVES = ("waves", "cubic", "advection")


@pytest.mark.parametrize("scheme", [WAVES, ("inflow", "cubic", "transport", "unsteady")])
def test_checkpoints_change_nothing_and_keep_few_states(scheme, monkeypatch):
    """With k checkpoints at most k states and the steps between two of them; all, if they fit."""
    kept, original = [], window.Window._states

    def counted(self, state, first, last):
        found = original(self, state, first, last)
        kept.append(len(found))
        return found

    monkeypatch.setattr(window.Window, "_states", counted)
    solver, run = solved(*scheme, dt=0.0145)  # 14 steps
    weight = np.random.default_rng(3).standard_normal(run.final.data.size)
    expected = solver.adjoint(run) @ weight
    reacting = solver.source is not None
    assert reacting or kept == [1] * 14
    for checkpoints, counts in ((1, [14]), (2, [7, 7]), (100, [1] * 14)):
        kept.clear()
        np.testing.assert_array_equal(solver.adjoint(run, checkpoints) @ weight, expected)
        assert reacting or kept == counts
    kept.clear()
    monkeypatch.setattr(window, "KEPT", 14 * run.final.data.nbytes - 1)
    np.testing.assert_array_equal(solver.adjoint(run) @ weight, expected)
    assert reacting or kept == [2, 4, 4, 4]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("feet", [0, 2**16])
def test_feet_that_are_not_kept_are_computed_again(feet, monkeypatch):
    """One set of feet has 3 x 25 x 8 bytes: none but the last is kept, or all."""
    computed, original = [], Solver.feet

    def counted(self, *arguments):
        computed.append(arguments)
        return original(self, *arguments)

    monkeypatch.setattr(Solver, "feet", counted)
    solver, run = solved(*WAVES, dt=0.03)  # seven steps
    weight = np.random.default_rng(3).standard_normal(run.final.data.size)
    expected = solver.adjoint(run) @ weight
    assert computed == []
    monkeypatch.setattr(derivatives, "KEPT", feet)
    found = solver.adjoint(run) @ weight
    assert len(computed) == (6 if feet == 0 else 0)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("shape", "profile"), [((100_000,), "cubic"), ((300, 300), "adini")])
def test_threads_give_the_same_bits(shape, profile, monkeypatch):
    texts = ("a + b*sin(2*pi*x1 + t)", "b*cos(2*pi*x1)")[: len(shape)]
    velocity = Velocity.from_expression(*texts, parameters={"a": 0.4, "b": 0.2})
    solver = Solver(Grid([(0, 1)] * len(shape), shape, periodic=True), velocity, profile=profile)
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
@pytest.mark.parametrize("form", ["transport", "advection"])
def test_paths_in_reverse_compiled_and_by_numpy_agree(form):
    """The same stages, sub-steps and formulas, in two ways."""
    velocity = Velocity.from_expression(
        "a + b*sin(2*pi*x2 + t)*exp(a*x1)", "b*cos(2*pi*x1)/(2 + a)",
        parameters={"a": 0.4, "b": 0.2},
    )  # fmt: skip
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


@pytest.mark.parametrize(("shape", "profile"), [((30_000,), "cubic"), ((9, 8), "bicubic")])
def test_changes_of_feet_that_are_compiled(shape, profile, monkeypatch):
    """As those of many nodes are; steps of a steady flow share them."""
    monkeypatch.setattr(path_tangent, "_COMPILE_FROM", min(shape))
    waves = ("a + b*sin(2*pi*(x1 + x2))*exp(a)", "b*cos(2*pi*(x1 + x2))/(2 + a)")[: len(shape)]
    texts = [text.replace(" + x2", "" if len(shape) == 1 else " + x2") for text in waves]
    flow = Velocity.from_expression(*texts, parameters={"a": 0.6, "b": 0.2})
    grid = Grid([(0, 1)] * len(shape), shape, periodic=True)
    form = "transport" if len(shape) == 1 else "advection"
    solver = Solver(grid, flow, form, profile)
    run, step = solver.run(solver.state(field_of(grid)), 3e-4, dt=1e-4), 1e-4
    change = 0.3 * along(solver, run, "a") - 0.8 * along(solver, run, "b")
    ends = [run_again(solver, run, a=0.6 + 0.3 * e, b=0.2 - 0.8 * e) for e in (step, -step)]
    expected = ((ends[0] - ends[1]) / (2 * step))[: grid.size]
    bound = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(change[: grid.size], expected, rtol=0, atol=bound)
    assert max(dot_test(solver, run, np.random.default_rng(3))) <= 1e-13


@pytest.mark.parametrize("speed", [1e-16, 1e-9, 1e-5, -1e-5, 1e-3])
def test_the_adjoint_of_a_flow_that_almost_rests(speed):
    """Feet next to a node, on either side: second derivatives of a quintic lost digits on one."""
    solver, run = solved("ring", "quintic", "transport", a=speed, b=0.0, dt=0.01)
    assert max(dot_test(solver, run, np.random.default_rng(8))) <= 1e-14


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("stream", "profile"), [(False, "adini"), (True, "adini"), (True, "csl4")])
def test_many_coefficients_of_splines(stream, profile):
    start = (lambda x, y: np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y) / 6) if stream else 0.5
    velocity = SplineVelocity(PLANE, (7, 6), start=start, stream=stream)
    solver = Solver(PLANE, velocity, form_of(profile), profile)
    run = solver.run(solver.state(field_of(PLANE)), 0.1, dt=0.04)
    assert len(velocity.names) == (42 if stream else 84)
    assert max(dot_test(solver, run, np.random.default_rng(7))) <= 1e-13


@pytest.mark.parametrize("periodic", [True, False])
def test_nodal_values_of_a_velocity(periodic):
    """As many splines as nodes, or nearly, of both components; with inflow through walls."""
    grid = Grid([(0, 1)] * 2, (9, 8), periodic=periodic)
    x, y = grid.mesh()
    start = [0.5 + 0.2 * np.sin(2 * np.pi * x + y), 0.3 + 0.2 * np.cos(2 * np.pi * y) * x]
    velocity = SplineVelocity(grid, (9, 8) if periodic else (5, 4), start=start)
    assert len(velocity.names) == 2 * (72 if periodic else 10 * 9)
    boundary = None if periodic else "1 + sin(3*t)*cos(x2 - x1)"
    solver = Solver(grid, velocity, profile="bicubic", boundary=boundary)
    run = solver.run(solver.state(field_of(grid)), 0.1, dt=0.04)
    rng, size, e = np.random.default_rng(5), run.final.data.size, 1e-5
    assert max(dot_test(solver, run, rng)) <= 1e-13
    direction = rng.standard_normal(len(velocity.names))
    found = solver.tangent(run) @ np.concatenate([np.zeros(size), direction])
    values = np.array(list(velocity.parameters.values()))
    ahead, behind = (
        run_again(solver, run, **dict(zip(velocity.names, values + s * direction, strict=True)))
        for s in (e, -e)
    )
    quotient, scale = (ahead - behind) / (2 * e), scales(run)
    assert np.abs(quotient / scale).max() > 0.01
    np.testing.assert_allclose(found / scale, quotient / scale, rtol=0, atol=2e-6)


def test_parameters_of_a_solver():
    solver = solver_of("inflow", "cubic", "transport", "unsteady")
    assert list(solver.parameters) == ["a", "b", "q", "m", "k", "l", "g", "w"]
    moved = solver.with_parameters(a=1.1, w=2.0)
    assert moved.parameters == {**solver.parameters, "a": 1.1, "w": 2.0}
    assert moved.velocity.parameters["a"] == moved.decay.parameters["a"] == 1.1
    assert solver.parameters["a"] == 0.8
    with pytest.raises(InputError, match="z: no parameter of this solver; known: a, b, q"):
        solver.with_parameters(z=1.0)
    grid, (a,) = FLOWS["inflow"][0], [Source.from_expression("a", {"a": 2.0})]
    with pytest.raises(InputError, match=r"source: its parameter 'a' is 2, that of velocity 0\.8"):
        Solver(grid, solver.velocity, source=a)
    with pytest.raises(InputError, match="boundary 'x-': expected a number, a formula or a call"):
        Solver(grid, solver.velocity, boundary={"x-": Source(np.ones(22))})
