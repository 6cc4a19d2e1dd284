"""Where P is singular the linear term decides, however small it is beside P."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.optimize import linprog

from gpu import Unbounded, solve_qp
from gpu.qp.data.standard_qp import StandardQP

STORED = {"dense": np.asarray, "sparse": sparse.csr_array}


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


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
def test_what_bounds_and_rows_keep_from_running_away(stored):
    free, inf = np.zeros(4), np.inf
    C = np.array([[1.0, 2.0, 0.0, 0.0], [0.0, -1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    program = StandardQP(
        stored(np.eye(4)), free, stored(C), np.array([-inf, -inf, 3.0]),
        np.array([1.0, -inf, 3.0]), np.array([0.0, 0.0, -5.0, -inf]),
        np.array([inf, inf, 5.0, inf]),
    )  # fmt: skip
    # x0 + 2 x1 <= 1 with both positive; the third by its bounds; the fourth by the last row.
    assert program.bounded.tolist() == [True, True, True, True]
    other = StandardQP(
        stored(np.eye(4)), free, stored(C), np.array([-inf, -inf, -inf]),
        np.array([1.0, 0.0, 3.0]), np.array([0.0, -inf, 0.0, 0.0]), np.array([inf, inf, inf, inf]),
    )  # fmt: skip
    # x2 <= x1 <= (1 - x0) / 2: one look does not see that this holds x0 too.
    assert other.bounded.tolist() == [False, True, True, True]
