"""The ordered Schur form: backward error, standard blocks, order; eigenvalues beside LAPACK's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from gpu.eigenvalues.schur import ordered_schur

EPS = np.finfo(float).eps


def companion(rng, m):
    S = np.diag(np.ones(m - 1), -1)
    S[0] = rng.standard_normal(m)
    return S


def arrow(rng, m):
    """What a restart leaves and Arnoldi steps fill up."""
    kept = m // 2
    S = np.triu(rng.standard_normal((m, m)), -1)
    S[:kept, :kept] = linalg.schur(rng.standard_normal((kept, kept)))[0]
    if kept < m:
        S[kept, :kept] = rng.standard_normal(kept) * 10.0 ** rng.uniform(-16, 0, kept)
    return S


KINDS = {
    "gaussian": lambda rng, m: rng.standard_normal((m, m)),
    "arrow": arrow,
    "symmetric": lambda rng, m: (lambda B: B + B.T)(rng.standard_normal((m, m))),
    "skew": lambda rng, m: (lambda B: B - B.T)(rng.standard_normal((m, m))),
    "orthogonal": lambda rng, m: np.linalg.qr(rng.standard_normal((m, m)))[0],
    "cyclic": lambda rng, m: np.roll(np.eye(m), 1, axis=0),
    "companion": companion,
    "integer": lambda rng, m: rng.integers(-1, 2, (m, m)).astype(float),
    "low rank": lambda rng, m: np.outer(rng.standard_normal(m), rng.standard_normal(m)),
    "ties": lambda rng, m: np.triu(rng.integers(-1, 2, (m, m)), -1).astype(float),
    "identity": lambda rng, m: np.eye(m),
    "triangular": lambda rng, m: np.triu(rng.standard_normal((m, m))),
    "below": lambda rng, m: np.tril(rng.standard_normal((m, m))),
    "jordan": lambda rng, m: 2.0 * np.eye(m) + np.diag(np.ones(m - 1), 1),
    "jordan below": lambda rng, m: 2.0 * np.eye(m) + np.diag(np.ones(m - 1), -1),
    "graded": lambda rng, m: rng.standard_normal((m, m)) * np.logspace(0, -30, m)[:, None],
    "graded up": lambda rng, m: rng.standard_normal((m, m)) * np.logspace(-30, 0, m),
    "pairs": lambda rng, m: linalg.block_diag(
        *[[[1.0, 10.0**p], [-(10.0**-p), 1.0]] for p in rng.uniform(-8, 8, (m + 1) // 2)]
    )[:m, :m],
}


RANKS = {
    "modulus": np.abs,
    "inverse modulus": lambda values: -np.abs(values),
    "real part": lambda values: values.real,
    "imaginary part": lambda values: np.abs(values.imag),
}


def check(S, rank=np.abs, power=0):
    """Of the matrix with largest entry one, times a power of ten; values as they were ordered."""
    m, S = len(S), S / np.abs(S).max()
    T, Q, values = ordered_schur(S * 10.0**power, rank, m)
    T, values = T / 10.0**power, values / 10.0**power
    assert np.abs(Q.conj().T @ Q - np.eye(m)).max() <= 100 * m * EPS
    assert np.abs(Q @ T @ Q.conj().T - S).max() <= 100 * m * EPS
    if S.dtype.kind == "c":
        assert not np.tril(T, -1).any()
        return values
    assert not np.tril(T, -2).any()
    pairs = T.diagonal(-1).nonzero()[0]
    assert (np.diff(pairs) > 1).all()
    for k in pairs:  # LAPACK's standard blocks, which `eigenvalues_of` reads
        assert T[k, k] == T[k + 1, k + 1]
        assert np.sign(T[k, k + 1]) == -np.sign(T[k + 1, k])
        assert values[k] == values[k + 1].conj()
        assert values[k].imag > 0.0
    return values


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(sorted(KINDS)),
    st.sampled_from(sorted(RANKS)),
    st.integers(2, 70),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, -280, 280]),
    st.booleans(),
)
def test_backward_error_and_form(kind, rank, m, seed, power, is_complex):
    rng = np.random.default_rng(seed)
    S = KINDS[kind](rng, m)
    if is_complex:
        S = S + 1j * KINDS[kind](rng, m)
    if S.any():
        check(S, RANKS[rank], power)


@pytest.mark.parametrize("rank", sorted(RANKS))
@pytest.mark.parametrize("kind", ["gaussian", "arrow", "orthogonal", "companion", "symmetric"])
@pytest.mark.parametrize("m", [2, 13, 40, 60])
def test_in_order_and_as_by_lapack(kind, m, rank):
    S = KINDS[kind](np.random.default_rng(2), m)
    S /= np.abs(S).max()
    values, rank = check(S, RANKS[rank]), RANKS[rank]
    assert (np.diff(rank(values)) <= 100 * m * EPS).all()
    theirs = np.sort(rank(linalg.eigvals(S)))[::-1]
    assert rank(values) == pytest.approx(theirs, rel=1e-10, abs=1e-12)
    if m == 40 and kind == "gaussian":  # only the leading rows are put in order
        T, Q, few = ordered_schur(S, rank, 5)
        assert rank(few[:5]) == pytest.approx(theirs[:5], rel=1e-10)
        assert (np.diff(rank(few[6:])) > 1e-3).any()
        assert np.abs(Q @ T @ Q.T - S).max() <= 100 * m * EPS


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.just(0.0) | st.floats(1.0, 10.0) | st.floats(-10.0, -1.0), min_size=4, max_size=4),
    st.lists(st.integers(-30, 30), min_size=4, max_size=4),
)
def test_blocks_of_two(mantissas, powers):
    """Of entries of any relative size, eigenvalues as LAPACK gives them."""
    S = np.array(mantissas).reshape(2, 2) * 10.0 ** np.array(powers).reshape(2, 2)
    if not S.any():
        return
    ours, theirs = check(S), linalg.eigvals(S / np.abs(S).max())
    assert np.abs(np.sort_complex(ours) - np.sort_complex(theirs)).max() <= np.sqrt(100 * EPS)
    assert ours.sum() == pytest.approx(theirs.sum(), abs=10 * EPS)
    assert ours.prod() == pytest.approx(theirs.prod(), abs=10 * EPS)


BLOCKS = [
    *([-1, -1, 1, 0], [0, -2, 2, -0.2], [1, 1, -1, 1], [1, 1, 1, 1], [0, 1, 0, 1], [0, 1, 1, 0]),
    *([0, -1, 1, -3.8e-314], [5e-324, 1, -1, 0], [1e-323, 1, -1, 0], [0, -1, 1e-320, 0]),
    *([1, 1e-310, -1, 1], [2e-300, 1e-310, 1, 0], [2e-300, -1e-310, 1, 0], [0, 1e-225, 1, 1e-300]),
]


@pytest.mark.parametrize("entries", BLOCKS)
def test_blocks_with_ties_and_subnormal_entries(entries):
    block = np.array(entries, dtype=float).reshape(2, 2)
    for S in (block, block.T, -block, linalg.block_diag(block, block, block)):
        check(S)


@pytest.mark.parametrize("power", [0, 5, 10, 15])
def test_small_entries_stay_beside_large_ones(power):
    """What is small beside the diagonal need not be round-off: 1 +- 10^-3.5 are the values."""
    values = check(np.array([[1.0, 10.0**power], [10.0 ** (-power - 7), 1.0]]))
    assert values.imag.tolist() == [0.0, 0.0]
    assert np.sort(values.real) * 10.0**power == pytest.approx([1 - 10**-3.5, 1 + 10**-3.5], 1e-12)
