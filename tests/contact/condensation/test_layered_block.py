"""Layers of equal cells: slab doubling against sparse factorisation, and what it refuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact import (
    ContactProblem,
    ContactResult,
    Infeasible,
    InputError,
    LayeredBlock,
    LoadStepper,
    NotConverged,
    Rigid,
    Unbounded,
)
from contact.arrays.dense_arrays import arrays_on
from contact.laws.methods import device_newton
from contact.result.certify import certify
from tests.contact.condensation.refined_solution import refined


def _supported(n):
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="y", top="x")
    return block.load("top", (0.0, -1.0)), 0.03, 0.9


def _layers(n):
    layers = [(0.25, n // 4 - 1, 2.0, 0.3), (0.35, n // 4, 20.0, 0.2), (0.4, n // 2, 1.0, 0.45)]
    block = LayeredBlock((1.5, 1.0), layers, sides=(None, "x"), columns=n)
    block.load("top", lambda x: np.array([0.1 * x[0], -1 + 0 * x[0]])).load("left", (0.2, 0.0))
    return block.body_force((0.0, -0.3)), 0.01, 0.4


def _floating(n):
    layers = [(0.5, n // 4, 2.0, 0.3), (0.3, n // 8 + 1, 20.0, 0.2)]
    block = LayeredBlock(2.0, layers, columns=n)
    return block.load("top", (0.1, -1.0)), lambda x: 0.01 * x[0] ** 2, 0.5


def _moved(n):
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="x", top="x")
    return block.fix("top", "y", -0.05), lambda x: 0.1 * (x[0] - 0.5) ** 2, 0.3


CASES = [_supported, _layers, _floating, _moved]


def _compare(block, obstacle, friction, **more):
    ours = ContactProblem(block, "bottom", obstacle, friction, **more).solve()
    sparse = refined(block, "bottom", obstacle, friction, **more)
    size = np.abs(sparse.mu).max()
    assert np.abs(ours.mu - sparse.mu).max() <= 1e-12 * size
    assert np.abs(ours.t - sparse.t).max() <= 1e-12 * size
    assert np.abs(ours.u - sparse.u).max() <= 1e-11 * np.abs(sparse.u).max()
    assert max(ours.kkt.values()) <= 1e-12
    return ours, sparse


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("case", "n"),
    [
        *((case, 16) for case in CASES),
        (_layers, 64),
        *(
            pytest.param(case, n, marks=pytest.mark.slow)
            for case in CASES
            for n in (64, 128)
            if (case, n) != (_layers, 64)
        ),
    ],
)
def test_agrees_with_sparse_factorisation(case, n):
    block, obstacle, friction = case(n)
    _compare(block, obstacle, friction)


@pytest.mark.parametrize("functional", ["gauss", "nodal"])
def test_other_functionals(functional):
    block, obstacle, friction = _layers(12)
    _compare(block, obstacle, friction, functional=functional)


@pytest.mark.parametrize("law", ["tresca", None])
def test_other_laws(law):
    block, obstacle, _ = (_floating if law else _supported)(16)
    _compare(block, obstacle, 0.2 if law else 0.0, law=law)


def test_plane_stress():
    block = LayeredBlock(1.0, [(1.0, 8, 2.0, 0.3)], sides="x", plane="stress")
    _compare(block.load("top", (0.0, -1.0)), lambda x: 0.05 * x[0] ** 2, 0.3)


def test_fields_agree_everywhere():
    block, obstacle, friction = _layers(16)
    ours, sparse = _compare(block, obstacle, friction)
    points = np.random.default_rng(3).random((2, 200)) * [[1.5], [1.0]]
    points[:, :4] = [[0.0, 1.5, 0.0, 1.5], [0.0, 0.0, 1.0, 1.0]]  # the corners
    for field in ("sample", "stress", "von_mises"):
        found, expected = (np.asarray(getattr(r, field)(points)) for r in (ours, sparse))
        assert np.abs(found - expected).max() <= 1e-10 * np.abs(expected).max()
    for ours_part, part in zip(ours.balance().values(), sparse.balance().values(), strict=True):
        assert np.allclose(ours_part, part, atol=1e-12)


def test_dofs_are_those_of_the_elastic_body():
    block, _, _ = _layers(12)
    body = block.elastic()
    body.f[:] = 0.0
    body.load("top", lambda x: np.array([0.1 * x[0], -1 + 0 * x[0]])).load("left", (0.2, 0.0))
    body.body_force((0.0, -0.3))
    assert np.abs(body.f - block.f).max() <= 1e-14
    u = np.random.default_rng(1).normal(size=block.f.size)
    S_u = body.stiffness @ u
    assert np.abs(block.stiffness @ u - S_u).max() <= 1e-13 * np.abs(S_u).max()
    _, u0 = body.constraint
    assert np.array_equal(np.sort(np.flatnonzero(np.diff(body.constraint[0].indptr) == 0)),
                          block.prescribed[0])  # fmt: skip
    assert np.array_equal(u0, block.constraint[1])


def test_translations_meet_no_force_at_all():
    """What refinement rests on: the stencil's rounding is that of strains, not of displacements."""
    block = LayeredBlock(1.0, [(0.3, 5, 3.0, 0.3), (0.7, 9, 1.0, 0.1)], columns=11)
    u = np.zeros((block.f.size // 6, 6))
    u[:, :2] = 1e6, -1e6 / 3
    assert not np.any(block.stiffness @ u.ravel())


@settings(max_examples=max(settings().max_examples // 3, 10))
@given(
    columns=st.integers(1, 7),
    rows=st.lists(st.integers(1, 9), min_size=1, max_size=3),
    sides=st.sampled_from([None, "x", "y", "xy", ("x", None), (None, "xy"), ("y", "x")]),
    top=st.sampled_from([None, "x", "y", "xy"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_reduces_and_expands_any_load_as_a_dense_elimination_does(columns, rows, sides, top, seed):
    rng = np.random.default_rng(seed)
    layers = [(rng.uniform(0.2, 2.0), n, 10 ** rng.uniform(-2, 2), rng.uniform(0, 0.45))
              for n in rows]  # fmt: skip
    block = LayeredBlock(rng.uniform(0.5, 3.0), layers, sides=sides, top=top, columns=columns)
    try:
        condensed = ContactProblem(block, "bottom", 0.0).condense().parts[0]
    except InputError:  # nothing of the bottom is free to move
        assert columns == 1
        assert sides == "xy"
        return
    factor, held = condensed._factor, block.prescribed[0]
    free = np.setdiff1d(np.arange(block.f.size), held)
    unit = sorted(condensed._P[:, condensed._boundary].tocsc().indices)
    inner = np.setdiff1d(free, unit)
    S = block.elastic().stiffness.toarray()
    S_ii, S_ib = S[np.ix_(inner, inner)], S[np.ix_(inner, unit)]
    solved = np.linalg.solve(S_ii, S_ib)
    schur = S[np.ix_(unit, unit)] - S_ib.T @ solved
    assert np.abs(factor.schur - schur).max() <= 1e-9 * np.abs(np.diag(S)).max()
    load = rng.normal(size=block.f.size)
    load[held] = 0.0
    z_b = rng.normal(size=len(unit))
    expected = np.zeros_like(load)
    expected[unit] = z_b
    expected[inner] = np.linalg.solve(S_ii, load[inner]) - solved @ z_b
    # Layers of 1e4 times the stiffness, cells of any shape: the dense solve is no better.
    assert np.abs(factor.expand(load, z_b) - expected).max() <= 1e-8 * np.abs(expected).max()
    reduced = load[unit] - solved.T @ load[inner]
    assert np.abs(factor.reduce(load) - reduced).max() <= 1e-8 * np.abs(reduced).max()


def test_contact_free_of_its_supports_is_named():
    block = LayeredBlock(2.0, [(1.0, 6, 1.0, 0.3)], columns=8).load("top", (0.3, -1.0))
    for body in (block, block.elastic()):
        with pytest.raises(Unbounded, match="a translation along x") as error:
            ContactProblem(body, "bottom", 0.0).solve()
        assert error.value.mode.shape == block.f.shape
    turned = LayeredBlock(2.0, [(1.0, 6, 1.0, 0.3)], sides="x", columns=8)
    with pytest.raises(Unbounded, match="a translation along y"):
        ContactProblem(turned.load("top", (0.0, 1.0)), "bottom", 0.0).solve()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", CASES)
def test_a_tolerance_below_rounding_is_refused(case):
    block, obstacle, friction = case(16)
    problem = ContactProblem(block, "bottom", obstacle, friction)
    with pytest.raises(NotConverged):
        problem.solve(tol=1e-18)
    with pytest.raises(NotConverged, match="fails its certificate"):
        certify(problem.solve(), 1e-30, 0.0)


def test_prescribed_penetration_is_infeasible():
    block = LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)]).fix("left", "y", -0.1)
    with pytest.raises(Infeasible, match="contact point 0"):
        ContactProblem(block, "bottom", 0.0).solve()


@pytest.mark.filterwarnings("ignore:displacements reach")  # E of one under loads of two
def test_load_history_and_driven_obstacle_as_with_a_basis():
    histories, driven = [], []
    for kind in (lambda b: b, LayeredBlock.elastic):
        block = LayeredBlock(1.0, [(1.0, 8, 1.0, 0.3)], top="x")
        body = kind(block)
        stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, 0.4))
        stepper.load("top", lambda x: np.array([0.0 * x[0], -0.1 - 0.1 * x[0]]))
        stepper.move("top", "x", 0.05, np.sin)
        histories.append(stepper.run([0.5, 1.0, 1.5]).results[-1])
        rigid = Rigid(0.0, displacement=(0.02, None), force=(None, 0.7))
        pressed = LayeredBlock(1.0, [(1.0, 8, 1.0, 0.3)], top="xy")
        driven.append(ContactProblem(kind(pressed), "bottom", rigid, 0.4).solve())
    for ours, sparse in (histories, driven):
        assert np.abs(ours.mu - sparse.mu).max() <= 1e-12 * sparse.mu.max()
        assert np.abs(ours.t - sparse.t).max() <= 1e-12 * sparse.mu.max()


def test_one_condensation_serves_every_load():
    block, obstacle, friction = _supported(8)
    problem = ContactProblem(block, "bottom", obstacle, friction)
    condensed = problem.condense()
    first = problem.solve()
    block.load("top", (0.0, -0.2))
    assert problem.condense() is condensed
    assert problem.solve(start=first).contact_force > first.contact_force


@pytest.mark.sampled(4)
@pytest.mark.parametrize("law", ["coulomb", "tresca", None])
@pytest.mark.parametrize("case", CASES)
def test_newton_for_devices_finds_what_the_host_finds(case, law):
    block, obstacle, friction = case(24)
    if law is None:
        block = LayeredBlock(1.0, [(1.0, 24, 2.0, 0.3)], sides="x").load("top", (0.0, -1.0))
    problem = ContactProblem(block, "bottom", obstacle, friction if law else 0.0, law=law)
    expected, condensed, system = problem.solve(), problem.condense(), problem.system
    boundary = condensed.boundary_problem(system.load, system.rows.gap)
    scaled = system.scaled_friction(condensed.point_scale)
    forces = device_newton(boundary, scaled, None, tol=1e-12, max_iterations=40)
    _, mu, t = condensed.recover(system.load, boundary, forces)
    assert np.abs(mu - expected.mu).max() <= 1e-9 * expected.mu.max()
    assert np.abs(t - expected.t).max() <= 1e-9 * expected.mu.max()


@pytest.mark.gpu
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("n", [16, 64])
def test_device_agrees_with_host(case, n):
    block, obstacle, friction = case(n)
    host = ContactProblem(block, "bottom", obstacle, friction).solve()
    block, obstacle, friction = case(n)
    problem = ContactProblem(block, "bottom", obstacle, friction)
    problem.condense(device="cuda")
    for method in ("newton", "tresca_loop"):
        device = problem.solve(method)
        assert np.abs(device.mu - host.mu).max() <= 1e-12 * host.mu.max()
        assert np.abs(device.t - host.t).max() <= 1e-12 * host.mu.max()
        assert np.abs(device.u - host.u).max() <= 1e-11 * np.abs(host.u).max()


GOOD = (1.0, [(1.0, 4, 1.0, 0.3)])


@pytest.mark.parametrize(
    ("arguments", "more", "message"),
    [
        ((0.0, GOOD[1]), {}, "lengths"),
        ((np.nan, GOOD[1]), {}, "lengths"),
        ((1j, GOOD[1]), {}, "lengths"),
        (((1.0, 2.0), GOOD[1]), {}, "lengths.*the layers are 1 high"),
        (((1.0, 1.0, 1.0), GOOD[1]), {}, "lengths"),
        ((1.0, []), {}, "layers"),
        ((1.0, None), {}, "layers"),
        ((1.0, [(1.0, 4, 1.0)]), {}, r"layers\[0\]"),
        ((1.0, [(1.0, 4, 1.0, 0.3), (-1.0, 4, 1.0, 0.3)]), {}, r"layers\[1\].*height"),
        ((1.0, [(1.0, 2.5, 1.0, 0.3)]), {}, "cells must be a whole number"),
        ((1.0, [(1.0, 0, 1.0, 0.3)]), {}, "cells must be a whole number"),
        ((1.0, [(1.0, 4, -1.0, 0.3)]), {}, "E="),
        ((1.0, [(1.0, 4, 1.0, 0.5)]), {}, "nu="),
        ((1.0, [(1.0, 4, np.inf, 0.3)]), {}, "E"),
        (GOOD, {"sides": "z"}, "components"),
        (GOOD, {"sides": ("x", "y", "x")}, "sides"),
        (GOOD, {"top": 5}, "components"),
        (GOOD, {"columns": 0}, "columns"),
        (GOOD, {"columns": "many"}, "columns"),
        (GOOD, {"plane": "membrane"}, "plane"),
    ],
)
def test_bad_blocks_are_refused(arguments, more, message):
    with pytest.raises(InputError, match=message):
        LayeredBlock(*arguments, **more)


def test_bad_use_is_refused():
    block = LayeredBlock(*GOOD)
    for call, message in (
        (lambda: block.fix("bottom", "x"), "boundary='bottom'"),
        (lambda: block.fix("middle"), "boundary='middle'"),
        (lambda: block.fix("top", "y", np.nan), "value"),
        (lambda: block.load("top", (np.nan, 0.0)), "traction"),
        (lambda: block.load("top", (1.0, 0.0, 0.0)), "traction"),
        (lambda: block.body_force((1.0,)), "force"),
        (lambda: ContactProblem(block, "top", 0.0), "boundary"),
        # Numbers of facets inside the block, as its lowest row of cells counts them.
        (lambda: ContactProblem(block, block.trace.mesh.f2t[1] == -1, 0.0), "that name"),
        (lambda: ContactProblem(block, block.trace.mesh.boundary_facets(), 0.0), "that name"),
        (lambda: LoadStepper(ContactProblem(block, "bottom", 0.0)).move("top", "x"), "not fixed"),
        (lambda: ContactProblem(block, "bottom", 0.0, solver="superlu").condense(), "solver"),
        (lambda: ContactProblem(block, "bottom", 0.0).condense(device="tpu"), "device='tpu'"),
        (
            lambda: ContactProblem(block.elastic(), "bottom", 0.0, solver="superlu").condense(
                device="cuda"
            ),
            "device",
        ),
    ):
        with pytest.raises(InputError, match=message):
            call()
    clash = LayeredBlock(*GOOD).fix("top", "y", 0.1).fix("left", "y", 0.2)
    with pytest.raises(InputError, match="differ where they meet"):
        ContactProblem(clash, "bottom", 0.0).solve()


def test_what_needs_a_basis_names_the_way_out():
    block, obstacle, friction = _supported(4)
    result = ContactProblem(block, "bottom", obstacle, friction).solve()
    assert isinstance(result, ContactResult)
    with pytest.raises(InputError, match=r"block.elastic\(\)"):
        _ = block.basis
    with pytest.raises(InputError, match="outside the block"):
        result.sample([[0.5, 1.2], [0.5, 0.5]])


def test_no_device_is_a_typed_error():
    cupy = pytest.importorskip("cupy", reason="CuPy tells whether there is a device")
    try:
        cupy.cuda.runtime.getDeviceCount()
    except cupy.cuda.runtime.CUDARuntimeError:
        with pytest.raises(InputError, match="no CUDA device"):
            arrays_on("cuda")
