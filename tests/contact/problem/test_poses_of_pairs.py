"""A pair of bodies moved, turned, mirrored, rescaled, or with its roles swapped: the same answer.

The pair sticks, slips and opens: an upper block is pushed down, sideways and turned on a lower one
that it covers in part, with a load on a side and body forces.
"""

import numpy as np
import pytest
from families import PLANE, SOLID, STRAIGHT
from scipy.spatial.transform import Rotation

from contact import ContactProblem, ElasticBody, Pair, Status

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
STIFF, SOFT = 3.0, 1.0


class Pose:
    """x to ``size (Q x) + shift``, stresses times `stress`."""

    def __init__(self, Q, shift=0.0, size=1.0, stress=1.0):
        self.Q, self.size, self.stress = np.asarray(Q, float), size, stress
        self.shift = np.broadcast_to(shift, self.Q.shape[:1]).astype(float)

    def __call__(self, x):
        return self.size * np.tensordot(self.Q, x, 1) + self.shift.reshape(-1, *(1,) * (x.ndim - 1))

    def home(self, x):
        moved = x - self.shift.reshape(-1, *(1,) * (x.ndim - 1))
        return np.tensordot(self.Q.T, moved, 1) / self.size


def body(element, ticks, E, pose):
    mesh = STRAIGHT[element].init_tensor(*ticks)
    names = {
        name: mesh.facets_satisfying(lambda x, k=k, v=v: np.abs(x[k] - v) < 1e-9, True)
        for name, k, v in (
            ("bottom", -1, ticks[-1][0]),
            ("top", -1, ticks[-1][-1]),
            ("right", 0, ticks[0][-1]),
        )
    }
    if np.linalg.det(pose.Q) < 0:
        mesh, names = reflected(mesh, names)
    mesh = type(mesh)(pose(mesh.p), mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=E * pose.stress, nu=0.3)


def reflected(mesh, names):
    """The same cells, with the first two axes of the reference cell exchanged."""
    corners = mesh.elem.refdom.p
    swapped = corners[[1, 0, *range(2, mesh.dim())]]
    order = [int(np.flatnonzero((c == corners.T).all(axis=1))[0]) for c in swapped.T]
    turned = type(mesh)(mesh.p, mesh.t[order], sort_t=False)
    keys = {tuple(sorted(f)): k for k, f in enumerate(turned.facets.T)}
    found = {
        name: np.array([keys[tuple(sorted(mesh.facets[:, f]))] for f in facets])
        for name, facets in names.items()
    }
    return turned, found


def problem(element, pose, friction=0.8, swap=False, law="coulomb"):
    """The pair in its pose; with swap its bodies are named in the other order."""
    dim = pose.Q.shape[0]
    across = [np.array([0.1, 0.35, 0.7, 1.05])] * (dim - 2)
    below = [np.linspace(0.0, 1.0, 4)] * (dim - 2)
    n = 7 if dim == 2 else 3
    upper = body(element, (np.linspace(0.2, 1.3, n + 1), *across, [0.0, 0.4, 0.8]), STIFF, pose)
    lower = body(element, (np.linspace(0, 1, n + 3), *below, [-0.8, -0.3, 0]), SOFT, pose)

    def pushed(x):
        y = pose.home(x)
        u = [0.002 + 0 * y[0], *[-0.001 + 0 * y[0]] * (dim - 2), -0.04 + 0.035 * y[0]]
        return pose.size * np.tensordot(pose.Q, np.array(u), 1)

    for c in range(dim):
        upper.fix("top", c, lambda x, c=c: pushed(x)[c])
        lower.fix("bottom", c)
    side = np.array([-0.004, 0.003, 0.002])[-dim:]
    upper.load("right", pose.stress * (pose.Q @ side))
    lower.body_force(pose.stress / pose.size * (pose.Q @ side))
    if law == "tresca":
        friction = 0.01 * pose.stress
    if swap:
        pair = Pair(lower, "top", upper, "bottom", friction=friction, multipliers="second")
    else:
        pair = Pair(upper, "bottom", lower, "top", friction=friction)
    return ContactProblem([lower, upper] if swap else [upper, lower], [pair], law=law), upper, lower


def traction(result):
    """Traction on the body with the multipliers at its places, shape (dim, m)."""
    rows = result.system.rows
    return np.einsum("mj,djm->dm", result.shear, rows.tangents) - result.pressure * rows.normals


def same(found, expected, pose, tol):
    """Tractions point by point and displacements of both bodies, mapped by the pose."""
    (problem, *bodies), (home, *originals) = found, expected
    one, two = problem.solve(), home.solve()
    assert max(one.kkt.values()) <= 1e-10
    at, where = pose.home(one.x_nominal), two.x_nominal
    near = np.abs(at[:, :, None] - where[:, None]).max(axis=0)
    match = near.argmin(axis=0)
    assert near[match, np.arange(match.size)].max() < 1e-6
    assert np.unique(match).size == match.size == one.pressure.size
    size = np.abs(two.pressure).max()
    assert (
        np.abs(traction(one)[:, match] / pose.stress - pose.Q @ traction(two)).max() <= tol * size
    )
    np.testing.assert_array_equal(one.status[match], two.status)
    for ours, theirs in zip(bodies, originals, strict=True):
        x = theirs.mesh.p[:, theirs.mesh.t].mean(axis=1)
        u = one[ours].sample(pose(x)) / pose.size
        v = pose.Q @ two[theirs].sample(x)
        assert np.abs(u - v).max() <= tol * np.abs(v).max()


def rotation(dim, seed):
    if dim == 3:
        return Rotation.random(random_state=seed).as_matrix()
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.fixture(scope="module")
def upright():
    """The pair as it stands, once for each element and law."""
    known = {}

    def get(element, **more):
        key = (element, *sorted(more.items()))
        if key not in known:
            known[key] = problem(element, Pose(np.eye(3 if element in SOLID else 2)), **more)
        return known[key]

    return get


LAWS = [("coulomb", 0.0), ("coulomb", 0.8), ("tresca", None)]
everything = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


@everything
def test_the_pair_sticks_slips_and_opens(element, upright):
    status = set(upright(element)[0].solve().status)
    assert status == {Status.OPEN, Status.SLIP, Status.STICK}


@pytest.mark.parametrize(("law", "friction"), LAWS)
@everything
def test_rigid_motion(element, law, friction, upright):
    reference = upright(element, law=law, friction=friction)
    dim = 3 if element in SOLID else 2
    for seed in (1, 2):
        shift = np.random.default_rng(seed).uniform(-3, 3, dim)
        pose = Pose(rotation(dim, seed), shift)
        found = problem(element, pose, law=law, friction=friction)
        same(found, reference, pose, 1e-9)


@everything
def test_mirror(element, upright):
    """Reflected and turned: an improper motion."""
    dim = 3 if element in SOLID else 2
    for Q in (np.diag([-1.0, *[1.0] * (dim - 1)]), -rotation(3, 5) if dim == 3 else None):
        if Q is not None:
            pose = Pose(Q)
            same(problem(element, pose), upright(element), pose, 1e-9)


@pytest.mark.parametrize(("size", "stress"), [(1e3, 1e-6), (1e6, 1e-12), (1e-3, 2.1e11)])
@everything
def test_units(element, size, stress, upright):
    """Metres, millimetres, microns; newtons kept, so that stresses change with areas."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim), size=size, stress=stress)
    same(problem(element, pose), upright(element), pose, 1e-9)


@everything
def test_roles(element, upright):
    """The multipliers stay with the upper body, which is named second."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim))
    same(problem(element, pose, swap=True), upright(element), pose, 1e-10)
