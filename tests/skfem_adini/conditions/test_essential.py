"""Dirichlet conditions: which dofs they fix, and exact data on slanted edges."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshHex,
    MeshHex1DG,
    MeshQuad,
    MeshQuad1DG,
    condense,
    solve,
)
from skfem.models.poisson import laplace

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    InputError,
    essential_constraints,
    essential_dofs,
    project_trace,
)

VECTOR = ElementVector(ElementQuadAdini())


def cubic(x):
    return x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[0] * x[1] - 2 * x[1] + 1


def cubic_gradient(x, y):
    return 3 * x**2 - 3 * y**2 + y, -6 * x * y + x - 2


@pytest.fixture
def rectangle():
    mesh = MeshQuad.init_tensor(np.linspace(0, 2, 4), np.linspace(0, 1, 3))
    return mesh.with_defaults()


def rotated(mesh, angle=0.4):
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = MeshQuad(R @ mesh.p, mesh.t)
    return turned.with_boundaries(dict(mesh.boundaries))


def trace_error(basis, x, facets, exact):
    trace = FacetBasis(basis.mesh, basis.elem, facets=facets)
    return np.abs(
        np.array(trace.interpolate(x)) - exact(np.array(trace.global_coordinates()))
    ).max()


def test_dofs_of_one_side_are_u_and_the_tangential_derivative(rectangle):
    basis = Basis(rectangle, ElementQuadAdini())
    nodes = np.flatnonzero(rectangle.p[1] == 0)
    expected = np.sort(np.concatenate([3 * nodes, 3 * nodes + 1]))
    np.testing.assert_array_equal(essential_dofs(basis, "bottom"), expected)
    nodes = np.flatnonzero(rectangle.p[0] == 2)
    expected = np.sort(np.concatenate([3 * nodes, 3 * nodes + 2]))
    np.testing.assert_array_equal(essential_dofs(basis, lambda x: x[0] == 2), expected)


def test_corner_has_both_derivatives(rectangle):
    basis = Basis(rectangle, ElementQuadAdini())
    corner = np.flatnonzero((rectangle.p == 0).all(axis=0))[0]
    fixed = essential_dofs(basis, {"left", "bottom"})
    assert set(3 * corner + np.arange(3)) <= set(fixed)


def test_components_of_a_vector_field(rectangle):
    basis = Basis(rectangle, VECTOR)
    names = np.array(VECTOR.dofnames)
    both = essential_dofs(basis, "left")
    second = essential_dofs(basis, "left", components=1)
    assert set(names[both % 6]) == {"u^1", "u^2", "u_y^1", "u_y^2"}
    assert set(names[second % 6]) == {"u^2", "u_y^2"}
    clamped = essential_dofs(basis, "left", clamp_normal=True, components=[0])
    assert set(names[clamped % 6]) == {"u^1", "u_x^1", "u_y^1"}


def test_slanted_edges_need_constraints(rectangle):
    basis = Basis(rotated(rectangle), ElementQuadAdini())
    with pytest.raises(InputError, match="essential_constraints"):
        essential_dofs(basis, "left")
    assert len(essential_dofs(basis, "left", clamp_normal=True)) == 9


def test_constraints_on_axis_parallel_edges_select_dofs(rectangle):
    basis = Basis(rectangle, ElementQuadAdini())
    T, x0 = essential_constraints(basis, rectangle.boundary_facets())
    free = basis.complement_dofs(essential_dofs(basis, rectangle.boundary_facets()))
    assert set(T.data) == {1.0}
    np.testing.assert_array_equal(np.sort(T.indices), free)
    assert not x0.any()


def test_constraints_and_condense_give_the_same_solution(rectangle):
    basis = Basis(rectangle, ElementQuadAdini())
    K, f = laplace.assemble(basis), LinearForm(lambda v, w: w.x[0] * v).assemble(basis)
    T, x0 = essential_constraints(basis, {"left": 0, "bottom": 0})
    x = T @ solve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0
    expected = solve(*condense(K, f, D=essential_dofs(basis, {"left", "bottom"})))
    np.testing.assert_allclose(x, expected, atol=1e-12)


@pytest.fixture
def parallelogram_basis(parallelograms):
    return Basis(parallelograms, ElementQuadAdini())


def test_columns_are_orthonormal_and_x0_is_orthogonal_to_them(parallelogram_basis):
    basis = parallelogram_basis
    T, x0 = essential_constraints(basis, basis.mesh.boundary_facets(), cubic)
    np.testing.assert_allclose((T.T @ T).toarray(), np.eye(T.shape[1]), atol=1e-14)
    assert (T.max(axis=0) + T.min(axis=0)).toarray().min() > -1e-14
    np.testing.assert_allclose(T.T @ x0, 0, atol=1e-13)


def test_cubic_data_on_edges_of_any_direction(parallelogram_basis, interpolate):
    """The trace is the data for every z, and the cubic itself is among the vectors."""
    basis = parallelogram_basis
    facets = basis.mesh.boundary_facets()
    T, x0 = essential_constraints(basis, facets, cubic)
    z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
    assert trace_error(basis, T @ z + x0, facets, cubic) < 1e-12

    exact = interpolate(
        basis, lambda *x: cubic(x), *(lambda *x, k=k: cubic_gradient(*x)[k] for k in (0, 1))
    )
    np.testing.assert_allclose(T @ (T.T @ (exact - x0)) + x0, exact, atol=1e-12)


def test_patch_test_with_slanted_edges(parallelogram_basis, interpolate):
    """The data are harmonic, so Laplace's equation gives the cubic back exactly."""
    basis = parallelogram_basis
    T, x0 = essential_constraints(basis, basis.mesh.boundary_facets(), cubic)
    K = laplace.assemble(basis)
    x = T @ solve((T.T @ K @ T).tocsc(), -T.T @ (K @ x0)) + x0
    exact = interpolate(
        basis, lambda *x: cubic(x), *(lambda *x, k=k: cubic_gradient(*x)[k] for k in (0, 1))
    )
    np.testing.assert_allclose(x, exact, atol=1e-10)


