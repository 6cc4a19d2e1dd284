"""Integrands: classes of cells, terms of coefficients, or scikit-fem's own loop; one matrix."""

import logging

import numpy as np
import pytest
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementQuad1, ElementVector, LinearForm, MeshQuad, asm
from skfem.element import DiscreteField
from skfem.helpers import ddot, div, dot, jump, mul, sym_grad

from skfem_adini import CutDomain, ElementQuadAdini, InputError, assemble, nitsche
from skfem_adini.assembly import local_tensors as module
from tests.skfem_adini.cut_problems import LEVEL_SETS, unit_square

MESH = MeshQuad.init_tensor(np.linspace(0, 1.7, 13), np.linspace(0, 1, 9))
CELLS = MESH.t.shape[1]
ELEMENT = ElementQuadAdini()
BASIS = Basis(MESH, ELEMENT)
VARYING = BASIS.global_coordinates()[0]
RNG = np.random.default_rng(4)
STEPS = np.array([1.0, 2.0, 5.0])
COEFFICIENTS = {
    "random": RNG.uniform(1, 3, CELLS),
    "layers": STEPS[RNG.integers(3, size=CELLS)],
    "one cell": np.where(np.arange(CELLS) == 40, 100.0, 1.0),
    "most of one": np.where(np.arange(CELLS) % 5, 2.0, np.linspace(1, 3, CELLS)),
}
FIELDS = {
    "k": RNG.uniform(0, 1, CELLS),
    "rho": RNG.uniform(1, 2, CELLS),
    "n": RNG.integers(0, 5, CELLS).astype(np.int8),
    "b": RNG.uniform(-1, 1, (2, CELLS, 1)),
    "D": RNG.uniform(-1, 1, (2, 2, CELLS, 1)),
}


def same(found, expected, to=1e-14):
    return np.abs(found - expected).max() <= to * max(np.abs(expected).max(), 1e-300)


def wide(k, basis=BASIS):
    """Numbers of the cells at all points."""
    return np.repeat(k[:, None], basis.W.size, axis=1)


def meant(fields, basis=BASIS):
    return {name: wide(v, basis) if v.ndim == 1 else v for name, v in fields.items()}


# Left to scikit-fem, which one sees, and right then too.


def laplace(u, v, w):
    return dot(u.grad, v.grad)


def caught(u, v, w):
    try:
        return w.x[0] * u * v
    except Exception:
        return u * v


def unpacked(u, v, w):
    known = {**w}
    return known.get("x", [1.0])[0] * u * v


NEED_SCIKIT_FEM = {
    "x": lambda u, v, w: w.x[0] * u * v,
    "item": lambda u, v, w: w["x"][1] * u * v,
    "get": lambda u, v, w: w.get("x", [1.0])[0] * u * v,
    "h": lambda u, v, w: u * v / w.h,
    "hasattr": lambda u, v, w: u * v * (2 if hasattr(w, "x") else 1),
    "idx": lambda u, v, w: jump(w, u) * v,
    "field": lambda u, v, w: w.varying * u * v,
    "dofs": lambda u, v, w: w.dofs * u * v,
    "held": lambda u, v, w: VARYING * u * v,
    "held cellwise": lambda u, v, w: np.arange(1.0, 1 + CELLS)[:, None] * u * v,
    "caught": caught,
    "copied": lambda u, v, w: w.copy().get("x", [1.0])[0] * u * v,
    "unpacked": unpacked,
    "items": lambda u, v, w: len(list(w.items())) * u * v,
}


@pytest.mark.parametrize("name", NEED_SCIKIT_FEM)
def test_forms_that_vary_inside_a_cell(name, caplog, capsys):
    form = BilinearForm(NEED_SCIKIT_FEM[name])
    fields = {"varying": VARYING, "dofs": np.random.default_rng(1).random(BASIS.N)}
    if name in ("items", "unpacked", "copied"):
        fields = {}
    with caplog.at_level(logging.DEBUG, logger="skfem_adini.assembly.assemble"):
        found = assemble(form, MESH, ELEMENT, verbose=True, **fields)
    assert same(found, asm(form, BASIS, **fields))
    assert "by scikit-fem" in caplog.text
    assert "by scikit-fem" in capsys.readouterr().out
    with pytest.raises(InputError, match="fallback"):
        assemble(form, MESH, ELEMENT, fallback=False, **fields)


