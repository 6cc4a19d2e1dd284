"""A pair of bodies moved, turned, mirrored, rescaled, or named in the other order: one answer."""

import numpy as np
import pytest
from families import PLANE, SOLID
from posed_pairs import Pose, body, posed
from scipy.spatial.transform import Rotation

from contact import Anisotropic, ContactProblem, ElasticBody, Status, Tie

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def traction(result):
    """Traction on the body with the multipliers at its places, shape (dim, m)."""
    rows = result.system.rows
    p, t = result.pressure + result.tie_pressure, result.shear + result.tie_shear
    return np.einsum("mj,djm->dm", t, rows.tangents) - p * rows.normals


def same(found, expected, pose, tol):
    """Forces and tractions point by point and displacements of both bodies, mapped by the pose.

    A traction is a force over a weight: where the weight is small, as at a hardly covered facet at
    the end of a tie, the traction has as many digits less than the force.
    """
    (problem, *bodies), (home, *originals) = found, expected
    one, two = problem.solve(), home.solve()
    assert max(one.kkt.values()) <= 1e-10
    at, where = pose.home(one.x_nominal), two.x_nominal
    near = np.abs(at[:, :, None] - where[:, None]).max(axis=0)
    match = near.argmin(axis=0)
    assert near[match, np.arange(match.size)].max() < 1e-6
    assert np.unique(match).size == match.size == one.pressure.size
    off = traction(one)[:, match] / pose.stress - pose.Q @ traction(two)
    weights = two.system.rows.weights
    np.testing.assert_allclose(
        one.system.rows.weights[match] / pose.size ** (len(at) - 1), weights, rtol=1e-8
    )
    forces = weights * traction(two)
    assert np.abs(weights * off).max() <= tol * np.abs(forces).max()
    covered = weights >= 1e-2 * weights.max()
    assert np.abs(off[:, covered]).max() <= tol * np.abs(traction(two)[:, covered]).max()
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
            known[key] = posed(element, Pose(np.eye(3 if element in SOLID else 2)), **more)
        return known[key]

    return get


LAWS = [("coulomb", 0.0), ("coulomb", 0.8), ("tresca", None)]
everything = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


@pytest.mark.sampled(4)
@everything
def test_the_pair_sticks_slips_and_opens(element, upright):
    status = set(upright(element)[0].solve().status)
    assert status == {Status.OPEN, Status.SLIP, Status.STICK}


@pytest.mark.sampled(7)
@pytest.mark.parametrize(("law", "friction"), LAWS)
@everything
def test_rigid_motion(element, law, friction, upright):
    reference = upright(element, law=law, friction=friction)
    dim = 3 if element in SOLID else 2
    for seed in (1, 2):
        shift = np.random.default_rng(seed).uniform(-3, 3, dim)
        pose = Pose(rotation(dim, seed), shift)
        found = posed(element, pose, law=law, friction=friction)
        same(found, reference, pose, 1e-9)


@pytest.mark.sampled(3)
@everything
def test_mirror(element, upright):
    """Reflected and turned: an improper motion."""
    dim = 3 if element in SOLID else 2
    for Q in (np.diag([-1.0, *[1.0] * (dim - 1)]), -rotation(3, 5) if dim == 3 else None):
        if Q is not None:
            pose = Pose(Q)
            same(posed(element, pose), upright(element), pose, 1e-9)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("size", "stress"), [(1e3, 1e-6), (1e6, 1e-12), (1e-3, 2.1e11)])
@everything
def test_units(element, size, stress, upright):
    """Metres, millimetres, microns; newtons kept, so that stresses change with areas."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim), size=size, stress=stress)
    same(posed(element, pose), upright(element), pose, 1e-9)


@pytest.mark.sampled(2)
@everything
def test_roles(element, upright):
    """The multipliers stay with the upper body, which is named second."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim))
    same(posed(element, pose, swap=True), upright(element), pose, 1e-10)


def anisotropic(dim, pose, scale):
    """A stiffness without symmetry but that of the plane, turned and rescaled with the body."""
    C = np.diag([4.0, 5.0, 6.0, 1.0, 1.2, 1.5])
    C[0, 1] = C[1, 0] = 1.0
    C[0, 5] = C[5, 0] = 0.5
    if dim == 3:
        C[2, 3] = C[3, 2] = 0.4
        C[1, 4] = C[4, 1] = -0.3
    R = np.eye(3)
    R[:dim, :dim] = pose.Q
    return Anisotropic(scale * pose.stress * C, rotation=R)


def heated(element, pose, functional):
    """Anisotropic bodies, bonded; the upper one heated, lifted, dragged and bent."""
    dim = pose.Q.shape[0]
    across = [np.array([0.1, 0.35, 0.7, 1.05])] * (dim - 2)
    below = [np.linspace(0.0, 1.0, 4)] * (dim - 2)
    n = 7 if dim == 2 else 3
    upper, lower = (
        body(element, (np.linspace(low, high, k + 1), *sides, heights), 1.0, pose)
        for low, high, k, sides, heights in (
            (0.2, 1.3, n, across, [0.0, 0.4, 0.8]),
            (0.0, 1.0, n + 2, below, [-0.8, -0.3, 0.0]),
        )
    )
    upper, lower = (
        ElasticBody.from_mesh(one.mesh, element(), material=anisotropic(dim, pose, scale))
        for one, scale in ((upper, 3.0), (lower, 1.0))
    )

    def moved(x):
        y = pose.home(x)
        u = [0.004 - 0.002 * y[0], *[0.003 + 0 * y[0]] * (dim - 2), 0.01 + 0.01 * y[0]]
        return pose.size * np.tensordot(pose.Q, np.array(u), 1)

    for c in range(dim):
        upper.fix("top", c, lambda x, c=c: moved(x)[c])
        lower.fix("bottom", c)
    upper.heat(lambda x: 0.5 + pose.home(x)[0], 0.01)
    tie = Tie(upper, "bottom", lower, "top", functional=functional)
    return ContactProblem([upper, lower], [tie]), upper, lower


@pytest.mark.sampled(7)
@pytest.mark.parametrize("functional", [None, "standard", "hat"])
@everything
def test_ties_of_heated_anisotropic_bodies(element, functional):
    dim = 3 if element in SOLID else 2
    pose = Pose(rotation(dim, 3), np.arange(dim) - 0.7, size=1e-3, stress=1e9)
    expected = heated(element, Pose(np.eye(dim)), functional)
    # A tenth of the last facet is covered: cubic functions on it nearly depend on one another, and
    # forces that cancel there are determined to a digit less than the displacements.
    same(heated(element, pose, functional), expected, pose, 1e-8)
