"""Seeded matrices of every kind beside LAPACK: residuals, values, none of the wanted missed.

A returned value must be that of LAPACK within 1e-10 + 100 eps |A| / |y* x|, the condition of the
eigenvalue, and no other may rank above the worst returned one by more than that. Matrices are
brought to entries of order one before they are judged, so that squares neither over- nor underflow.
"""

import importlib

import numpy as np
import pytest
from scipy import linalg
from scipy.optimize import linear_sum_assignment

from gpu import eigs

EPS = np.finfo(float).eps
RANK = {
    "LM": np.abs,
    "SM": lambda z: -np.abs(z),
    "LR": np.real,
    "SR": lambda z: -np.real(z),
    "LI": np.imag,
    "SI": lambda z: -np.imag(z),
}


@pytest.fixture(autouse=True)
def iterate(monkeypatch):
    """Matrices from order 129 on go through the iteration, as larger ones do by default."""
    module = importlib.import_module("gpu.eigenvalues.eigs")
    monkeypatch.setattr(module, "LIMITS", module.LIMITS._replace(dense=128))


def similar(rng, D, condition):
    """X D X^-1 with X of the given condition number."""
    n = len(D)
    U = np.linalg.qr(rng.standard_normal((n, n)))[0]
    W = np.linalg.qr(rng.standard_normal((n, n)))[0]
    s = np.logspace(0, np.log10(condition), n)
    return U @ (s[:, None] * (W @ D @ W.T) / s) @ U.T


def jordan(rng, n, size):
    D = np.diag(rng.uniform(-1.0, 1.0, n))
    for place in range(0, min(3 * size, n - size + 1), size):
        block = slice(place, place + size)
        D[block, block] = (1.5 + 0.5 * place / size) * np.eye(size) + np.diag(np.ones(size - 1), 1)
    return D


def pairs(rng, n):
    D = np.diag(rng.uniform(-1.0, 1.0, n))
    for place in range(0, min(20, n - 1), 2):
        radius, angle = 2.0 - 0.04 * place, rng.uniform(0.2, 2.9)
        c, s = radius * np.cos(angle), radius * np.sin(angle)
        D[place : place + 2, place : place + 2] = [[c, s], [-s, c]]
    return D


def repeated(rng, n):
    """Diagonalisable; the outer values occur up to six times."""
    values = rng.uniform(-0.9, 0.9, n)
    place = 0
    for value in (2.0, -1.7, 1.4, 1.2):
        copies = int(rng.integers(1, 7))
        values[place : place + copies] = value
        place += copies
    return np.diag(values)


def clustered(rng, n):
    values = rng.uniform(-1.0, 1.0, n)
    values[:8] = (2.0 + 10.0 ** rng.uniform(-12.0, -3.0) * np.arange(8))[:n]
    return np.diag(values)


