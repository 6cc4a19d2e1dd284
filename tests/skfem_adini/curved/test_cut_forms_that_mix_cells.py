"""Forms that reduce over cells are refused on cut domains, which are assembled in batches."""

import numpy as np
import pytest
from skfem import BilinearForm, ElementQuad1, ElementQuad2, ElementVector, Functional, LinearForm
from skfem.helpers import ddot, sym_grad

from skfem_adini import CutDomain, ElementQuadAdini, InputError

ELEMENTS = {
    "Adini": ElementQuadAdini(derivatives=2),
    "Q2": ElementQuad2(),
    "vectors": ElementVector(ElementQuad1()),
}
REDUCTIONS = {
    "max": lambda k: k / k.max(),
    "mean": lambda k: k - k.mean(),
    "axis": lambda k: k - np.asarray(k).mean(axis=0),
    "median": lambda k: np.where(k > np.median(k), 2.0, 1.0),
    "outliers": lambda k: np.where(k > k.mean() + 2 * k.std(), 2.0, 1.0),
    "equals": lambda k: np.where(k == k.max(), 2.0, 1.0),
    "sort": lambda k: np.sort(k, axis=0),
    "cumsum": lambda k: np.cumsum(k, axis=0),
    "norm": lambda k: k / np.linalg.norm(k),
    "roll": lambda k: np.roll(np.asarray(k), 1, axis=0),
    "length": lambda k: k / len(k),
    "sum": lambda k: k / k.sum(),
    "points": lambda k: k - np.asarray(k).mean(axis=1, keepdims=True),
    "number of points": lambda k: k * np.shape(k)[1],
}
FIELDS = {
    "x": lambda w: w.x[0],
    "x and y": lambda w: np.hypot(w.x[0] - 0.4, w.x[1] - 0.6),
    "dofs": lambda w: w.k,
    "one dof": lambda w: w.spike,
}


def kind(name, element, coefficient):
    dims = 2 if isinstance(element, ElementVector) else 0
    if name == "functional":
        return Functional(coefficient)
    if name == "load":
        return LinearForm(lambda v, w: coefficient(w) * (v[0] if dims else v))
    return BilinearForm(lambda u, v, w: coefficient(w) * ((u * v).sum(axis=0) if dims else u * v))


@pytest.fixture
def disk(cut_problems):
    return CutDomain(cut_problems.unit_square(9), cut_problems.LEVEL_SETS["disk"], q=4)


