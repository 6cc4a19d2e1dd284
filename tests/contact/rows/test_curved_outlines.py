"""Pressures on curved outlines of straight and of curved facets: Lame's ring, shear included.

The ring is shrunk by D into a rigid hole, or onto a rigid shaft, given as a gap of one size, so
that the polygon's own sagitta does not matter.
"""

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE, SOLID
from rings import NU, B, lame, ring
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad2, ElementTetP1, ElementTriP1, ElementTriP2

from contact import ContactProblem, ElasticBody, InputError
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

D = 0.05
LINEAR = (ElementTriP1, ElementTetP1)
CASES = [(e, c) for e in PLANE + SOLID for c in (False, True) if not c or e in CURVED]


def errors(result, exact):
    """Rms and largest error of the pressure, largest shear, in parts of the exact pressure."""
    off, w = result.pressure / exact - 1, result.system.rows.weights
    rms = float(np.sqrt(np.sum(w * off**2) / w.sum()))
    return rms, float(np.abs(off).max()), float(np.abs(result.shear).max() / exact)


def solved(make, element, n, curved, where):
    """Errors of the ring with friction."""
    result = ContactProblem(ring(make, element, n, curved), where, -D, 0.3).solve()
    return errors(result, lame(where, D))


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("element", "curved"), CASES)
def test_ring_in_a_hole(element, curved, make):
    """Uniform pressure, no shear; the triangles of P1 know their stress to first order only."""
    facets = [6, 12, 24] if element in PLANE else [4, 8, 12]
    found = [solved(make, element, n, curved, "right") for n in facets]
    rms, worst, shear = np.array(found).T
    finest = 0.01 if element in PLANE else 0.03  # at 24 and at 12 facets
    # The last number of P1 triangles, on the plane of symmetry, belongs to one of them alone.
    assert rms[-1] < finest
    assert worst[-1] < (0.1 if element in LINEAR else 2 * finest)
    assert order(facets, rms) > (1.0 if element in LINEAR else 1.2)
    assert shear[-1] < (0.03 if element in LINEAR else 0.02)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE])
def test_ring_on_a_shaft(element, curved, make):
    """The bore, where stresses change fastest, so that linear elements need finer meshes."""
    facets = [6, 12, 24]
    found = [solved(make, element, n, curved, "left") for n in facets]
    rms, _worst, shear = np.array(found).T
    assert rms[-1] < (0.03 if element in LINEAR else 0.01)
    assert order(facets, rms) > (1.1 if element in LINEAR else 1.2)
    assert shear[-1] < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in SOLID])
def test_solid_ring_on_a_shaft(element, curved, make):
    facets = [4, 8, 12]
    rms = [solved(make, element, n, curved, "left")[0] for n in facets]
    # Stresses of P1 are of first order, and the bore has few tetrahedra.
    assert rms[-1] < (0.15 if element is ElementTetP1 else 0.01)
    assert order(facets, rms) > (0.8 if element is ElementTetP1 else 1.2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE])
def test_graded_facets(element, curved, make):
    """Lengths of facets in the ratio of one to a hundred."""
    facets, rms = [12, 24, 48], []
    for n in facets:
        length = 100 ** np.linspace(0, 1, n)
        angles = 0.5 * np.pi * np.r_[0, np.cumsum(length)] / length.sum()
        body = ring(make, element, n, curved, angles=angles)
        rms.append(errors(ContactProblem(body, "right", -D, 0.3).solve(), lame("right", D))[0])
    assert rms[1] < 0.015
    assert order(facets, rms) > 1.5


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("size", "turn"), [(1e-6, 0.0), (1e3, 0.0), (1.0, np.pi / 2)])
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE])
def test_units_and_directions(element, curved, size, turn, make):
    """The same errors in any unit of length; turned, the planes of symmetry change places."""
    found = []
    for scale, angle in ((1.0, 0.0), (size, turn)):
        body = ring(make, element, 6, curved, size=scale, turn=angle)
        if angle:
            body = ElasticBody.from_mesh(body.mesh, element(), E=1.0, nu=NU)
            body.fix("bottom", "x").fix("top", "y")
        result = ContactProblem(body, "right", -D * scale, 0.3).solve()
        found.append(errors(result, lame("right", D)))
    assert np.abs(np.diff(found, axis=0)).max() < 1e-10  # rounding of a factorisation


@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE])
def test_errors_are_those_of_the_displacement(element, curved, make):
    """Lame's pressure as a load, and what it displaces as a gap, give the pressure back.

    So P1's error, of first order at the ends of the bore and of second between, is its own
    displacement's, which a load without contact shows too.
    """
    body, loaded = ring(make, element, 12, curved), ring(make, element, 12, curved)
    exact = lame("left", D)
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
        found.append(errors(problem.solve(), lame("left", D)))
    rms, worst, shear = np.array(found).T
    assert rms[-1] < 0.005
    assert worst[-1] < 0.005
    assert shear[-1] < 0.05
    assert order(facets, rms) > 1.8


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2, ElementQuadAdini])
def test_gauss_points_are_not_taken_on_curves(element, make):
    body = ring(make, element, 4)
    chosen, default = (ContactProblem(body, "right", -D, functional=f) for f in ("gauss", None))
    assert chosen.rows.functional == default.rows.functional == "bernstein"
    assert (chosen.rows.G - default.rows.G).nnz == 0


def test_thesis_points_are_refused_on_curves(make):
    with pytest.raises(InputError, match="curved boundary"):
        ContactProblem(ring(make, ElementQuadAdini, 4), "right", -D, functional="thesis")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", PLANE + SOLID)
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
