"""A half or a quarter of two bodies between planes of symmetry has the tractions of the whole."""

import numpy as np
import pytest
from families import PLANE, SOLID
from skfem import ElementHex1, ElementHex2, ElementTetP1, ElementTetP2

from contact import ContactProblem, ElasticBody, Pair, Tie
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
# Adini's multipliers on an end of the interface in the plane are not those within it.
ELEMENTS = [e for e in PLANE + SOLID if e is not ElementQuadAdini]
PLANES = {"left": 0, "front": 1}


def reflected(mesh, axis):
    """The mesh and its image in the plane of zero of an axis; `+` rounds to 8 decimals."""
    corners = mesh.elem.refdom.p
    swapped = corners[[1, 0, *range(2, mesh.dim())]]
    order = [int(np.flatnonzero((c == corners.T).all(axis=1))[0]) for c in swapped.T]
    image = mesh.p.copy()
    image[axis] *= -1
    return mesh + type(mesh)(image, mesh.t[order], sort_t=False)


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
                mesh = reflected(mesh, axis)
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
    if kind is Tie:
        pair = Tie(upper, "bottom", lower, "top", functional=functional)
    else:
        pair = Pair(upper, "bottom", lower, "top", friction=friction, functional=functional)
    return ContactProblem([upper, lower], [pair]).solve(), upper, lower


def traction(result):
    rows = result.system.rows
    p, t = result.pressure + result.tie_pressure, result.shear + result.tie_shear
    return np.einsum("mj,djm->dm", t, rows.tangents) - p * rows.normals


def compare(part, whole, tol):
    (result, *bodies), (reference, *others) = part, whole
    near = np.abs(result.x_nominal[:, :, None] - reference.x_nominal[:, None]).max(axis=0)
    match = near.argmin(axis=1)
    assert near.min(axis=1).max() < 1e-9
    off = np.abs(traction(result) - traction(reference)[:, match]).max()
    assert off <= tol * np.abs(traction(reference)).max()
    for body, other in zip(bodies, others, strict=True):
        x = body.mesh.p[:, body.mesh.t].mean(axis=1)
        u = reference[other].sample(x)
        assert np.abs(result[body].sample(x) - u).max() <= tol * np.abs(u).max()
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.sampled(7)
@pytest.mark.parametrize("functional", [None, "standard", "hat"])
@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.__name__)
def test_contact_with_friction(element, functional, make):
    # Derivatives of Adini vanish on planes of symmetry in the whole, in parts weakly.
    tol = 5e-3 if element is ElementHexAdini else 1e-9
    whole = solved(make, element, (), Pair, functional)
    assert np.abs(whole[0].shear).max() > 0.05 * whole[0].pressure.max()
    for parts in ((0,), (1,), (0, 1)) if element in SOLID else ((0,),):
        compare(solved(make, element, parts, Pair, functional), whole, tol)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("functional", [None, "standard", "hat"])
@pytest.mark.parametrize(
    "element", [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2], ids=lambda e: e.__name__
)
def test_ties(element, functional, make):
    whole = solved(make, element, (), Tie, functional)
    for parts in ((0,), (1,), (0, 1)):
        compare(solved(make, element, parts, Tie, functional), whole, 1e-9)
