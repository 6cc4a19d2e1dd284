"""Fields on meshes with hanging vertices are continuous, and nothing else is lost."""

import numpy as np
import pytest
from skfem import Basis, ElementVector, MeshQuad
from skfem.models.poisson import laplace

from skfem_adini import ElementQuadAdini, InputError, essential_constraints, hanging_constraints


def tensor(x, y):
    return MeshQuad.init_tensor(np.array(x, float), np.array(y, float))


def refine(mesh, cells):
    return mesh.remove_elements(cells) + mesh.restrict(cells).refined()


def local():
    """Two levels; the inner one shares vertices with the edge of the outer one."""
    mesh = refine(tensor(np.arange(4), np.arange(4)), np.array([4]))
    centres = mesh.p[:, mesh.t].mean(axis=1)
    return refine(mesh, np.flatnonzero((centres > 1).all(0) & (centres < 1.5).all(0)))


def chain():
    """The ends of an edge with a hanging vertex hang themselves."""
    mesh = tensor([0, 1, 2], [0, 1, 2])
    for corner in ((0, 0), (0.5, 0.5), (0.75, 0.75)):
        centres = mesh.p[:, mesh.t].mean(axis=1) - np.array(corner)[:, None]
        size = np.abs(mesh.p[0, mesh.t[0]] - mesh.p[0, mesh.t[2]])
        mesh = refine(mesh, np.flatnonzero((np.abs(centres - size / 2) < 1e-9).all(axis=0)))
    return mesh


def uneven():
    """Two cells beside three, at unequal places, and four beside one."""
    left = tensor([0, 1], [0, 2])
    right = tensor([1, 2], [0, 0.3, 1.1, 1.9, 2])
    return left + right + tensor([-1, 0], [0, 1, 2])


def slanted():
    c, s = np.cos(0.4), np.sin(0.4)
    mesh = local()
    return MeshQuad(np.array([[c, -s], [s, c]]) @ mesh.p, mesh.t)


def sheared_chain():
    mesh = chain()
    return MeshQuad(np.array([[1.0, 0.5], [-0.2, 1]]) @ mesh.p, mesh.t)


def mutual():
    """Cells above and below overlap like bricks in a wall, so vertices hang on each other."""
    return tensor([0, 2, 4], [0, 1]) + tensor([0, 1, 3, 4], [1, 2])


MESHES = {f.__name__: f for f in (local, chain, uneven, slanted, sheared_chain, mutual)}


@pytest.fixture(params=MESHES)
def mesh(request):
    return MESHES[request.param]()


def on_segment(p, a, b):
    """Places s of the points p on the segment from a to b, and whether they lie on it."""
    side = b - a
    s = (p - a) @ side / (side @ side)
    return s, np.linalg.norm(p - a - s[:, None] * side, axis=1) < 1e-9


def hanging_vertices(mesh):
    found = set()
    for edge in mesh.facets[:, mesh.boundary_facets()].T:
        s, close = on_segment(mesh.p.T, *mesh.p[:, edge].T)
        found |= set(np.flatnonzero(close & (s > 1e-9) & (s < 1 - 1e-9)))
    return found


def overlaps(mesh):
    """Pairs of one-sided facets, the second inside the first or across its end, and where."""
    single = mesh.boundary_facets()
    for f in single:
        ends = mesh.p[:, mesh.facets[:, f]].T
        for g in single:
            s, close = on_segment(mesh.p[:, mesh.facets[:, g]].T, *ends)
            low, high = max(s.min(), 0), min(s.max(), 1)
            if f != g and close.all() and high - low > 1e-9:
                yield f, g, ends[0] + np.outer([low, high], ends[1] - ends[0])


def largest_jump(mesh, element, x):
    """Evaluate the field in the cells on both sides, where one-sided edges overlap."""
    pairs = list(overlaps(mesh))
    assert len(pairs) >= 2
    s = np.array([0.1, 0.35, 0.6, 0.9])
    points = np.array([ends[0] + s[:, None] * (ends[1] - ends[0]) for *_, ends in pairs])
    mapping, sides = mesh._mapping(), []
    for side in (0, 1):
        cells = mesh.f2t[0, [pair[side] for pair in pairs]]
        X = mapping.invF(points.transpose(2, 0, 1), tind=cells)
        np.testing.assert_allclose(mapping.F(X, cells), points.transpose(2, 0, 1), atol=1e-12)
        dofs = Basis(mesh, element, intorder=1).element_dofs[:, cells]
        functions = (element.gbasis(mapping, X, i, cells)[0] for i in range(len(dofs)))
        sides.append(sum(x[d][:, None] * np.array(f) for d, f in zip(dofs, functions, strict=True)))
    return np.abs(sides[0] - sides[1]).max()