def test_two_boundaries_and_a_free_component(rectangle):
    basis = Basis(rotated(rectangle), VECTOR)
    T, x0 = essential_constraints(basis, {"left": (1.0, None), "bottom": (None, cubic)})
    z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
    x = T @ z + x0
    names = np.array(VECTOR.dofnames)
    nodes = np.unique(basis.mesh.facets[:, basis.mesh.boundaries["left"]])
    np.testing.assert_allclose(x[basis.nodal_dofs[0, nodes]], 1.0, atol=1e-13)
    assert names[0] == "u^1"
    assert np.ptp(x[basis.nodal_dofs[1, nodes]]) > 0.1
    nodes = np.unique(basis.mesh.facets[:, basis.mesh.boundaries["bottom"]])
    data = cubic(basis.mesh.p[:, nodes])
    np.testing.assert_allclose(x[basis.nodal_dofs[1, nodes]], data, atol=1e-13)


def test_vector_data_and_components(rectangle):
    basis = Basis(rotated(rectangle), VECTOR)
    T, x0 = essential_constraints(basis, "top", lambda x: np.array([cubic(x), x[0] ** 2]))
    z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
    error = trace_error(basis, T @ z + x0, "top", lambda x: np.array([cubic(x), x[0] ** 2]))
    assert error < 1e-12
    one, _ = essential_constraints(basis, "top", 2.0, components=1)
    assert one.shape[1] - T.shape[1] == basis.N - one.shape[1]


def test_derivative_rule_is_exact_to_degree_six(rectangle, interpolate):
    basis = Basis(rectangle, ElementQuadAdini())
    _, x0 = essential_constraints(basis, "bottom", lambda x: x[0] ** 6 - x[0])
    nodes = np.flatnonzero(rectangle.p[1] == 0)
    slope = 6 * rectangle.p[0, nodes] ** 5 - 1
    np.testing.assert_allclose(x0[basis.nodal_dofs[1, nodes]], slope, atol=1e-11)