def test_constant_integrands_and_unused_fields_are_fine(caplog):
    form = BilinearForm(lambda u, v, w: 1.0)
    assert same(assemble(form, MESH, ELEMENT, fallback=False), asm(form, BASIS))
    with caplog.at_level(logging.DEBUG, logger="skfem_adini.assembly.assemble"):
        found = assemble(laplace, MESH, ELEMENT, fallback=False, varying=VARYING)
    assert same(found, asm(laplace, BASIS))
    assert "classes of 96 cells" in caplog.text


def test_a_form_that_holds_an_array_over_as_many_cells_as_there_are_entries():
    """The fast path must not take the 144 entries of one local matrix for the 144 cells."""
    ticks = np.linspace(0, 1, 13)
    mesh = MeshQuad.init_tensor(ticks, ticks)
    basis = Basis(mesh, ELEMENT)
    held = np.random.default_rng(2).uniform(1, 2, (144, 1))
    for form in (
        BilinearForm(lambda u, v, w: held * u * v),
        BilinearForm(lambda u, v, w: (held + basis.global_coordinates()[0]) * u * v),
    ):
        assert same(assemble(form, mesh, ELEMENT), asm(form, basis))


NUMBERS = {
    "column": np.linspace(1, 2, CELLS)[:, None],
    "field": DiscreteField(np.repeat(np.linspace(1, 2, CELLS)[:, None], BASIS.W.size, axis=1)),
    "vector": np.linspace(1, 2, CELLS),
    "one column": DiscreteField(np.linspace(1, 2, CELLS)[:, None]),
    "few": np.where(np.arange(CELLS) % 2, 1.0, 3.0)[:, None],
    "whole": np.arange(1, 1 + CELLS)[:, None],
    "complex": np.linspace(1, 2, CELLS)[:, None] * (1 + 1j),
    "scalar": 2.5,
}


@pytest.mark.parametrize("name", NUMBERS)
def test_coefficients_that_enter_in_any_way(name):
    dtype = np.complex128 if name == "complex" else np.float64
    k = np.asarray(NUMBERS[name])
    meant = k[:, None] if k.ndim == 1 else NUMBERS[name] if k.ndim == 0 else k
    for power in (1.0, 2.0, -0.5):
        form = BilinearForm(lambda u, v, w, p=power: np.array(w.k) ** p * u * v, dtype=dtype)
        found = assemble(form, MESH, ELEMENT, fallback=False, k=NUMBERS[name])
        assert same(found, asm(form, BASIS, k=meant))


def test_interpolated_constants_with_their_gradient():
    """A field that is constant in each cell comes with a gradient, which is zero and constant."""
    steps = Basis(MESH, skfem.ElementQuad0(), quadrature=BASIS.quadrature)
    field = steps.interpolate(np.arange(1.0, 1 + CELLS))
    form = BilinearForm(lambda u, v, w: w.k * u * v + w.k.grad[0] * u * v)
    assert same(assemble(form, MESH, ELEMENT, fallback=False, k=field), asm(form, BASIS, k=field))


class Shifted(skfem.ElementQuad1):
    """An element whose functions depend on where the cell lies."""

    def gbasis(self, mapping, X, i, tind=None):
        (field,) = super().gbasis(mapping, X, i, tind)
        x = mapping.F(X, tind)[0]
        return (DiscreteField((1 + x) * np.array(field), grad=field.grad),)


def test_elements_and_bases_that_need_scikit_fem():
    mass = BilinearForm(lambda u, v, w: u * v)
    mesh = MeshQuad().refined(2)
    triangles = skfem.MeshTri().refined(1)
    cases = [
        (mesh, Shifted()),
        (triangles, skfem.ElementTriArgyris()),
        (skfem.FacetBasis(mesh, ELEMENT), None),
    ]
    for where, element in cases:
        basis = where if element is None else Basis(where, element)
        assert same(assemble(mass, where, element), asm(mass, basis))
        with pytest.raises(InputError, match="needs scikit-fem"):
            assemble(mass, where, element, fallback=False)


