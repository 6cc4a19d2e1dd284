"""A pair of bodies moved, turned, mirrored, rescaled, or named in the other order: one answer."""

import numpy as np
import pytest
from families import PLANE, SOLID
from posed_pairs import Pose, posed
from scipy.spatial.transform import Rotation

from contact import Status

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


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
    off = traction(one)[:, match] / pose.stress - pose.Q @ traction(two)
    assert np.abs(off).max() <= tol * np.abs(two.pressure).max()
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
        found = posed(element, pose, law=law, friction=friction)
        same(found, reference, pose, 1e-9)


@everything
def test_mirror(element, upright):
    """Reflected and turned: an improper motion."""
    dim = 3 if element in SOLID else 2
    for Q in (np.diag([-1.0, *[1.0] * (dim - 1)]), -rotation(3, 5) if dim == 3 else None):
        if Q is not None:
            pose = Pose(Q)
            same(posed(element, pose), upright(element), pose, 1e-9)


@pytest.mark.parametrize(("size", "stress"), [(1e3, 1e-6), (1e6, 1e-12), (1e-3, 2.1e11)])
@everything
def test_units(element, size, stress, upright):
    """Metres, millimetres, microns; newtons kept, so that stresses change with areas."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim), size=size, stress=stress)
    same(posed(element, pose), upright(element), pose, 1e-9)


@everything
def test_roles(element, upright):
    """The multipliers stay with the upper body, which is named second."""
    dim = 3 if element in SOLID else 2
    pose = Pose(np.eye(dim))
    same(posed(element, pose, swap=True), upright(element), pose, 1e-10)
