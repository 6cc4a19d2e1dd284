"""Coefficients of the cells enter by scaling, whatever the form makes of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementQuad1, ElementVector, LinearForm, MeshQuad, asm
from skfem.helpers import ddot, div, dot, mul, sym_grad

from skfem_adini import ElementQuadAdini, assemble
from skfem_adini.assembly import local_tensors as module

MESH = MeshQuad.init_tensor(np.linspace(0, 1.7, 13), np.linspace(0, 1, 9))
CELLS = MESH.t.shape[1]
RNG = np.random.default_rng(5)
FIELDS = {
    "k": RNG.uniform(0, 1, CELLS),
    "rho": RNG.uniform(1, 2, CELLS),
    "n": RNG.integers(0, 5, CELLS).astype(np.int8),
    "b": RNG.uniform(-1, 1, (2, CELLS, 1)),
    "D": RNG.uniform(-1, 1, (2, 2, CELLS, 1)),
}
POINTS = Basis(MESH, ElementQuadAdini()).W.size
MEANT = {
    name: np.repeat(value[:, None], POINTS, axis=1) if value.ndim == 1 else value
    for name, value in FIELDS.items()
}

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
OTHER = {
    "square of a product": lambda u, v, w: (w.k * u) ** 2 * v,
    "mixed": lambda u, v, w: np.exp(w.k * u) * v,
    "quotient": lambda u, v, w: u * v / (1 + w.k * u**2),
    "array": lambda u, v, w: np.array(w.k) * u * v,
    "caught": lambda u, v, w: caught(w) * u * v,
    "chosen": lambda u, v, w: np.where(w.k > 0.5, u, v) * v,
    "of the kind": lambda u, v, w: (2.0 if isinstance(w.k, np.ndarray) else 1.0) * w.k * u * v,
}


def caught(w):
    try:
        return w.k * (1 + 0 * w.k.mean(axis=-1, keepdims=True)) + w.k.shape[-1]
    except Exception:
        return w.k


def same(found, expected, to=1e-14):
    return np.abs(found - expected).max() <= to * max(np.abs(expected).max(), 1e-300)


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
    element, form = ElementQuadAdini(), BilinearForm(SCALED[name])
    found = assemble(form, MESH, element, fallback=False, **FIELDS)
    assert rows == [144]
    expected = asm(form, Basis(MESH, element), **MEANT)
    assert same(found, expected, 1e-8 if name == "cancelling" else 1e-14)


@pytest.mark.parametrize("name", OTHER)
def test_forms_without_such_terms(name):
    element, form = ElementQuadAdini(), BilinearForm(OTHER[name])
    fields = {name: value for name, value in FIELDS.items() if name != "n"}
    meant = {name: MEANT[name] for name in fields}
    found = assemble(form, MESH, element, fallback=False, **fields)
    assert same(found, asm(form, Basis(MESH, element), **meant))


def test_elasticity_and_loads():
    element = ElementVector(ElementQuad1())
    form = BilinearForm(
        lambda u, v, w: (
            w.k * div(u) * div(v) + 2 * ddot(w.rho * sym_grad(u), sym_grad(v)) / (1 + w.k)
        )
    )
    load = LinearForm(lambda v, w: w.k**2 * v[0] - dot(w.b, v))
    basis = Basis(MESH, element)
    meant = FIELDS | {
        name: np.repeat(FIELDS[name][:, None], basis.W.size, axis=1) for name in ("k", "rho", "n")
    }
    for each in (form, load):
        found = assemble(each, MESH, element, fallback=False, **FIELDS)
        assert same(found, asm(each, basis, **meant))


def test_entries_one_by_one_are_those_of_one_call(monkeypatch):
    """Many cells get a call for each entry; few get one call for all."""
    form = BilinearForm(OTHER["quotient"])
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


def test_terms_do_not_hide_a_form_that_mixes_cells():
    form = BilinearForm(lambda u, v, w: w.k / np.max(w.k) * u * v + w.rho * u * v)
    element, fields = ElementQuad1(), {name: FIELDS[name] for name in ("k", "rho")}
    meant = {name: value[:, None] for name, value in fields.items()}
    assert same(assemble(form, MESH, element, **fields), asm(form, Basis(MESH, element), **meant))
