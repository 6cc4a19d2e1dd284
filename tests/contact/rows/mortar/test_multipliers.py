"""Multiplier functions: partition of unity, biorthogonality, positive bases, narrow coverage."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2
from two_blocks import block, facing, ring, sides

from contact.rows.functionals import facet_functional
from contact.rows.mortar.facet_curves import FacetCurves
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.multipliers import LEAST_WEIGHT, Multipliers, PositiveBasis
from contact.rows.outline import Outline
from skfem_adini import ElementQuadAdini, ElementQuadBFS

KINDS = ["dual", "standard", "hat"]
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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", PLANE_AND_BFS)
@pytest.mark.parametrize(("n", "m", "shift"), [(7, 10, 0.0), (3, 30, 0.013), (30, 3, 0.3)])
def test_on_straight_facets(element, kind, n, m, shift):
    outline, basis, q, functions = interface(sides(*facing(element, n, m, shift=shift)), kind)
    check(q, functions, kind)
    degree = 1 if kind == "hat" else DEGREE.get(element, 3)
    # A vertex between two facets on a line has no coefficient where the trace is C1.
    full = 2 * n + 2 if degree == 3 else degree * n + 1
    assert basis.size == full
    assert np.all(
        np.diff(outline.body.mesh.p[0, outline.corners].min(axis=1)[basis.nominal[0]]) >= 0
    )


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


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", [*DEGREE, ElementQuadAdini])
def test_on_a_curve(element, kind, curved):
    """One number a vertex, as for one body; second-order facets likewise."""
    if curved and element is ElementQuadAdini:
        curved = False
    upper = block(element, [0.5, 1.0], np.linspace(-1, 1, 9), place=ring(1.0, (0, 1), -np.pi / 2))
    lower = block(
        element,
        [0.5, 1.0],
        np.linspace(-0.5, 0.47, 8),
        place=ring(2.0, (0, -2), np.pi / 2),
        curved=curved,
    )
    for one, two in ((upper, lower), (lower, upper)):
        pair = one, one.facets("right"), two, two.facets("right")
        _, basis, q, functions = interface(pair, kind)
        check(q, functions, kind)
        assert basis.size == pair[1].size + 1


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


def test_narrow_coverage_keeps_its_digits():
    """A part 1e-3 of a facet: dual functions against rational arithmetic."""
    import sympy

    upper, lower = facing(ElementTriP2, 1, 1, shift=1 - 1 / 1024)
    _, _, q, functions = interface(sides(upper, lower), "dual")
    s = sympy.symbols("s")
    N = [(1 - s) ** 2, 2 * s * (1 - s), s**2]
    low = 1 - sympy.Rational(1, 1024)
    mass = sympy.Matrix(3, 3, lambda i, j: sympy.integrate(sympy.expand(N[i] * N[j]), (s, low, 1)))
    D = [sympy.integrate(sympy.expand(n), (s, low, 1)) for n in N]
    psi = sympy.diag(*D) * mass.inv() * sympy.Matrix(N)
    first, facets, *_ = sides(upper, lower)
    backwards = first.mesh.p[0, first.mesh.facets[0, facets[0]]] > 0.5
    assert not backwards
    at = [sympy.Rational(float(x)) for x in q.X[0]]
    exact = np.array([[float(f.subs(s, x)) for f in psi] for x in at])
    # The point of weight (1e-3)^3 / 3 has joined that of the vertex.
    joined = exact[:, 1:] + np.array([[0.0, 1.0]]) * exact[:, :1]
    assert functions.weights.size == 2
    assert np.abs(functions.psi.toarray() - joined).max() < 1e-11
