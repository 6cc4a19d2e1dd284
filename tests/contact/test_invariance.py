"""A renumbered, turned or rescaled problem has the renumbered, turned or rescaled solution."""

import numpy as np
import pytest
from families import PLANE, STRAIGHT
from posed_pairs import traction
from skfem import ElementTriP2, MeshTri

from contact import ContactProblem, Cylinder, ElasticBody
from skfem_adini import ElementQuadAdini

PLANAR = [ElementQuadAdini, *PLANE[:4]]
POINTS = np.random.default_rng(8).uniform(0, 1, (2, 60))


def pressed(element, mesh, Q=None, shift=(0.0, 0.0), length=1.0, E=2.0, friction=0.4, **law):
    """A square whose top is moved down and sideways, onto a disk, with a load from the right."""
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


@pytest.mark.parametrize("method", ["pdas", "tresca_loop", "fixed_point", "qp:osqp"])
def test_units_of_every_method(method, home):
    reference = home(ElementTriP2)
    problem = pressed(ElementTriP2, grid(ElementTriP2), length=1e-3, E=4e11)
    result = problem.solve(method)
    ours, theirs = result.sample(1e-3 * POINTS), 1e-3 * reference.sample(POINTS)
    # The fixed point is regularised by 1e-5 of the displacement; QP solvers stop at 1e-7.
    tol = {"fixed_point": 1e-4, "qp:osqp": 1e-5}.get(method, 1e-9)
    assert np.abs(ours - theirs).max() < tol * np.abs(theirs).max()