KINDS = {
    "gaussian": lambda rng, n: rng.standard_normal((n, n)),
    "uniform": lambda rng, n: rng.random((n, n)),
    "complex": lambda rng, n: rng.standard_normal((n, n)) + 1j * rng.standard_normal((n, n)),
    "symmetric": lambda rng, n: (lambda B: B + B.T)(rng.standard_normal((n, n))),
    "skew": lambda rng, n: (lambda B: B - B.T)(rng.standard_normal((n, n))),
    "orthogonal": lambda rng, n: np.linalg.qr(rng.standard_normal((n, n)))[0],
    "projector": lambda rng, n: (lambda U: U[:, : n // 3] @ U[:, : n // 3].T)(
        np.linalg.qr(rng.standard_normal((n, n)))[0]
    ),
    "low rank": lambda rng, n: rng.standard_normal((n, 4)) @ rng.standard_normal((4, n)),
    "diagonal": lambda rng, n: np.diag(rng.standard_normal(n)),
    "identity": lambda rng, n: rng.standard_normal() * np.eye(n),
    "zero": lambda rng, n: np.zeros((n, n)),
    "one entry": lambda rng, n: np.diag(np.r_[1.0, np.zeros(n - 1)]),
    "tiny": lambda rng, n: 1e-200 * rng.standard_normal((n, n)),
    "huge": lambda rng, n: 1e200 * rng.standard_normal((n, n)),
    "nilpotent": lambda rng, n: np.diag(np.ones(n - 1), 1),
    "cyclic": lambda rng, n: np.roll(np.eye(n), 1, axis=0),
    "jordan": lambda rng, n: similar(rng, jordan(rng, n, int(rng.integers(2, 4))), 3.0),
    "jordan bare": lambda rng, n: jordan(rng, n, int(rng.integers(2, 4))),
    "pairs": lambda rng, n: similar(rng, pairs(rng, n), 10.0),
    "repeated": lambda rng, n: similar(rng, repeated(rng, n), 10.0 ** rng.uniform(0, 3)),
    "repeated diagonal": lambda rng, n: (lambda p: repeated(rng, n)[np.ix_(p, p)])(
        rng.permutation(n)
    ),
    "clustered": lambda rng, n: similar(rng, clustered(rng, n), 10.0),
    "non-normal": lambda rng, n: similar(rng, np.diag(rng.standard_normal(n)), 1e5),
    "triangular": lambda rng, n: (
        np.triu(rng.standard_normal((n, n)) / np.sqrt(n), 1) + np.diag(rng.standard_normal(n))
    ),
    "two copies": lambda rng, n: np.kron(
        rng.standard_normal(((n + 1) // 2, (n + 1) // 2)), np.eye(2)
    )[:n, :n],
    "two blocks": lambda rng, n: linalg.block_diag(
        *[rng.standard_normal((n // 2, n // 2))] * 2, np.zeros((n - n // 2 * 2, n - n // 2 * 2))
    ),
    "outliers": lambda rng, n: (
        0.05 * rng.standard_normal((n, n)) / np.sqrt(n)
        + np.diag(np.r_[np.linspace(1.1, 2.0, min(n, 20)), np.zeros(max(n - 20, 0))])
    ),
}


def case(seed, n_max=180):
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    n = (
        int(rng.integers(1, 11))
        if rng.random() < 0.15
        else int(rng.integers(11 if rng.random() < 0.2 else 129, n_max))
    )
    k = int(rng.integers(1, min(n, 13))) if n > 1 else 1
    which = str(rng.choice(list(RANK)))
    return kind, KINDS[kind](rng, n), k, which


def problems(A, k, which, w, v):
    """What is wrong with an answer, in words."""
    real = np.isrealobj(A)
    found = []
    if v.shape != (len(A), len(w)) or not k <= len(w) <= k + 1:
        found.append(f"shape {w.shape}, {v.shape}")
    if len(w) and not np.allclose(np.linalg.norm(v, axis=0), 1.0, rtol=1e-12):
        found.append("not unit vectors")
    unit = np.abs(A).max() or 1.0
    A, w = A / unit, w / unit
    residual = np.linalg.norm(A @ v - v * w, axis=0).max(initial=0.0)
    size = np.linalg.norm(A, 2)
    if residual > 1e-10 * size:
        found.append(f"residual {residual / size:.1e}")
    true, left, right = linalg.eig(A, left=True)
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    # Of a cluster only as far as its width: rounding has parted the copies.
    bound = size * (1e-10 + 100 * EPS / np.maximum(overlap, EPS))
    rank = RANK[which]
    if real and which[1] == "I":
        rank = (lambda z: np.abs(z.imag)) if which[0] == "L" else (lambda z: -np.abs(z.imag))
    cost = np.abs(w[:, None] - true[None]) / np.where(bound > 0, bound, 1.0)
    row, column = linear_sum_assignment(np.minimum(cost, 1e6))
    off = cost[row, column]
    if off.max(initial=0.0) > 1.0:
        found.append(f"value off by {off.max():.1e} of its bound")
    rest = np.setdiff1d(np.arange(len(true)), column)
    if rest.size:
        worst = rank(w).min()
        better = rank(true[rest]) - bound[rest] > worst + bound[column[np.argmin(rank(w))]]
        if better.any():
            found.append(
                f"{better.sum()} missed, by {(rank(true[rest]).max() - worst) / (size or 1):.1e}"
            )
    return found


def check(seed, cupy=None):
    kind, A, k, which = case(seed)
    w, v = eigs(cupy.asarray(A) if cupy else A, k, which=which)
    if cupy:
        w, v = w.get(), v.get()
    assert problems(A, k, which, w, v) == [], f"seed {seed}: {kind}, n = {len(A)}, {k} {which}"


@pytest.mark.filterwarnings("ignore:A is far from normal")  # the bounds know the conditions
@pytest.mark.parametrize(
    "seed",
    [*range(len(KINDS)), *(pytest.param(s, marks=pytest.mark.slow) for s in range(1000, 1500))],
)
def test_every_kind(seed):
    check(seed)


@pytest.mark.gpu
@pytest.mark.parametrize("seed", range(3 * len(KINDS)))
def test_every_kind_on_a_device(seed):
    import cupy

    check(seed, cupy)


@pytest.mark.parametrize("size", [2, 3])
def test_defective_clusters_by_their_mean(size):
    """The copies of a Jordan block part by rounding to the power 1 / size, their mean does not."""
    rng = np.random.default_rng(size)
    n, values = 150, [2.0, 1.7, -1.6]
    D = np.diag(rng.uniform(-1.0, 1.0, n))
    for place, value in enumerate(values):
        block = slice(size * place, size * (place + 1))
        D[block, block] = value * np.eye(size) + 0.5 * np.diag(np.ones(size - 1), 1)
    A = similar(rng, D, 3.0)
    w, v = eigs(A, 3 * size, which="LM")
    assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-10 * np.linalg.norm(A, 2)
    for value in values:
        copies = w[np.abs(w - value) < 0.04]
        assert len(copies) == size
        assert abs(copies.mean() - value) < 1e-8


@pytest.mark.parametrize("copies", [2, 5, 9])
def test_all_copies_of_a_repeated_eigenvalue(copies):
    """A Krylov space of one vector holds one vector of each eigenspace."""
    rng = np.random.default_rng(copies)
    D = np.diag(np.r_[np.full(copies, 2.0), rng.uniform(-1.5, 1.5, 200 - copies)])
    w, v = eigs(similar(rng, D, 5.0), copies)
    assert np.abs(w - 2.0).max() < 1e-10
    assert np.linalg.svd(v, compute_uv=False)[-1] > 1e-3


def test_singular_matrix_nearest_to_zero():
    """Rounding in the image of a zero eigenvalue must not make all others look equal."""
    A = np.diag(np.r_[0.0, np.arange(1.0, 200.0)])
    w = eigs(A, 5, which="SM", return_eigenvectors=False)
    assert np.sort(np.abs(w)) == pytest.approx([0, 1, 2, 3, 4], abs=1e-9)
