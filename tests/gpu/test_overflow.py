"""What overflows is never certified: a residual that is not a number is no small one."""

import itertools
import warnings
from decimal import Decimal

import numpy as np
import pytest
from scipy import sparse

from gpu import GpuError, NotConverged, QPFactor, RiccatiError, care, eigs, lqe, lqr, solve_qp, svds
from gpu.eigenvalues.eigs import certify
from gpu.eigenvalues.operator import as_matrix
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.data.qp_result import kkt_residuals
from gpu.qp.data.standard_qp import residuals
from gpu.riccati.problem.lqr_problem import check_lqr
from gpu.riccati.proof.refinement import riccati_residual

SLOW = pytest.mark.slow
STORED = {"dense": np.asarray, "sparse": sparse.csr_array}
SHAPE = np.array([[2.0, 1.0], [1.0, 2.0]])
ROWS = {
    "none": {},
    "bounds": {"lb": 0.0},
    "equality": {"A": [[1.0, 1.0]], "b": [1.0]},
    "row": {"G": [[1.0, 1.0]], "h": [1.0]},
}
# Of the matrix and of the linear term.
SIZES = [
    (1e-300, 1e300),
    (5e307, 5e307),
    *(pytest.param(*pair, marks=SLOW) for pair in ((5e-324, 1.0), (1e-200, 1.0), (1e150, 1e-200))),
]


@pytest.mark.parametrize("stored", [np.asarray, pytest.param(sparse.csr_array, marks=SLOW)])
@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.parametrize(("size", "linear"), SIZES)
def test_no_size_gives_a_wrong_answer_or_a_raw_error(size, linear, rows, stored):
    """x = -inf came back as OPTIMAL with residual 0."""
    with np.errstate(all="ignore"):
        P, q, ratio = size * SHAPE, linear * np.array([1.0, -0.5]), np.divide(linear, size)
    rows_of = {k: stored(np.array(v)) if k in "AG" else v for k, v in ROWS[rows].items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            x = solve_qp(stored(P), q, **rows_of).x
        except GpuError:
            return
    assert np.isfinite(x).all()
    if rows in ("none", "bounds"):
        # Optimal for the ratio of the two, in numbers of the size of one.
        want = np.array([-5.0, 4.0]) / 6.0 if rows == "none" else np.array([0.0, 0.25])
        np.testing.assert_allclose(x / ratio, want, rtol=1e-7)


def test_usual_problems_of_unusual_size_are_solved():
    for size in (1e-300, 1e-150, 1e150, 1e300):
        for rows in ROWS.values():
            np.testing.assert_allclose(
                solve_qp(size * SHAPE, size * np.array([1.0, -0.5]), **rows).x,
                solve_qp(SHAPE, [1.0, -0.5], **rows).x,
                rtol=1e-12,
            )
    asymmetric = 1.5e308 * np.array([[1.0, 0.5], [0.5 * (1 + 1e-15), 1.0]])
    assert np.isfinite(QPFactor(asymmetric).P).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["x", "y", "z", "z_box"])
@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
def test_residuals_of_no_numbers_are_infinite(place, wrong, stored):
    rows = stored(np.array([[1.0, 1.0]]))
    box = (stored(SHAPE), [1.0, -0.5], None, None, rows, [1.0], [-1.0, -np.inf], 1.0, None)
    general = (*box[:2], rows, [5.0], *box[4:])
    for arguments, boxes in ((box, True), (general, False)):
        problem = check_problem(*arguments)
        for i in range(2):
            parts = {"x": np.ones(2), "y": np.ones(1), "z": np.ones(1), "z_box": np.ones(2)}
            if i >= parts[place].size or (place == "z" and boxes):
                continue
            parts[place][i] = wrong
            x, y, z, z_box = parts.values()
            if boxes and isinstance(problem.factor.P, np.ndarray):
                assert kkt_residuals(problem, x, y, z_box).worst == np.inf
            both = y if boxes else np.concatenate([y, z])
            assert residuals(problem.program, x, both, z_box).worst == np.inf


def test_sums_that_overflow_excuse_no_error():
    """Beside an infinite sum of moduli every residual was zero."""
    P, x = 1e308 * np.array([[1.5, -1.4], [-1.4, 1.5]]), np.array([1.0, 1.0])
    problem = check_problem(P, [1e300, 0.0], None, None, None, None, None, None, None)
    nothing = np.zeros(0)
    assert not kkt_residuals(problem, x, nothing, np.zeros(2)).worst < 1e-9
    assert not residuals(problem.program, x, nothing, np.zeros(2)).worst < 1e-9


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_eigenvalues_that_are_no_numbers_fail_their_certificate(value):
    matrix = as_matrix("A", np.eye(3))
    with pytest.raises(NotConverged, match="certificate"), np.errstate(all="ignore"):
        certify(matrix, None, np.array([1.0, value + 0j]), np.eye(3)[:, :2], 0.0, 0.0)


@pytest.mark.parametrize("find", [eigs, svds])
@pytest.mark.parametrize("size", [1e-312, 1e-200, 1e200, 1e305])
def test_eigenvalues_of_unusual_size(find, size):
    A = np.diag(np.arange(1.0, 301.0))
    options = {"return_eigenvectors" if find is eigs else "return_singular_vectors": False}
    found = find(size * A, 2, **options)
    assert sorted(found.real / size) == pytest.approx([299.0, 300.0], rel=1e-9)


