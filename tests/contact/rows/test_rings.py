"""Pressures on curved outlines of straight and of curved facets: Lame's rings, shear included.

The ring is shrunk by D into a rigid hole, or onto a rigid shaft, given as a gap of one size, so
that the polygon's own sagitta does not matter.
"""

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
import pyvista
from convergence import order
from families import CURVED, PLANE, SOLID, STRAIGHT
from fields import rms
from rings import NU, A, B, lame, ring
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad2, ElementTetP1, ElementTriP1, ElementTriP2, MeshQuad

from contact import ContactProblem, InputError
from skfem_adini import ElementQuadAdini
from tests.contact.rows.cases import whole_ring

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

D = 0.05
LINEAR = (ElementTriP1, ElementTetP1)
CASES = [(e, c) for e in PLANE + SOLID for c in (False, True) if not c or e in CURVED]
plane_cases = pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] in PLANE])


def errors(result, exact):
    """Rms and largest error of the pressure, largest shear, in parts of the exact pressure."""
    off = result.pressure / exact - 1
    return rms(result, exact), np.abs(off).max(), np.abs(result.shear).max() / exact


def solved(make, element, n, side, friction=0.3, **more):
    functional = more.pop("functional", None)
    body = ring(make, element, n, **more)
    return ContactProblem(body, side, -D, friction, functional=functional).solve()


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("element", "curved", "side"),
    [
        pytest.param(
            *case, side, marks=pytest.mark.slow if side == "left" and case[0] in SOLID else ()
        )
        for side in ("right", "left")
        for case in CASES
    ],
)
def test_uniform_pressure_without_shear(element, curved, side, make):
    """Stresses of P1 are of first order; those at the bore ("left") change fastest."""
    plane, linear, hole = element in PLANE, element in LINEAR, side == "right"
    facets = [6, 12, 24] if plane else [4, 8, 12]
    found = [errors(solved(make, element, n, side, curved=curved), lame(side, D)) for n in facets]
    rms, worst, shear = np.array(found).T
    if hole:
        finest = 0.01 if plane else 0.03
        # The last number of P1 triangles, on the plane of symmetry, belongs to one of them alone.
        assert worst[-1] < (0.1 if linear else 2 * finest)
        assert shear[-1] < (0.03 if linear else 0.02)
        least = 1.0 if linear else 1.2
    else:
        finest = 0.01 if not linear else 0.03 if plane else 0.15
        assert shear[-1] < 0.03 or not plane
        least = 1.2 if not linear else 1.1 if plane else 0.8
    assert rms[-1] < finest
    assert order(facets, rms) > least


@pytest.mark.sampled(3)
@plane_cases
def test_graded_facets(element, curved, make):
    """Lengths of facets in the ratio of one to a hundred."""
    facets, found = [12, 24, 48], []
    for n in facets:
        length = 100 ** np.linspace(0, 1, n)
        angles = 0.5 * np.pi * np.r_[0, np.cumsum(length)] / length.sum()
        result = solved(make, element, n, "right", curved=curved, angles=angles)
        found.append(rms(result, lame("right", D)))
    assert found[1] < 0.015
    assert order(facets, found) > 1.5


