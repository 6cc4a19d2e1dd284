"""Dirichlet conditions in the plane and in space: fixed dofs, exact data, projected traces."""

import re

import numpy as np
import pytest
import skfem
from convergence import order
from skfem import Basis, ElementVector, FacetBasis, Functional, MeshHex, MeshQuad, condense, solve
from skfem.models.poisson import laplace, unit_load

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    InputError,
    essential_constraints,
    essential_dofs,
    project_trace,
)

ADINI, BRICK, BFS = ElementQuadAdini(), ElementHexAdini(), ElementQuadBFS()
ELEMENTS = {2: ADINI, 3: BRICK}
ANGLE = 0.4
each = pytest.mark.parametrize("dim", [2, 3])


def box(dim, turned=False):
    """Cells of several sizes; turned about the last axis of space."""
    ticks = np.linspace(0, 2, 4), np.linspace(0, 1, 3), np.array([0, 0.4, 1])
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*ticks[:dim]).with_defaults()
    if not turned:
        return mesh
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    p = np.array([c * mesh.p[0] - s * mesh.p[1], s * mesh.p[0] + c * mesh.p[1], *mesh.p[2:]])
    return type(mesh)(p, mesh.t).with_boundaries(dict(mesh.boundaries))


def space(dim, turned=False, vector=False):
    element = ElementVector(ELEMENTS[dim]) if vector else ELEMENTS[dim]
    return Basis(box(dim, turned), element, intorder=1)


def cubic(x):
    """A harmonic cubic."""
    plane = x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[0] * x[1] - 2 * x[-1] + 1
    return plane if len(x) == 2 else plane + x[0] * x[1] * x[2] + x[2] ** 2 - x[1] ** 2


def exact_dofs(basis):
    """The cubic and its gradient at the vertices."""
    found, p = basis.zeros(), basis.mesh.p
    slopes = [3 * p[0] ** 2 - 3 * p[1] ** 2 + p[1], -6 * p[0] * p[1] + p[0], *(0 * p[2:])]
    slopes[-1] = slopes[-1] - 2
    if len(p) == 3:
        more = [p[1] * p[2], p[0] * p[2] - 2 * p[1], p[0] * p[1] + 2 * p[2]]
        slopes = np.add(slopes, more)
    found[basis.nodal_dofs] = [cubic(p), *slopes]
    return found


def smooth(x):
    return (
        np.sin(3 * x[0]) * np.exp(x[1]) if len(x) == 2 else np.sin(3 * x[0] + x[2]) * np.exp(x[1])
    )


def trace(basis, x, facets, intorder=8):
    boundary = FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=intorder)
    return boundary, np.array(boundary.interpolate(x)), np.array(boundary.global_coordinates())


def random(T):
    return np.random.default_rng(0).uniform(-1, 1, T.shape[1])


# Which dofs are fixed.


@pytest.mark.parametrize("element", [ADINI, BFS, BRICK], ids=lambda e: type(e).__name__)
def test_dofs_of_one_side_are_u_and_its_derivatives_along_it(element):
    basis = Basis(box(element.dim), element, intorder=1)
    names, n = np.array(element.dofnames), element.nodal_dofs
    for axis in range(element.dim):
        nodes = np.flatnonzero(basis.mesh.p[axis] == 0)
        across = [name for name in names if "xyz"[axis] in name]
        kinds = np.flatnonzero(~np.isin(names, across))
        side = lambda x, axis=axis: x[axis] == 0  # noqa: E731
        expected = np.sort((n * nodes[:, None] + kinds).ravel())
        np.testing.assert_array_equal(essential_dofs(basis, side), expected)
        whole = np.sort((n * nodes[:, None] + np.arange(n)).ravel())
        np.testing.assert_array_equal(essential_dofs(basis, side, clamp_normal=True), whole)
    # What the idiom of Lagrange elements adds is the normal derivative.
    left = basis.get_dofs("left")
    extra = np.setdiff1d(left.all(), essential_dofs(basis, "left"))
    across = [name for name in names if "x" in name]
    np.testing.assert_array_equal(extra, np.sort(left.all(across)))


