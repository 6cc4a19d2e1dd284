"""Dirichlet conditions and trace projection on faces."""

import numpy as np
import pytest
from skfem import Basis, ElementVector, FacetBasis, MeshHex, condense, solve
from skfem.models.poisson import laplace, unit_load

from skfem_adini import (
    ElementHexAdini,
    InputError,
    essential_constraints,
    essential_dofs,
    project_trace,
)

VECTOR = ElementVector(ElementHexAdini())


def cubic(x):
    """A harmonic cubic."""
    return x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[0] * x[1] * x[2] + x[2] ** 2 - x[1] ** 2 - 2 * x[2]


def gradient(x):
    return np.array(
        [
            3 * x[0] ** 2 - 3 * x[1] ** 2 + x[1] * x[2],
            -6 * x[0] * x[1] + x[0] * x[2] - 2 * x[1],
            x[0] * x[1] + 2 * x[2] - 2,
        ]
    )


def smooth(x):
    return np.sin(3 * x[0] + x[2]) * np.exp(x[1])


def exact_dofs(basis):
    x = basis.zeros()
    x[basis.nodal_dofs] = [cubic(basis.mesh.p), *gradient(basis.mesh.p)]
    return x


@pytest.fixture
def box():
    mesh = MeshHex.init_tensor(np.linspace(0, 2, 4), np.linspace(0, 1, 3), np.array([0, 0.4, 1]))
    return mesh.with_defaults()


def trace(basis, x, facets):
    boundary = FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=8)
    points = np.array(boundary.global_coordinates())
    return boundary, np.array(boundary.interpolate(x)), points


@pytest.mark.parametrize("axis", range(3))
def test_dofs_of_one_face_are_u_and_two_tangential_derivatives(box, axis):
    basis = Basis(box, ElementHexAdini(), intorder=1)
    nodes = np.flatnonzero(box.p[axis] == 0)
    kinds = np.delete(np.arange(4), axis + 1)
    expected = np.sort((4 * nodes[:, None] + kinds).ravel())
    np.testing.assert_array_equal(essential_dofs(basis, lambda x: x[axis] == 0), expected)
    clamped = essential_dofs(basis, lambda x: x[axis] == 0, clamp_normal=True)
    np.testing.assert_array_equal(clamped, np.sort((4 * nodes[:, None] + np.arange(4)).ravel()))


def test_edges_of_the_box_have_all_derivatives(box):
    basis = Basis(box, ElementHexAdini(), intorder=1)
    edge = np.flatnonzero((box.p[:2] == 0).all(axis=0))
    fixed = set(essential_dofs(basis, lambda x: (x[0] == 0) | (x[1] == 0)))
    assert set((4 * edge[:, None] + np.arange(4)).ravel()) <= fixed


def test_components_of_a_vector_field(box):
    basis = Basis(box, VECTOR, intorder=1)
    names = np.array(VECTOR.dofnames)
    second = essential_dofs(basis, "left", components=1)
    assert set(names[second % 12]) == {"u^2", "u_y^2", "u_z^2"}


def turned(mesh):
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return MeshHex(R @ mesh.p, mesh.t).with_boundaries(dict(mesh.boundaries))


def test_slanted_faces_need_constraints(box):
    basis = Basis(turned(box), ElementHexAdini(), intorder=1)
    with pytest.raises(InputError, match="essential_constraints"):
        essential_dofs(basis, "left")
    assert len(essential_dofs(basis, "left", clamp_normal=True)) == 36


def test_constraints_on_axis_parallel_faces_select_dofs(box):
    basis = Basis(box, ElementHexAdini(), intorder=1)
    T, x0 = essential_constraints(basis, box.boundary_facets())
    free = basis.complement_dofs(essential_dofs(basis, box.boundary_facets()))
    assert set(T.data) == {1.0}
    np.testing.assert_array_equal(np.sort(T.indices), free)
    assert not x0.any()


def test_constraints_and_condense_give_the_same_solution(box):
    basis = Basis(box, ElementHexAdini())
    K, f = laplace.assemble(basis), unit_load.assemble(basis)
    T, x0 = essential_constraints(basis, {"left": 0, "top": 0})
    x = T @ solve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0
    expected = solve(*condense(K, f, D=essential_dofs(basis, ["left", "top"])))
    np.testing.assert_allclose(x, expected, atol=1e-12)


