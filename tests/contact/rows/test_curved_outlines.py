"""Pressures on curved outlines of straight and of curved facets: Lame's ring, shear included.

Plane strain, radii a < b, a quarter: shrunk by D into a rigid hole, or onto a rigid shaft, given
as a gap of one size, so that the polygon's own sagitta does not matter (S. P. Timoshenko and J. N.
Goodier, Theory of Elasticity, 3rd ed., McGraw-Hill 1970, article 28).
"""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshHex2,
    MeshQuad2,
    MeshTet2,
    MeshTri2,
)

from contact import ContactProblem, ElasticBody, InputError
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

B, D, NU, DEPTH = 2.0, 0.05, 0.3, 0.3
SECOND = {
    ElementTriP1: MeshTri2,
    ElementTriP2: MeshTri2,
    ElementQuad1: MeshQuad2,
    ElementQuad2: MeshQuad2,
    ElementTetP1: MeshTet2,
    ElementTetP2: MeshTet2,
    ElementHex1: MeshHex2,
    ElementHex2: MeshHex2,
}
PLANE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
SOLID = [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini]
LINEAR = (ElementTriP1, ElementTetP1)
CASES = [(e, c) for e in PLANE + SOLID for c in (False, True) if not c or e in SECOND]


def ring(make, element, n, curved=False, a=1.0, angles=None, size=1.0, turn=0.0):
    """A quarter of the ring, n facets on its outer side, held in its planes of symmetry."""
    solid = element in SOLID
    angles = np.linspace(0, np.pi / 2, n + 1) if angles is None else angles
    ticks = [np.linspace(a, B, max(2, n // 2) + 1), angles]
    mesh = make.box(element, *ticks, *([np.array([0.0, DEPTH])] if solid else []))
    names = dict(mesh.boundaries)
    if curved:
        mesh = SECOND[element].from_mesh(mesh)
    ends = ("bottom", "top") if not solid else ("front", "back")
    place = mesh.doflocs.copy()
    place[:2] = place[0] * np.array([np.cos(place[1] + turn), np.sin(place[1] + turn)])
    mesh = type(mesh)(size * place, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU)
    body.fix(ends[0], "y").fix(ends[1], "x")
    return body.fix(["bottom", "top"], "z") if solid else body


def lame(where, a=1.0):
    """Pressure on the side that is moved by D."""
    E, nu = 1 / (1 - NU**2), NU / (1 - NU)
    k = (B**2 + a**2) / (B**2 - a**2)
    return D * E / (B * (k - nu)) if where == "right" else D * E / (a * (k + nu))


def errors(result, exact):
    """Rms and largest error of the pressure, largest shear, in parts of the exact pressure."""
    off, w = result.pressure / exact - 1, result.system.rows.weights
    rms = float(np.sqrt(np.sum(w * off**2) / w.sum()))
    return rms, float(np.abs(off).max()), float(np.abs(result.shear).max() / exact)


def solved(make, element, n, curved, where):
    """Errors of the ring with friction."""
    result = ContactProblem(ring(make, element, n, curved), where, -D, 0.3).solve()
    return errors(result, lame(where))


def ids(value):
    return getattr(value, "__name__", str(value))


def order(facets, found):
    return -np.polyfit(np.log(facets), np.log(found), 1)[0]


@pytest.mark.parametrize(("element", "curved"), CASES, ids=ids)
def test_ring_in_a_hole(element, curved, make):
    """Uniform pressure, no shear; the triangles of P1 know their stress to first order only."""
    facets = [6, 12, 24] if element in PLANE else [4, 8, 12]
    found = [
        errors(
            ContactProblem(ring(make, element, n, curved), "right", -D, 0.3).solve(), lame("right")
        )
        for n in facets
    ]
    rms, worst, shear = np.array(found).T
    finest = 0.01 if element in PLANE else 0.03  # at 24 and at 12 facets
    # The last number of P1 triangles, on the plane of symmetry, belongs to one of them alone.
    assert rms[-1] < finest
    assert worst[-1] < (0.1 if element in LINEAR else 2 * finest)
    assert order(facets, rms) > (1.0 if element in LINEAR else 1.2)
    assert shear[-1] < (0.03 if element in LINEAR else 0.02)


@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE], ids=ids)
def test_ring_on_a_shaft(element, curved, make):
    """The bore, where stresses change fastest, so that linear elements need finer meshes."""
    facets = [6, 12, 24]
    found = [
        errors(
            ContactProblem(ring(make, element, n, curved), "left", -D, 0.3).solve(), lame("left")
        )
        for n in facets
    ]
    rms, _worst, shear = np.array(found).T
    assert rms[-1] < (0.03 if element in LINEAR else 0.01)
    assert order(facets, rms) > (1.1 if element in LINEAR else 1.2)
    assert shear[-1] < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in SOLID], ids=ids)
