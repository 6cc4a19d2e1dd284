"""Zeros and terms that are nearly nothing: rows, stored entries, linear terms beside singular P."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.optimize import linprog

from gpu import Infeasible, Unbounded, solve_qp

STORED = {"dense": np.asarray, "sparse": sparse.csr_array}
MATRICES = {
    "zero": np.zeros((3, 3)),
    "rank one": np.outer([1.0, -1.0, 2.0], [1.0, -1.0, 2.0]),
    "definite": np.diag([1.0, 2.0, 3.0]),
}


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("P", MATRICES.values(), ids=MATRICES)
@pytest.mark.parametrize(("low", "high"), [(-np.inf, -1e-3), (1e-3, np.inf), (2e-3, 2e-3)])
def test_a_zero_row_that_excludes_zero(stored, P, low, high):
    """However large the other rows are, beside which it was taken for rounding."""
    G = stored(np.array([[1e8, 2e8, 0.0], [0.0, 0.0, 0.0]]))
    with pytest.raises(Infeasible, match=r"G\[1\] is zero") as caught:
        solve_qp(stored(P), np.ones(3), G, [1e8, high], h_low=[-1e8, low], lb=-1.0, ub=1.0)
    z = caught.value.certificate
    assert z[0] == 0.0
    assert min(z[1] * r for r in (low, high) if np.isfinite(r)) > 0.0
    assert np.isfinite(low if z[1] > 0 else high)


@pytest.mark.parametrize("P", MATRICES.values(), ids=MATRICES)
def test_a_zero_equality_row(P):
    with pytest.raises(Infeasible, match=r"A\[0\] is zero") as caught:
        solve_qp(P, np.ones(3), A=[[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]], b=[-2.0, 1.0], lb=0.0)
    assert caught.value.certificate.tolist() == [-1.0, 0.0]


def test_zero_rows_that_say_nothing():
    G = np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    x = solve_qp(np.eye(2), [-1.0, -1.0], G, [1.0, 0.0, 1e-20], h_low=[-1.0, 0.0, -np.inf]).x
    assert x == pytest.approx([0.5, 0.5], abs=1e-12)


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("P", MATRICES.values(), ids=MATRICES)
@pytest.mark.parametrize("size", [1.0, 2.0**16])
def test_no_linear_term_and_zero_inside(stored, P, size):
    """What tends to zero is never small beside itself: a thousand steps led to no answer."""
    G = stored(np.array([[0.0, 2.0, 2.0], [2.0, 3.0, -3.0]]))
    result = solve_qp(
        stored(size * P), np.zeros(3), G, [1.0, np.inf], h_low=[-np.inf, -3.0],
        lb=[0.0, -np.inf, -np.inf], ub=[np.inf, 2.0, 0.0],
    )  # fmt: skip
    assert 0.5 * result.x @ (size * P) @ result.x <= 1e-20
    assert result.residuals(stored(size * P), np.zeros(3), G, [1.0, np.inf]).primal == 0.0


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("size", [1.0, 2.0**-16, 2.0**16])
@pytest.mark.parametrize("seed", range(6))
def test_least_variance_is_zero(stored, size, seed):
    """Fewer samples than assets: a portfolio without risk, whose multipliers are all zero."""
    rng = np.random.default_rng(seed)
    returns = rng.standard_normal((3, 8))
    P = size * returns.T @ returns
    A, b = np.ones((1, 8)), np.ones(1)
    result = solve_qp(stored((P + P.T) / 2), np.zeros(8), A=stored(A), b=b, lb=-5.0)
    assert abs(result.x.sum() - 1.0) < 1e-9
    assert result.x.min() >= -5.0
    assert np.abs(returns @ result.x).max() < 1e-5 * np.abs(returns).max()


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("seed", range(6))
def test_any_point_where_there_is_no_objective(stored, seed):
    rng = np.random.default_rng(seed)
    G, scale = rng.standard_normal((9, 5)), 2.0 ** rng.integers(-12, 13, 5)
    x = rng.standard_normal(5)
    h = G @ x + rng.integers(0, 2, 9)
    P, rows = stored(np.zeros((5, 5))), stored(G * scale)
    result = solve_qp(P, np.zeros(5), rows, h, lb=(x - 1.0) / scale)
    assert np.all(G @ (scale * result.x) <= h + 1e-8)
    assert np.all(scale * result.x >= x - 1.0 - 1e-8)


@pytest.mark.parametrize("P", MATRICES.values(), ids=MATRICES)
def test_a_linear_term_that_is_nearly_nothing(P):
    q = np.array([1e-30, 0.0, 0.0])
    if not P.any():
        with pytest.raises(Unbounded):
            solve_qp(P, q, lb=[-np.inf, 0.0, 0.0])
    else:
        assert np.abs(solve_qp(P, q, lb=-1.0, ub=1.0).x @ P).max() < 1e-9


@pytest.mark.parametrize("kind", [sparse.csr_matrix, sparse.csr_array])
def test_sparse_arguments_are_left_alone(kind):
    """Repeated entries and zeros among them."""
    arguments = [
        kind((np.array([1.0, 1.0, 0.0, 2.0, 3.0]), np.array(columns), np.array(ends)), (3, 3))
        for columns, ends in (([0, 0, 1, 1, 2], [0, 3, 4, 5]), ([1, 1, 0, 2, 0], [0, 3, 5, 5]))
    ]
    before = [[part.copy() for part in (M.data, M.indices, M.indptr)] for M in arguments]
    P, G = arguments
    result = solve_qp(P, [1.0, -1.0, 2.0], G, [1.0, 2.0, 3.0], lb=-5.0)
    assert result.kkt.worst < 1e-9
    for M, parts in zip(arguments, before, strict=True):
        for part, known in zip((M.data, M.indices, M.indptr), parts, strict=True):
            np.testing.assert_array_equal(part, known)


def singular(rng, n):
    L = rng.standard_normal((int(rng.integers(1, n)), n))
    P = L.T @ L
    return L, (P + P.T) / 2


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.integers(2, 7), st.sampled_from([9, 12, 16, 30, 100]))
def test_the_least_of_it_on_the_face_without_curvature(seed, n, decades):
    """From 1e-8 on no such problem was solved but by chance; the linear program is the limit."""
    rng = np.random.default_rng(seed)
    L, P = singular(rng, n)
    q = rng.standard_normal(n)
    want = linprog(q, A_eq=L, b_eq=np.zeros(len(L)), bounds=[(-1.0, 1.0)] * n).fun
    stored = STORED[("dense", "sparse")[seed % 2]]
    result = solve_qp(stored(P), 10.0**-decades * q, lb=-1.0, ub=1.0)
    # Multipliers of the size of q over the curvature, which is at least 1e-3 or so.
    assert q @ result.x == pytest.approx(want, abs=1e-6 + 10.0 ** (4 - decades))
    assert np.abs(L @ result.x).max() < 1e-6


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("size", [1e-9, 1e-12, 1e-30])
def test_a_portfolio_without_risk_of_the_best_return(size, stored):
    """The sum of the weights bounds them, not their upper bounds."""
    rng = np.random.default_rng(3)
    L = rng.standard_normal((2, 6))
    P, q = L.T @ L, -rng.uniform(1.0, 2.0, 6)
    rows = np.vstack([L, np.ones(6)])
    best = linprog(q, A_eq=rows, b_eq=[0.0, 0.0, 1.0], bounds=(0.0, None))
    assert best.success
    result = solve_qp(stored((P + P.T) / 2), size * q, A=stored(np.ones((1, 6))), b=[1.0], lb=0.0)
    assert q @ result.x == pytest.approx(best.fun, abs=1e-6)


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
@pytest.mark.parametrize("size", [1e-6, 1e-12])
def test_without_a_bound_there_is_no_least(size, stored):
    """Rounding excuses no variable that runs away."""
    v = np.array([1.0, -1.0, 2.0])
    with pytest.raises(Unbounded) as caught:
        solve_qp(stored(np.outer(v, v)), size * np.array([1.0, 0.0, 0.0]))
    assert abs(v @ caught.value.ray) < 1e-9


@settings(max_examples=12)
@given(st.integers(0, 10**6))
def test_rounding_of_the_data_changes_nothing(seed):
    """Some processors failed here after 225 steps: every number is moved by its last bit."""
    rng = np.random.default_rng(seed)
    v = np.array([1.0, -1.0, 2.0]) * (1.0 + 2e-16 * rng.integers(-1, 2, 3))
    result = solve_qp(np.outer(v, v), [1e-30, 0.0, 0.0], lb=-1.0 - 2e-16 * (seed % 2), ub=1.0)
    assert abs(v @ result.x) < 1e-9
    assert result.x[0] == pytest.approx(-1.0, abs=1e-6)
