"""Facets of cells that are slender and turned: their places in the cells need no search."""

from dataclasses import replace

import numpy as np
import pytest
from families import PLANE
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad2,
    ElementTetP2,
    ElementTriP2,
    FacetBasis,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
)

from contact import ContactProblem, ElasticBody, Plane
from contact.facet_basis import facet_basis, places_on_facets
from contact.rows.contact_boundaries import outward_normals
from skfem_adini import ElementQuadAdini


def askew(make, element, ratio, dim=2):
    """A plate of four cells along and three across, cells of the ratio, turned by .5."""
    turn = np.eye(dim)
    turn[np.ix_([0, -1], [0, -1])] = [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
    along, across = np.linspace(0, 1, 5 if dim == 2 else 3), np.linspace(0, 0.75 / ratio, 4)
    mesh = make.box(element, *(along,) * (dim - 1), across)
    return replace(mesh, doflocs=turn @ mesh.doflocs), turn


@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("element", PLANE)
def test_plate(element, ratio, make):
    """Q1 and Q2 ended in a bare Exception of scikit-fem from 1e4 on."""
    mesh, turn = askew(make, element, ratio)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    body.load("top", turn @ (0.1, -2.5))
    np.testing.assert_allclose(turn.T @ body.total(body.f), (0.1, -2.5), atol=1e-14)
    below = mesh.p[:, mesh.facets[:, mesh.boundaries["bottom"]]].mean(axis=1)
    normals = outward_normals(mesh, below)
    np.testing.assert_allclose(normals, -turn[:, 1:] + 0 * below, atol=1e-15 * ratio)
    result = ContactProblem(body, "bottom", Plane((0.0, 0.0), tuple(turn[:, 1])), 0.4).solve()
    # Places are rounded by machine precision of the length, of the thickness that is more by the
    # ratio; the tolerance of the solution is 1e-10.
    np.testing.assert_allclose(turn.T @ result.resultant, [-0.1, 2.5], rtol=1e-11 + 1e-14 * ratio)
    middle = turn @ np.array([[0.3, 0.6], [0.1 / ratio, 0.4 / ratio]])
    near = result.u[body.basis.nodal_dofs[:2]]
    assert np.all(np.abs(result.sample(middle)) <= 1.5 * np.abs(near).max())


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2])
def test_plate_in_space(element, make):
    mesh, turn = askew(make, element, 1e5, dim=3)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    body.load("top", turn @ (0.1, 0.0, -2.5))
    np.testing.assert_allclose(turn.T @ body.total(body.f), (0.1, 0.0, -2.5), atol=1e-13)
    foundation = Plane((0.0, 0.0, 0.0), tuple(turn[:, 2]))
    result = ContactProblem(body, "bottom", foundation, 0.4).solve()
    np.testing.assert_allclose(turn.T @ result.resultant, [-0.1, 0.0, 2.5], atol=1e-9)


@pytest.mark.parametrize("where", ["boundary", "everywhere"])
@pytest.mark.parametrize(
    ("plain", "curved", "element"),
    [
        (MeshTri, None, ElementTriP2),
        (MeshTri, MeshTri2, ElementTriP2),
        (MeshQuad, None, ElementQuadAdini),
        (MeshQuad, MeshQuad2, ElementQuad2),
        (MeshTet, None, ElementTetP2),
        (MeshTet, MeshTet2, ElementTetP2),
        (MeshHex, None, ElementHex2),
        (MeshHex, MeshHex2, ElementHex2),
    ],
)
def test_the_same_as_a_search(plain, curved, element, where):
    mesh = plain().refined(1)
    mesh = mesh if curved is None else curved.from_mesh(mesh)
    noise = np.random.default_rng(0).standard_normal(mesh.doflocs.shape)
    mesh = replace(mesh, doflocs=mesh.doflocs + (0.03 if curved is None else 0.01) * noise)
    facets = mesh.boundary_facets() if where == "boundary" else np.arange(mesh.nfacets)
    ours = facet_basis(mesh, element(), facets, intorder=4)
    theirs = FacetBasis(mesh, element(), facets=facets, intorder=4)
    # Newton's method stops at 1e-12, derivatives of the functions are some ten times as large.
    np.testing.assert_allclose(ours.dx, theirs.dx, rtol=1e-12)
    np.testing.assert_allclose(ours.normals, theirs.normals, atol=1e-11)
    for one, two in zip(ours.basis, theirs.basis, strict=True):
        np.testing.assert_allclose(one[0].grad, two[0].grad, atol=1e-10)
    mapping, inner = mesh.mapping(), np.flatnonzero(mesh.f2t[1] >= 0)
    for side in (0, 1):
        X = places_on_facets(mesh, inner, ours.X, side)
        x = mapping.F(X, tind=mesh.f2t[side, inner])
        np.testing.assert_allclose(x, mapping.G(ours.X, find=inner), atol=1e-14)