def test_a_riccati_residual_that_overflows_is_not_small():
    problem = check_lqr(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.eye(2), 1.0)
    with np.errstate(all="ignore"):
        for S in (np.full((2, 2), np.nan), 1e200 * np.eye(2), 1e308 * np.eye(2)):
            assert riccati_residual(problem, S).relative > 1e-3


REGULATORS = [1e-300, 1e-150, 1.0, 1e70, 1e154, 1e300]


def solution(a, b, q, r):
    """S and K of one state, in decimals."""
    a, b, q, r = map(Decimal, (a, b, q, r))
    effect = b**2 / r
    root = (a**2 + effect * q).sqrt()
    S = (a + root) / effect if a > 0 else q / (root - a)
    return S, S * b / r


@pytest.mark.parametrize("a", [1e-150, 1.0, 1e154, 1e300])
def test_every_size_of_one_unstable_state(a):
    """Solved, unless a number of the solution is out of range."""
    for b, q, r in itertools.product(REGULATORS, repeat=3):
        S, K = solution(a, b, q, r)
        pole = Decimal(a) - Decimal(b) * K
        if not all(Decimal("1e-290") < abs(value) < Decimal("1e307") for value in (S, K, pole)):
            continue
        if Decimal(b) ** 2 / Decimal(r) * Decimal(q) < Decimal(a) ** 2 * Decimal("1e-280"):
            continue  # beside the term of A the others are among the least numbers
        for result in (lqr([[a]], [[b]], [[q]], [[r]]), lqe([[a]], [[1.0]], [[b]], q, r)):
            assert result.K[0, 0] == pytest.approx(float(K), rel=1e-12, abs=0.0)
            assert result.S[0, 0] == pytest.approx(float(S), rel=1e-12, abs=0.0)
            assert result.E[0].real == pytest.approx(float(pole), rel=1e-12, abs=0.0)
        cost = care([[a]], [[b]], [[q]], [[r]])
        assert cost[0, 0] == pytest.approx(float(S), rel=1e-12, abs=0.0)


def test_sizes_of_one_stable_state_lose_no_digit_unsaid():
    """The gain and the cost are right, or refused: none is zero by rounding."""
    for a, b, q, r in itertools.product([1.0, 1e154, 1e300], *3 * [REGULATORS]):
        S, K = solution(-a, b, q, r)
        if min(S, K) < Decimal("1e-300"):
            continue
        try:
            result = lqr([[-a]], [[b]], [[q]], [[r]])
        except NotConverged:
            continue
        assert result.S[0, 0] == pytest.approx(float(S), rel=1e-12, abs=0.0)
        assert result.K[0, 0] == pytest.approx(float(K), rel=1e-12, abs=0.0)


@pytest.mark.parametrize("seed", range(12))
def test_units_of_regulators_change_nothing(seed):
    """Units of time, mass, inputs and costs beyond the squares of double precision."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    A, B, C = (rng.standard_normal(shape) for shape in ((n, n), (n, m), (n, n)))
    N = 0.1 * rng.standard_normal((n, m)) if seed % 2 else np.zeros((n, m))
    Q, E = C.T @ C + N @ N.T + np.eye(n), 2.0 * np.eye(n) + 0.2 * rng.standard_normal((n, n))
    usual = lqr(A, B, Q, np.eye(m), N, E)
    a, e, b = (int(v) for v in rng.integers(-300, 301, 3))
    q = 2 * int(rng.integers(-150, 151))
    scaled = lqr(
        np.ldexp(A, a), np.ldexp(B, b), np.ldexp(Q, q), np.ldexp(np.eye(m), q + 2 * b - 2 * a),
        np.ldexp(N, q + b - a), np.ldexp(E, e),
    )  # fmt: skip
    for found in (scaled, scaled.refined()):
        gain, value = np.ldexp(found.K, b - a), np.ldexp(found.S, a + e - q)
        np.testing.assert_allclose(gain, usual.K, rtol=1e-9, atol=1e-10 * abs(usual.K).max())
        np.testing.assert_allclose(value, usual.S, rtol=1e-9, atol=1e-10 * abs(usual.S).max())
        assert isinstance(found.abscissa, float)
        assert np.ldexp(found.abscissa, e - a) == pytest.approx(usual.abscissa, rel=1e-8)
        assert found.residual <= 1e-9


@pytest.mark.parametrize("size", [1.0, 1e160, 1e300])
def test_modes_are_named_in_the_units_of_the_arguments(size):
    with pytest.raises(RiccatiError, match="not stabilisable") as caught:
        lqr(size * np.diag([1.0, 2.0]), [[1.0], [0.0]], np.eye(2), 1.0)
    assert caught.value.eigenvalue == pytest.approx(2.0 * size)
    assert f"{2.0 * size:.6g}" in str(caught.value)


@pytest.mark.parametrize("size", [1e-300, 1e-150, 1e-100, 1e100, 1e150, 1e300])
@pytest.mark.parametrize("which", ["A", "B", "Q", "R"])
def test_regulators_of_unusual_size(which, size):
    """Stabilised, or a typed error."""
    parts = {"A": np.diag([1.0, -2.0]), "B": np.ones((2, 1)), "Q": np.eye(2), "R": np.eye(1)}
    parts[which] = size * parts[which]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = lqr(*parts.values())
        except GpuError:
            return
    assert np.isfinite(result.K).all()
    assert np.isfinite(result.S).all()
    assert np.linalg.eigvals(parts["A"] - parts["B"] @ result.K).real.max() < 0.0
