"""Multiplier functions: partition of unity, biorthogonality; segments beside rays."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)
from solid_boxes import pair as boxes
from solid_boxes import rows
from two_blocks import block, facing, ring, sides, turned

from contact.rows.functionals import facet_functional
from contact.rows.mortar.facet_curves import FacetCurves, interface_segments
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.mortar.multipliers import LEAST_WEIGHT, Multipliers, PositiveBasis
from contact.rows.outline import Outline
from skfem_adini import ElementQuadAdini, ElementQuadBFS

CUBIC = (ElementQuadAdini, ElementQuadBFS)
DEGREE = {ElementTriP1: 1, ElementQuad1: 1, ElementTriP2: 2, ElementQuad2: 2}


def interface(pair, kind, tied=False):
    first, facets, second, others = pair
    outline = Outline(first, facets)
    form = facet_functional(first.element, None)
    basis = PositiveBasis.of(outline, form, kind == "hat", tied)
    q = FacetCurves.of(outline).cut(FacetCurves.of(Outline(second, others)), 9)
    return outline, basis, q, Multipliers.of(basis, q, kind != "standard")


def check(q, functions, kind, tolerance=1e-13):
    psi, N, w = functions.psi, functions.N, functions.weights
    largest = np.abs(psi.data).max()
    assert np.abs(psi.sum(axis=1) - 1.0).max() < tolerance * largest
    assert np.abs(N.sum(axis=1) - 1.0).max() < 1e-14
    assert N.data.min() >= 0
    assert np.all(w > 0)
    assert np.abs(psi.T @ q.w - w).max() < tolerance * w.max()
    if kind != "standard":
        products = (psi.T @ (N * q.w[:, None])).toarray()
        # A point that has joined another one changes this by the part of its weight.
        bound = tolerance if functions.weights.size == functions.point.size else LEAST_WEIGHT
        assert np.abs(products - np.diag(w)).max() < max(bound, tolerance) * w.max()


@pytest.mark.parametrize("element", CUBIC)
@pytest.mark.parametrize("kind", ["dual", "standard"])
def test_cubic_functions_are_those_of_the_trace(element, kind):
    """On a graded line the N_k span the trace of Adini and BFS, and nothing else."""
    xs = np.array([0.0, 0.1, 0.4, 0.5, 0.95, 1.0])
    upper = block(element, xs, [0.0, 1.0])
    lower = block(element, [-1.0, 2.0], [-1.0, 0.0])
    outline, _, q, functions = interface(sides(upper, lower), kind)
    trace = facet_trace(outline, q.facet, q.X).toarray()
    trace = trace[:, np.abs(trace).max(axis=0) > 0]
    N = functions.N.toarray()
    assert N.shape[1] == np.linalg.matrix_rank(trace) == 2 * 5 + 2
    found = np.linalg.lstsq(trace, N, rcond=None)[0]
    assert np.abs(trace @ found - N).max() < 1e-12


@pytest.mark.parametrize("element", PLANE_AND_BFS)
@pytest.mark.parametrize("held", [("left",), ("left", "right"), ()])
def test_lower_degree_at_held_ends(element, held):
    """c_0 = c_1, 2 c_1 - c_2 or 3 c_1 - 3 c_2 + c_3: on the facet, the degree is one less."""
    upper, lower = facing(element, 6, 9)
    for side in held:
        upper.fix(side, "xy")
    p = DEGREE.get(element, 3)
    outline, basis, q, functions = interface(sides(upper, lower), "standard", tied=True)
    full = interface(sides(upper, lower), "standard")[1].size
    assert basis.size == full - len(held)
    check(q, functions, "standard")
    middle = outline.body.mesh.p[0, outline.corners].mean(axis=1)
    for f, end in ((middle.argmin(), "left"), (middle.argmax(), "right")):
        here = q.facet == f
        values = functions.N[here].toarray()
        monomials = q.X[0, here][:, None] ** np.arange(p + 1 - (end in held))
        fit = np.linalg.lstsq(monomials, values, rcond=None)[0]
        assert np.abs(monomials @ fit - values).max() < 1e-12
        assert np.linalg.matrix_rank(values, tol=1e-9) == monomials.shape[1]


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_one_facet_held_at_both_ends(element):
    upper, lower = facing(element, 1, 3)
    upper.fix(["left", "right"], "xy")
    _, basis, q, functions = interface(sides(upper, lower), "standard", tied=True)
    assert basis.size == max(DEGREE.get(element, 3) - 1, 1)
    check(q, functions, "standard")


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP1, ElementTetP2])
def test_dual_functions_have_the_trace_as_their_partner(element):
    upper, lower = boxes(element, shift=(0.25, 0.0))
    found = rows(upper, lower)
    interface = Interface.of(upper, upper.facets("bottom"), lower, lower.facets("top"))
    q = found.quadrature
    N = interface.basis.values(q.facet, q.X)
    number = interface.basis.number[q.facet]
    mixed = np.zeros((found.P.shape[0], interface.basis.size))
    P = found.P.tocoo()
    for k in range(N.shape[1]):
        np.add.at(mixed, (P.row, number[P.col, k]), P.data * N[P.col, k])
    own = mixed.argmax(axis=1)
    rest = mixed.copy()
    rest[np.arange(own.size), own] -= 1.0
    assert np.abs(rest).max() <= 1e-9
    assert np.unique(own).size == own.size


@settings(max_examples=60)
@given(
    st.sampled_from(PLANE_AND_BFS),
    st.sampled_from(["dual", "standard"]),
    st.integers(1, 9),
    st.integers(1, 9),
    st.floats(1e-8, 1.0),
    st.integers(0, 8),
    st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_partial_coverage(element, kind, n, m, part, k, size):
    """Any part of a facet covered, 1e-8 of it too."""
    shift = (k % n + 1 - part) / n
    pair = sides(*facing(element, n, m, shift=shift, size=size))
    _, _, q, functions = interface(pair, kind)
    check(q, functions, kind, 1e-12)
    assert functions.weights.min() >= LEAST_WEIGHT * functions.weights.max()
    assert abs(functions.weights.sum() - q.w.sum()) < 1e-13 * q.w.sum()
    # Bounded, however narrow the part: the pressure of a uniform displacement does not grow.
    assert np.abs(functions.psi.data).max() < 60


def curves(body, side):
    return FacetCurves.of(Outline(body, body.facets(side)))


def both(upper, lower):
    first, facets, second, others = sides(upper, lower)
    return FacetCurves.of(Outline(first, facets)), FacetCurves.of(Outline(second, others))


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def cylinders(element, n, m, curved, R=2.0, height=0.0):
    """A cylinder of radius 1 on one of radius R below it, arcs of 1.2 rad to either side."""
    arc = np.linspace(-1.2, 1.2, n + 1), np.linspace(-1.2, 1.2, m + 1)
    upper = ring(1.0, (0.0, 1.0 + height), -np.pi / 2)
    lower = ring(R, (0.0, -R), np.pi / 2)
    return (
        curves(block(element, [0.5, 1.0], arc[0], place=upper, curved=curved), "right"),
        curves(block(element, [0.5, 1.0], arc[1], place=lower, curved=curved), "right"),
    )


def rays(one, two, q):
    """Distance to the nearest facing facet on the ray of every point, by trial of all facets."""
    at = np.arange(two.sign.size)
    outward = two.outward(at, np.full(at.size, 0.5))
    a, b = (two.at(at, np.full(at.size, s)) for s in (0.0, 1.0))
    n, x = q.n[:, :, None], q.x[:, :, None]
    A = np.broadcast_arrays(n[0], (a - b)[0][None], n[1], (a - b)[1][None])
    t, along = np.linalg.solve(
        np.stack(A, -1).reshape(*A[0].shape, 2, 2), np.moveaxis(a[:, None] - x, 0, -1)[..., None]
    )[..., 0].transpose(2, 0, 1)
    met = (along >= -1e-8) & (along <= 1 + 1e-8) & (np.tensordot(q.n, outward, (0, 0)) <= -0.25)
    t = np.where(met, t, np.inf)
    return np.take_along_axis(t, np.abs(t).argmin(axis=1)[:, None], axis=1)[:, 0]


def wavy(seed):
    """Two sides of random waves, rough and graded, apart by up to .8 of their length."""
    rng = np.random.default_rng(seed)
    wave, height = rng.uniform(1, 9, 2), rng.uniform(0, 0.3, 2)
    ticks = [np.unique(np.append(rng.uniform(0, 1, 70) ** p, [0.0, 1.0])) for p in (1, 3)]

    def place(k, lift):
        return lambda x: np.array([x[0], x[1] + height[k] * np.sin(wave[k] * x[0]) + lift])

    one = block(ElementQuad1, ticks[0], [0, 2], place=place(0, 0.4 * (seed % 3)))
    two = block(ElementQuad1, ticks[1], [-2, 0], place=place(1, 0.0))
    return curves(one, "bottom"), curves(two, "top")


POLYGONS = [
    *(lambda n=n, m=m: cylinders(ElementQuad1, n, m, False, height=0.1) for n, m in
      ((5, 5), (13, 4), (3, 17), (11, 30))),
    *(lambda seed=seed: wavy(seed) for seed in range(5)),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(POLYGONS)))
def test_polygons_against_rays(case):
    pair = POLYGONS[case]()
    for one, two in (pair, pair[::-1]):
        q = one.cut(two, 3)
        assert np.abs(cross(q.y - q.x, q.n)).max() < 1e-14
        assert np.abs(q.gap - rays(one, two, q)).max() < 1e-12


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
@pytest.mark.parametrize(("n", "m"), [(5, 7), (12, 3)])
def test_curved_facets_against_a_bracketing_solver(element, n, m):
    """Places lie on the curved facets of either side, found by Brent's method here."""
    pair = cylinders(element, n, m, True)
    for one, two in (pair, pair[::-1]):
        q = one.cut(two, 9)
        assert np.any(two.bulge)
        for k in range(0, q.w.size, 5):
            at, n_k, x = q.other[[k]], q.n[:, k], q.x[:, k]

            def off(s, at=at, n_k=n_k, x=x, two=two):
                return cross(two.at(at, np.array([s]))[:, 0] - x, n_k)

            s = brentq(off, -1e-9, 1 + 1e-9, xtol=1e-15)
            assert np.abs(two.at(at, np.array([s]))[:, 0] - q.y[:, k]).max() < 1e-14
        assert np.abs(q.x - one.at(q.facet, q.X[0])).max() == 0.0


@settings(max_examples=40)
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.floats(-0.99, 0.99),
    st.floats(-3.1, 3.1),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from([0.0, 0.3, -0.05]),
)
def test_covered_length_of_blocks(n, m, shift, angle, size, gap):
    place = turned(angle, (2.0, -1.0))
    upper, lower = facing(ElementQuad1, n, m, shift=shift, gap=gap, place=place, size=size)
    for one, two in (both(upper, lower), both(upper, lower)[::-1]):
        q = one.cut(two, 3)
        # Rounding of places of size 3 against a length of 1 - |shift|, at least .01.
        assert abs(q.w.sum() - size * (1 - abs(shift))) < 1e-14 * size
        assert np.abs(q.gap - size * gap).max() < 1e-14 * size
        pieces = interface_segments(one, two)
        assert np.all(pieces.end > pieces.start)
        inside = np.diff(pieces.facet) == 0
        assert np.all(pieces.start[1:][inside] == pieces.end[:-1][inside])
