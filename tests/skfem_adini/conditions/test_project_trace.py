"""L2 projection onto the boundary trace."""

import numpy as np
import pytest
from skfem import Basis, ElementVector, FacetBasis, MeshQuad

from skfem_adini import ElementQuadAdini, project_trace


def cubic(x):
    return x[0] ** 3 - x[0] * x[1] ** 2 + 2 * x[1]


def smooth(x):
    return np.sin(3 * x[0]) * np.exp(x[1])


def trace(basis, x):
    boundary = FacetBasis(basis.mesh, basis.elem, intorder=12)
    return boundary, np.array(boundary.interpolate(x)), np.array(boundary.global_coordinates())


def test_cubics_are_reproduced(parallelograms):
    basis = Basis(parallelograms, ElementQuadAdini())
    x = project_trace(basis, parallelograms.boundary_facets(), cubic)
    _, values, points = trace(basis, x)
    np.testing.assert_allclose(values, cubic(points), atol=1e-11)


def test_the_error_is_orthogonal_to_the_trace_space(parallelograms):
    basis = Basis(parallelograms, ElementQuadAdini())
    x = project_trace(basis, parallelograms.boundary_facets(), smooth)
    boundary, values, points = trace(basis, x)
    error = (values - smooth(points)) * boundary.dx
    moments = np.zeros(basis.N)
    for (function,), dofs in zip(boundary.basis, boundary.element_dofs, strict=True):
        np.add.at(moments, dofs, (error * np.array(function)).sum(axis=1))
    np.testing.assert_allclose(moments, 0, atol=1e-10)


def test_order_four(convergence_order):
    cells, errors = [4, 8, 16, 32], []
    for n in cells:
        mesh = MeshQuad().refined(int(np.log2(n)))
        basis = Basis(mesh, ElementQuadAdini())
        boundary, values, points = trace(
            basis, project_trace(basis, mesh.boundary_facets(), smooth)
        )
        errors.append(np.sqrt(np.sum((values - smooth(points)) ** 2 * boundary.dx)))
    assert convergence_order(cells, errors) == pytest.approx(4, abs=0.1)


def test_normal_derivatives_and_other_dofs_stay_zero():
    mesh = MeshQuad().refined(2).with_defaults()
    basis = Basis(mesh, ElementQuadAdini())
    x = project_trace(basis, "bottom", smooth)
    bottom = mesh.p[1] == 0
    assert not x[basis.nodal_dofs[2]].any()
    assert not x[basis.nodal_dofs[:, ~bottom]].any()
    assert np.abs(x[basis.nodal_dofs[1, bottom]]).min() > 0


def test_vector_components():
    mesh = MeshQuad().refined(2).with_defaults()
    basis = Basis(mesh, ElementVector(ElementQuadAdini()))
    scalar = project_trace(Basis(mesh, ElementQuadAdini()), "top", smooth)
    x = project_trace(basis, "top", [cubic, smooth], components=1)
    np.testing.assert_array_equal(x[basis.nodal_dofs[1::2]], scalar.reshape(-1, 3).T)
    assert not x[basis.nodal_dofs[::2]].any()
