"""Forms and data that reduce over cells are found out; those that do not keep the fast path."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad0,
    ElementQuad1,
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

from skfem_adini import CutDomain, ElementQuadAdini, InputError, assemble, nitsche
from tests.skfem_adini.cut_problems import LEVEL_SETS, unit_square

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
    "most of one": np.where(np.arange(CELLS) % 5, 2.0, np.linspace(1, 3, CELLS)),
}
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


def at_all_points(k):
    return np.repeat(k[:, None], BASIS.W.size, axis=1)


def same(found, expected):
    return np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("name", REDUCTIONS)
def test_reductions_over_cells(name):
    """They came back 9 to 950 % off: each batch had a largest value and an order of its own."""
    form = LinearForm(lambda v, w: REDUCTIONS[name](w.k) * v)
    for k in COEFFICIENTS.values():
        expected = asm(form, BASIS, k=at_all_points(k))
        assert same(assemble(form, MESH, ELEMENT, k=k), expected)
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
        for reduction in (np.sum, np.linalg.norm, lambda k: k.shape[1]):
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
    k, wide = COEFFICIENTS["random"], at_all_points(COEFFICIENTS["random"])
    form = BilinearForm(lambda u, v, w: SUMS_OF_A_CELL[name](w.k) * u * v)
    for given in (k, wide):
        found = assemble(form, MESH, ELEMENT, fallback=False, k=given)
        assert same(found, asm(form, BASIS, k=wide))
    assert same(assemble(form, MESH, ELEMENT, k=k[:, None]), asm(form, BASIS, k=k[:, None]))


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


@pytest.mark.parametrize("name", FAST)
def test_forms_that_keep_the_fast_path(name):
    form = BilinearForm(FAST[name])
    for k in (COEFFICIENTS["random"], COEFFICIENTS["one cell"]):
        found = assemble(form, MESH, ELEMENT, fallback=False, k=k)
        assert same(found, asm(form, BASIS, k=at_all_points(k)))


def test_elasticity_keeps_the_fast_path():
    element, lam = ElementVector(ElementQuad2()), COEFFICIENTS["layers"]
    form = BilinearForm(
        lambda u, v, w: w.lam * div(u) * div(v) + 2 * ddot(sym_grad(u), sym_grad(v)) / w.lam
    )
    found = assemble(form, MESH, element, fallback=False, lam=lam)
    assert same(found, asm(form, Basis(MESH, element), lam=lam[:, None]))


# Cut domains are assembled in batches: there such forms are refused.

ELEMENTS = {
    "Adini": ElementQuadAdini(derivatives=2),
    "Q2": ElementQuad2(),
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
        return Functional(coefficient)
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
    boundary = disk.boundary(ElementQuad2())
    x = np.asarray(boundary.global_coordinates())
    expected = nitsche(boundary, lambda x: 1e9 * np.sin(x[0]) * x[1] ** 3)[1]
    kept = 1e9 * np.sin(x[0]) * x[1] ** 3
    found = nitsche(boundary, lambda x: kept)[1]
    np.testing.assert_array_equal(found, expected)
    largest = np.abs(x).max()
    nitsche(boundary, lambda x: x[0] / largest, coefficient=lambda x: np.where(x[0] > 0.5, 1e6, 1))
    one, same = (nitsche(boundary, value)[1] for value in (lambda x: 3.0, 3.0))
    np.testing.assert_array_equal(one, same)