def test_functionals_pairs_of_bases_no_cells_and_broken_forms():
    area = skfem.Functional(lambda w: 1.0 + 0 * w.x[0])
    assert assemble(area, MESH, ELEMENT) == pytest.approx(1.7, rel=1e-14)
    pair = [BASIS, BASIS]
    assert same(assemble(laplace, pair, pair), asm(laplace, pair, pair))
    found = assemble(laplace, MESH, ELEMENT, elements=np.empty(0, dtype=int))
    assert found.shape == (BASIS.N, BASIS.N)
    assert found.nnz == 0
    with pytest.raises(AttributeError, match="missing"):
        assemble(lambda u, v, w: u * v * w.missing, MESH, ELEMENT)


# Coefficients of the cells enter by scaling, whatever the form makes of them.

SCALED = {
    "linear": lambda u, v, w: w.k * dot(u.grad, v.grad),
    "inside": lambda u, v, w: dot(w.k * u.grad, v.grad),
    "power": lambda u, v, w: (1e-3 + w.k**3 * (1 - 1e-3)) * dot(u.grad, v.grad),
    "square": lambda u, v, w: w.k**2 * u * v,
    "inverse": lambda u, v, w: dot(u.grad, v.grad) / w.rho,
    "offset": lambda u, v, w: (w.k + 1) * u * v,
    "threshold": lambda u, v, w: np.where(w.k > 0.5, 1.0, 2.0) * u * v,
    "branches": lambda u, v, w: np.where(w.k > 0.5, w.k, 1 / w.rho) * u * v,
    "comparison": lambda u, v, w: ((w.k > 0.2) * (w.k < 0.7)) * u * v,
    "clip": lambda u, v, w: np.clip(w.k, 0.2, 0.8) * u * v,
    "two": lambda u, v, w: w.k * dot(u.grad, v.grad) + w.rho * u * v - u.grad[0] * v,
    "product": lambda u, v, w: (w.k * u) * (w.rho * v),
    "small integers": lambda u, v, w: (w.n * u) * (100 * w.n * v) * np.sqrt(w.rho),
    "cancelling": lambda u, v, w: w.k * u * v - (w.k - 1e-8) * u * v,
    "vector": lambda u, v, w: dot(w.b, u.grad) * v,
    "component": lambda u, v, w: w.b[0] * u.grad[0] * v + w.b[1] * u.grad[1] * v,
    "tensor": lambda u, v, w: dot(mul(w.D, u.grad), v.grad),
    "sum": lambda u, v, w: (w.k * u.grad * v.grad).sum(axis=0),
    "numpy sum": lambda u, v, w: np.sum(w.k * u.grad * v.grad, axis=0),
    "python sum": lambda u, v, w: sum(w.k * u.grad * v.grad),
    "only some entries": lambda u, v, w: u * v,
}


@pytest.mark.parametrize("name", SCALED)
def test_terms_of_a_form(name, monkeypatch):
    """The integrand is evaluated in cells of other shapes only, and gives scikit-fem's matrix."""
    rows = []
    density = module._density

    def counted(form, arguments, w, dx):
        rows.append(len(dx))
        return density(form, arguments, w, dx)

    monkeypatch.setattr(module, "check_pointwise", lambda *_: None)
    monkeypatch.setattr(module, "_density", counted)
    form = BilinearForm(SCALED[name])
    found = assemble(form, MESH, ELEMENT, fallback=False, **FIELDS)
    assert rows == [144]
    expected = asm(form, BASIS, **meant(FIELDS))
    assert same(found, expected, 1e-8 if name == "cancelling" else 1e-14)


def test_elasticity_and_loads():
    element = ElementVector(ElementQuad1())
    form = BilinearForm(
        lambda u, v, w: (
            w.k * div(u) * div(v) + 2 * ddot(w.rho * sym_grad(u), sym_grad(v)) / (1 + w.k)
        )
    )
    load = LinearForm(lambda v, w: w.k**2 * v[0] - dot(w.b, v))
    basis = Basis(MESH, element)
    for each in (form, load):
        found = assemble(each, MESH, element, fallback=False, **FIELDS)
        assert same(found, asm(each, basis, **meant(FIELDS, basis)))


def tried(w):
    try:
        return w.k * (1 + 0 * w.k.mean(axis=-1, keepdims=True)) + w.k.shape[-1]
    except Exception:
        return w.k


