"""A pair of bodies moved, turned, mirrored, halved, rescaled or renamed: one answer."""

import numpy as np
import pytest
from families import PLANE, SOLID
from posed_pairs import Pose, blocks, mirrored, posed, rotation, traction

from contact import Anisotropic, ContactProblem, ElasticBody, Pair, Status, Tie
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def same(found, expected, pose, tol):
    """Forces and tractions point by point and displacements of both bodies, mapped by the pose."""
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


everything = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


POSES = {
    "turned and moved": lambda dim: Pose(rotation(dim, 1), np.arange(dim) - 1.7),
    "mirrored": lambda dim: Pose(-rotation(3, 5) if dim == 3 else np.diag([-1.0, 1.0])),
    "mm": lambda dim: Pose(np.eye(dim), size=1e3, stress=1e-6),
    "microns": lambda dim: Pose(np.eye(dim), size=1e6, stress=1e-12),
    "km and steel": lambda dim: Pose(np.eye(dim), size=1e-3, stress=2.1e11),
    "named in the other order": lambda dim: Pose(np.eye(dim)),
}


@pytest.mark.sampled(12)
@pytest.mark.parametrize(
    ("law", "friction"), [("coulomb", 0.0), ("coulomb", 0.8), ("tresca", None)]
)
@pytest.mark.parametrize("name", POSES)
@everything
def test_poses(element, name, law, friction):
    """Newtons are kept in other units; the multipliers stay with the upper body."""
    dim = element().dim
    pose, laws = POSES[name](dim), {"law": law, "friction": friction}
    upright = posed(element, Pose(np.eye(dim)), **laws)
    if friction == 0.8:
        assert set(upright[0].solve().status) == {Status.OPEN, Status.SLIP, Status.STICK}
    same(posed(element, pose, swap="order" in name, **laws), upright, pose, 1e-9)


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
    upper, lower = (
        ElasticBody.from_mesh(one.mesh, element(), material=anisotropic(dim, pose, scale))
        for one, scale in zip(blocks(element, pose), (3.0, 1.0), strict=True)
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


# Adini's multipliers on an end of the interface in the plane are not those within it.
ELEMENTS = [e for e in PLANE + SOLID if e is not ElementQuadAdini]
PLANES = {"left": 0, "front": 1}


def doubled(mesh, axis):
    """The mesh and its image in the plane of zero of an axis; `+` rounds to 8 decimals."""
    image = mesh.p.copy()
    image[axis] *= -1
    return mesh + type(mesh)(image, mirrored(mesh), sort_t=False)


def solved(make, element, parts, kind, functional, friction=0.5):
    """Two bodies modelled in full, or cut by the named planes of symmetry."""
    space = element in SOLID
    dim, bodies = 2 + space, []
    for n, rows, wide, heights, E in (
        (4, 3, 1.0, (0, 0.4, 0.8), 3.0),
        (3, 4, 1.2, (-0.8, -0.3, 0), 1.0),
    ):
        sides = [np.linspace(0, wide, n + 1)] + [np.linspace(0, wide, rows)] * space
        mesh = make.box(element, *sides, heights)
        for axis in range(dim - 1):
            if axis not in parts:
                mesh = doubled(mesh, axis)
        names = {
            name: (lambda x, k=k, v=v: np.abs(x[k] - v) < 1e-9)
            for name, k, v in (("bottom", -1, heights[0]), ("top", -1, heights[-1]))
        }
        names |= {name: (lambda x, k=k: np.abs(x[k]) < 1e-9) for name, k in PLANES.items()}
        names = {name: mesh.facets_satisfying(of, True) for name, of in names.items()}
        mesh = type(mesh)(mesh.p, mesh.t, sort_t=False).with_boundaries(names)
        body = ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3)
        for name, axis in PLANES.items():
            if axis in parts:
                body.fix(name, axis)
        bodies.append(body)
    upper, lower = bodies
    for k in range(dim - 1):
        upper.fix("top", k, lambda x, k=k: (0.004 - 0.007 * k) * x[k])
    upper.fix("top", dim - 1, lambda x: -0.04 + 0.03 * x[0] ** 2 + 0.01 * x[-2] ** 2)
    lower.fix("bottom")
    more = {} if kind is Tie else {"friction": friction}
    pair = kind(upper, "bottom", lower, "top", functional=functional, **more)
    return ContactProblem([upper, lower], [pair]).solve(), upper, lower


def compare(part, whole, tol):
    (result, *bodies), (reference, *others) = part, whole
    near = np.abs(result.x_nominal[:, :, None] - reference.x_nominal[:, None]).max(axis=0)
    match = near.argmin(axis=1)
    assert near.min(axis=1).max() < 1e-9
    off = np.abs(traction(result) - traction(reference)[:, match]).max()
    assert off <= tol * np.abs(traction(reference)).max()
    for part_body, other in zip(bodies, others, strict=True):
        x = part_body.mesh.p[:, part_body.mesh.t].mean(axis=1)
        u = reference[other].sample(x)
        assert np.abs(result[part_body].sample(x) - u).max() <= tol * np.abs(u).max()
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.sampled(7)
@pytest.mark.parametrize(
    ("element", "kind"), [*((e, Pair) for e in ELEMENTS), *((e, Tie) for e in SOLID[:4])]
)
@pytest.mark.parametrize("functional", [None, "standard", "hat"])
def test_planes_of_symmetry(element, functional, kind, make):
    """A half or a quarter of two bodies has the tractions of the whole."""
    # Derivatives of Adini vanish on planes of symmetry in the whole, in parts weakly.
    tol = 5e-3 if element is ElementHexAdini else 1e-9
    whole = solved(make, element, (), kind, functional)
    shear = whole[0].shear + whole[0].tie_shear
    assert np.abs(shear).max() > 0.05 * np.abs(whole[0].pressure + whole[0].tie_pressure).max()
    for parts in ((0,), (1,), (0, 1)) if element in SOLID else ((0,),):
        compare(solved(make, element, parts, kind, functional), whole, tol)
