"""Cross terms of states and inputs, however A and Q are stored, against SciPy on dense matrices."""

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, splu

from gpu import InputError, lqe, lqr
from gpu.errors import NotSupported

R = np.array([[2.0, 0.5], [0.5, 1.0]]) * 1e-2
ROOT = np.linalg.cholesky(R)


def transport(k=8):
    """Diffusion and a wind on k^2 nodes, two inputs, two outputs; the matrix is not symmetric."""
    h = 1 / (k + 1)
    D = sparse.diags([np.full(k, -2.0), np.ones(k - 1), np.ones(k - 1)], [0, 1, -1]) / h**2
    G = sparse.diags([np.ones(k - 1), -np.ones(k - 1)], [1, -1]) / (2 * h)
    one = sparse.eye(k)
    A = sparse.csr_array(sparse.kron(D - 10 * G, one) + sparse.kron(one, D - 30 * G))
    B, C = np.zeros((k * k, 2)), np.zeros((2, k * k))
    B[:k, 0] = B[-k:, 1] = 5.0
    C[0, : 2 * k] = C[1, 4 * k : 5 * k] = 10.0
    return A, B, C


def mass(n, seed=0):
    d = np.random.default_rng(seed).uniform(1, 2, n)
    return sparse.csr_array(sparse.diags(d) + 0.1 * sparse.eye(n, k=1))


def contraction(shape, size, seed=0):
    D = np.random.default_rng(seed).standard_normal(shape)
    return D * (size / np.linalg.norm(D, 2))


def by_scipy(A, B, Q, N, E=None, R=R):
    """Gain and value, E taken out by hand: SciPy's own e is inaccurate where not symmetric."""
    E = np.eye(len(A)) if E is None else E
    moved, b = np.linalg.solve(E, A), np.linalg.solve(E, B)
    X = linalg.solve_continuous_are(moved, b, Q, R, s=N)
    S = np.linalg.solve(E.T, np.linalg.solve(E.T, X).T)
    return np.linalg.solve(R, b.T @ X + N.T), S


def apart(found, wanted):
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


@pytest.mark.parametrize("stored", ["sparse", "dense", "operator"])
@pytest.mark.parametrize("with_mass", [False, True], ids=["", "E"])
def test_weight_of_low_rank(stored, with_mass):
    A, B, C = transport()
    n = len(B)
    E = mass(n) if with_mass else None
    N = C.T @ contraction((2, 2), 0.9) @ ROOT.T
    K, S = by_scipy(A.toarray(), B, C.T @ C, N, None if E is None else E.toarray())
    given, options = A, {}
    if stored == "dense":
        given = A.toarray()
    if stored == "operator":
        lu = splu(A.tocsc())
        pairs = {"matvec": lambda x: A @ x, "rmatvec": lambda x: A.T @ x}
        given = LinearOperator((n, n), **pairs, dtype=float)
        solves = {"matvec": lu.solve, "rmatvec": lambda x: lu.solve(x, "T")}
        options = {"inverse": LinearOperator((n, n), **solves, dtype=float)}
    result = lqr(given, B, C, R, N, E, method="reduced", factored=True, **options)
    assert apart(result.K, K) <= 1e-8
    assert apart(result.S.toarray(), S) <= 1e-8
    assert result.stable
    assert result.residual <= 1e-10


@pytest.mark.parametrize("stored", [sparse.csr_array, lambda A: A.toarray()], ids=["", "dense"])
@pytest.mark.parametrize("weight", ["number", "diagonal", "matrix"])
def test_weight_of_full_rank(weight, stored):
    A, B, _ = transport(6)
    n = len(B)
    Q, full = {
        "number": (100.0, 100 * np.eye(n)),
        "diagonal": (np.linspace(50, 200, n), np.diag(np.linspace(50, 200, n))),
        "matrix": (stored(-A - A.T), -(A + A.T).toarray()),
    }[weight]
    unit = np.linalg.cholesky(full) @ contraction((n, 2), 1.0) @ ROOT.T
    E = mass(n, 1)
    K, _ = by_scipy(A.toarray(), B, full, 0.7 * unit, E.toarray())
    result = lqr(stored(A), B, Q, R, 0.7 * unit, stored(E), method="reduced")
    assert apart(result.K, K) <= 1e-10
    assert result.stable
    with pytest.raises(InputError, match="Q is not positive semidefinite"):
        lqr(stored(A), B, Q, R, 1.02 * unit, stored(E), method="reduced")