FAST = {
    "largest component": lambda u, v, w: np.max(np.abs(v.grad), axis=0) * u + w.k * u * v,
    "points": lambda u, v, w: w.k * (u - u.mean(axis=-1, keepdims=True)) * v,
    "coefficient over points": lambda u, v, w: w.k.mean(axis=-1, keepdims=True) * u * v,
    "check of signs": lambda u, v, w: w.k * u * v if (w.k > 0).all() else 1 / 0,
    "table": lambda u, v, w: STEPS[np.asarray(w.k).astype(int) % 3] * u * v,
    "einsum": lambda u, v, w: w.k * np.einsum("i...,i...", u.grad, v.grad),
    "no more than rounding": lambda u, v, w: (w.k / w.k.max()) * w.k.max() * u * v,
    "held number": lambda u, v, w: COEFFICIENTS["random"].max() * w.k * u * v,
    "square of a product": lambda u, v, w: (w.k * u) ** 2 * v,
    "mixed": lambda u, v, w: np.exp(w.k * u) * v,
    "quotient": lambda u, v, w: u * v / (1 + w.k * u**2),
    "array": lambda u, v, w: np.array(w.k) * u * v,
    "caught": lambda u, v, w: tried(w) * u * v,
    "chosen": lambda u, v, w: np.where(w.k > 2, u, v) * v,
    "of the kind": lambda u, v, w: (2.0 if isinstance(w.k, np.ndarray) else 1.0) * w.k * u * v,
}


@pytest.mark.parametrize("name", FAST)
def test_forms_that_keep_the_fast_path(name):
    form = BilinearForm(FAST[name])
    for k in (COEFFICIENTS["random"], COEFFICIENTS["one cell"]):
        found = assemble(form, MESH, ELEMENT, fallback=False, k=k)
        assert same(found, asm(form, BASIS, k=wide(k)))


def test_entries_one_by_one_are_those_of_one_call(monkeypatch):
    """Many cells get a call for each entry; few get one call for all."""
    form = BilinearForm(FAST["quotient"])
    cells = MeshQuad(MESH.p + RNG.uniform(-0.01, 0.01, MESH.p.shape), MESH.t)
    for mesh in (MESH, cells):
        expected = asm(form, Basis(mesh, ElementQuad1()), k=FIELDS["k"][:, None])
        for least in (1, 10**6):
            monkeypatch.setattr(module, "LIMITS", module.LIMITS._replace(cells=least))
            found = assemble(form, mesh, ElementQuad1(), fallback=False, k=FIELDS["k"])
            assert same(found, expected)


POWERS = [lambda k: k, lambda k: k**2, lambda k: 1 / k, lambda k: k + 1, np.sqrt, np.exp]
POWERS += [lambda k: np.where(k > 1.5, k, 1.0), lambda k: np.maximum(k, 1.2), lambda k: -k]


@settings(max_examples=30, deadline=None)
@given(st.lists(st.sampled_from(POWERS), min_size=1, max_size=4), st.integers(0, 2**31))
def test_sums_and_products_of_functions_of_a_coefficient(functions, seed):
    k = np.random.default_rng(seed).uniform(1, 2, CELLS)
    parts = [
        lambda u, v: dot(u.grad, v.grad),
        lambda u, v: u * v,
        lambda u, v: u.grad[0] * v,
        lambda u, v: u * v.grad[1],
    ]

    def integrand(u, v, w):
        return sum(f(w.k) * part(u, v) for f, part in zip(functions, parts, strict=False))

    form, element = BilinearForm(integrand), ElementQuad1()
    assert same(assemble(form, MESH, element, k=k), asm(form, Basis(MESH, element), k=k[:, None]))


# Those that reduce over cells are found out: a batch has a largest value and an order of its own.

