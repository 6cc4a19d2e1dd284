"""Rigid motions and linear functions, in the dofs of these elements."""

import numpy as np
import pytest
from skfem import Basis, ElementVector, MeshQuad
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    essential_constraints,
    essential_dofs,
    hanging_constraints,
    near_null_space,
)

X = np.array([0, 0.3, 0.5, 1.1])


@pytest.mark.sampled(2)
def test_rigid_motions(space):
    mesh, kind = space
    dim = mesh.dim()
    basis = Basis(mesh, ElementVector(kind()), intorder=4 if dim == 3 else None)
    modes = near_null_space(basis).modes
    count = dim * (dim + 1) // 2
    assert modes.shape == (basis.N, count)
    assert np.linalg.matrix_rank(modes) == count
    K = linear_elasticity(1.0, 1.0).assemble(basis)
    np.testing.assert_allclose(K @ modes, 0, atol=1e-12 * abs(K).max())


def test_scalar_field_has_linear_functions(parallelepipeds):
    """Their energy is at the boundary alone, that of the constant nowhere."""
    basis = Basis(parallelepipeds, ElementHexAdini(), intorder=4)
    forces = laplace.assemble(basis) @ near_null_space(basis).modes
    assert forces.shape[1] == 4
    np.testing.assert_allclose(forces[:, 0], 0, atol=1e-12)
    inside = np.delete(np.arange(basis.N), basis.get_dofs().all())
    np.testing.assert_allclose(forces[inside], 0, atol=1e-12)


def test_unknowns_and_their_vertices():
    basis = Basis(MeshQuad.init_tensor(X, X), ElementQuadAdini())
    free = basis.complement_dofs(essential_dofs(basis, basis.mesh.boundary_facets()))
    space, whole = near_null_space(basis, free), near_null_space(basis)
    np.testing.assert_array_equal(space.modes, whole.modes[free])
    for row in basis.nodal_dofs:
        np.testing.assert_array_equal(whole.vertex[row], np.arange(basis.mesh.nvertices))
    np.testing.assert_array_equal(space.vertex, whole.vertex[free])


def test_parametrised_unknowns():
    """T z is a mode again wherever the condition allows it."""
    turned = MeshQuad(
        np.array([[1, -1], [1, 1]]) @ MeshQuad().refined(2).p, MeshQuad().refined(2).t
    )
    basis = Basis(turned, ElementQuadAdini())
    T, _ = essential_constraints(basis, turned.boundary_facets())
    space, modes = near_null_space(basis, T), near_null_space(basis).modes
    np.testing.assert_allclose(space.modes, T.T @ modes, atol=1e-12)
    assert space.vertex.shape == (T.shape[1],)
    inside = np.setdiff1d(np.arange(basis.N), basis.get_dofs().all())
    np.testing.assert_allclose((T @ space.modes)[inside], modes[inside], atol=1e-12)


def test_hanging_nodes_keep_the_modes():
    """Linear functions are continuous across hanging nodes, so nothing of them is lost."""
    mesh = MeshQuad().refined(2)
    coarse, fine = mesh.restrict(np.arange(8)), mesh.restrict(np.arange(8, 16)).refined()
    basis = Basis(coarse + fine, ElementVector(ElementQuadAdini()))
    T, _ = hanging_constraints(basis)
    assert T.shape[1] < T.shape[0]
    space = near_null_space(basis, T)
    np.testing.assert_allclose(T @ space.modes, near_null_space(basis).modes, atol=1e-12)