def test_random_fields_are_continuous(mesh):
    """Two dofs of every hanging vertex are lost, and no more."""
    for components in (1, 2):
        element = ElementVector(ElementQuadAdini()) if components == 2 else ElementQuadAdini()
        basis = Basis(mesh, element, intorder=1)
        T, x0 = hanging_constraints(basis)
        assert not x0.any()
        z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
        assert largest_jump(mesh, element, T @ z) < 1e-13
        free = np.random.default_rng(0).uniform(-1, 1, basis.N)
        assert largest_jump(mesh, element, free) > 0.1
        assert T.shape[1] == basis.N - 2 * components * len(hanging_vertices(mesh))
    assert np.linalg.matrix_rank(T.toarray()) == T.shape[1]


def cubic(basis):
    """The dofs of a harmonic cubic."""
    found, (x, y) = basis.zeros(), basis.mesh.p
    slopes = [3 * x**2 - 3 * y**2, -6 * x * y + 1]
    found[basis.nodal_dofs] = [x**3 - 3 * x * y**2 + y, *slopes]
    return found


def test_every_cubic_remains(mesh):
    basis = Basis(mesh, ElementQuadAdini(), intorder=1)
    T, x = hanging_constraints(basis)[0], cubic(basis)
    z = np.linalg.lstsq(T.toarray(), x, rcond=None)[0]
    np.testing.assert_allclose(T @ z, x, atol=1e-12)


def test_formula_at_the_middle_of_an_edge():
    """One cell of height 2 beside two: u_m, t_m from the ends, u_n free."""
    mesh = tensor([0, 1], [0, 2]) + tensor([1, 2], [0, 1, 2])
    basis = Basis(mesh, ElementQuadAdini(), intorder=1)
    T, _ = hanging_constraints(basis)
    z = np.random.default_rng(0).uniform(-1, 1, T.shape[1])
    m, low, high = (np.flatnonzero(((1, y) == mesh.p.T).all(axis=1))[0] for y in (1, 0, 2))
    u, _, u_y = (T @ z)[basis.nodal_dofs]
    assert u[m] == pytest.approx((u[low] + u[high]) / 2 + 2 / 8 * (u_y[low] - u_y[high]))
    assert u_y[m] == pytest.approx(3 * (u[high] - u[low]) / 4 - (u_y[low] + u_y[high]) / 4)
    row = T[[basis.nodal_dofs[1, m]]]
    assert row.data.tolist() == [1.0]
    assert T[:, row.indices].nnz == 1
    T, x0 = hanging_constraints(Basis(MeshQuad().refined(2), ElementQuadAdini()))
    np.testing.assert_array_equal(T.toarray(), np.eye(len(x0)))  # nothing hangs there


def test_patch_test_with_dirichlet_conditions(mesh):
    """The data are harmonic, so Laplace's equation gives the cubic back exactly."""
    basis = Basis(mesh, ElementQuadAdini())
    inner = [facet for pair in overlaps(mesh) for facet in pair[:2]]
    outer = np.setdiff1d(mesh.boundary_facets(), inner)
    data = lambda x: x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[1]  # noqa: E731
    essential = essential_constraints(basis, outer, data)
    T, x0 = hanging_constraints(basis, essential)
    K = laplace.assemble(basis)
    z = np.linalg.solve((T.T @ K @ T).toarray(), -T.T @ (K @ x0))
    np.testing.assert_allclose(T @ z + x0, cubic(basis), atol=1e-10)


def test_conditions_on_the_divided_edges_are_refused():
    mesh = local()
    basis = Basis(mesh, ElementQuadAdini(), intorder=1)
    essential = essential_constraints(basis, mesh.boundary_facets())
    with pytest.raises(InputError, match="name the boundary by its coordinates"):
        hanging_constraints(basis, essential)
