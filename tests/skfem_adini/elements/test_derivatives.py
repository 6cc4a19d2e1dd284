"""Derivatives: against differences and by the chain rule, on demand, and as many as asked for."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from math import perm

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementDG,
    ElementVector,
    FacetBasis,
    Functional,
    InteriorFacetBasis,
    MeshHex,
    MeshQuad,
)
from skfem.helpers import dd, ddd, ddot
from skfem.models.poisson import laplace

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, InputError

# Places of value, gradient and Hessian in DiscreteField.get.
FIELD = [0, 1, 4]
NAMES = ["value", "grad", "hess", "grad3", "grad4", "grad5", "grad6"]
STEP = 1e-6
CELLS = {
    ElementQuadAdini: MeshQuad().refined(1),
    ElementQuadBFS: MeshQuad().refined(1),
    ElementHexAdini: MeshHex(),
}
BENDING = BilinearForm(lambda u, v, _: ddot(dd(u), dd(v)))
each = pytest.mark.parametrize("kind", CELLS)


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


def ticks(n, dim):
    return [np.linspace(0, 1, n + 1)] * dim


FINE = [
    *((ElementQuadAdini, (3, 1), n) for n in (8, 64)),
    *((ElementHexAdini, (1, 3, 1), n) for n in (2, 8)),
    *((ElementQuadBFS, (2, 1), n) for n in (40, 150)),
]


@pytest.mark.parametrize(("kind", "exponents", "n"), FINE)
def test_interpolation_error_is_rounding_on_fine_meshes(kind, exponents, n):
    """With a monomial basis the error of BFS is 3e-5 at n = 40 and 7e-2 at n = 150."""
    dim = len(exponents)
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*ticks(n, dim))
    u, exact = interpolant(Basis(mesh, kind(derivatives=2), intorder=3), exponents, np.eye(dim))
    for order, found in enumerate((u, u.grad, u.hess)):
        np.testing.assert_allclose(found, exact(order), rtol=0, atol=1e-14 * n**order)


@each
def test_third_derivatives_reach_forms_and_solutions(kind):
    """Of x^3, in interpolated solutions and vector fields."""
    basis = Basis(CELLS[kind], kind(derivatives=3))
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
    mesh = CELLS[kind]
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
    mesh = CELLS[kind]
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
    basis = Basis(CELLS[kind], kind())
    x = basis.project(quadratic)
    assert x @ BENDING.assemble(basis) @ x == pytest.approx(22, rel=1e-10)  # 2^2 + 2 * 3^2
    explicit = BENDING.assemble(basis.with_element(kind(derivatives=3)))
    assert abs(BENDING.assemble(basis) - explicit).max() == 0
    vector = basis.with_element(ElementVector(kind()))
    y = vector.project(lambda x: np.array([quadratic(x), *(0 * x[1:])]))
    form = BilinearForm(lambda u, v, _: np.einsum("ijk...,ijk...", dd(u), dd(v)))
    assert y @ form.assemble(vector) @ y == pytest.approx(22, rel=1e-10)


@each
@pytest.mark.parametrize("wrapped", [ElementVector, ElementDG, lambda e: e * e])
def test_inside_other_elements(kind, wrapped):
    basis = Basis(CELLS[kind], wrapped(kind()))
    fields = basis.interpolate(basis.ones())
    for field in fields if isinstance(fields, tuple) else (fields,):
        assert field.hess.shape[-4:-2] == (basis.mesh.dim(),) * 2


@each
@pytest.mark.parametrize("kind_of_basis", [Basis, FacetBasis, InteriorFacetBasis])
def test_interpolated_fields(kind, kind_of_basis):
    mesh = CELLS[kind].refined(1) if kind is ElementHexAdini else CELLS[kind]
    x = Basis(mesh, kind()).project(quadratic)
    basis = kind_of_basis(mesh, kind())
    found = basis.interpolate(x).hess
    np.testing.assert_allclose(
        found[0, :2], np.ones(found[0, :2].shape) * [[[2]], [[3]]], atol=1e-8
    )
    size = Functional(lambda w: dd(w["u"])[0, 0] / 2).assemble(basis, u=x)
    assert size == pytest.approx(basis.dx.sum(), rel=1e-10)


@each
def test_nothing_is_made_before_it_is_used(kind, monkeypatch):
    orders = []
    original = kind._evaluate

    def counted(self, cells, X, i, order):
        orders.append(order)
        return original(self, cells, X, i, order)

    monkeypatch.setattr(kind, "_evaluate", counted)
    basis = Basis(CELLS[kind], kind())
    laplace.assemble(basis)
    assert set(orders) == {0, 1}
    BENDING.assemble(basis)
    BENDING.assemble(basis)
    assert orders.count(2) == basis.Nbfun


@each
def test_copies_and_arithmetic(kind):
    field = Basis(CELLS[kind], kind()).basis[2][0]
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
