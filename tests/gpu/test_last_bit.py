"""Nothing hangs on the last bit: with every number moved by it, each problem ends as before.

Another processor sums in another order, which is the same to a solver as data of another last bit.
"""

import carex_problems as carex
import convex_problems as convex
import numpy as np
import pytest
from scipy import sparse

from gpu import GpuError, care, eigs, lqr, solve_qp

SLOW = pytest.mark.slow
LAST_BIT = 2.2e-16


def moved(rng, M, symmetric=False):
    """By one unit of the last place up, down, or not at all; zeros stay."""
    by = rng.integers(-1, 2, np.shape(M))
    if symmetric:
        by = np.triu(by) + np.triu(by, 1).T
    return np.asarray(M) * (1.0 + LAST_BIT * by)


def ends(solve):
    try:
        solve()
    except GpuError as error:
        return type(error).__name__
    return "solved"


def same_ends(tasks):
    found = [ends(task) for task in tasks]
    assert len(set(found)) == 1, found
    assert found[0] != "NotConverged"


def programs(p, rng=None):
    def data(M, symmetric=False):
        return M if rng is None else moved(rng, M, symmetric)

    rows = {"lb": p.lb, "ub": p.ub}
    if len(p.b):
        rows |= {"A": data(p.A), "b": data(p.b)}
    if len(getattr(p, "h", ())):
        rows |= {"G": data(p.G), "h": p.h, "h_low": p.h_low}
    P, q = data(p.P, True), data(p.q)
    return lambda: solve_qp(P, q, **rows)


SEEDS = [*range(6), *(pytest.param(seed, marks=SLOW) for seed in range(6, 120))]


@pytest.mark.parametrize("seed", SEEDS)
def test_quadratic_programs(qps, seed):
    for p in (qps.random(seed, 25), convex.convex_problem(seed, 25)):
        same_ends([programs(p), *(programs(p, np.random.default_rng(k)) for k in (1, 2))])


RICCATI = carex.BENIGN | carex.HARD | carex.UNKNOWN | {"1.4": carex.example_1_4()}


@pytest.mark.parametrize("name", RICCATI)
def test_riccati_equations(name):
    A, B, Q, R, _ = RICCATI[name]
    tasks = [lambda: care(A, B, Q, R)]
    for k in range(4):
        rng = np.random.default_rng(k)
        data = moved(rng, A), moved(rng, B), moved(rng, Q, True), moved(rng, R, True)
        tasks.append(lambda data=data: care(*data))
    same_ends(tasks)


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_array], ids=["dense", "sparse"])
@pytest.mark.parametrize("rank", ["full", "one"])
def test_regulators_of_a_beam_and_of_a_weak_input(rank, stored):
    n = 12
    K = (n + 1) ** 2 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    beam = np.block([[np.zeros((n, n)), np.eye(n)], [-K @ K / 100, -0.1 * np.eye(n)]])
    for A, B in (
        (beam, np.r_[np.zeros(2 * n - 1), 1.0][:, None]),
        (np.diag(np.r_[1.0, -np.arange(1.0, n)]), np.r_[1e-8, np.ones(n - 1)][:, None]),
    ):
        Q = 1.0 if rank == "full" else np.ones((1, len(A)))
        tasks = []
        for k in range(4):
            rng = np.random.default_rng(k)
            data = stored(moved(rng, A)), moved(rng, B)
            tasks.append(lambda data=data, Q=Q: lqr(*data, Q, 1.0, factored=rank == "one"))
        same_ends(tasks)


@pytest.mark.parametrize(
    ("kind", "which"),
    [
        ("random", "LM"),
        ("repeated", "SR"),
        *(pytest.param(*case, marks=SLOW) for case in (("random", "LI"), ("symmetric", "LR"))),
    ],
)
def test_eigenvalues(kind, which):
    rng = np.random.default_rng(0)
    A = rng.standard_normal((300, 300))
    if kind == "symmetric":
        A = A + A.T
    elif kind == "repeated":
        Q = np.linalg.qr(A)[0]
        A = (Q * np.repeat(np.arange(1.0, 101.0), 3)) @ Q.T
    data = [moved(np.random.default_rng(k), A) for k in range(3)]
    values = [eigs(M, 5, which=which, return_eigenvectors=False) for M in data]
    values = [np.sort_complex(found) for found in values]
    np.testing.assert_allclose(values[1:], [values[0]] * 2, rtol=0, atol=1e-9)