REDUCTIONS = {
    "max": lambda k: k / k.max(),
    "mean": lambda k: k - k.mean(),
    "axis": lambda k: k - k.mean(axis=0),
    "median": lambda k: np.where(k > np.median(k), 2.0, 1.0),
    "outliers": lambda k: np.where(k > k.mean() + 3 * k.std(), 2.0, 1.0),
    "equals": lambda k: np.where(k == k.max(), 2.0, 1.0),
    "sort": lambda k: np.sort(k, axis=0),
    "rank": lambda k: np.argsort(np.argsort(k, axis=0), axis=0) + 1.0,
    "cumsum": lambda k: np.cumsum(k, axis=0),
    "norm": lambda k: k / np.linalg.norm(k),
    "product": lambda k: k * (np.asarray(k).T @ np.asarray(k)).sum(),
    "first": lambda k: k / k[0],
    "roll": lambda k: np.roll(np.asarray(k), 1, axis=0),
    "length": lambda k: k / len(k),
    "sum": lambda k: k / k.sum(),
    "count": lambda k: k * np.count_nonzero(k > 1.5),
    "of all": lambda k: k / np.sum(k),
    "dot": lambda k: k / np.dot(np.ravel(k), np.ravel(k)),
    "average": lambda k: k - np.average(k, weights=np.asarray(k) ** 2),
    "any": lambda k: 2.0 * k if np.any(k > 2.5) else k,
    "iteration": lambda k: k / sum(row.sum() for row in k),
    "convolution": lambda k: np.convolve(np.ravel(k), [1, 2, 1], "same").reshape(k.shape),
}


@pytest.mark.parametrize("name", REDUCTIONS)
def test_reductions_over_cells(name):
    """They came back 9 to 950 % off."""
    form = LinearForm(lambda v, w: REDUCTIONS[name](w.k) * v)
    for k in COEFFICIENTS.values():
        expected = asm(form, BASIS, k=wide(k))
        assert same(assemble(form, MESH, ELEMENT, k=k), expected, 1e-13)
    form = BilinearForm(lambda u, v, w: REDUCTIONS[name](w.k) * u * v)
    k = COEFFICIENTS["random"]
    assert same(assemble(form, BASIS, k=k), asm(form, BASIS, k=wide(k)), 1e-13)
    with pytest.raises(InputError, match="among other cells"):
        assemble(form, MESH, ELEMENT, fallback=False, k=k)


