"""Multiplier functions: partition of unity, biorthogonality, positive bases, narrow coverage."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from hypothesis import given, settings
from hypothesis import strategies as st
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
from two_blocks import block, facing, sides

from contact.rows.functionals import facet_functional
from contact.rows.mortar.facet_curves import FacetCurves
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
