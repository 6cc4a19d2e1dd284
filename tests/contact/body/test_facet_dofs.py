"""Dofs and edges of facets are those of scikit-fem, which numbers all edges for them."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementHex1,
    ElementHex2,
    ElementQuad2,
    ElementTetP2,
    ElementTriP2,
    ElementVector,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)

from contact.body.deferred_basis import dofs_on_facets, edges_of_facets
from skfem_adini import ElementHexAdini, ElementQuadAdini

CASES = [
    (MeshTri, ElementTriP2),
    (MeshQuad, ElementQuad2),
    (MeshQuad, ElementQuadAdini),
    (MeshTet, ElementTetP2),
    (MeshHex, ElementHex1),
    (MeshHex, ElementHex2),
    (MeshHex, ElementHexAdini),
]


@pytest.mark.parametrize(("kind", "element"), CASES)
def test_dofs_are_those_of_get_dofs(kind, element):
    basis = Basis(kind().refined(2), ElementVector(element()), intorder=1)
    rng = np.random.default_rng(5)
    some = rng.choice(basis.mesh.nfacets, basis.mesh.nfacets // 3, replace=False)
    for facets in (basis.mesh.boundary_facets(), some):
        expected = basis.get_dofs(facets).flatten()
        np.testing.assert_array_equal(dofs_on_facets(basis, facets), expected)


@pytest.mark.parametrize("kind", [MeshTet, MeshHex])
def test_edges_are_those_of_the_facets(kind):
    mesh = kind().refined(2)
    facets = np.arange(mesh.nfacets)[::3]
    np.testing.assert_array_equal(
        edges_of_facets(mesh, facets), np.sort(mesh.f2e[:, facets], axis=0)
    )


def test_no_edges_are_numbered_where_none_has_dofs():
    mesh = MeshHex().refined(2)
    basis = Basis(mesh, ElementVector(ElementHex1()))
    dofs_on_facets(basis, mesh.boundary_facets())
    assert not {"_edges", "_f2e"} & set(vars(mesh))