def test_boundaries_must_agree_where_they_meet(rectangle):
    basis = Basis(rectangle, ElementQuadAdini())
    with pytest.raises(InputError, match="agree where boundaries meet"):
        essential_constraints(basis, {"left": 0.0, "bottom": 1.0})
    essential_constraints(basis, {"left": 0.0, "bottom": lambda x: np.sin(np.pi * x[0])})
    essential_constraints(basis, {"right": 0.0, "bottom": lambda x: np.sin(np.pi * x[0])})


@pytest.mark.parametrize("element", [ElementQuadAdini(), ElementQuadBFS(), VECTOR])
def test_clamped_constraints_leave_what_the_clamped_dofs_leave(rectangle, element):
    basis = Basis(rectangle, element)
    fixed = essential_dofs(basis, "left", clamp_normal=True)
    T, x0 = essential_constraints(basis, "left", clamp_normal=True)
    np.testing.assert_array_equal(T.indices, np.setdiff1d(np.arange(basis.N), fixed))
    assert not x0.any()


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_clamped_data_have_no_slope_across_the_side(rectangle, angle):
    """Of any function that satisfies the conditions: u = g and d_n u = 0 at the vertices."""
    basis = Basis(rotated(rectangle, angle), ElementQuadAdini())
    T, x0 = essential_constraints(basis, "bottom", lambda x: x[0] ** 2, clamp_normal=True)
    x = T @ np.random.default_rng(0).uniform(-1, 1, T.shape[1]) + x0
    nodes = np.unique(basis.mesh.facets[:, basis.mesh.boundaries["bottom"]])
    nodes = nodes[(rectangle.p[0, nodes] > 0) & (rectangle.p[0, nodes] < 2)]
    normal = np.array([-np.sin(angle), np.cos(angle)])
    np.testing.assert_allclose(normal @ x[basis.nodal_dofs[1:, nodes]], 0, atol=1e-12)
    tangent = np.array([np.cos(angle), np.sin(angle)])
    slope = 2 * basis.mesh.p[0, nodes] * np.cos(angle)
    np.testing.assert_allclose(tangent @ x[basis.nodal_dofs[1:, nodes]], slope, atol=1e-12)
    assert trace_error(basis, x, "bottom", lambda x: x[0] ** 2) < 1e-12


def periodic(mesh, kind):
    ends = (mesh.nodes_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (1, 0))
    return kind.periodic(mesh, *ends)


RING = periodic(MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2), MeshQuad1DG)
RING_3D = periodic(MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3), MeshHex1DG)


@pytest.mark.parametrize(
    ("mesh", "element"),
    [(RING, ElementQuadAdini()), (RING_3D, ElementHexAdini())],
    ids=["2-D", "3-D"],
)
def test_sides_of_periodic_meshes(mesh, element):
    """Poisson's equation between two walls is that of one dimension: u = y (1 - y) / 2."""
    basis = Basis(mesh, element)
    walls = []
    for facet in mesh.boundary_facets():
        cell = mesh.f2t[0, facet]
        corners = np.isin(mesh.t[:, cell], mesh.facets[:, facet])
        y = mesh.doflocs[1, mesh.dofs.element_dofs[corners, cell]]
        if np.ptp(y) < 1e-9 and (np.isclose(y[0], 0) or np.isclose(y[0], 1)):
            walls.append(facet)
    D = essential_dofs(basis, np.array(walls))
    K, f = laplace.assemble(basis), LinearForm(lambda v, w: v).assemble(basis)
    x = solve(*condense(K, f, D=D))
    height = np.zeros(mesh.nvertices)
    height[mesh.t] = mesh.doflocs[1, mesh.dofs.element_dofs]
    np.testing.assert_allclose(x[basis.nodal_dofs[0]], height * (1 - height) / 2, atol=1e-12)
    for conditions in (
        lambda: essential_constraints(basis),
        lambda: project_trace(basis, None, 0.0),
    ):
        with pytest.raises(InputError, match="the mesh is periodic"):
            conditions()
