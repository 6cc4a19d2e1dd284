"""The functions of the elements: symbolic oracles, duality, continuity, spaces they reproduce."""

from itertools import product

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval2d, polyval3d
from skfem import Basis, ElementVector, InteriorFacetBasis, MeshHex, MeshQuad
from symfem import create_element

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

EPS = np.finfo(float).eps
X = sympy.symbols("x y z")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
CUBE = [(1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)]
CORNERS = {2: SQUARE, 3: CUBE}
MESHES = {2: MeshQuad, 3: MeshHex}
# Exponents of the monomials that span the functions.
EXPONENTS = {
    ElementQuadAdini: [e for e in np.ndindex(4, 4) if sum(k > 1 for k in e) <= 1],
    ElementHexAdini: [e for e in np.ndindex(4, 4, 4) if sum(k > 1 for k in e) <= 1],
    ElementQuadBFS: list(np.ndindex(4, 4)),
}
CELLS = {
    "square": SQUARE,
    "clockwise": [(0, 0), (0, 2), (1, 2), (1, 0)],
    "sheared square": [(1, 1), (3, 2), (4, 4), (2, 3)],
    "trapezoid": [(0, 0), (2, 0), (1, 1), (0, 1)],
    "convex": [(0, 0), (3, -1), (4, 3), (1, 2)],
    "cube": CUBE,
    "mirrored": [(y, x, 2 * z) for x, y, z in CUBE],
    "sheared cube": [(2 * x + y, 1 + y - z, 3 * z + x) for x, y, z in CUBE],
    "frustum": [(x * (4 - z), y * (4 - 2 * z), 3 * z) for x, y, z in CUBE],
    "twisted": [(3 * x + y * z, 2 * y - x * z, 4 * z + x * y * z) for x, y, z in CUBE],
}


def dual_basis(corners, space):
    """In exact arithmetic: coefficients of the functions dual to u and its gradient, and DF^T."""
    dim = len(corners[0])
    x, F = X[:dim], sympy.zeros(dim, 1)
    for corner, place in zip(CORNERS[dim], corners, strict=True):
        weight = sympy.prod(t if c else 1 - t for t, c in zip(x, corner, strict=True))
        F += weight * sympy.Matrix(place)
    jacobian, rows = F.jacobian(x).T, []
    for corner in CORNERS[dim]:
        at = dict(zip(x, corner, strict=True))
        gradients = sympy.Matrix([[m.diff(t).subs(at) for m in space] for t in x])
        rows += [[m.subs(at) for m in space]]
        rows += (jacobian.subs(at).inv() * gradients).tolist()
    dofs = sympy.polys.matrices.DomainMatrix.from_Matrix(sympy.Matrix(rows)).to_field()
    return dofs.inv().to_Matrix().T, jacobian


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CELLS)
def test_functions_equal_the_symbolic_dual_basis(name):
    corners = CELLS[name]
    dim = len(corners[0])
    x, element = X[:dim], {2: ElementQuadAdini(), 3: ElementHexAdini()}[dim]
    space = [sympy.prod(t**k for t, k in zip(x, e, strict=True)) for e in EXPONENTS[type(element)]]
    coefficients, jacobian = dual_basis(corners, space)
    mesh = MESHES[dim](np.array(corners, float).T, np.arange(2**dim)[:, None])
    points = np.array(list(product((0, 2, 5, 7), repeat=dim))).T / 7
    C = np.array(coefficients, dtype=float)
    monomials, *slopes = (
        np.array([np.broadcast_to(sympy.lambdify(x, m)(*points), points[0].shape) for m in row])
        for row in (space, *([m.diff(t) for m in space] for t in x))
    )
    DFT = np.array([[sympy.lambdify(x, entry)(*p) for entry in jacobian] for p in points.T])
    inverse = np.linalg.inv(DFT.reshape(-1, dim, dim).astype(float))
    gradients = np.einsum("pij,jfp->ifp", inverse, np.array([C @ slope for slope in slopes]))
    atol = {2: 2e-14, 3: 4e-14}[dim]
    for i in range(len(C)):
        (field,) = element.gbasis(mesh._mapping(), points, i)
        np.testing.assert_allclose(np.array(field)[0], (C @ monomials)[i], rtol=0, atol=atol)
        np.testing.assert_allclose(field.grad[:, 0], gradients[:, i], rtol=0, atol=atol)
        if name in ("square", "cube"):
            value, gradient = element.lbasis(points, i)
            np.testing.assert_allclose(value, (C @ monomials)[i], rtol=0, atol=1e-14)
            np.testing.assert_allclose(gradient, gradients[:, i], rtol=0, atol=1e-14)


