"""The search for missed eigenvalues: its bound, its curves, copies that it must find."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import LinearOperator

from gpu import NotConverged, eigs
from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.krylov.krylov_schur import unbeaten
from gpu.eigenvalues.schur import ORDERS, edge_of, rank_of


def compressed(values, locked, condition, seed):
    """A matrix of these eigenvalues, and a basis whose first rows span those of `locked` places."""
    rng = np.random.default_rng(seed)
    n = len(values)
    X = np.linalg.qr(rng.standard_normal((n, n)))[0] * np.geomspace(1.0, condition, n)
    X = X @ np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = X * values @ np.linalg.inv(X)
    basis = Arnoldi(lambda x: A @ x, n, 40, np.dtype(float), np, seed=seed)
    basis.V[: len(locked)] = np.linalg.qr(X[:, locked])[0].T
    return A, basis


def search(basis, locked, worst, which="LM", **options):
    numbers = {"tol": 1e-10, "floor": 1e-12, "restarts": 200, "patience": 10**6} | options
    return unbeaten(basis, locked, worst, rank_of(which, True), edge_of(which, True), **numbers)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.floats(0.0, 3.0), st.booleans(), st.integers(0, 2**32 - 1))
def test_a_hidden_copy_is_found_and_nothing_where_there_is_none(power, hidden, seed):
    rng = np.random.default_rng(seed)
    values = np.r_[3.0, 2.5, 2.5 if hidden else 0.5, rng.uniform(-1.0, 1.0, 97)]
    _, basis = compressed(values, [0, 1], 10.0**power, seed)
    # The copy ranks as the last of the wanted, so ask for what is larger than a little less.
    won, _ = search(basis, 2, 2.4)
    assert won is not hidden


def test_far_fewer_products_where_the_wanted_are_far_from_the_rest():
    rng = np.random.default_rng(0)
    values = np.r_[3.0, 2.5, 0.01 * rng.uniform(-1.0, 1.0, 198)]
    _, basis = compressed(values, [0, 1], 1.0, 0)
    assert search(basis, 2, 2.5) == (True, 0)
    assert basis.matvecs <= 5


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.floats(0.0, 3.0), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_components_are_bounded_by_the_product_of_residuals(power, steps, seed):
    """The bound of the docstring, for every eigenvalue, however far from normal."""
    rng = np.random.default_rng(seed)
    A, basis = compressed(rng.standard_normal(60), [], 10.0**power, seed)
    basis.start(0)
    r = basis.V[0].copy()
    found = basis.sweep(0, steps)
    H = np.zeros((steps, steps))
    found.project(H, 0, steps)
    mu, left = np.linalg.eig(A.T)
    bound = np.prod(found.betas) / np.abs(mu[:, None] - np.linalg.eigvals(H)).prod(axis=1)
    assert np.all(np.abs(left.T @ r) <= bound * (1 + 1e-6) + 1e-9)


@given(
    st.sampled_from([w for w in ORDERS if w[0] == "L"]),
    st.booleans(),
    st.floats(0.1, 10.0),
    st.integers(0, 2**32 - 1),
)
def test_the_edge_has_the_rank_of_the_worst(which, real, worst, seed):
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(5) + 1j * rng.standard_normal(5)
    points = edge_of(which, real)(worst, values)
    assert rank_of(which, real)(points) == pytest.approx(np.full(len(points), worst))


@pytest.mark.parametrize("which", ["SM", "SR", "SI"])
def test_the_edge_of_the_smallest(which):
    points = edge_of(which, True)(-0.5, np.array([1.0 + 2.0j, -3.0]))
    assert rank_of(which, True)(points) == pytest.approx(np.full(len(points), -0.5))


@pytest.mark.parametrize("seed", [0, 2, 29])
def test_values_inside_the_spectrum_are_not_missed_in_silence(seed):
    """Seed 29 gave an imaginary part of 0.0156 where four real eigenvalues are."""
    rng = np.random.default_rng(seed)
    n, which = int(rng.integers(130, 300)), ["SM", "SI"][seed % 2]
    A = rng.standard_normal((n, n)) / np.sqrt(n) + (0, 1.2, 2)[seed % 3] * np.eye(n)
    operator = LinearOperator(A.shape, matvec=lambda x: A @ x, dtype=float)
    rank = rank_of(which, True)
    true = np.sort(rank(np.linalg.eigvals(A)))[::-1][:4]
    try:
        w = eigs(operator, 4, which=which, return_eigenvectors=False, maxiter=100)
    except NotConverged:
        return
    assert np.sort(rank(w))[::-1] == pytest.approx(true, abs=1e-8)