def test_statistics_of_coefficients_mean_what_they_mean_to_scikit_fem():
    """A form with k / sum(k) was wrong by the number of points, 25, for numbers of the cells."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 15), np.linspace(0, 1, 15))
    k = np.random.default_rng(7).uniform(1, 2, 196)
    for element in (ELEMENT, skfem.ElementQuad2()):
        basis = Basis(mesh, element)
        at = wide(k, basis)
        steps = Basis(mesh, skfem.ElementQuad0(), quadrature=basis.quadrature).interpolate(k)
        kinds = [(k, at), (DiscreteField(k), at), (DiscreteField(k[:, None]), at)]
        kinds += [(each, each) for each in (at, steps, k[:, None])]
        for reduction in (np.sum, np.linalg.norm, lambda k: k.shape[1]):
            forms = [
                BilinearForm(lambda u, v, w, of=reduction: w.k / of(w.k) * u * v),
                LinearForm(lambda v, w, of=reduction: w.k / of(w.k) * v),
                skfem.Functional(lambda w, of=reduction: w.k / of(w.k) + 0 * w.x[0]),
            ]
            for form in forms:
                for one, same_to_it in kinds:
                    found = assemble(form, mesh, element, k=one)
                    assert same(found, asm(form, basis, k=same_to_it), 1e-13)


SUMS_OF_A_CELL = {
    "sum": lambda k: np.sum(k, axis=-1, keepdims=True),
    "points": lambda k: k * k.shape[-1],
    "norm": lambda k: k / np.linalg.norm(k, axis=-1, keepdims=True),
    "trapezoid": lambda k: np.trapezoid(k, axis=-1)[:, None],
    "cumsum": lambda k: np.cumsum(k, axis=-1),
}


@pytest.mark.parametrize("name", SUMS_OF_A_CELL)
def test_sums_over_the_points_of_a_cell(name):
    k = COEFFICIENTS["random"]
    form = BilinearForm(lambda u, v, w: SUMS_OF_A_CELL[name](w.k) * u * v)
    for one in (k, wide(k)):
        found = assemble(form, MESH, ELEMENT, fallback=False, k=one)
        assert same(found, asm(form, BASIS, k=wide(k)), 1e-13)
    column = k[:, None]
    assert same(assemble(form, MESH, ELEMENT, k=column), asm(form, BASIS, k=column), 1e-13)


def doubled(k):
    k *= 2.0
    return k


def filled(k):
    k[:] = 1.0
    return k


@pytest.mark.parametrize("change", [doubled, filled])
def test_forms_that_write_into_their_arguments(change):
    """scikit-fem hands the changed array to its next call; nothing else is the same matrix."""
    form = BilinearForm(lambda u, v, w: change(w.k) * u * v)
    element = skfem.ElementQuad0()
    basis = Basis(MESH, element)
    given, other = (wide(COEFFICIENTS["random"], basis) for _ in range(2))
    assert same(assemble(form, MESH, element, k=given), asm(form, basis, k=other), 1e-13)
    np.testing.assert_array_equal(given, other)
    of_cells = COEFFICIENTS["random"].copy()
    assemble(form, MESH, element, k=of_cells)
    np.testing.assert_array_equal(of_cells, COEFFICIENTS["random"])


OTHER = {
    "of the second coefficient": lambda u, v, w: w.k / w.rho.max() * u * v,
    "of a function": lambda u, v, w: u * v / np.abs(u).max(),
    "of a gradient": lambda u, v, w: u * v * np.linalg.norm(v.grad),
    "random": lambda u, v, w: w.k * u * v * np.random.default_rng().uniform(1, 2),
    "beside a term": lambda u, v, w: w.k / np.max(w.k) * u * v + w.rho * u * v,
    "of what is held": lambda u, v, w: (np.resize(STEPS, len(u))[:, None] + w.rho) * u * v,
}


@pytest.mark.parametrize("name", OTHER)
def test_other_forms_that_mix_cells(name):
    form = BilinearForm(OTHER[name])
    fields = {"k": COEFFICIENTS["random"], "rho": COEFFICIENTS["layers"]}
    if name != "random":
        columns = {name: value[:, None] for name, value in fields.items()}
        assert same(assemble(form, MESH, ELEMENT, **fields), asm(form, BASIS, **columns), 1e-13)
    with pytest.raises(InputError, match="among other cells"):
        assemble(form, MESH, ELEMENT, fallback=False, **fields)


def test_reductions_of_places_and_sizes_and_on_facets():
    k = COEFFICIENTS["random"]
    facets = skfem.FacetBasis(MESH, ELEMENT)
    x = RNG.standard_normal(BASIS.N)
    cases = [
        (lambda u, v, w: w.x[0] / w.x[0].max() * u * v, BASIS, {}),
        (lambda u, v, w: w.h / w.h.mean() * u * v, BASIS, {}),
        (lambda u, v, w: (w.before - w.before.mean()) * u * v, BASIS, {"before": x}),
        (lambda u, v, w: w.x[0] / w.x[0].max() * u * v, facets, {}),
        (lambda u, v, w: k.max() * u * v, BASIS, {}),
    ]
    for integrand, basis, fields in cases:
        form = BilinearForm(integrand)
        assert same(assemble(form, basis, **fields), asm(form, basis, **fields), 1e-13)


# Cut domains are assembled in batches: there such forms are refused.

ELEMENTS = {
    "Adini": ElementQuadAdini(derivatives=2),
    "Q2": skfem.ElementQuad2(),
    "vectors": ElementVector(ElementQuad1()),
}
PLACES = {
    "x": lambda w: w.x[0],
    "x and y": lambda w: np.hypot(w.x[0] - 0.4, w.x[1] - 0.6),
    "dofs": lambda w: w.k,
    "one dof": lambda w: w.spike,
}


def kind(name, element, coefficient):
    dims = 2 if isinstance(element, ElementVector) else 0
    if name == "functional":
        return skfem.Functional(coefficient)
    if name == "load":
        return LinearForm(lambda v, w: coefficient(w) * (v[0] if dims else v))
    return BilinearForm(lambda u, v, w: coefficient(w) * ((u * v).sum(axis=0) if dims else u * v))


@pytest.fixture
def disk():
    return CutDomain(unit_square(9), LEVEL_SETS["disk"], q=4)


def data(domain, element):
    """Vectors of dofs: random, and one everywhere but for one dof inside."""
    basis = next(iter(domain.groups(element)))
    spike = np.ones(basis.N)
    spike[basis.element_dofs[0, basis.nelems // 2]] = 100.0
    return {"k": np.random.default_rng(2).uniform(1, 2, basis.N), "spike": spike}


# Cells of several batches differ in their numbers of points too.
IN_BATCHES = REDUCTIONS | {
    "outliers": lambda k: np.where(k > k.mean() + 2 * k.std(), 2.0, 1.0),
    "points": lambda k: k - np.asarray(k).mean(axis=1, keepdims=True),
    "number of points": lambda k: k * np.shape(k)[1],
}
CUT = ["max", "mean", "axis", "median", "outliers", "equals", "sort", "cumsum", "norm", "roll"]
CUT += ["length", "sum", "points", "number of points"]
OF_ONE_DOF = ("max", "mean", "outliers", "norm", "sum")


@pytest.mark.parametrize("name", CUT)
def test_reductions_are_refused_on_cut_domains(disk, name):
    """Each batch had a largest value, a mean and an order of its own: sums of different forms."""
    element = ELEMENTS["Q2"]
    cases = [("bilinear", "x"), ("load", "x"), ("functional", "x and y"), ("functional", "dofs")]
    for form, field in cases + [("functional", "one dof")] * (name in OF_ONE_DOF):
        reduced = kind(form, element, lambda w, f=field: IN_BATCHES[name](PLACES[f](w)))
        with pytest.raises(InputError, match="hand them over"):
            disk.assemble(reduced, element, **data(disk, element))


@pytest.mark.parametrize("element", ELEMENTS)
def test_reductions_in_other_elements(disk, element):
    for form, name in (("bilinear", "max"), ("load", "median"), ("functional", "cumsum")):
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
@pytest.mark.parametrize("name", POINTWISE)
def test_ordinary_forms_are_assembled(disk, name, element):
    """They give what scikit-fem gives on full and cut cells, to rounding."""
    element = ELEMENTS[element]
    fields = {"a": 2.0, "largest": 3.0, "tensor": np.eye(2)[:, :, None, None]}
    fields["k"] = 1.0 if element is ELEMENTS["vectors"] else data(disk, element)["k"]
    for form in ("bilinear", "load", "functional"):
        integrand = kind(form, element, POINTWISE[name])
        found = disk.assemble(integrand, element, **fields)
        expected = sum(integrand.assemble(b, **fields) for b in disk.basis(element))
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


def test_a_domain_without_cut_cells_is_one_batch():
    """There scikit-fem's own assembly sees all cells at once, reductions included."""
    mesh = unit_square(4)
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


