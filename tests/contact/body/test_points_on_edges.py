"""Points on the edge of a body, its own vertices among them, lie in the body."""

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshHex1,
    MeshHex2,
    MeshQuad1,
    MeshQuad2,
    MeshTet1,
    MeshTet2,
    MeshTri1,
    MeshTri2,
)

from contact import ElasticBody, InputError
from contact.body.cell_finder import find_cells, places_in
from skfem_adini import ElementHexAdini, ElementQuadAdini

KINDS = [
    (MeshTri1, ElementTriP1),
    (MeshTri1, ElementTriP2),
    (MeshTri2, ElementTriP2),
    (MeshQuad1, ElementQuad1),
    (MeshQuad1, ElementQuadAdini),
    (MeshQuad2, ElementQuad2),
    (MeshTet1, ElementTetP1),
    (MeshTet2, ElementTetP2),
    (MeshHex1, ElementHex1),
    (MeshHex1, ElementHexAdini),
    (MeshHex2, ElementHex2),
]


STRAIGHT = {kind.__name__[:-1]: kind for kind in (MeshTri1, MeshQuad1, MeshTet1, MeshHex1)}


def plate(kind, ratio, moved=0.0):
    """Cells of the ratio, a few across, turned about all axes and moved."""
    dim = kind.elem.refdom.dim()
    lines = [np.linspace(0, 1, 9 - 2 * dim)] * (dim - 1) + [np.linspace(0, 0.75 / ratio, 6 - dim)]
    mesh = STRAIGHT[kind.__name__[:-1]].init_tensor(*lines)
    turn = np.eye(dim)
    for plane in ([0, 1], [0, 2], [1, 2])[: 2 * dim - 3]:
        one = np.eye(dim)
        one[np.ix_(plane, plane)] = [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
        turn = one @ turn
    mesh = type(mesh)(turn @ mesh.p + moved, mesh.t)
    return (mesh if kind is type(mesh) else kind.from_mesh(mesh)), turn


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("ratio", "moved"), [(1e2, 0.0), (1e6, 0.0), (1e5, 100.0)])
@pytest.mark.parametrize(("kind", "element"), KINDS)
def test_vertices_and_middles(kind, element, ratio, moved):
    """Turned triangles from 1e2:1 and bilinear cells at 1e6:1 refused their own vertices."""
    mesh, turn = plate(kind, ratio, moved)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    corners = mesh.p[:, mesh.facets[:, mesh.boundary_facets()]]
    points = np.hstack((mesh.p[:, np.unique(mesh.t)], corners.mean(axis=1)))
    cells = body.cells_of(points)
    X = places_in(mesh, body.basis.mapping, points, cells)
    # Rounding of places is machine precision of the largest, of the thickness by the ratio more.
    rounding = 1e-14 * (1 + moved) * ratio
    assert np.all((-1e-8 - rounding <= X) & (1 + 1e-8 + rounding >= X))
    again = body.basis.mapping.F(X[:, :, None], tind=cells)[:, :, 0]
    np.testing.assert_allclose(again, points, rtol=0, atol=1e-13 + rounding / 10)
    aside = points[:, :1] - turn[:, -1:] * 1e-3 / ratio
    if 1e-8 + rounding < 1e-3:
        with pytest.raises(InputError, match="outside the body"):
            body.cells_of(np.hstack((points, aside)))


def test_displacement_of_slender_triangles():
    """The vertices' own displacement is what is sampled there."""
    mesh, _ = plate(MeshTri1, 1e4)
    body = ElasticBody.from_mesh(mesh, ElementTriP1(), E=2.0, nu=0.3)
    u = np.random.default_rng(0).standard_normal(body.basis.N)
    expected = u[body.basis.nodal_dofs]
    # Rounding of the place across a cell, 1e-16, is 1e-12 of its thickness.
    np.testing.assert_allclose(body.displacement(u, mesh.p), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", [MeshTri1, MeshQuad1, MeshTet1, MeshHex1, MeshTri2, MeshHex2])
def test_no_points(kind):
    """No point lies outside."""
    assert find_cells(kind(), np.zeros((kind.elem.refdom.dim(), 0))).shape == (0,)


def test_mesh_without_cells():
    """It is refused as such; NumPy was asked for the largest of none."""
    with pytest.raises(InputError, match="no cells"):
        ElasticBody.from_mesh(
            MeshTri1(np.zeros((2, 3)), np.zeros((3, 0), dtype=int)), ElementTriP1(), E=1.0, nu=0.3
        )