@each
def test_components_of_a_vector_field(dim):
    basis = space(dim, vector=True)
    names = np.array(basis.elem.dofnames)

    def held(**options):
        return set(names[essential_dofs(basis, "left", **options) % len(names)])

    rest = [f"u_{axis}" for axis in "yz"[: dim - 1]]
    along = {f"{name}^{k + 1}" for name in ("u", *rest) for k in range(dim)}
    assert held() == along
    assert held(components=1) == {name for name in along if name.endswith("2")}
    first = {name for name in names if name.endswith("1")}
    assert held(clamp_normal=True, components=[0]) == first


@each
def test_slanted_sides_need_constraints(dim):
    basis = space(dim, turned=True)
    with pytest.raises(InputError) as refusal:
        essential_dofs(basis, "left")
    recipe = re.sub(r"\s+", " ", str(refusal.value))
    assert "T, x0 = essential_constraints(basis, facets, value)" in recipe
    assert "(T.T @ K @ T) z = T.T @ (f - K @ x0)" in recipe
    assert len(essential_dofs(basis, "left", clamp_normal=True)) == {2: 9, 3: 36}[dim]


@each
def test_constraints_on_axis_parallel_sides_select_dofs(dim):
    basis = space(dim)
    facets = basis.mesh.boundary_facets()
    T, x0 = essential_constraints(basis)
    free = basis.complement_dofs(essential_dofs(basis))
    assert set(T.data) == {1.0}
    np.testing.assert_array_equal(np.sort(T.indices), free)
    assert not x0.any()
    # The whole boundary is the default.
    np.testing.assert_array_equal(essential_dofs(basis), essential_dofs(basis, facets))
    one, same = essential_constraints(basis, value=1.0), essential_constraints(basis, facets, 1.0)
    assert abs(one[0] - same[0]).max() == 0
    np.testing.assert_array_equal(one[1], same[1])


# Data on sides of any direction.


def one_normal(mesh):
    """Vertices of the boundary whose facets have one normal."""
    basis = FacetBasis(mesh, ELEMENTS[mesh.dim()], intorder=1)
    n = np.array(basis.normals)[:, :, 0]
    found = []
    for vertex in mesh.boundary_nodes():
        own = (mesh.facets[:, basis.find] == vertex).any(axis=0)
        if np.abs(n[:, own] - n[:, own][:, :1]).max() < 1e-9:
            found.append(vertex)
    return found


def test_cubic_data_on_sides_of_any_direction(parallel_cells):
    """The trace is the data for every z, the cubic is among the vectors, and solves Laplace's."""
    mesh, dim = parallel_cells, parallel_cells.dim()
    basis = Basis(mesh, ELEMENTS[dim])
    facets, exact = mesh.boundary_facets(), exact_dofs(basis)
    T, x0 = essential_constraints(basis, facets, cubic)
    np.testing.assert_allclose((T.T @ T).toarray(), np.eye(T.shape[1]), atol=1e-14)
    np.testing.assert_allclose(T.T @ x0, 0, atol=1e-13)
    if dim == 2:
        assert (T.max(axis=0) + T.min(axis=0)).toarray().min() > -1e-14
    assert T.shape[1] == (dim + 1) * len(mesh.interior_nodes()) + len(one_normal(mesh))
    _, values, points = trace(basis, T @ random(T) + x0, facets)
    np.testing.assert_allclose(values, cubic(points), atol=1e-12)
    np.testing.assert_allclose(T @ (T.T @ (exact - x0)) + x0, exact, atol=1e-12)
    K = laplace.assemble(basis)
    x = T @ solve((T.T @ K @ T).tocsc(), -T.T @ (K @ x0)) + x0
    np.testing.assert_allclose(x, exact, atol=1e-10)
    _, values, points = trace(basis, project_trace(basis, facets, cubic), facets)
    np.testing.assert_allclose(values, cubic(points), atol=1e-11)


@each
def test_several_boundaries_and_a_free_component(dim):
    basis = space(dim, turned=True, vector=True)
    rest = (2.0,) * (dim - 2)
    T, x0 = essential_constraints(
        basis, {"left": (1.0, None, *rest), "bottom": (None, cubic, *rest)}
    )
    x = T @ random(T) + x0
    for side, component, data in (("left", 0, lambda x: 1.0), ("bottom", 1, cubic)):
        _, values, points = trace(basis, x, side)
        np.testing.assert_allclose(values[component], data(points), atol=1e-12)
        np.testing.assert_allclose(values[2:], 2, atol=1e-12)
        assert np.ptp(values[1 - component]) > 0.1
    data = lambda x: np.array([cubic(x), x[0] ** 2, *(0 * x[2:])])  # noqa: E731
    T, x0 = essential_constraints(basis, "right", data)
    _, values, points = trace(basis, T @ random(T) + x0, "right")
    np.testing.assert_allclose(values, data(points), atol=1e-12)
    one, _ = essential_constraints(basis, "right", 2.0, components=1)
    assert basis.N - T.shape[1] == dim * (basis.N - one.shape[1])


