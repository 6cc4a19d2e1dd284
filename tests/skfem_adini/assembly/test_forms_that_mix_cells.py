"""Forms that reduce over cells are found out; those that reduce inside a cell stay fast."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshQuad,
    asm,
)
from skfem.helpers import ddot, div, sym_grad

from skfem_adini import ElementQuadAdini, InputError, assemble

MESH = MeshQuad.init_tensor(np.linspace(0, 1.7, 13), np.linspace(0, 1, 9))
CELLS = MESH.t.shape[1]
ELEMENT = ElementQuadAdini()
BASIS = Basis(MESH, ELEMENT)
RNG = np.random.default_rng(4)
STEPS = np.array([1.0, 2.0, 5.0])
COEFFICIENTS = {
    "random": RNG.uniform(1, 3, CELLS),
    "layers": STEPS[RNG.integers(3, size=CELLS)],
    "one cell": np.where(np.arange(CELLS) == 40, 100.0, 1.0),
    "all but one": np.where(np.arange(CELLS) == 40, 1.0, 100.0),
    "most of one": np.where(np.arange(CELLS) % 5, 2.0, np.linspace(1, 3, CELLS)),
}
REDUCTIONS = {
    "max": lambda k: k / k.max(),
    "mean": lambda k: k - k.mean(),
    "axis": lambda k: k - k.mean(axis=0),
    "keepdims": lambda k: k - np.mean(k, axis=-2, keepdims=True),
    "median": lambda k: np.where(k > np.median(k), 2.0, 1.0),
    "quantile": lambda k: np.clip(k, *np.percentile(k, [10, 90])),
    "outliers": lambda k: np.where(k > k.mean() + 3 * k.std(), 2.0, 1.0),
    "equals": lambda k: np.where(k == k.max(), 2.0, 1.0),
    "least": lambda k: np.where(k == k.min(), 2.0, 1.0),
    "sort": lambda k: np.sort(k, axis=0),
    "rank": lambda k: np.argsort(np.argsort(k, axis=0), axis=0) + 1.0,
    "cumsum": lambda k: np.cumsum(k, axis=0),
    "accumulate": lambda k: np.maximum.accumulate(k, axis=0),
    "reduce": lambda k: k + np.add.reduce(k, axis=0),
    "norm": lambda k: k / np.linalg.norm(k),
    "einsum": lambda k: k / np.sqrt(np.einsum("cq,cq->", k, k)),
    "product": lambda k: k * (np.asarray(k).T @ np.asarray(k)).sum(),
    "first": lambda k: k / k[0],
    "fancy": lambda k: k[np.zeros(len(k), dtype=int)],
    "roll": lambda k: np.roll(np.asarray(k), 1, axis=0),
    "flip": lambda k: np.asarray(k)[::-1],
    "gradient": lambda k: np.diff(np.asarray(k), axis=0, prepend=0),
    "length": lambda k: k / len(k),
    "size": lambda k: k * k.size,
    "sum": lambda k: k / k.sum(),
    "count": lambda k: k * np.count_nonzero(k > 1.5),
    "unique": lambda k: np.searchsorted(np.unique(k), np.asarray(k)) + 1.0,
    "builtin": lambda k: k / max(np.asarray(k).ravel().tolist()),
    "spread": lambda k: (k - k.min()) / (np.ptp(k) + 1.0),
}


def same(found, expected):
    return np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("given", COEFFICIENTS)
@pytest.mark.parametrize("name", REDUCTIONS)
def test_reductions_over_cells(name, given):
    """They came back 9 to 950 % off: each batch had a largest value and an order of its own."""
    k, reduction = COEFFICIENTS[given], REDUCTIONS[name]
    expected = asm(form := LinearForm(lambda v, w: reduction(w.k) * v), BASIS, k=k[:, None])
    assert same(assemble(form, MESH, ELEMENT, k=k), expected)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_no_fast_path_for_them(name):
    form = BilinearForm(lambda u, v, w: REDUCTIONS[name](w.k) * u * v)
    k = COEFFICIENTS["random"]
    assert same(assemble(form, BASIS, k=k), asm(form, BASIS, k=k[:, None]))
    with pytest.raises(InputError, match="among other cells"):
        assemble(form, MESH, ELEMENT, fallback=False, k=k)


OTHER = {
    "of the second coefficient": lambda u, v, w: w.k / w.rho.max() * u * v,
    "of a function": lambda u, v, w: u * v / np.abs(u).max(),
    "of a gradient": lambda u, v, w: u * v * np.linalg.norm(v.grad),
    "random": lambda u, v, w: w.k * u * v * np.random.default_rng().uniform(1, 2),
    "of what is held": lambda u, v, w: (np.resize(STEPS, len(u))[:, None] + w.rho) * u * v,
}


@pytest.mark.parametrize("name", OTHER)
def test_other_forms_that_mix_cells(name):
    form = BilinearForm(OTHER[name])
    fields = {"k": COEFFICIENTS["random"], "rho": COEFFICIENTS["layers"]}
    if name != "random":
        wide = {name: value[:, None] for name, value in fields.items()}
        assert same(assemble(form, MESH, ELEMENT, **fields), asm(form, BASIS, **wide))
    with pytest.raises(InputError, match="among other cells"):
        assemble(form, MESH, ELEMENT, fallback=False, **fields)


def test_reductions_of_places_and_sizes_and_on_facets():
    k = COEFFICIENTS["random"]
    facets = FacetBasis(MESH, ELEMENT)
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
        assert same(assemble(form, basis, **fields), asm(form, basis, **fields))


FAST = {
    "components": lambda u, v, w: w.k * (u.grad * v.grad).sum(axis=0),
    "largest component": lambda u, v, w: np.max(np.abs(v.grad), axis=0) * u + w.k * u * v,
    "points": lambda u, v, w: w.k * (u - u.mean(axis=-1, keepdims=True)) * v,
    "coefficient over points": lambda u, v, w: w.k.mean(axis=-1, keepdims=True) * u * v,
    "check of signs": lambda u, v, w: w.k * u * v if (w.k > 0).all() else 1 / 0,
    "table": lambda u, v, w: STEPS[np.asarray(w.k).astype(int) % 3] * u * v,
    "threshold": lambda u, v, w: np.where(w.k > 2, np.exp(w.k), np.sqrt(w.k)) * u * v,
    "einsum": lambda u, v, w: w.k * np.einsum("i...,i...", u.grad, v.grad),
    "no more than rounding": lambda u, v, w: (w.k / w.k.max()) * w.k.max() * u * v,
    "held number": lambda u, v, w: COEFFICIENTS["random"].max() * w.k * u * v,
}


@pytest.mark.parametrize("given", ["random", "one cell"])
@pytest.mark.parametrize("name", FAST)
def test_forms_that_keep_the_fast_path(name, given):
    k = COEFFICIENTS[given]
    form = BilinearForm(FAST[name])
    found = assemble(form, MESH, ELEMENT, fallback=False, k=k)
    assert same(found, asm(form, BASIS, k=np.repeat(k[:, None], BASIS.W.size, axis=1)))


def test_elasticity_keeps_the_fast_path():
    element, lam = ElementVector(ElementQuad2()), COEFFICIENTS["layers"]
    form = BilinearForm(
        lambda u, v, w: w.lam * div(u) * div(v) + 2 * ddot(sym_grad(u), sym_grad(v)) / w.lam
    )
    found = assemble(form, MESH, element, fallback=False, lam=lam)
    assert same(found, asm(form, Basis(MESH, element), lam=lam[:, None]))
