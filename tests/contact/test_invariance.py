"""A shifted, turned, renumbered or rescaled problem has the shifted, ... rescaled solution."""

import numpy as np
import pytest
from families import STRAIGHT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2, MeshTri

from contact import ContactProblem, Cylinder, ElasticBody
from skfem_adini import ElementQuadAdini

PLANAR = [ElementQuadAdini, ElementTriP2, ElementQuad2, ElementQuad1, ElementTriP1]
POINTS = np.random.default_rng(8).uniform(0, 1, (2, 60))
few = settings(max_examples=5, suppress_health_check=list(HealthCheck))


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def pressed(element, mesh, Q=None, shift=(0.0, 0.0), length=1.0, E=2.0, friction=0.4, **law):
    """A square whose top is moved down and sideways, onto a disk, with a load from the right.

    Everything is turned by Q, shifted, scaled in length, and in stress by E.
    """
    Q, shift = np.eye(2) if Q is None else Q, np.asarray(shift)
    mesh = type(mesh)(length * (Q @ mesh.p) + shift[:, None], mesh.t, sort_t=False)

    def home(x):
        offset = shift.reshape(2, *(1,) * (x.ndim - 1))
        return np.tensordot(Q.T, x - offset, axes=1) / length

    def side(axis, value):
        return lambda x: np.abs(home(x)[axis] - value) < 1e-6

    mesh = mesh.with_boundaries(
        {"bottom": side(1, 0), "top": side(1, 1), "left": side(0, 0), "right": side(0, 1)}
    )
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3)

    def moved(x, c):
        u = np.array([0.03 + 0 * x[0], -0.06 - 0.02 * home(x)[0]])
        return length * np.tensordot(Q[c], u, axes=1)

    for c in range(2):
        body.fix("top", c, lambda x, c=c: moved(x, c))
    body.load("right", 0.005 * E * (Q @ np.array([-1.0, 0.3])))
    centre = length * (Q @ np.array([0.45, -2.02])) + shift
    if law.get("law") == "tresca":
        friction = friction * 0.02 * E
    return ContactProblem(body, "bottom", Cylinder(centre, 2.0 * length), friction, **law)


def grid(element, n=5, graded=False):
    ticks = np.linspace(0, 1, n + 1) ** (1.3 if graded else 1.0)
    return STRAIGHT[element].init_tensor(ticks, ticks)


def traction(result):
    """Traction on the body as vectors, shape (2, m)."""
    rows = result.system.rows
    return -result.pressure * rows.normals + result.shear[:, 0] * rows.tangents[:, 0]


@pytest.fixture(scope="module")
def home():
    """Results in the original place."""
    known = {}

    def solve(element, **keys):
        key = (element, *sorted(keys.items()))
        if key not in known:
            known[key] = pressed(element, grid(element), **keys).solve()
        return known[key]

    return solve


def same(result, reference, Q, shift, length, E, tol):
    """The result is the turned, shifted, scaled reference, up to tol and order along the arc."""
    assert max(result.kkt.values()) < 1e-10
    ours = result.sample(length * (Q @ POINTS) + np.reshape(shift, (2, 1)))
    theirs = length * (Q @ reference.sample(POINTS))
    assert np.abs(ours - theirs).max() < tol * np.abs(theirs).max()

    def sorted_along(r, Q, shift, length):
        x = np.round(Q.T @ (r.x_nominal - np.reshape(shift, (2, 1))) / length, 6)
        return np.argsort(x[0], kind="stable")

    one = traction(result)[:, sorted_along(result, Q, shift, length)]
    two = E * (Q @ traction(reference))[:, sorted_along(reference, np.eye(2), (0, 0), 1.0)]
    assert np.abs(one - two).max() < 10 * tol * np.abs(two).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("law", "friction"), [("coulomb", 0.0), ("coulomb", 0.4), ("tresca", 0.4)])