def test_zero_on_warped_faces(warped_hexes):
    basis = Basis(warped_hexes, BRICK, intorder=1)
    T, x0 = essential_constraints(basis, warped_hexes.boundary_facets())
    _, values, _ = trace(basis, T @ random(T) + x0, None)
    assert np.abs(values).max() < 1e-14
    assert T.shape[1] >= 4


def test_derivative_rule_is_exact_to_degree_six():
    basis = space(2)
    _, x0 = essential_constraints(basis, "bottom", lambda x: x[0] ** 6 - x[0])
    nodes = np.flatnonzero(basis.mesh.p[1] == 0)
    slope = 6 * basis.mesh.p[0, nodes] ** 5 - 1
    np.testing.assert_allclose(x0[basis.nodal_dofs[1, nodes]], slope, atol=1e-11)


def test_boundaries_must_agree_where_they_meet():
    basis, wave = space(2), lambda x: np.sin(np.pi * x[0])
    with pytest.raises(InputError, match="agree where boundaries meet"):
        essential_constraints(basis, {"left": 0.0, "bottom": 1.0})
    essential_constraints(basis, {"left": 0.0, "bottom": wave})
    essential_constraints(basis, {"right": 0.0, "bottom": wave})


@pytest.mark.parametrize("element", [ADINI, BFS, ElementVector(ADINI)])
def test_clamped_constraints_leave_what_the_clamped_dofs_leave(element):
    basis = Basis(box(2), element)
    fixed = essential_dofs(basis, "left", clamp_normal=True)
    T, x0 = essential_constraints(basis, "left", clamp_normal=True)
    np.testing.assert_array_equal(T.indices, np.setdiff1d(np.arange(basis.N), fixed))
    assert not x0.any()


@pytest.mark.parametrize("turned", [False, True])
def test_clamped_data_have_no_slope_across_the_side(turned):
    """Of any function that satisfies the conditions: u = g and d_n u = 0 at the vertices."""
    basis, angle = space(2, turned), ANGLE * turned
    T, x0 = essential_constraints(basis, "bottom", lambda x: x[0] ** 2, clamp_normal=True)
    x, straight = T @ random(T) + x0, box(2).p[0]
    nodes = np.unique(basis.mesh.facets[:, basis.mesh.boundaries["bottom"]])
    nodes = nodes[(straight[nodes] > 0) & (straight[nodes] < 2)]
    normal, tangent = np.array([[-np.sin(angle), np.cos(angle)], [np.cos(angle), np.sin(angle)]])
    np.testing.assert_allclose(normal @ x[basis.nodal_dofs[1:, nodes]], 0, atol=1e-12)
    slope = 2 * basis.mesh.p[0, nodes] * np.cos(angle)
    np.testing.assert_allclose(tangent @ x[basis.nodal_dofs[1:, nodes]], slope, atol=1e-12)
    _, values, points = trace(basis, x, "bottom")
    np.testing.assert_allclose(values, points[0] ** 2, atol=1e-12)


def periodic(mesh, kind):
    ends = (mesh.nodes_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (1, 0))
    return kind.periodic(mesh, *ends)


RING = periodic(MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2), skfem.MeshQuad1DG)
RING_3D = periodic(MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3), skfem.MeshHex1DG)


