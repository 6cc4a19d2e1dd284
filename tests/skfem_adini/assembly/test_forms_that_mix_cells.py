"""Forms that reduce over cells are found out; those that reduce inside a cell stay fast."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad0,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    Functional,
    LinearForm,
    MeshQuad,
    asm,
)
from skfem.element import DiscreteField
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
    "of all": lambda k: k / np.sum(k),
    "reduce of all": lambda k: k / np.add.reduce(np.add.reduce(np.asarray(k))),
    "dot": lambda k: k / np.dot(np.ravel(k), np.ravel(k)),
    "inner": lambda k: k / np.vdot(np.ravel(k), np.ones(k.size)),
    "transposed": lambda k: k / np.asarray(k).T.sum(axis=1).sum(),
    "shape": lambda k: k / (k.shape[0] * k.shape[1]),
    "prod": lambda k: k * np.prod(np.asarray(k) ** (1 / k.size)),
    "average": lambda k: k - np.average(k, weights=np.asarray(k) ** 2),
    "trapezoid": lambda k: k / np.trapezoid(np.asarray(k), axis=0).sum(),
    "nansum": lambda k: k / np.nansum(k),
    "nanmax": lambda k: k / np.nanmax(k),
    "nanmean": lambda k: k - np.nanmean(k),
    "variance": lambda k: k / (1.0 + np.var(k)),
    "any": lambda k: 2.0 * k if np.any(k > 2.5) else k,
    "all": lambda k: 2.0 * k if np.all(k < 2.5) else k,
    "which": lambda k: k * len(np.flatnonzero(k > 1.5)),
    "searchsorted": lambda k: np.searchsorted(np.sort(np.ravel(k)), np.asarray(k)) + 1.0,
    "histogram": lambda k: k * np.histogram(k, bins=4)[0].max(),
    "iteration": lambda k: k / sum(row.sum() for row in k),
    "items": lambda k: k / sum(np.asarray(k).flat),
    "convolution": lambda k: np.convolve(np.ravel(k), [1, 2, 1], "same").reshape(k.shape),
    "outer": lambda k: k * np.maximum.outer(np.ravel(k)[:9], np.ravel(k)[-9:]).sum(),
    "interpolated": lambda k: np.interp(k, np.sort(np.ravel(k)), np.arange(k.size)) + 1.0,
    "centred": lambda k: k / np.linalg.norm(k - k.mean(), axis=0),
    "covariance": lambda k: k * (1.0 + np.cov(np.ravel(k))),
}


def at_all_points(k):
    return np.repeat(k[:, None], BASIS.W.size, axis=1)


def same(found, expected):
    return np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("given", COEFFICIENTS)
@pytest.mark.parametrize("name", REDUCTIONS)
def test_reductions_over_cells(name, given):
    """They came back 9 to 950 % off: each batch had a largest value and an order of its own."""
    k, reduction = COEFFICIENTS[given], REDUCTIONS[name]
    form = LinearForm(lambda v, w: reduction(w.k) * v)
    expected = asm(form, BASIS, k=at_all_points(k))
    assert same(assemble(form, MESH, ELEMENT, k=k), expected)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_no_fast_path_for_them(name):
    form = BilinearForm(lambda u, v, w: REDUCTIONS[name](w.k) * u * v)
    k = COEFFICIENTS["random"]
    assert same(assemble(form, BASIS, k=k), asm(form, BASIS, k=at_all_points(k)))
    with pytest.raises(InputError, match="among other cells"):
        assemble(form, MESH, ELEMENT, fallback=False, k=k)


def test_statistics_of_coefficients_mean_what_they_mean_to_scikit_fem():
    """A form with k / sum(k) was wrong by the number of points, 25, for numbers of the cells."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 15), np.linspace(0, 1, 15))
    k = np.random.default_rng(7).uniform(1, 2, 196)
    for element in (ELEMENT, ElementQuad2()):
        basis = Basis(mesh, element)
        wide = np.repeat(k[:, None], basis.W.size, axis=1)
        interpolated = Basis(mesh, ElementQuad0(), quadrature=basis.quadrature).interpolate(k)
        kinds = [(k, wide), (DiscreteField(k), wide), (DiscreteField(k[:, None]), wide)]
        kinds += [(each, each) for each in (wide, interpolated, k[:, None])]
        for reduction in (np.sum, np.linalg.norm, np.size, np.max, lambda k: k.shape[1]):
            forms = [
                BilinearForm(lambda u, v, w, of=reduction: w.k / of(w.k) * u * v),
                LinearForm(lambda v, w, of=reduction: w.k / of(w.k) * v),
                Functional(lambda w, of=reduction: w.k / of(w.k) + 0 * w.x[0]),
            ]
            for form in forms:
                for given, meant in kinds:
                    assert same(assemble(form, mesh, element, k=given), asm(form, basis, k=meant))


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
    for given, meant in ((k, at_all_points(k)), (at_all_points(k), at_all_points(k))):
        found = assemble(form, MESH, ELEMENT, fallback=False, k=given)
        assert same(found, asm(form, BASIS, k=meant))
    narrow = k[:, None]
    assert same(assemble(form, MESH, ELEMENT, k=narrow), asm(form, BASIS, k=narrow))


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
    basis = Basis(MESH, ElementQuad0())
    k = COEFFICIENTS["random"]
    given, other = (np.repeat(k[:, None], basis.W.size, axis=1) for _ in range(2))
    assert same(assemble(form, MESH, ElementQuad0(), k=given), asm(form, basis, k=other))
    np.testing.assert_array_equal(given, other)
    of_cells = COEFFICIENTS["random"].copy()
    assemble(form, MESH, ElementQuad0(), k=of_cells)
    np.testing.assert_array_equal(of_cells, COEFFICIENTS["random"])


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