@pytest.mark.parametrize("element", PLANAR)
def test_rotation(element, law, friction, home):
    reference = home(element, law=law, friction=friction)
    assert 2 <= np.count_nonzero(reference.mu) < reference.mu.size

    @few
    @given(st.floats(-np.pi, np.pi))
    def check(angle):
        Q = turn(angle)
        result = pressed(element, grid(element), Q=Q, law=law, friction=friction).solve()
        # Rounding of the geometry times the condition of the body.
        same(result, reference, Q, (0, 0), 1.0, 1.0, 1e-10)

    check()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", PLANAR)
def test_shift(element, home):
    reference = home(element)

    @few
    @given(st.tuples(*(st.floats(-100.0, 100.0),) * 2))
    def check(shift):
        result = pressed(element, grid(element), shift=shift).solve()
        # Coordinates of size 100 lose two digits against a cell, curvature of the disk two more.
        same(result, reference, np.eye(2), shift, 1.0, 1.0, 1e-9)

    check()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("element", PLANAR)
def test_renumbering(element, seed, home):
    """Vertices and cells in another order; quadrilaterals also begin at another corner."""
    rng = np.random.default_rng(seed)
    mesh = grid(element)
    new = rng.permutation(mesh.p.shape[1])
    p = np.empty_like(mesh.p)
    p[:, new] = mesh.p
    t = new[mesh.t][:, rng.permutation(mesh.t.shape[1])]
    for k in range(t.shape[1]):
        t[:, k] = np.roll(t[:, k], rng.integers(t.shape[0]))
        if rng.random() < 0.5:
            t[:, k] = t[::-1, k]
    sort = {"sort_t": True} if isinstance(mesh, MeshTri) else {}
    result = pressed(element, type(mesh)(p, t, **sort)).solve()
    # Order of summation, times the condition of the body.
    same(result, home(element), np.eye(2), (0, 0), 1.0, 1.0, 1e-11)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize(
    ("length", "stress"),
    [(1e-6, 1e12), (1e-6, 1e-3), (1e-3, 1e6), (1e3, 1e-3), (1e3, 1e12)]
    + [
        pytest.param(length, stress, marks=pytest.mark.slow)
        for length in (1e-6, 1e-3, 1.0, 1e3)
        for stress in (1e-3, 1.0, 1e6, 1e12)
    ],
)
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2])
def test_units(element, stress, length, law, home):
    """Pascal or gigapascal, micrometre or kilometre: every residual is relative."""
    reference = home(element, law=law)
    problem = pressed(element, grid(element), length=length, E=2.0 * stress, law=law)
    result = problem.solve()
    assert max(result.kkt.values()) < 1e-12  # rounding
    # Units are no powers of two: rounding times the condition of the body.
    same(result, reference, np.eye(2), (0, 0), length, stress, 1e-11)


@pytest.mark.parametrize("method", ["pdas", "tresca_loop", "fixed_point", "qp:osqp"])
def test_units_of_every_method(method, home):
    reference = home(ElementTriP2)
    problem = pressed(ElementTriP2, grid(ElementTriP2), length=1e-3, E=4e11)
    result = problem.solve(method)
    ours, theirs = result.sample(1e-3 * POINTS), 1e-3 * reference.sample(POINTS)
    # The fixed point is regularised by 1e-5 of the displacement; QP solvers stop at 1e-7.
    tol = {"fixed_point": 1e-4, "qp:osqp": 1e-5}.get(method, 1e-9)
    assert np.abs(ours - theirs).max() < tol * np.abs(theirs).max()


def test_loads_superpose_without_contact():
    """Out of reach the problem is linear: twice the load, twice the displacement."""
    mesh = grid(ElementTriP2).with_defaults()

    def solve(factor):
        body = ElasticBody.from_mesh(mesh, ElementTriP2(), E=1.0, nu=0.2)
        body.fix("top", "xy").load("right", (0.01 * factor, 0.0)).body_force((0.0, -0.01 * factor))
        return ContactProblem(body, "bottom", 10.0, 0.3).solve()

    one, two = solve(1.0), solve(2.0)
    assert not one.mu.any()
    # Rounding.
    assert np.abs(two.u - 2 * one.u).max() < 1e-13 * np.abs(two.u).max()
