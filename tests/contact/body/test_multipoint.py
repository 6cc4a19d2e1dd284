"""Periodic and tied boundaries and multipoint constraints, against saddle-point solutions."""

import numpy as np
import pytest
from families import PLANE_AND_BFS as PLANE
from families import STRAIGHT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    MeshQuad,
)

from contact import ContactProblem, ElasticBody, LoadStepper, Unbounded
from contact.body.free_motions import free_motions
from contact.body.rigid_modes import describe_motion
from contact.errors import InputError
from skfem_adini import ElementQuadAdini

SPACE = [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2]


def mesh_of(element, unit=1.0, refine=1):
    return STRAIGHT[element]().refined(refine).scaled(unit).with_defaults()


def sides_of(mesh):
    """Pairs of opposite sides, one a direction, by the places of their facets."""
    middle = mesh.p[:, mesh.facets].mean(axis=1)
    result = []
    for c in range(mesh.dim()):
        low, high = mesh.p[c].min(), mesh.p[c].max()
        at = [
            np.flatnonzero(np.isclose(middle[c], v, atol=1e-9 * (high - low))) for v in (low, high)
        ]
        result.append((at[1], at[0]))
    return result


def solved(body):
    P, u0 = body.constraint
    P = P @ sparse.diags_array(1.0 / body.lengths[1])  # unknowns that are displacements
    S = (P.T @ body.stiffness @ P).toarray()
    z = np.linalg.lstsq(S, P.T @ (body.f - body.stiffness @ u0), rcond=1e-11)[0]
    return P @ z + u0


def saddle(S, f, C, c):
    """Displacement of the saddle-point system, by least squares."""
    size = abs(S).max()
    K = np.block([[S / size, C.T], [C, np.zeros((C.shape[0],) * 2)]])
    return np.linalg.lstsq(K, np.r_[f / size, c], rcond=1e-13)[0][: S.shape[0]]


@pytest.mark.parametrize("element", PLANE + SPACE)
def test_a_periodic_cell_under_a_mean_strain_is_strained_uniformly(element):
    unit = 1e-4
    mesh = mesh_of(element, unit)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    H = np.array([[1.0, 0.4, -0.2], [0.3, -0.5, 0.1], [0.2, 0.6, 0.7]])[: body.dim, : body.dim]
    for c, (high, low) in enumerate(sides_of(mesh)):
        body.periodic(high, low, H[:, c] * unit * 1e-3)
    u = solved(body)
    points = unit * np.random.default_rng(0).uniform(0.1, 0.9, (body.dim, 5))
    assert np.abs(body.gradient(u, points) - 1e-3 * H[:, :, None]).max() < 1e-14
    assert body.support_error(u) < 1e-13 * unit
    P = body.constraint[0]
    assert abs(body.picked.T @ P - sparse.eye_array(P.shape[1])).max() < 1e-12
    motions = free_motions(body)
    assert motions.shape[1] == body.dim
    names = {describe_motion(body, P @ motions[:, k]) for k in range(body.dim)}
    assert names == {f"a translation along {axis}" for axis in "xyz"[: body.dim]}


@pytest.mark.parametrize("element", [*PLANE, ElementHex1, ElementTetP2])
def test_a_rigid_side_is_a_rigid_motion_of_its_dofs(element):
    unit = 1e-3
    mesh = mesh_of(element, unit)
    high, low = sides_of(mesh)[0]
    traction = np.array([0.3, 0.2, -0.1])[: mesh.dim()]
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).fix(low)
    body.load(high, lambda x: traction.reshape(-1, 1, 1) * (1 + x[1] / unit))
    u = solved(body.tie(high, rigid=True))
    where = mesh.p[:, np.unique(mesh.facets[:, high])]
    v, arm = body.displacement(u, where), where - where.mean(axis=1, keepdims=True)
    off = v - v.mean(axis=1, keepdims=True)
    spin = np.linalg.lstsq(arm.T, off.T, rcond=None)[0].T
    spin[:, 0] = -spin[0] * (np.arange(mesh.dim()) > 0)
    assert np.abs(spin + spin.T).max() < 1e-10 * np.abs(spin).max()
    assert np.abs(off - spin @ arm).max() < 1e-11 * np.abs(v).max()
    assert np.abs(spin).max() * unit > 1e-3 * np.abs(v).max()
    # The work of the loads is twice the energy: forces within the rigid side do no work.
    assert body.f @ u == pytest.approx(u @ body.stiffness @ u, rel=1e-10)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12), st.sampled_from([ElementQuad1, ElementQuadAdini]))
