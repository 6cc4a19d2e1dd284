"""Meshes that lie on themselves are refused, however their cells are numbered or oriented."""

from dataclasses import replace

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
)

from contact import ElasticBody, InputError
from contact.body import cell_check, jacobians
from contact.body.cell_check import check_cells
from contact.facet_basis import places_on_facets

KINDS = [
    (MeshTri, None, ElementTriP1),
    (MeshTri, None, ElementTriP2),
    (MeshTri, MeshTri2, ElementTriP2),
    (MeshQuad, None, ElementQuad1),
    (MeshQuad, MeshQuad2, ElementQuad1),
    (MeshTet, None, ElementTetP1),
    (MeshTet, MeshTet2, ElementTetP2),
    (MeshHex, None, ElementHex1),
    (MeshHex, MeshHex2, ElementHex1),
]
SIMPLICES = [MeshTri, MeshTet]
kinds = pytest.mark.parametrize(("plain", "curved", "element"), KINDS)


def grid(plain, curved=None, places=lambda x: x):
    mesh = plain.init_tensor(*(np.linspace(0, 1, 4),) * (2 if plain in (MeshTri, MeshQuad) else 3))
    mesh = mesh if curved is None else curved.from_mesh(mesh)
    return replace(mesh, doflocs=places(mesh.doflocs))


def body(mesh, element):
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)


@kinds
def test_vertex_beyond_its_neighbours(plain, curved, element):
    """Every P1 triangle is one to one by itself; three of them lie on others."""

    def moved(x):
        inner = np.argmin(np.abs(x - 1 / 3).sum(axis=0))
        return np.where(np.arange(x.shape[1]) == inner, 0.9, x)

    with pytest.raises(InputError, match="untangle"):
        body(grid(plain, curved, moved), element)


@kinds
def test_half_that_lies_on_the_other(plain, curved, element):
    """A sheet folded along a line of facets, no cell of it bent."""
    mesh = grid(plain, curved, lambda x: np.vstack((np.minimum(x[0], 4 / 3 - x[0]), x[1:])))
    with pytest.raises(InputError, match="same side, one upon the other"):
        body(mesh, element)


@pytest.mark.parametrize("plain", [MeshTri, MeshQuad, MeshTet, MeshHex])
def test_cell_that_is_there_twice(plain):
    mesh = grid(plain)
    element = {MeshTri: ElementTriP1, MeshQuad: ElementQuad1, MeshTet: ElementTetP1}
    with pytest.raises(InputError, match=r"room for two|same side"):
        body(plain(mesh.p, np.hstack((mesh.t, mesh.t[:, 4:5]))), element.get(plain, ElementHex1))


@kinds
def test_what_is_accepted(plain, curved, element):
    """Uneven, mirrored and turned, of any unit, and 1e6 times as long as wide."""
    rng = np.random.default_rng(1)
    body(grid(plain, curved, lambda x: x + 0.005 * rng.standard_normal(x.shape)), element)
    body(grid(plain, curved, lambda x: -1e-6 * x[::-1]), element)
    if plain in SIMPLICES and curved is None:
        mesh = grid(plain)
        t = mesh.t.copy()
        t[:2, ::2] = t[1::-1, ::2]
        for sort in (False, True):
            body(plain(mesh.p, t, sort_t=sort), element)
    c, s = np.cos(0.7), np.sin(0.7)

    def needle(x):
        x = x * np.array([[1.0], [1e-6], [1e-6]][: len(x)])
        return np.vstack((c * x[0] - s * x[1], s * x[0] + c * x[1], *x[2:]))

    body(grid(plain, curved, needle), element)


@pytest.mark.parametrize("vertex", [-1, -(10**7), 25, 10**8])
def test_cells_name_vertices_that_exist(vertex):
    mesh = MeshQuad().refined(2)
    t = mesh.t.copy()
    t[1, 3] = vertex
    with pytest.raises(InputError, match=f"cell 3 has the vertices .*{vertex}.*, of 0 to 24"):
        body(MeshQuad(mesh.p, t), ElementQuad1)


@pytest.mark.parametrize("plain", [MeshTri, MeshQuad, MeshTet, MeshHex])
@pytest.mark.parametrize("more", [-1, 1])
def test_points_have_the_coordinates_of_the_mesh(plain, more):
    mesh = plain().refined(1)
    rows = mesh.p[:-1] if more < 0 else np.vstack([mesh.p, mesh.p[:1] ** 2])
    mesh.doflocs = rows
    with pytest.raises(InputError, match=rf"points of {mesh.dim()} coordinates, got {len(rows)}"):
        check_cells(mesh)


@pytest.mark.parametrize("plain", [MeshTri2, MeshQuad2, MeshTet2, MeshHex2])
def test_curved_cells_have_places_for_all_nodes(plain):
    mesh = plain()
    count = mesh.doflocs.shape[1]
    mesh.doflocs = mesh.doflocs[:, :-1].copy()
    with pytest.raises(
        InputError, match=f"have {count} nodes, and places are given for {count - 1}"
    ):
        check_cells(mesh)


def test_flat_cells_are_refused():
    """Also where a determinant is exactly zero, of which scikit-fem makes a bare Exception."""
    for plain, element in (
        (MeshQuad, ElementQuad1),
        (MeshTri, ElementTriP1),
        (MeshHex, ElementHex1),
    ):
        with pytest.raises(InputError, match="flat, not convex or folded"):
            body(grid(plain, None, lambda x: np.vstack((x[:-1], 0 * x[-1]))), element)


@pytest.mark.parametrize("plain", [MeshTri, MeshQuad, MeshTet, MeshHex])
def test_middles_lie_where_the_mapping_has_its_normals(plain):
    """At every inner facet of a mesh that is tangled so much that a third of them are folded."""
    rng = np.random.default_rng(3)
    mesh = grid(plain, None, lambda x: x + 0.1 * rng.standard_normal(x.shape))
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    normals = mesh.mapping().normals
    middle = mesh.brefdom.p.mean(axis=1)[:, None]
    ours, theirs = (
        normals(places_on_facets(mesh, inner, middle, k), mesh.f2t[k, inner], inner, mesh.t2f)
        for k in (0, 1)
    )
    folded = np.sum(ours * theirs, axis=0)[:, 0] > 0
    assert 0 < folded.sum() < inner.size
    np.testing.assert_array_equal(cell_check._on_one_side(mesh, inner) > 0, folded)


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad, MeshTet, MeshHex, MeshTri2, MeshQuad2])
def test_jacobians_are_those_of_the_mapping(kind):
    mesh = kind().refined(2)
    mesh.doflocs[:] += 0.02 * np.random.default_rng(4).standard_normal(mesh.doflocs.shape)
    places = mesh.elem.refdom.p[:, :1] if mesh.affine else mesh.elem.doflocs.T
    expected = mesh.mapping().DF(places)[:, :, 3:7]
    found = jacobians.jacobians(mesh, np.arange(3, 7), places)
    np.testing.assert_allclose(found.transpose(2, 3, 0, 1), expected, atol=1e-14)
    det, norms, extent = jacobians.measures(mesh, slice(3, 7), places)
    np.testing.assert_array_equal(extent, np.ptp(mesh.p[:, mesh.t[:, 3:7]], axis=1).max(axis=0))
    np.testing.assert_allclose(det, np.linalg.det(found), atol=1e-14)
    size = [np.linalg.norm(J, axis=(2, 3)) for J in (found, np.linalg.inv(found))]
    np.testing.assert_allclose(norms / np.abs(det), size[0] * size[1], rtol=1e-10)
