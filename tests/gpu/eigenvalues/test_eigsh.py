"""Symmetric problems beside closed forms, dense algebra and SciPy's ARPACK."""

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import aslinearoperator

from gpu import InputError, NotConverged, eigs, eigsh, svds


def line(n):
    return sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))


def plate(n):
    """The five-point matrix of a square, most of whose eigenvalues are double."""
    return sparse.csr_array(sparse.kronsum(line(n), line(n)))


def plate_values(n):
    one = 4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * n + 2)) ** 2
    return np.sort(np.add.outer(one, one).ravel())


def pencil(n, seed=0, complex_too=True):
    """A hermitian A, indefinite, and a positive definite M with a condition of about 100."""
    rng = np.random.default_rng(seed)
    H, F = rng.standard_normal((2, n, n)) + (1j * rng.standard_normal((2, n, n)) * complex_too)
    M = F @ F.conj().T / n + 0.05 * np.eye(n)
    return (H + H.conj().T, M) if complex_too else ((H + H.T).real, M.real)


def wanted(values, k, which, sigma=None):
    """The k of all values that SciPy's documentation asks for."""
    key = values if sigma is None else 1.0 / (values - sigma)
    order = np.argsort({"LM": -np.abs(key), "SM": np.abs(key), "LA": -key}.get(which, key))
    if which == "BE":
        order = np.concatenate([order[: k // 2], order[::-1][: k - k // 2]])
    return np.sort(values[order[:k]])


def check(A, M, w, v, values):
    dense = A.toarray() if hasattr(A, "toarray") else A
    M = np.eye(len(v)) if M is None else M
    assert w.dtype == np.float64
    scale = np.abs(values).max() + np.linalg.norm(dense, 2)
    np.testing.assert_allclose(w, values, rtol=0, atol=1e-12 * scale)
    assert np.abs(v.conj().T @ M @ v - np.eye(len(w))).max() <= 1e-12
    error = np.linalg.norm(dense @ v - M @ v * w, axis=0)
    assert error.max() <= 1e-11 * scale * np.linalg.norm(v, axis=0).max()


@pytest.mark.parametrize("k", [1, 7])
@pytest.mark.parametrize("which", ["LM", "SM", "LA", "SA", "BE"])
def test_double_eigenvalues(which, k):
    A = plate(24)
    w, v = eigsh(A, k, which=which)
    check(A, None, w, v, wanted(plate_values(24), k, which))
    np.testing.assert_array_equal(eigsh(A, k, which=which, return_eigenvectors=False), w)


@pytest.mark.parametrize("which", ["LM", "LA", "SA", "BE"])
@pytest.mark.parametrize("sigma", [None, 0.3])
@pytest.mark.parametrize("mass", [False, True], ids=["", "M"])
@pytest.mark.parametrize("complex_too", [False, True], ids=["real", "complex"])
@pytest.mark.parametrize("n", [30, 300])  # decomposed, and iterated
def test_pencils(n, complex_too, mass, sigma, which):
    A, M = pencil(n, complex_too=complex_too)
    M = M if mass else None
    # With maxiter no decomposition stands in for an iteration that fails.
    w, v = eigsh(A, 5, M, sigma, which, maxiter=None if n < 100 else 300)
    check(A, M, w, v, wanted(linalg.eigh(A, M, eigvals_only=True), 5, which, sigma))


@pytest.mark.parametrize("n", [20, 400])
def test_a_mass_that_does_not_see_all(n):
    """Unknowns without mass are eliminated: the eigenvalues of the Schur complement."""
    A, _ = pencil(n, 1, complex_too=False)
    A = A + 3 * np.sqrt(n) * np.eye(n)
    M = np.diag(np.arange(n) % 2.0)
    some, other = np.arange(n) % 2 == 1, np.arange(n) % 2 == 0
    S = A[np.ix_(some, some)] - A[np.ix_(some, other)] @ np.linalg.solve(
        A[np.ix_(other, other)], A[np.ix_(other, some)]
    )
    w, v = eigsh(A, 4, M, sigma=0.1)
    check(A, M, w, v, wanted(np.linalg.eigvalsh(S), 4, "LM", 0.1))


def test_operators_and_functions():
    A = plate(20)
    values = plate_values(20)[-4:]
    for given, v0 in ((aslinearoperator(A), None), (lambda x: A @ x, np.ones(400))):
        w, v = eigsh(given, 4, which="LA", v0=v0)
        check(A, None, w, v, values)


def test_digits_of_small_eigenvalues_are_kept():
    """With sigma they have the digits of the inverse, not those of A v: diag(1e-12 j)."""
    values = np.concatenate([1e-12 * np.arange(1.0, 5), np.linspace(1, 2, 396)])
    Q = sparse.diags_array(values).tocsr()
    np.testing.assert_allclose(eigsh(Q, 4, sigma=0.0)[0], values[:4], rtol=1e-12)


def test_the_start_is_drawn_and_repeatable():
    A, B = plate(20), np.random.default_rng(0).standard_normal((400, 300))
    for solve, M in ((eigs, A), (eigsh, A), (svds, B)):
        first, again, other, fixed = (
            solve(M, 3, rng=rng)[-1 if solve is svds else 1] for rng in (1, 1, 2, None)
        )
        np.testing.assert_array_equal(first, again)
        assert not np.array_equal(first, other)
        assert not np.array_equal(first, fixed)
        generator = np.random.default_rng(1)
        np.testing.assert_array_equal(solve(M, 3, rng=generator)[-1 if solve is svds else 1], first)
        with pytest.raises(InputError, match="rng"):
            solve(M, 3, rng="seed")


def test_few_restarts_are_few_also_of_small_matrices():
    A = np.diag(1.0 + 1e-6 * np.arange(200.0))
    for solve in (eigs, eigsh, svds):
        with pytest.raises(NotConverged) as caught:
            solve(A, 3, maxiter=1)
        assert len(caught.value.eigenvalues) < 3
        assert len(solve(A, 3)[-2]) == 3
        assert len(solve(np.diag(np.arange(60.0)), 3, maxiter=1)[-2]) == 3  # decomposed


def test_arguments_of_svds():
    B = np.random.default_rng(0).standard_normal((40, 30))
    u, s, vh = svds(B, 4)
    for solver in ("arpack", "lobpcg", "propack"):
        left, values, none = svds(B, 4, return_singular_vectors="u", solver=solver)
        assert none is None
        np.testing.assert_array_equal(left, u)
        np.testing.assert_array_equal(values, s)
    none, _, right = svds(B, 4, return_singular_vectors="vh")
    assert none is None
    np.testing.assert_array_equal(right, vh)
    with pytest.raises(InputError, match="solver"):
        svds(B, 4, solver="lapack")


SKEW = np.diag(np.ones(299), 1)
EYE = sparse.eye_array(300)
BAD = {
    "A is not symmetric, .* gpu.eigs": {"A": SKEW},
    "A is not symmetric on two": {"A": aslinearoperator(SKEW)},
    "M is not symmetric": {"M": SKEW + np.eye(300)},
    "M is not positive definite": {"M": np.diag(np.arange(300.0) - 1)},
    "M is not positive semidefinite": {"A": np.eye(2), "M": [[1.0, 2], [2, 1]], "k": 1, "sigma": 3},
    "singular for the same vector": {
        "A": np.diag([1.0, 0]), "M": np.diag([1.0, 0]), "k": 1, "sigma": 3,
    },
    "M is singular: 1 ": {"A": np.eye(2), "M": np.diag([1.0, 0]), "k": 2, "sigma": 3},
    "real": {"sigma": 1j},
    "which": {"which": "LR"},
    "k=301|k": {"k": 301},
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_bad_input(message):
    with pytest.raises(InputError, match=message):
        eigsh(**({"A": EYE.tocsr()} | BAD[message]))


def test_one_eigenvalue_of_three_hundred_copies():
    w, v = eigsh(EYE.tocsr(), 5)
    np.testing.assert_allclose(w, 1.0, rtol=1e-14)
    assert np.abs(v.T @ v - np.eye(5)).max() <= 1e-13
    with pytest.raises(NotConverged, match="orthonormal"):
        eigsh(EYE.tocsr(), 6, which="BE")  # both ends are the same