def test_diagonal_with_a_zero_mode():
    d = -(np.arange(40.0) ** 2)
    B = np.random.default_rng(2).standard_normal((40, 2))
    N = contraction((40, 2), 0.7, 2)
    K, S = by_scipy(np.diag(d), B, np.eye(40), N, R=np.eye(2))
    assert apart(lqr(d, B, 1.0, None, N).K, K) <= 1e-10
    found = lqe(d, np.eye(40), B.T, np.eye(40), np.eye(2), N)
    assert apart(found.K.T, K) <= 1e-10
    for pi in ("printed", "symmetric"):
        for A in (d, np.diag(d)):
            result = lqr(A, B, 1.0, None, N, method="hamiltonian", modes=80, pi=pi)
            assert apart(result.K, K) <= 1e-10
            if pi == "symmetric":
                assert apart(result.S.toarray(), S) <= 1e-10


@pytest.mark.parametrize("stored", [sparse.csr_array, np.asarray], ids=["sparse", "dense"])
def test_value_by_eigenvectors_with_a_mass_matrix(stored):
    rng = np.random.default_rng(3)
    n = 12
    A, B = rng.standard_normal((n, n)) - 3 * np.eye(n), rng.standard_normal((n, 2))
    E, Q = np.eye(n) + 0.2 * rng.standard_normal((n, n)), np.diag(rng.uniform(1, 2, n))
    N = 0.5 * contraction((n, 2), 1.0) @ ROOT.T
    K, S = by_scipy(A, B, Q, N, E)
    result = lqr(stored(A), B, Q.diagonal(), R, N, stored(E), method="hamiltonian", modes=2 * n)
    assert apart(result.K, K) <= 1e-9
    assert apart(result.S.toarray(), S) <= 1e-9


def test_random_problems_stored_in_every_way():
    """A sparse A, a dense one and Newton's method without projection tell the same gain."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(8, 25)), int(rng.integers(1, 4))
        G = sparse.random_array((n, n), density=0.2, rng=rng).toarray()
        A = (G - G.T) - np.diag(rng.uniform(0.5, 5.0, n))
        B, C = rng.standard_normal((n, m)), rng.standard_normal((2, n))
        N = C.T @ contraction((2, m), 0.95, seed)
        K, _ = by_scipy(A, B, C.T @ C, N, R=np.eye(m))
        given = sparse.csr_array(A)
        assert apart(lqr(given, B, C, None, N, factored=True).K, K) <= 1e-7
        assert apart(lqr(given, B, C, None, N, factored=True, method="newton").K, K) <= 1e-9


def test_joint_weights_that_are_not_semidefinite_are_refused():
    A, B, C = transport()
    inside = C.T @ contraction((2, 2), 1.0) @ ROOT.T
    for N in (1.01 * inside, 0.5 * inside + 1e-3):
        with pytest.raises(InputError, match="Q is not positive semidefinite"):
            lqr(A, B, C, R, N, factored=True)


def test_operators_that_the_cross_term_makes_singular():
    identity = LinearOperator((3, 3), matvec=lambda x: -x, rmatvec=lambda x: -x, dtype=float)
    # A - B N^T has a zero on its diagonal.
    b = np.array([1.0, 0.0, 0.0])
    with pytest.raises(NotSupported, match=r"^N"):
        lqr(identity, b, 2.0, None, -b, inverse=identity, method="reduced")
    # So few states have all their entries stored: -2 s - (s - 1)^2 + 2 = 0.
    K = lqr(identity, b, 2.0, None, -b, inverse=identity).K
    np.testing.assert_allclose(K, [[0.0, 0.0, 0.0]], atol=1e-12)