def test_bicubic_functions_equal_symfem():
    """symfem numbers vertices (0,0), (1,0), (0,1), (1,1) and dofs u, u_x, u_y, u_xy."""
    oracle = create_element("quadrilateral", "BFS", 3).get_basis_functions()
    points = np.array(list(product((0, 2, 5, 7), repeat=2))).T / 7
    for i in range(16):
        expression = oracle[4 * (0, 1, 3, 2)[i // 4] + i % 4].as_sympy()
        value, gradient = ElementQuadBFS().lbasis(points, i)
        exact = [expression, *(sympy.diff(expression, x) for x in X[:2])]
        for computed, function in zip((value, *gradient), exact, strict=True):
            expected = sympy.lambdify(X[:2], function)(*points)
            np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-14)


def test_dofs_of_functions_are_the_identity(space):
    mesh, kind = space
    element, mapping = kind(), mesh._mapping()
    n, dofs = len(element.doflocs), []
    for i in range(n):
        (f,) = element.gbasis(mapping, element.doflocs[:: element.nodal_dofs].T, i)
        parts = {"u": np.array(f), "u_xy": f.hess[0, 1]}
        parts |= {f"u_{name}": f.grad[k] for k, name in enumerate("xyz"[: mesh.dim()])}
        own = np.array([parts[name] for name in element.dofnames])
        dofs.append(own.transpose(1, 2, 0).reshape(-1, n))
    identity = np.broadcast_to(np.eye(n)[:, None], np.shape(dofs))
    atol = 1e-12 if kind is ElementQuadBFS else 1e-13
    np.testing.assert_allclose(dofs, identity, rtol=0, atol=atol)


def test_value_functions_are_a_partition_of_unity(space):
    mesh, kind = space
    element, mapping, dim = kind(), mesh._mapping(), mesh.dim()
    points = np.random.default_rng(0).uniform(0, 1, (dim, 30))
    values = range(0, len(element.doflocs), element.nodal_dofs)
    fields = [element.gbasis(mapping, points, i)[0] for i in values]
    rounding = {2: 1e-15, 3: 2e-15}[dim]
    for found in (
        sum(np.array(f) for f in fields),
        sum(element.lbasis(points, i)[0] for i in values),
    ):
        np.testing.assert_allclose(found, 1, rtol=0, atol=rounding)
    np.testing.assert_allclose(sum(f.grad for f in fields), 0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", EXPONENTS)
def test_there_are_no_other_functions(kind):
    element = kind()
    mapping = MESHES[element.dim]()._mapping()
    for i in (-1, len(EXPONENTS[kind]), 1000):
        with pytest.raises(ValueError, match="Index larger than the number of basis functions"):
            element.lbasis(element.refdom.p, i)
        with pytest.raises(ValueError, match="Index larger than the number of basis functions"):
            element.gbasis(mapping, element.refdom.p, i)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("vector", [False, True], ids=["scalar", "vector"])
def test_jumps_of_random_fields(space, vector):
    """u and its derivatives along facets are continuous, those across for BFS alone."""
    mesh, kind = space
    element = ElementVector(kind()) if vector else kind()
    order = {2: None, 3: 5}[mesh.dim()]
    sides = [InteriorFacetBasis(mesh, element, side=side, intorder=order) for side in (0, 1)]
    x = np.random.default_rng(0).uniform(-1, 1, sides[0].N)
    u, v = (basis.interpolate(x) for basis in sides)
    assert np.abs(np.array(u) - np.array(v)).max() < 1e-13

    n = np.array(sides[0].normals)
    jump = u.grad - v.grad
    across = np.einsum("...iep,iep->...ep", jump, n)
    along = jump - np.einsum("...ep,iep->...iep", across, n)
    size = np.abs(u.grad).max()
    assert np.linalg.norm(along, axis=-3).max() < 1e-13 * size
    if kind is ElementQuadBFS:
        assert np.abs(across).max() < 1e-13 * size
        assert np.abs(u.hess - v.hess).max() > 0.1 * np.abs(u.hess).max()
    else:
        assert np.abs(across).max() > 0.1 * size


def placed(kind, dim, log_size, log_aspects, shear, seed, mirrored):
    """DF of a cell [-1, 1]^dim -> parallelepiped; rectangles are turned by quarters only."""
    lengths = 10.0**log_size * np.array([1.0, *(10.0 ** np.array(log_aspects))])[:dim]
    upper = np.eye(dim)
    if kind is ElementQuadBFS:
        rotation = np.linalg.matrix_power(np.array([[0.0, -1], [1, 0]]), seed % 4)
    else:
        rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(dim, dim)))[0]
        upper[np.triu_indices(dim, 1)] = shear[: dim * (dim - 1) // 2]
    DF = rotation @ upper @ np.diag(lengths) / 2
    return DF[:, ::-1] if mirrored else DF


@pytest.mark.parametrize("kind", EXPONENTS)
@given(
    coefficients=st.lists(st.integers(-9, 9), min_size=32, max_size=32).filter(
        lambda c: any(c[:12])
    ),
    log_size=st.floats(-6, 6),
    log_aspects=st.tuples(st.floats(-4, 4), st.floats(-3, 3)),
    log_offset=st.floats(-2, 8),
    shear=st.tuples(*[st.floats(-1, 1)] * 3),
    seed=st.integers(0, 1000),
    mirrored=st.booleans(),
)
def test_polynomials_in_scaled_coordinates(
    kind, coefficients, log_size, log_aspects, log_offset, shear, seed, mirrored
):
    """Interpolate p((F^-1 x)) on a cell of any size, aspects, place, direction and sense."""
    element = kind()
    dim = element.dim
    polyval = {2: polyval2d, 3: polyval3d}[dim]
    p = np.zeros((4,) * dim)
    for e, c in zip(EXPONENTS[kind], coefficients, strict=False):
        p[e] = c
    p /= np.abs(polyval(*np.meshgrid(*[np.linspace(-1, 1, {2: 41, 3: 15}[dim])] * dim), p)).max()
    DF = placed(kind, dim, log_size, log_aspects, shear, seed, mirrored)
    direction = np.random.default_rng(seed + 1).normal(size=dim)
    smallest = 2 * np.linalg.svd(DF, compute_uv=False).min()
    offset = 10.0**log_offset * smallest * direction / np.linalg.norm(direction)
    corners = 2 * element.refdom.p - 1
    mesh = MESHES[dim](offset[:, None] + DF @ corners, np.arange(2**dim)[:, None])

    slopes = np.array([polyval(*corners, polyder(p, axis=axis)) for axis in range(dim)])
    rows = [polyval(*corners, p), *np.linalg.solve(DF.T, slopes)]
    if kind is ElementQuadBFS:
        D = np.linalg.inv(DF)
        mixed = polyval(*corners, polyder(polyder(p, axis=0), axis=1))
        rows.append((D[0, 0] * D[1, 1] + D[1, 0] * D[0, 1]) * mixed)
    dofs = np.vstack(rows).T.ravel()

    points, mapping = np.random.default_rng(0).uniform(0, 1, (dim, 50)), mesh._mapping()
    u = sum(d * np.array(element.gbasis(mapping, points, i)[0]) for i, d in enumerate(dofs))
    error = np.abs(u[0] - polyval(*(2 * points - 1), p)).max()
    # The rounding of the vertices, over the thickness of the cell.
    assert error <= 1e-12 + 10 * EPS * np.abs(mesh.p).max() / smallest


@pytest.mark.parametrize("exponents", [(2, 2), (2, 2, 0), (2, 0, 2), (0, 2, 2)], ids=str)
def test_the_spaces_lack_products_of_squares(exponents):
    dim, e = len(exponents), np.array(exponents)
    basis = Basis(MESHES[dim](), {2: ElementQuadAdini(), 3: ElementHexAdini()}[dim])
    p, x = basis.mesh.p.T, basis.zeros()
    x[basis.nodal_dofs[0]] = np.prod(p**e, axis=1)
    for row, unit in zip(basis.nodal_dofs[1:], np.eye(dim, dtype=int), strict=True):
        x[row] = (e @ unit) * np.prod(p ** np.maximum(e - unit, 0), axis=1)
    exact = np.prod(np.moveaxis(np.array(basis.global_coordinates()), 0, -1) ** e, axis=-1)
    assert np.abs(basis.interpolate(x) - exact).max() > 1e-2