def test_solid_ring_on_a_shaft(element, curved, make):
    facets = [4, 8, 12]
    rms = [solved(make, element, n, curved, "left")[0] for n in facets]
    # Stresses of P1 are of first order, and the bore has few tetrahedra.
    assert rms[-1] < (0.15 if element is ElementTetP1 else 0.01)
    assert order(facets, rms) > (0.8 if element is ElementTetP1 else 1.2)


@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE], ids=ids)
def test_graded_facets(element, curved, make):
    """Lengths of facets in the ratio of one to a hundred."""
    facets, rms = [12, 24, 48], []
    for n in facets:
        length = 100 ** np.linspace(0, 1, n)
        angles = 0.5 * np.pi * np.r_[0, np.cumsum(length)] / length.sum()
        body = ring(make, element, n, curved, angles=angles)
        rms.append(errors(ContactProblem(body, "right", -D, 0.3).solve(), lame("right"))[0])
    assert rms[1] < 0.015
    assert order(facets, rms) > 1.5


@pytest.mark.parametrize(("size", "turn"), [(1e-6, 0.0), (1e3, 0.0), (1.0, np.pi / 2)])
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE], ids=ids)
def test_units_and_directions(element, curved, size, turn, make):
    """The same errors in any unit of length; turned, the planes of symmetry change places."""
    found = []
    for scale, angle in ((1.0, 0.0), (size, turn)):
        body = ring(make, element, 6, curved, size=scale, turn=angle)
        if angle:
            body = ElasticBody.from_mesh(body.mesh, element(), E=1.0, nu=NU)
            body.fix("bottom", "x").fix("top", "y")
        result = ContactProblem(body, "right", -D * scale, 0.3).solve()
        found.append(errors(result, lame("right")))
    assert np.abs(np.diff(found, axis=0)).max() < 1e-10  # rounding of a factorisation


@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE], ids=ids)
def test_errors_are_those_of_the_displacement(element, curved, make):
    """Lame's pressure as a load, and what it displaces as a gap, give the pressure back.

    So P1's error, of first order at the ends of the bore and of second between, is its own
    displacement's, which a load without contact shows too.
    """
    body, loaded = ring(make, element, 12, curved), ring(make, element, 12, curved)
    exact = lame("left")
    loaded.load("left", lambda x: exact * x / np.linalg.norm(x, axis=0))
    P, _ = loaded.constraint
    u = P @ spsolve((P.T @ loaded.stiffness @ P).tocsc(), P.T @ loaded.f)
    gap = ContactProblem(body, "left", 0.0).rows.G @ u
    rms, _, _ = errors(ContactProblem(body, "left", gap).solve(), exact)
    # The load is radial, the contact along the facets' normals: they differ by half a turn squared.
    assert rms < (np.pi / 4 / 12) ** 2


@pytest.mark.parametrize("functional", ["gauss", "centroid"])
def test_other_functionals_of_adini(functional, make):
    facets, found = [6, 12, 24], []
    for n in facets:
        problem = ContactProblem(
            ring(make, ElementQuadAdini, n), "left", -D, 0.3, functional=functional
        )
        found.append(errors(problem.solve(), lame("left")))
    rms, worst, shear = np.array(found).T
    assert rms[-1] < 0.005
    assert worst[-1] < 0.005
    assert shear[-1] < 0.05
    assert order(facets, rms) > 1.8


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2, ElementQuadAdini], ids=ids)
def test_gauss_points_are_not_taken_on_curves(element, make):
    body = ring(make, element, 4)
    chosen, default = (ContactProblem(body, "right", -D, functional=f) for f in ("gauss", None))
    assert chosen.rows.functional == default.rows.functional == "bernstein"
    assert (chosen.rows.G - default.rows.G).nnz == 0


def test_thesis_points_are_refused_on_curves(make):
    with pytest.raises(InputError, match="curved boundary"):
        ContactProblem(ring(make, ElementQuadAdini, 4), "right", -D, functional="thesis")


@pytest.mark.parametrize("element", PLANE + SOLID, ids=ids)
@pytest.mark.parametrize("n", [2, 3, 7])
def test_hydrostatic_state_of_a_polygon(element, n, make):
    """A regular polygon that shrinks evenly: each facet moves in by D, the pressure is one."""
    body = ring(make, element, n, a=0.4)
    shrunk = D / (B * np.cos(np.pi / 4 / n))  # in parts of the distance of a facet
    for c in range(body.dim - 1 if body.dim == 3 else 2):
        body.fix("left", c, lambda x, c=c: -shrunk * x[c])
    result = ContactProblem(body, "right", -D, 0.3).solve()
    exact = shrunk / ((1 + NU) * (1 - 2 * NU))
    # Rounding of a factorisation; Adini's twisted cells hold linear fields as exactly.
    assert np.abs(result.pressure / exact - 1).max() < 1e-9
    assert np.abs(result.shear).max() < 1e-9 * exact