def data(domain, element):
    """Vectors of dofs: random, and one everywhere but for one dof inside."""
    basis = next(iter(domain.groups(element)))
    spike = np.ones(basis.N)
    spike[basis.element_dofs[0, basis.nelems // 2]] = 100.0
    return {"k": np.random.default_rng(2).uniform(1, 2, basis.N), "spike": spike}


CASES = [(form, name, "x") for form in ("bilinear", "load") for name in REDUCTIONS]
CASES += [("functional", name, field) for name in REDUCTIONS for field in ("x and y", "dofs")]
CASES += [("functional", name, "one dof") for name in ("max", "mean", "outliers", "norm", "sum")]


@pytest.mark.parametrize(("form", "name", "field"), CASES)
def test_reductions_are_refused(disk, form, name, field):
    """Each batch had a largest value, a mean and an order of its own: sums of different forms."""
    element = ELEMENTS["Q2"]
    reduced = kind(form, element, lambda w: REDUCTIONS[name](FIELDS[field](w)))
    with pytest.raises(InputError, match="hand them over"):
        disk.assemble(reduced, element, **data(disk, element))


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("form", ["bilinear", "load", "functional"])
def test_reductions_in_other_elements(disk, form, element):
    for name in ("max", "median", "cumsum"):
        reduced = kind(form, ELEMENTS[element], lambda w, name=name: REDUCTIONS[name](w.x[1]))
        with pytest.raises(InputError, match="hand them over"):
            disk.assemble(reduced, ELEMENTS[element])


POINTWISE = {
    "numbers": lambda w: w.a * np.sin(w.x[0] / w.largest),
    "jump": lambda w: np.where(w.x[0] > 0.5, 1e6, 1e-6),
    "size": lambda w: w.h**2 * np.exp(5 * w.x[1]),
    "far": lambda w: 1e9 * (w.x[0] - 0.4) ** 3,
    "tensor": lambda w: np.einsum("i...,ij...,j...", w.x, w.tensor, w.x),
    "points of a cell": lambda w: np.asarray(w.x[0]).max(axis=1, keepdims=True),
    "complex": lambda w: np.exp(1j * w.x[0]).imag,
    "constant": lambda w: 3.0,
    "dofs": lambda w: w.k * np.ones_like(w.x[0]),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("form", ["bilinear", "load", "functional"])
@pytest.mark.parametrize("name", POINTWISE)
def test_ordinary_forms_are_assembled(disk, form, name, element):
    """They give what scikit-fem gives on full and cut cells, to rounding."""
    element = ELEMENTS[element]
    integrand = kind(form, element, POINTWISE[name])
    numbers = {"a": 2.0, "largest": 3.0, "tensor": np.eye(2)[:, :, None, None]}
    fields = {"k": data(disk, element)["k"]} if element is not ELEMENTS["vectors"] else {"k": 1.0}
    found = disk.assemble(integrand, element, **numbers, **fields)
    expected = sum(integrand.assemble(b, **numbers, **fields) for b in disk.basis(element))
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_second_derivatives_and_gradients_of_dofs(disk):
    element = ELEMENTS["Adini"]
    k = data(disk, element)["k"]
    plate = BilinearForm(lambda u, v, w: (1 + w.k.grad[0] ** 2) * ddot(u.hess, v.hess))
    expected = sum(plate.assemble(b, k=k) for b in disk.basis(element))
    assert abs(disk.assemble(plate, element, k=k) - expected).max() < 1e-12 * abs(expected).max()
    for value in (lambda w: w.k.grad[0] / w.k.grad.max(), lambda w: w.k.hess[0, 0].mean()):
        mixed = BilinearForm(lambda u, v, w, value=value: value(w) * ddot(u.hess, v.hess))
        with pytest.raises(InputError, match="among other cells"):
            disk.assemble(mixed, element, k=k)


def test_derivatives_that_no_form_asks_for_are_not_made(disk, monkeypatch):
    element = ElementQuadAdini(derivatives=2)
    monkeypatch.setattr(element, "_demanded", lambda *_: pytest.fail("made"))
    gradient = BilinearForm(lambda u, v, w: (u.grad * v.grad).sum(axis=0))
    assert disk.assemble(gradient, element).nnz


def test_a_domain_without_cut_cells_is_one_batch(cut_problems):
    """There scikit-fem's own assembly sees all cells at once, reductions included."""
    mesh = cut_problems.unit_square(4)
    whole = CutDomain(mesh, lambda x: x[0] - 2.0)
    element = ELEMENTS["Q2"]
    form = LinearForm(lambda v, w: w.x[0] / w.x[0].max() * v)
    (basis,) = whole.groups(element)
    np.testing.assert_array_equal(whole.assemble(form, element), form.assemble(basis))


def test_the_boundary_is_one_batch(disk):
    """A reduction there sees all points of the curve, however many parts and cells it has."""
    element = ELEMENTS["Adini"]
    boundary = disk.boundary(element)
    largest = np.asarray(disk.quadrature.boundary_points[0]).max()
    for form in ("bilinear", "load", "functional"):
        reduced = kind(form, element, lambda w: w.x[0] / w.x[0].max())
        expected = kind(form, element, lambda w: w.x[0] / largest).assemble(boundary)
        assert np.abs(reduced.assemble(boundary) - expected).max() <= 1e-13 * np.abs(expected).max()


def test_forms_that_raise_on_part_of_the_cells_are_named(disk):
    full = disk.full.size
    form = LinearForm(lambda v, w: v / (len(v) in (full, *sizes)) if len(v) in sizes else 1 / 0)
    sizes = [basis.nelems for basis in disk.groups(ELEMENTS["Q2"])]
    with pytest.raises(InputError, match="ZeroDivisionError"):
        disk.assemble(form, ELEMENTS["Q2"])


def test_elasticity(disk):
    element = ElementVector(ElementQuadAdini())
    form = BilinearForm(lambda u, v, w: (1 + w.x[0]) * ddot(sym_grad(u), sym_grad(v)))
    expected = sum(form.assemble(basis) for basis in disk.basis(element))
    assert abs(disk.assemble(form, element) - expected).max() < 1e-12 * abs(expected).max()