def test_cubic_data_on_faces_of_any_direction(parallelepipeds):
    """The trace is the data for every z, and the cubic itself is among the vectors."""
    basis = Basis(parallelepipeds, ElementHexAdini(), intorder=1)
    facets = parallelepipeds.boundary_facets()
    T, x0 = essential_constraints(basis, facets, cubic)
    np.testing.assert_allclose((T.T @ T).toarray(), np.eye(T.shape[1]), atol=1e-14)
    z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
    _, values, points = trace(basis, T @ z + x0, facets)
    np.testing.assert_allclose(values, cubic(points), atol=1e-12)
    exact = exact_dofs(basis)
    np.testing.assert_allclose(T @ (T.T @ (exact - x0)) + x0, exact, atol=1e-12)
    normals = T.shape[1] - 4 * len(parallelepipeds.interior_nodes())
    assert normals == len(inner_face_vertices(parallelepipeds))


def inner_face_vertices(mesh):
    """Vertices of the boundary whose faces have one normal."""
    basis = FacetBasis(mesh, ElementHexAdini(), intorder=1)
    n = np.array(basis.normals)[:, :, 0]
    found = []
    for vertex in mesh.boundary_nodes():
        own = (mesh.facets[:, basis.find] == vertex).any(axis=0)
        if np.abs(n[:, own] - n[:, own][:, :1]).max() < 1e-9:
            found.append(vertex)
    return found


def test_patch_test(parallelepipeds):
    """The data are harmonic, so Laplace's equation gives the cubic back exactly."""
    basis = Basis(parallelepipeds, ElementHexAdini())
    T, x0 = essential_constraints(basis, parallelepipeds.boundary_facets(), cubic)
    K = laplace.assemble(basis)
    x = T @ solve((T.T @ K @ T).tocsc(), -T.T @ (K @ x0)) + x0
    np.testing.assert_allclose(x, exact_dofs(basis), atol=1e-10)


def test_vector_data_with_a_free_component(box):
    basis = Basis(turned(box), VECTOR, intorder=1)
    T, x0 = essential_constraints(basis, {"right": (None, cubic, 2.0)})
    x = T @ np.random.default_rng(0).uniform(-1, 1, T.shape[1]) + x0
    _, values, points = trace(basis, x, "right")
    np.testing.assert_allclose(values[1], cubic(points), atol=1e-12)
    np.testing.assert_allclose(values[2], 2, atol=1e-12)
    assert np.ptp(values[0]) > 0.1


def test_zero_on_warped_faces(warped_hexes):
    basis = Basis(warped_hexes, ElementHexAdini(), intorder=1)
    T, x0 = essential_constraints(basis, warped_hexes.boundary_facets())
    x = T @ np.random.default_rng(0).uniform(-1, 1, T.shape[1]) + x0
    _, values, _ = trace(basis, x, None)
    assert np.abs(values).max() < 1e-14
    assert T.shape[1] >= 4


def test_cubics_are_reproduced_by_projection(parallelepipeds):
    basis = Basis(parallelepipeds, ElementHexAdini(), intorder=1)
    facets = parallelepipeds.boundary_facets()
    _, values, points = trace(basis, project_trace(basis, facets, cubic), facets)
    np.testing.assert_allclose(values, cubic(points), atol=1e-11)


def test_the_error_of_projection_is_orthogonal_to_the_trace_space(any_hexes):
    basis = Basis(any_hexes, ElementHexAdini(), intorder=1)
    x = project_trace(basis, any_hexes.boundary_facets(), smooth)
    rule = np.polynomial.legendre.leggauss(8)
    s, w = (rule[0] + 1) / 2, rule[1] / 2
    square = np.array(np.meshgrid(s, s)).reshape(2, -1), np.outer(w, w).ravel()
    boundary = FacetBasis(any_hexes, ElementHexAdini(), quadrature=square)
    points = np.array(boundary.global_coordinates())
    error = (np.array(boundary.interpolate(x)) - smooth(points)) * boundary.dx
    moments = np.zeros(basis.N)
    for (function,), dofs in zip(boundary.basis, boundary.element_dofs, strict=True):
        np.add.at(moments, dofs, (error * np.array(function)).sum(axis=1))
    np.testing.assert_allclose(moments, 0, atol=1e-10)
    assert np.abs(error).max() > 1e-6


def test_normal_derivatives_and_other_dofs_stay_zero(box):
    basis = Basis(box, ElementHexAdini(), intorder=1)
    x = project_trace(basis, lambda x: x[2] == 1, smooth)
    face = box.p[2] == 1
    assert not x[basis.nodal_dofs[3]].any()
    assert not x[basis.nodal_dofs[:, ~face]].any()
    assert np.abs(x[basis.nodal_dofs[1:3, face]]).min() > 0
