"""The compiled Schur form: backward error, standard blocks, eigenvalues beside LAPACK's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from gpu.eigenvalues.schur import real_schur as module
from gpu.eigenvalues.schur import schur_kernels
from gpu.eigenvalues.schur.ordered_schur import eigenvalues_of, ordered_schur
from gpu.eigenvalues.schur.real_schur import real_schur

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


def check(S, power=0):
    """Of the matrix with largest entry one, times a power of ten."""
    m, S = len(S), S / np.abs(S).max()
    T, Q = real_schur(S * 10.0**power)
    T /= 10.0**power
    assert np.abs(Q.T @ Q - np.eye(m)).max() <= 20 * m * EPS
    assert np.abs(Q @ T @ Q.T - S).max() <= 20 * m * EPS
    assert not np.tril(T, -2).any()
    pairs = T.diagonal(-1).nonzero()[0]
    assert (np.diff(pairs) > 1).all()
    for k in pairs:  # as LAPACK's trexc expects them
        assert T[k, k] == T[k + 1, k + 1]
        assert np.sign(T[k, k + 1]) == -np.sign(T[k + 1, k])
    return T


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(sorted(KINDS)),
    st.integers(2, 70),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, -280, 280]),
)
def test_backward_error_and_form(kind, m, seed, power):
    S = KINDS[kind](np.random.default_rng(seed), m)
    if S.any():
        check(S, power)


def test_entries_that_underflow_beside_others():
    """Of 600 decades, subnormal ones among them; a few are left to LAPACK."""
    rng, left = np.random.default_rng(5), 0
    for m in rng.integers(2, 60, 400):
        S = rng.choice([-1.0, 0.0, 1.0], (m, m)) * 10.0 ** rng.uniform(-320, 0, (m, m))
        if rng.random() < 0.5:
            S = np.triu(S, -1) - np.triu(S, -1).T
        if S.any() and real_schur(S / np.abs(S).max()) is None:
            left += 1
        elif S.any():
            check(S)
    assert left < 20


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e300, np.inf, np.nan])
def test_left_to_lapack(size):
    assert real_schur(np.full((15, 15), size)) is None


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
    T = check(S)
    theirs = eigenvalues_of(linalg.schur(S / np.abs(S).max())[0])
    ours = eigenvalues_of(T)
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
    values = eigenvalues_of(check(np.array([[1.0, 10.0**power], [10.0 ** (-power - 7), 1.0]])))
    assert values.imag.tolist() == [0.0, 0.0]
    assert np.sort(values.real) * 10.0**power == pytest.approx([1 - 10**-3.5, 1 + 10**-3.5], 1e-12)


@pytest.mark.parametrize("kind", ["gaussian", "arrow", "orthogonal", "graded", "companion"])
@pytest.mark.parametrize("m", [13, 40, 60])
def test_ordered_as_by_lapack(kind, m):
    S = KINDS[kind](np.random.default_rng(2), m)
    T, Q, values = ordered_schur(S, np.abs, m, True)
    assert np.abs(Q @ T @ Q.T - S).max() <= 100 * m * EPS * np.abs(S).max()
    assert (np.diff(np.abs(values)) <= 100 * m * EPS * np.abs(S).max()).all()
    theirs = ordered_schur(S, np.abs, m)[2]
    if kind != "graded":
        assert np.abs(values) == pytest.approx(np.abs(theirs), rel=1e-10, abs=1e-12)


def test_lapack_takes_over_where_the_iteration_fails(monkeypatch):
    monkeypatch.setattr(module, "_compiled", lambda: lambda W: False)
    S = np.random.default_rng(3).standard_normal((20, 20))
    for ours, theirs in zip(
        ordered_schur(S, np.abs, 5, True), ordered_schur(S, np.abs, 5), strict=True
    ):
        assert np.array_equal(ours, theirs)


def test_gives_up_after_so_many_sweeps(monkeypatch):
    """The plain functions are those that are compiled."""
    plain = {
        kernel.__name__: getattr(kernel, "py_func", kernel) for kernel in schur_kernels.KERNELS
    }
    for name, kernel in plain.items():
        monkeypatch.setattr(schur_kernels, name, kernel)
    W = np.zeros((7, 13))
    W[:6, :6] = linalg.hessenberg(np.random.default_rng(4).standard_normal((6, 6)))
    W[:6, 7:] = np.eye(6)
    same = W.copy()
    assert plain["iterate"](W)
    assert not np.tril(W[:6, :6], -2).any()
    monkeypatch.setattr(schur_kernels, "SWEEPS", 0)
    assert not plain["iterate"](same)