@pytest.mark.parametrize("mesh", [RING, RING_3D], ids=["2-D", "3-D"])
def test_sides_of_periodic_meshes(mesh):
    """Poisson's equation between two walls is that of one dimension: u = y (1 - y) / 2."""
    basis = Basis(mesh, ELEMENTS[mesh.dim()])
    walls = []
    for facet in mesh.boundary_facets():
        cell = mesh.f2t[0, facet]
        corners = np.isin(mesh.t[:, cell], mesh.facets[:, facet])
        y = mesh.doflocs[1, mesh.dofs.element_dofs[corners, cell]]
        if np.ptp(y) < 1e-9 and (np.isclose(y[0], 0) or np.isclose(y[0], 1)):
            walls.append(facet)
    K, f = laplace.assemble(basis), unit_load.assemble(basis)
    x = solve(*condense(K, f, D=essential_dofs(basis, np.array(walls))))
    height = np.zeros(mesh.nvertices)
    height[mesh.t] = mesh.doflocs[1, mesh.dofs.element_dofs]
    np.testing.assert_allclose(x[basis.nodal_dofs[0]], height * (1 - height) / 2, atol=1e-12)
    for conditions in (essential_constraints, lambda basis: project_trace(basis, None, 0.0)):
        with pytest.raises(InputError, match="the mesh is periodic"):
            conditions(basis)


# One call for Dirichlet conditions: what it gives, and what `get_dofs` costs.


def wave(x):
    return np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])


def error(basis, u, exact):
    square = Functional(lambda w: (w["u"] - exact(w.x)) ** 2)
    return np.sqrt(square.assemble(basis, u=basis.interpolate(u)))


@pytest.mark.parametrize("element", [ADINI, BFS], ids=["Adini", "BFS"])
def test_orders_of_both_idioms(element):
    cells, right, wrong = (4, 8, 16), [], []
    for n in cells:
        basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2), element)
        K = laplace.assemble(basis)
        f = skfem.LinearForm(lambda v, w: 2 * np.pi**2 * wave(w.x) * v).assemble(basis)
        right.append(error(basis, solve(*condense(K, f, D=essential_dofs(basis))), wave))
        wrong.append(error(basis, solve(*condense(K, f, D=basis.get_dofs())), wave))
    assert order(cells, right) == pytest.approx(4, abs=0.15)
    assert order(cells, wrong) == pytest.approx(1, abs=0.25)


# L2 projection onto the trace.


def test_the_error_of_projection_is_orthogonal(any_cells):
    """The error of the projection is orthogonal to the trace space, by another quadrature."""
    mesh = any_cells
    basis = Basis(mesh, ELEMENTS[mesh.dim()], intorder=1)
    x = project_trace(basis, mesh.boundary_facets(), smooth)
    rule = np.polynomial.legendre.leggauss(8)
    s, w = (rule[0] + 1) / 2, rule[1] / 2
    square = np.array(np.meshgrid(s, s)).reshape(2, -1), np.outer(w, w).ravel()
    quadrature = (s[None], w) if mesh.dim() == 2 else square
    boundary = FacetBasis(mesh, basis.elem, quadrature=quadrature)
    error = np.array(boundary.interpolate(x)) - smooth(np.array(boundary.global_coordinates()))
    error, moments = error * boundary.dx, np.zeros(basis.N)
    for (function,), dofs in zip(boundary.basis, boundary.element_dofs, strict=True):
        np.add.at(moments, dofs, (error * np.array(function)).sum(axis=1))
    np.testing.assert_allclose(moments, 0, atol=1e-10)
    assert np.abs(error).max() > 1e-6


@each
def test_projection_leaves_normal_derivatives_and_other_dofs_zero(dim):
    basis = space(dim)
    x, on = project_trace(basis, lambda x: x[-1] == 1, smooth), basis.mesh.p[-1] == 1
    assert not x[basis.nodal_dofs[dim]].any()
    assert not x[basis.nodal_dofs[:, ~on]].any()
    assert np.abs(x[basis.nodal_dofs[1:dim, on]]).min() > 0
    vector = space(dim, vector=True)
    y = project_trace(vector, lambda x: x[-1] == 1, [cubic, smooth, cubic][:dim], components=1)
    np.testing.assert_array_equal(y[vector.nodal_dofs[1::dim]], x[basis.nodal_dofs])
    assert not np.delete(y[vector.nodal_dofs], np.s_[1::dim], axis=0).any()


def test_bicubic_traces():
    basis = Basis(box(2), BFS)
    field = lambda x: x[0] ** 3 * x[1] ** 2 - 2 * x[0] * x[1] ** 3 + x[1] + 1  # noqa: E731
    T, x0 = essential_constraints(basis, "top", field)
    assert T.shape[1] == basis.N - len(essential_dofs(basis, "top"))
    for x in (T @ random(T) + x0, project_trace(basis, "top", field)):
        _, values, points = trace(basis, x, "top")
        np.testing.assert_allclose(values, field(points), atol=1e-12)
