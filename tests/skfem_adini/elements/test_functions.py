"""The functions of the elements and their derivatives: symbolic oracles, duality, continuity."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from math import perm

import numpy as np
import pytest
import skfem
import sympy
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval2d, polyval3d
from skfem import Basis, BilinearForm, ElementDG, ElementVector, FacetBasis, MeshHex, MeshQuad
from skfem.helpers import dd, ddd, ddot
from skfem.models.poisson import laplace
from symfem import create_element

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, InputError

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
    sides = [skfem.InteriorFacetBasis(mesh, element, side=side, intorder=order) for side in (0, 1)]
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


# Derivatives: against differences and by the chain rule, on demand, and as many as asked for.


# Places of value, gradient and Hessian in DiscreteField.get.
FIELD = [0, 1, 4]
NAMES = ["value", "grad", "hess", "grad3", "grad4", "grad5", "grad6"]
STEP = 1e-6
MESH_OF = {
    ElementQuadAdini: MeshQuad().refined(1),
    ElementQuadBFS: MeshQuad().refined(1),
    ElementHexAdini: MeshHex(),
}
BENDING = BilinearForm(lambda u, v, _: ddot(dd(u), dd(v)))
each = pytest.mark.parametrize("kind", MESH_OF)


@pytest.mark.parametrize("order", [1, 2])
def test_differences_of_the_order_below(space, order):
    mesh, kind = space
    element, mapping, dim = kind(derivatives=order), mesh._mapping(), mesh.dim()
    points = np.random.default_rng(0).uniform(0.1, 0.9, (dim, 12 // dim))
    tind = np.arange(mesh.nelements)
    ends = [
        [mapping.invF(mapping.F(points) + s * shift, tind=tind) for s in (1, -1)]
        for shift in STEP * np.eye(dim)[:, :, None, None]
    ]
    for i in range(0, len(element.doflocs), 1 if dim == 2 else 5):
        quotients = []
        for pair in ends:
            high, low = (element.gbasis(mapping, end, i, tind=tind)[0] for end in pair)
            quotients.append((high.get(FIELD[order - 1]) - low.get(FIELD[order - 1])) / (2 * STEP))
        computed = element.gbasis(mapping, points, i)[0].get(FIELD[order])
        scale = np.abs(computed).max()
        np.testing.assert_allclose(computed, quotients, rtol=0, atol=1e-7 * max(scale, 10.0**order))


def tensor(exponents, A, x, order):
    """All derivatives of one order of the monomial (A x)^e, by the chain rule."""
    dim, X = len(A), np.einsum("ij,j...->i...", A, x)
    found = np.zeros((dim,) * order + X.shape[1:])
    for index in np.ndindex(*(dim,) * order):
        counts = np.bincount(np.array(index, dtype=int), minlength=dim)
        left = np.subtract(exponents, counts)
        if left.min() >= 0:
            factor = np.prod([perm(e, k) for e, k in zip(exponents, counts, strict=True)])
            found[index] = factor * np.prod([c**k for c, k in zip(X, left, strict=True)], axis=0)
    for axis in range(order):
        found = np.moveaxis(np.tensordot(A, found, (0, axis)), 0, axis)
    return found


def interpolant(basis, exponents, A):
    """The interpolant of (A x)^e, and its derivatives of each order by the chain rule."""
    p, points = basis.mesh.p, np.array(basis.global_coordinates())
    rows = [tensor(exponents, A, p, 0), *tensor(exponents, A, p, 1)]
    if basis.elem.nodal_dofs > len(rows):
        rows.append(tensor(exponents, A, p, 2)[0, 1])
    x = basis.zeros()
    x[basis.nodal_dofs] = rows
    return basis.interpolate(x), lambda order: tensor(exponents, A, points, order)


GRADED = MeshQuad.init_tensor(np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0, 1.1]))
SHEARED = [
    (ElementQuadAdini, MeshQuad().refined(2), (3, 1), 0.5),
    (ElementHexAdini, MeshHex().refined(1), (3, 1, 1), 0.5),
    (ElementQuadBFS, GRADED, (3, 3), 0.0),
]


@pytest.mark.parametrize(("kind", "mesh", "exponents", "shear"), SHEARED)
def test_every_order_of_a_monomial_on_sheared_cells(kind, mesh, exponents, shear):
    A = np.eye(mesh.dim())
    A[0, 1] = -shear
    mesh = type(mesh)(np.linalg.inv(A) @ mesh.p, mesh.t)
    u, exact = interpolant(Basis(mesh, kind(derivatives=6), intorder=3), exponents, A)
    for order, atol in enumerate((1e-14, 1e-12, 1e-11, 1e-10, 1e-8, 1e-7, 1e-5)):
        found = np.array(u) if order == 0 else getattr(u, NAMES[order])
        np.testing.assert_allclose(found, exact(order), rtol=0, atol=atol)


FINE = [
    *((ElementQuadAdini, (3, 1), n) for n in (8, 64)),
    *((ElementHexAdini, (1, 3, 1), n) for n in (2, 8)),
    *((ElementQuadBFS, (2, 1), n) for n in (40, 150)),
]


@pytest.mark.parametrize(("kind", "exponents", "n"), FINE)
def test_interpolation_error_is_rounding_on_fine_meshes(kind, exponents, n):
    """With a monomial basis the error of BFS is 3e-5 at n = 40 and 7e-2 at n = 150."""
    dim = len(exponents)
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*[np.linspace(0, 1, n + 1)] * dim)
    u, exact = interpolant(Basis(mesh, kind(derivatives=2), intorder=3), exponents, np.eye(dim))
    for order, found in enumerate((u, u.grad, u.hess)):
        np.testing.assert_allclose(found, exact(order), rtol=0, atol=1e-14 * n**order)


@each
def test_third_derivatives_reach_forms_and_solutions(kind):
    """Of x^3, in interpolated solutions and vector fields."""
    basis = Basis(MESH_OF[kind], kind(derivatives=3))
    x = basis.project(lambda x: x[0] ** 3)
    third = basis.interpolate(x).grad3
    expected = np.zeros(third.shape)
    expected[0, 0, 0] = 6
    np.testing.assert_allclose(third, expected, atol=1e-9)
    vector = basis.with_element(ElementVector(basis.elem))
    y = vector.project(lambda x: np.array([0 * x[0], x[0] ** 3, *(0 * x[2:])]))
    np.testing.assert_allclose(vector.interpolate(y).grad3[1], expected, atol=1e-9)


@each
def test_as_many_orders_as_asked_for(kind):
    mesh = MESH_OF[kind]
    point = np.array([[0.3], [0.4], [0.7]])[: mesh.dim()]
    for derivatives in range(7):
        (field,) = kind(derivatives).gbasis(mesh._mapping(), point, 7)
        orders = [field.get(place) for place in (1, 4, 5, 6, 7, 8)]
        assert [order is not None for order in orders] == [k < derivatives for k in range(6)]
        for order in range(derivatives + 1, 7):
            with pytest.raises(InputError, match=rf"{kind.__name__}\(derivatives={order}\)"):
                getattr(field, NAMES[order])
    with pytest.raises(InputError, match=r"grad is not there.*derivatives=1\)"):
        laplace.assemble(Basis(mesh, kind(0)))
    third = BilinearForm(lambda u, v, _: ddd(u)[0, 0, 0] * v)
    with pytest.raises(InputError, match=rf"{kind.__name__}\(derivatives=3\)"):
        third.assemble(Basis(mesh, kind()))


@pytest.mark.parametrize("kind", [ElementQuadAdini, ElementHexAdini])
def test_third_derivatives_need_parallelograms(kind):
    mesh = MESH_OF[kind]
    p = mesh.p + 0.05 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape)
    words = rf"parallel(ogram|epiped).*{kind.__name__}\(derivatives=2\)"
    with pytest.raises(InputError, match=words):
        kind(3).gbasis(type(mesh)(p, mesh.t)._mapping(), np.full((mesh.dim(), 1), 0.3), 0)


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_rounding_is_no_twist(parallelepipeds, offset):
    """Far from the origin cells still count as parallelograms and parallelepipeds."""
    solid = MeshHex(parallelepipeds.p + offset, parallelepipeds.t)
    c, s = np.cos(0.7), np.sin(0.7)
    mesh = MeshQuad().refined(3)
    plane = MeshQuad(np.array([[c, -s], [s, c]]) @ mesh.p + offset, mesh.t)
    for mesh, kind in ((solid, ElementHexAdini), (plane, ElementQuadAdini)):
        assert Basis(mesh, kind(derivatives=3), intorder=1).basis[0][0].grad3 is not None


def test_points_of_each_cell_or_shared(space):
    mesh, kind = space
    element, mapping, dim = kind(derivatives=2), mesh._mapping(), mesh.dim()
    shared = np.random.default_rng(0).uniform(0, 1, (dim, 5))
    tind = np.arange(mesh.nelements)[::2]
    own = np.repeat(shared[:, None], len(tind), axis=1)
    for i in range(len(element.doflocs)):
        (a,) = element.gbasis(mapping, shared, i, tind=tind)
        (b,) = element.gbasis(mapping, own, i, tind=tind)
        (c,) = element.gbasis(mapping, shared, i)
        for name in NAMES[1:3]:
            scale = np.abs(getattr(a, name)).max()
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-14 * scale)
            # A cell's values do not depend on which others are asked for: in the plane to the bit.
            rtol = {2: 0, 3: 1e-15}[dim]
            np.testing.assert_allclose(getattr(a, name), getattr(c, name)[..., tind, :], rtol=rtol)
        np.testing.assert_allclose(a, b, atol=1e-15)


# Second derivatives are there without being asked for, and cost nothing until they are used.


def quadratic(x):
    return x[0] ** 2 + 3 * x[0] * x[1]


@each
def test_form_of_fourth_order(kind):
    basis = Basis(MESH_OF[kind], kind())
    x = basis.project(quadratic)
    assert x @ BENDING.assemble(basis) @ x == pytest.approx(22, rel=1e-10)  # 2^2 + 2 * 3^2
    explicit = BENDING.assemble(basis.with_element(kind(derivatives=3)))
    assert abs(BENDING.assemble(basis) - explicit).max() == 0
    vector = basis.with_element(ElementVector(kind()))
    y = vector.project(lambda x: np.array([quadratic(x), *(0 * x[1:])]))
    form = BilinearForm(lambda u, v, _: np.einsum("ijk...,ijk...", dd(u), dd(v)))
    assert y @ form.assemble(vector) @ y == pytest.approx(22, rel=1e-10)
    for wrapped in (ElementDG(kind()), kind() * kind()):
        inside = basis.with_element(wrapped)
        fields = inside.interpolate(inside.ones())
        for field in fields if isinstance(fields, tuple) else (fields,):
            assert field.hess.shape[:2] == (basis.mesh.dim(),) * 2


@each
@pytest.mark.parametrize("kind_of_basis", [Basis, FacetBasis, skfem.InteriorFacetBasis])
def test_interpolated_fields(kind, kind_of_basis):
    mesh = MESH_OF[kind].refined(1) if kind is ElementHexAdini else MESH_OF[kind]
    x = Basis(mesh, kind()).project(quadratic)
    basis = kind_of_basis(mesh, kind())
    found = basis.interpolate(x).hess
    np.testing.assert_allclose(
        found[0, :2], np.ones(found[0, :2].shape) * [[[2]], [[3]]], atol=1e-8
    )
    size = skfem.Functional(lambda w: dd(w["u"])[0, 0] / 2).assemble(basis, u=x)
    assert size == pytest.approx(basis.dx.sum(), rel=1e-10)


@each
def test_nothing_is_made_before_it_is_used(kind, monkeypatch):
    orders = []
    original = kind._evaluate

    def counted(self, cells, X, i, order):
        orders.append(order)
        return original(self, cells, X, i, order)

    monkeypatch.setattr(kind, "_evaluate", counted)
    basis = Basis(MESH_OF[kind], kind())
    laplace.assemble(basis)
    assert set(orders) == {0, 1}
    BENDING.assemble(basis)
    BENDING.assemble(basis)
    assert orders.count(2) == basis.Nbfun


@each
def test_copies_and_arithmetic(kind):
    field = Basis(MESH_OF[kind], kind()).basis[2][0]
    for copied in (copy.copy, copy.deepcopy, lambda f: pickle.loads(pickle.dumps(f)), np.transpose):
        np.testing.assert_array_equal(copied(field).hess, field.hess)
        np.testing.assert_array_equal(copied(field).grad, field.grad)
    assert type(2 * field) is np.ndarray
    assert "grad" in repr(field)
    assert "hess" in repr(field)
    assert not np.any(field.zeros())
    assert not np.any(field.zeros().hess)


def test_threads_see_the_same():
    basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    expected = BENDING.assemble(Basis(basis.mesh, basis.elem)).toarray()
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: BENDING.assemble(basis).toarray(), range(4)):
            np.testing.assert_array_equal(found, expected)