def test_random_equations_against_the_saddle_point(seed, count, element):
    rng = np.random.default_rng(seed)
    body = ElasticBody.from_mesh(mesh_of(element), element(), E=1.0, nu=0.2).fix("left")
    body.load("right", (0.1, 0.05))
    n = body.basis.N
    free = np.flatnonzero(np.diff(body.constraint[0].indptr))
    C = np.zeros((count, n))
    for row in C:
        row[rng.choice(free, 3, replace=False)] = rng.uniform(0.5, 2.0, 3)
        row[rng.choice(n)] += 1.0
    C = np.vstack([C, C[:1] + 2 * C[-1:]])  # redundant
    c = C @ rng.normal(size=n)
    inside = C[:, free]
    if np.linalg.matrix_rank(inside) < count or np.linalg.cond(inside[:count]) > 1e3:
        return
    T, u1 = body.constraint
    body.constrain(sparse.csr_array(C), c)
    left = np.eye(n) - (T @ T.T).toarray()
    expected = saddle(body.stiffness.toarray(), body.f, np.vstack([C, left]), np.r_[c, u1])
    u = solved(body)
    assert np.abs(C @ u - c).max() < 1e-11 * max(1.0, np.abs(c).max())
    assert np.abs(u - expected).max() < 1e-8 * np.abs(expected).max()
    P, u0 = body.constraint
    assert abs(body.picked.T @ P - sparse.eye_array(P.shape[1])).max() < 1e-12
    assert np.abs(body.picked.T @ u0).max() < 1e-11 * max(1.0, np.abs(u0).max())


def wavy(element, share, n=64, unit=1.0):
    """A periodic block on a wave of amplitude 0.01, and its mean pressure (Westergaard 1939)."""
    above = 0.25 + 1.25 * np.linspace(0, 1, n // 4 + 1)[1:] ** 1.3
    y = np.r_[np.linspace(0, 0.25, n // 4 + 1), above]
    mesh = MeshQuad.init_tensor(unit * np.linspace(-0.5, 0.5, n + 1), unit * y).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).periodic("right", "left")
    mean = share * np.pi * 0.01 / (1 - 0.3**2)
    body.fix("top", "x").tie("top", "y").load("top", (0.0, -mean))

    def gap(x):
        return unit * 0.01 * (1 - np.cos(2 * np.pi * x[0] / unit))

    return ContactProblem(body, "bottom", gap), mean


def test_a_load_stepper_moves_the_supports_of_a_coupled_body():
    mesh = mesh_of(ElementQuad1, refine=3)

    def problem(shift):
        body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "y", -shift)
        body.periodic("right", "left", (0.01, 0.0))
        middle = np.zeros((1, body.basis.N))
        middle[0, body.basis.get_dofs("top").flatten()[::2]] = 1.0
        body.constrain(middle, 0.02)
        return ContactProblem(body, "bottom", lambda x: 0.05 + (x[0] - 0.5) ** 2)

    steps = LoadStepper(problem(0.0)).move("top", "y", -0.1)
    moved, at_once = steps.step(1.0), problem(0.1).solve()
    assert at_once.resultant[1] > 1e-3
    assert np.abs(moved.u - at_once.u).max() < 1e-10 * np.abs(at_once.u).max()


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_pressures_that_shared_unknowns_leave_open_are_refused(element):
    problem, _ = wavy(element, 1.5, n=16)  # complete contact: both corners touch
    with pytest.raises(InputError, match=r"body: .* pressures are not determined"):
        problem.solve()
    mesh = mesh_of(element, refine=3)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).fix("top", "x")
    body.load("top", (0.0, -0.1)).tie("bottom", "y")
    with pytest.raises(InputError, match=r"body: .* pressures are not determined"):
        ContactProblem(body, "bottom", 0.0).solve()


def test_a_periodic_body_that_nothing_stops_is_free_to_be_translated():
    problem, _ = wavy(ElementQuad1, 0.3, n=16)
    body = ElasticBody.from_mesh(problem.body.mesh, E=1.0, nu=0.3).periodic("right", "left")
    body.load("top", (0.001, -0.01))
    with pytest.raises(Unbounded, match="a translation along x"):
        ContactProblem(body, "bottom", 0.0).solve()
