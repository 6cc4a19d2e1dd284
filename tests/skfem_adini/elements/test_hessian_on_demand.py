"""Second derivatives are there without being asked for, and cost nothing until they are used."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

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

CELLS = {
    ElementQuadAdini: MeshQuad().refined(1),
    ElementQuadBFS: MeshQuad().refined(1),
    ElementHexAdini: MeshHex(),
}
BENDING = BilinearForm(lambda u, v, _: ddot(dd(u), dd(v)))
each = pytest.mark.parametrize("kind", CELLS)


def quadratic(x):
    return x[0] ** 2 + 3 * x[0] * x[1]


def energy(dim):
    hessian = np.zeros((dim, dim))
    hessian[:2, :2] = [[2, 3], [3, 0]]
    return np.sum(hessian**2)


@each
def test_form_of_fourth_order(kind):
    basis = Basis(CELLS[kind], kind())
    x = basis.project(quadratic)
    assert x @ BENDING.assemble(basis) @ x == pytest.approx(energy(basis.mesh.dim()), rel=1e-10)
    explicit = BENDING.assemble(basis.with_element(kind(derivatives=3)))
    assert abs(BENDING.assemble(basis) - explicit).max() == 0


@each
@pytest.mark.parametrize("wrapped", [ElementVector, ElementDG, lambda e: e * e])
def test_inside_other_elements(kind, wrapped):
    basis = Basis(CELLS[kind], wrapped(kind()))
    fields = basis.interpolate(basis.ones())
    fields = fields if isinstance(fields, tuple) else (fields,)
    dim = basis.mesh.dim()
    for field in fields:
        assert field.hess.shape[-4:-2] == (dim, dim)


def test_vector_form_of_fourth_order():
    basis = Basis(MeshQuad().refined(1), ElementVector(ElementQuadAdini()))
    x = basis.project(lambda x: np.array([quadratic(x), 0 * x[0]]))
    form = BilinearForm(lambda u, v, _: np.einsum("ijk...,ijk...", dd(u), dd(v)))
    assert x @ form.assemble(basis) @ x == pytest.approx(energy(2), rel=1e-10)


@each
@pytest.mark.parametrize("kind_of_basis", [Basis, FacetBasis, InteriorFacetBasis])
def test_interpolated_fields(kind, kind_of_basis):
    mesh = CELLS[kind].refined(1) if kind is ElementHexAdini else CELLS[kind]
    x = Basis(mesh, kind()).project(quadratic)
    basis = kind_of_basis(mesh, kind())
    found = basis.interpolate(x).hess
    np.testing.assert_allclose(found[0, 1], 3, atol=1e-8)
    np.testing.assert_allclose(found[0, 0], 2, atol=1e-8)
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
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_an_order_that_was_not_asked_for_names_the_option(kind, derivatives):
    basis = Basis(CELLS[kind], kind(derivatives=derivatives))
    form = BilinearForm(lambda u, v, _: (dd(u) if derivatives < 2 else ddd(u))[0, 0, 0] * v)
    needed = max(2, derivatives + 1)
    with pytest.raises(InputError, match=rf"{kind.__name__}\(derivatives={needed}\)"):
        form.assemble(basis)
    if derivatives == 0:
        with pytest.raises(InputError, match=r"grad is not there.*derivatives=1\)"):
            laplace.assemble(basis)


@each
@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda f: pickle.loads(pickle.dumps(f)), np.transpose]
)
def test_copies_keep_it(kind, copied):
    field = Basis(CELLS[kind], kind()).basis[2][0]
    np.testing.assert_array_equal(copied(field).hess, field.hess)
    np.testing.assert_array_equal(copied(field).grad, field.grad)


@each
def test_arithmetic_gives_plain_numbers(kind):
    field = Basis(CELLS[kind], kind()).basis[1][0]
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
