"""Meshes of second order whose cells are straight give what those of first order give."""

import numpy as np
import pytest
from skfem import Basis, ElementVector, FacetBasis, MeshHex, MeshHex2, MeshQuad, MeshQuad2
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    InputError,
    assemble,
    essential_constraints,
    essential_dofs,
    near_null_space,
    nodal_gradient,
    project_trace,
    to_pyvista,
)


def _twisted(mesh):
    step = 0.05 * np.random.default_rng(3).uniform(-1, 1, mesh.p.shape)
    return type(mesh)(mesh.p + step, mesh.t)


PAIRS = {
    "quad": (_twisted(MeshQuad().refined(2)), MeshQuad2, ElementQuadAdini),
    "rectangle": (MeshQuad().refined(2), MeshQuad2, ElementQuadBFS),
    "far rectangle": (MeshQuad().refined(2).translated((30.0, -20.0)), MeshQuad2, ElementQuadAdini),
    "small": (MeshQuad().refined(2).scaled((1e-6, 1e-6)), MeshQuad2, ElementQuadAdini),
    "brick": (_twisted(MeshHex().refined(1)), MeshHex2, ElementHexAdini),
}


@pytest.fixture(params=PAIRS)
def bases(request):
    first, second, element = PAIRS[request.param]
    second = second.from_mesh(first)
    return [Basis(mesh.with_defaults(), element()) for mesh in (first, second)]


def agree(a, b):
    return abs(a - b).max() <= 1e-8 * abs(a).max()


def test_matrices(bases):
    assert agree(*(laplace.assemble(basis) for basis in bases))
    assert agree(*(mass.assemble(FacetBasis(basis.mesh, basis.elem)) for basis in bases))
    assert agree(*(assemble(mass, basis.mesh, basis.elem) for basis in bases))


def test_conditions_and_fields(bases):
    # Vertices come first, in the order of the first-order mesh.
    np.testing.assert_array_equal(bases[0].nodal_dofs, bases[1].nodal_dofs)
    x = np.random.default_rng(0).standard_normal(bases[0].N)
    left = [basis.mesh.facets_satisfying(lambda x: x[0] == x[0].min()) for basis in bases]
    some = [basis.mesh.boundary_facets()[:3] for basis in bases]
    calls = (
        lambda basis, _: nodal_gradient(basis, x),
        lambda basis, _: near_null_space(basis).modes,
        lambda basis, facets: essential_constraints(basis, facets, lambda x: x[0])[1],
        lambda basis, facets: project_trace(basis, facets, lambda x: x[0] ** 2),
    )
    assert [facets.tolist() for facets in some[:1]] == [facets.tolist() for facets in some[1:]]
    assert len(left[0]) == len(left[1])
    for call in calls:
        assert agree(*(call(basis, facets) for basis, facets in zip(bases, some, strict=True)))
    fixed = [essential_dofs(b, f, clamp_normal=True) for b, f in zip(bases, some, strict=True)]
    np.testing.assert_array_equal(*fixed)


def test_output(bases):
    x = np.random.default_rng(0).standard_normal(bases[0].N)
    grids = [to_pyvista(basis, x) for basis in bases]
    assert agree(*(np.asarray(grid.points) for grid in grids))
    assert agree(*(np.asarray(grid.point_data["u"]) for grid in grids))


def test_vector_field():
    mesh = MeshQuad().refined(2)
    elements = ElementVector(ElementQuadAdini())
    K = [
        linear_elasticity(1.0, 1.0).assemble(Basis(m, elements))
        for m in (mesh, MeshQuad2.from_mesh(mesh))
    ]
    assert agree(*K)


@pytest.mark.parametrize("by", [1e-7, 1e-3, np.nan])
@pytest.mark.parametrize("node", [25, -1], ids=["edge", "inside"])
def test_curved_cells_are_refused(by, node):
    mesh = MeshQuad2.from_mesh(MeshQuad().refined(2))
    p = mesh.doflocs.copy()
    p[1, node] += by
    with pytest.raises(InputError, match=r"cells of the MeshQuad2 are curved.*CutDomain"):
        Basis(MeshQuad2(p, mesh.t), ElementQuadAdini())