# Boundary data that reduce over places are refused where these come padded with others.

OF_DATA = IN_BATCHES | {"one number": lambda k: k.max()}


@pytest.mark.parametrize("name", [*CUT[:4], "cumsum", "norm", "number of points", "one number"])
def test_boundary_data_that_mix_places(disk, name):
    boundary = disk.boundary(ElementQuadAdini())
    mixed = lambda x: 9 + OF_DATA[name](x[1])  # noqa: E731
    for what in ("value", "coefficient"):
        with pytest.raises(InputError, match=f"{what}: .* each place alone"):
            nitsche(boundary, **{what: mixed})
    boundary = disk.boundary(ElementVector(ElementQuad1()))
    both = lambda x: np.array([0 * x[0], mixed(x) + 0 * x[0]])  # noqa: E731
    for value in (both, [0.0, mixed]):
        with pytest.raises(InputError, match=r"value: .* each place alone"):
            nitsche(boundary, value, lame=(1.0, 1.0))
    for lame in ((mixed, 1.0), (1.0, mixed)):
        with pytest.raises(InputError, match=r"lame: .* each place alone"):
            nitsche(boundary, lame=lame)


def test_ordinary_boundary_data(disk):
    """Of places, constant, and numbers of one's own at the basis's points."""
    boundary = disk.boundary(skfem.ElementQuad2())
    x = np.asarray(boundary.global_coordinates())
    expected = nitsche(boundary, lambda x: 1e9 * np.sin(x[0]) * x[1] ** 3)[1]
    kept = 1e9 * np.sin(x[0]) * x[1] ** 3
    found = nitsche(boundary, lambda x: kept)[1]
    np.testing.assert_array_equal(found, expected)
    largest = np.abs(x).max()
    nitsche(boundary, lambda x: x[0] / largest, coefficient=lambda x: np.where(x[0] > 0.5, 1e6, 1))
    one, same = (nitsche(boundary, value)[1] for value in (lambda x: 3.0, 3.0))
    np.testing.assert_array_equal(one, same)