@pytest.mark.parametrize("functional", ["gauss", "centroid"])
def test_other_functionals_of_adini(functional, make):
    facets, exact = [6, 12, 24], lame("left", D)
    found = [
        errors(solved(make, ElementQuadAdini, n, "left", functional=functional), exact)
        for n in facets
    ]
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


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", PLANE)
def test_between_a_shaft_and_a_housing(element, tmp_path):
    """A whole ring held by contact alone, its two boundaries of a pressure each, also in VTK."""
    out, into = 0.02, 0.05
    c, d = np.linalg.solve([[A, 1 / A], [B, 1 / B]], [out, -into])  # u = c r + d / r
    lam, mu = NU / ((1 + NU) * (1 - 2 * NU)), 0.5 / (1 + NU)
    exact = np.array([2 * mu * d / r**2 - 2 * (lam + mu) * c for r in (A, B)])
    facets, found = [6, 12, 24], []
    for n in facets:
        body = whole_ring(element, 4 * n, np.linspace(A, B, n // 2 + 1), 0.1)
        result = ContactProblem(body, ["bore", "rim"], [-out, -into], 0.3).solve()
        found.append(np.sqrt(np.mean((result.pressure / exact[result.part] - 1) ** 2)))
        # Diagonals that all lean one way turn bore against rim by less than the pressure's error.
        askew = found[-1] * exact.max() if "Tri" in element.__name__ else 1e-8
        assert np.abs(result.shear).max() < askew
    assert found[-1] < 0.01
    assert order(facets, found) > 1.8
    path = tmp_path / "contact.vtp"
    result.boundary_to_pyvista().save(path)
    kept = pyvista.read(path)
    assert kept.n_lines == 2
    np.testing.assert_array_equal(kept["pressure"], result.pressure)
    np.testing.assert_allclose(np.asarray(kept.points)[:, :2].T, result.x, atol=1e-6)


def triangles(make, n, cells):
    """A quarter of a ring of triangles that lean one way or cross, or of tetrahedra."""
    if cells != "crossed":
        return ring(make, ElementTetP1 if cells == "tetrahedra" else ElementTriP1, n)
    crossing = SimpleNamespace(
        init_tensor=lambda *t: MeshQuad.init_tensor(*t).to_meshtri(style="x")
    )
    with patch.dict(STRAIGHT, {ElementTriP1: crossing}):
        return ring(make, ElementTriP1, n)


@pytest.mark.parametrize("cells", ["one diagonal", "crossed", "tetrahedra"])
def test_pressure_of_linear_triangles_is_their_reaction(cells, make):
    """To the same normal displacement without contact, by one multiplier a vertex."""
    body = triangles(make, 8, cells)
    result = ContactProblem(body, "left", -D).solve()
    rows, P = result.system.rows, body.constraint[0]
    K, C = P.T @ body.stiffness @ P, sparse.diags_array(rows.weights) @ rows.G @ P
    saddle = sparse.block_array([[K, C.T], [C, None]], format="csc")
    expected = spsolve(saddle, np.r_[np.zeros(K.shape[0]), -D * rows.weights])[K.shape[0] :]
    # Rounding of two factorisations.
    assert np.abs(result.pressure - expected).max() < 1e-9 * lame("left", D)


def test_rows_of_linear_triangles_are_radial_displacements(make):
    """What plain geometry says: of the facets' normals, half of either facet."""
    body = triangles(make, 12, "one diagonal")
    rows, turn = ContactProblem(body, "left", -D).rows, np.pi / 24
    outwards = (body.mesh.p / np.linalg.norm(body.mesh.p, axis=0)).ravel(order="F")
    np.testing.assert_allclose(rows.G @ outwards, -np.cos(turn / 2), rtol=1e-12)
    np.testing.assert_allclose(rows.weights[1:-1], 2 * np.sin(turn / 2), rtol=1e-12)


def test_cells_that_meet_a_hundredth(make):
    """One diagonal leaves the ends of first order; triangles that cross are of second all over."""
    facets, found = [6, 12, 24], {}
    for cells in ("one diagonal", "crossed"):
        bodies = (triangles(make, n, cells) for n in facets)
        results = [ContactProblem(body, "left", -D, 0.3).solve() for body in bodies]
        found[cells] = [rms(result, lame("left", D)) for result in results]
    rate = {c: order(facets, e) for c, e in found.items()}
    assert found["crossed"][-1] < 0.003
    assert 1.9 < rate["crossed"] < 2.2
    assert 0.02 < found["one diagonal"][-1] < 0.03
    assert 1.2 < rate["one diagonal"] < 1.7
