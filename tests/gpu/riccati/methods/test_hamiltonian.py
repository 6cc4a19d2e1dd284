"""The inverse Hamiltonian against the Hamiltonian itself, for every way of storing the matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

from gpu import InputError, eigs, hamiltonian_inverse
from gpu.riccati.methods.hamiltonian import solve as algorithm5
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import check_lqr


def heat(N):
    """Modes of the cube with two controlled patches: diagonal of A with one zero, and B."""
    k = np.arange(N)
    norm = np.where(k > 0, np.sqrt(2), 1.0)
    wave = np.maximum(k, 1) * np.pi
    c = np.where(k > 0, norm * (np.sin(0.77 * wave) - np.sin(0.3 * wave)) / wave, 0.47)
    near = c[:, None, None] * c[:, None] * norm
    A = -(np.pi**2) * (k[:, None, None] ** 2.0 + k[:, None] ** 2 + k**2).ravel()
    return A, np.stack([near.ravel(), (near * (-1.0) ** k).ravel()], axis=1)


def hamiltonian(A, B, Q, R=None, scale=1.0):
    A = np.diag(A) if A.ndim == 1 else A
    Q = Q * np.eye(len(A)) if np.ndim(Q) == 0 else np.diag(Q) if np.ndim(Q) == 1 else Q
    R = np.eye(B.shape[1]) if R is None else R
    return np.block([[A, -scale * B @ np.linalg.solve(R, B.T)], [-Q / scale, -A.T]])


def residual(H, operator, D=None, seed=1):
    v = np.random.default_rng(seed).standard_normal(len(H))
    Dv = v if D is None else D @ v
    return np.linalg.norm(H @ operator.matvec(v) - Dv) / np.linalg.norm(Dv)


def transposed(operator, seed=2):
    """``w . (H^-1 v) = (H^-T w) . v``, relative."""
    v, w = np.random.default_rng(seed).standard_normal((2, operator.shape[0]))
    x, y = operator.matvec(v), operator.rmatvec(w)
    return abs(w @ x - y @ v) / (np.linalg.norm(w) * np.linalg.norm(x))


STORED = {"diagonal": lambda a: a, "dense": np.diag, "sparse": lambda a: sparse.diags(a).tocsr()}


@pytest.mark.parametrize(
    ("stored", "N"),
    [*((name, 8) for name in STORED), pytest.param("dense", 11, marks=pytest.mark.slow)],
)
def test_heat_equation_with_its_zero_mode(stored, N):
    A, B = heat(N)
    assert np.count_nonzero(A) == A.size - 1
    operator = hamiltonian_inverse(STORED[stored](A), B, 1.0)
    assert residual(hamiltonian(A, B, 1.0), operator) < 1e-12
    assert transposed(operator) < 1e-12


JORDAN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
SINGULAR = {
    "double integrator": (JORDAN, np.array([[0.0], [1.0], [1.0]])),
    "two zero modes": (np.diag([0.0, 0.0, -2.0]), np.array([[1.0, 0.5], [0.2, -1.0], [1.0, 1.0]])),
    "left and right differ": (
        np.array([[-1.0, 2.0, 0.0], [1.0, -2.0, 0.0], [0.5, 0.0, -1.0]]),
        np.array([[1.0], [0.5], [0.0]]),
    ),
    "nothing but zeros": (np.zeros((2, 2)), np.eye(2)),
}


@pytest.mark.parametrize("name", SINGULAR)
@pytest.mark.parametrize("stored", [np.array, sparse.csr_array])
def test_singular_state_matrices(name, stored):
    A, B = SINGULAR[name]
    R = np.diag(np.arange(1.0, B.shape[1] + 1))
    Q = np.diag(np.arange(1.0, len(A) + 1))
    for cost in (stored(R), R.diagonal()):
        operator = hamiltonian_inverse(stored(A), B, Q, cost)
        assert residual(hamiltonian(A, B, Q, R), operator) < 1e-12
        assert transposed(operator) < 1e-12


@pytest.mark.parametrize("stored", [np.array, sparse.csr_array])
@pytest.mark.parametrize("singular", [False, True])
def test_pencil_with_weights(stored, singular):
    rng = np.random.default_rng(3)
    n = 20
    A = -sparse.diags([np.full(n, 2.0), np.full(n - 1, -1.1), np.full(n - 1, -0.9)], [0, 1, -1])
    A = A.toarray()
    if singular:
        A -= np.diag(A.sum(axis=1))  # the right null vector is constant, the left one is not
    E = np.diag(rng.uniform(1, 2, n)) + 0.1 * np.eye(n, k=1)
    B, G = rng.standard_normal((2, n, 3))
    Q, R = G @ G.T, np.diag([1.0, 2.0, 3.0]) + 0.3
    operator = hamiltonian_inverse(stored(A), B, Q, R, stored(E), scale=7.0)
    D = np.block([[E, np.zeros_like(E)], [np.zeros_like(E), E.T]])
    H = hamiltonian(A, B, Q, R, scale=7.0)
    v = rng.standard_normal(2 * n)
    z = operator.matvec(v)
    # Rounding of what LU solves with: relative to H z, not to its small sum.
    assert np.linalg.norm(H @ z - D @ v) < 1e-13 * np.linalg.norm(H) * np.linalg.norm(z)
    assert transposed(operator) < 1e-12
    # Scaling is a similarity: eigenvalues stay, and come in pairs +-.
    values = np.linalg.eigvals(np.linalg.solve(D, H))
    w = 1 / eigs(operator, 4, return_eigenvectors=False)
    assert np.abs(w[:, None] - values).min(axis=1).max() < 1e-9
    assert np.abs(w[:, None] + values).min(axis=1).max() < 1e-9


def test_operator_with_an_inverse_takes_two_solves():
    A, B = heat(4)
    A = A - 1.0
    count = [0, 0]

    def solve(x, way):
        count[way] += 1
        return x / A

    inverse = LinearOperator(
        (64, 64), matvec=lambda x: solve(x, 0), rmatvec=lambda x: solve(x, 1), dtype=float
    )
    A_operator = LinearOperator((64, 64), matvec=lambda x: A * x, rmatvec=lambda x: A * x)
    operator = hamiltonian_inverse(A_operator, B, 2.0, inverse=inverse)
    count[:] = [0, 0]
    assert residual(hamiltonian(A, B, 2.0), operator) < 1e-13
    assert count == [1, 1]
    with pytest.raises(InputError, match="inverse"):
        hamiltonian_inverse(A_operator, B, 2.0)


@pytest.mark.parametrize(
    ("A", "B", "Q"),
    [
        (np.array([0.0, -1.0]), np.array([0.0, 1.0]), 1.0),
        (np.array([0.0, -1.0]), np.array([1.0, 1.0]), np.array([0.0, 1.0])),
        (np.zeros(2), np.ones(2), 1.0),
        (np.diag([0.0, -1.0]), np.array([0.0, 1.0]), 1.0),
    ],
    ids=["not stabilisable", "not detectable", "two zeros, one input", "dense"],
)
def test_singular_hamiltonian_is_an_error(A, B, Q):
    with pytest.raises(np.linalg.LinAlgError, match="eigenvalue 0 of A"):
        hamiltonian_inverse(A, B, Q)


@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 3), st.booleans())
def test_random_problems(seed, n, m, singular):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    if singular:
        A[0] = A[-1] if n > 1 else 0.0
    G = rng.standard_normal((n, n))
    H = hamiltonian(A, B, G @ G.T + np.eye(n))
    operator = hamiltonian_inverse(A, B, G @ G.T + np.eye(n))
    # Whatever the condition of A; a relative residual is rounding times that of H.
    assert residual(H, operator) < 1e-11 + 1e-14 * np.linalg.cond(H)


@pytest.mark.parametrize("stored", ["dense", "sparse"])
@pytest.mark.parametrize("name", ["integrators", "rod"])
def test_where_null_vectors_are_not_told_apart(name, stored):
    """Many double zeros, or one beside weights of all sizes: the whole matrix is factored."""
    n = 40
    rng = np.random.default_rng(3)
    tridiagonal = np.eye(n, k=1) + np.eye(n, k=-1)
    if name == "integrators":
        E = (4.0 * np.eye(n) + tridiagonal) / 6.0
        A = E @ np.kron(np.diag(np.linspace(0.5, 2.0, n // 2)), [[0.0, 1.0], [0.0, 0.0]])
        B, Q = E @ np.kron(np.eye(n // 2), [[0.0], [1.0]]), np.ones(n)
    else:
        E, A = None, tridiagonal - 2.0 * np.eye(n)
        A[0, 0] = A[-1, -1] = -1.0
        B, Q = 1e2 * rng.standard_normal((n, 2)), 10.0 ** rng.uniform(-4, 4, n)
    sort = sparse.csr_array if stored == "sparse" else np.asarray
    inverse = hamiltonian_inverse(sort(A), B, Q, E=None if E is None else sort(E))
    H = np.block([[A, -B @ B.T], [-np.diag(Q), -A.T]])
    v = rng.standard_normal(2 * n)
    x = inverse.matvec(v)
    right = v if E is None else np.r_[E @ v[:n], E.T @ v[n:]]
    # As good as the solution of the dense system by elimination is.
    size = np.linalg.norm(H, 2) * np.linalg.norm(x)
    assert np.linalg.norm(H @ x - right) <= 1e-13 * size


def on_device(A):
    import cupy
    from cupyx.scipy import sparse as device

    return device.csr_matrix(A) if sparse.issparse(A) else cupy.asarray(A)


@pytest.mark.gpu
@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
def test_inverse_on_a_device(stored):
    A, B = heat(6)
    A = stored(A)
    v = np.random.default_rng(0).standard_normal(2 * len(B))
    here = hamiltonian_inverse(A, B, 1.0)
    there = hamiltonian_inverse(on_device(A), on_device(B), 1.0)
    for name in ("matvec", "rmatvec"):
        x, y = getattr(here, name)(v), getattr(there, name)(on_device(v))
        assert type(y).__module__.startswith("cupy")
        assert np.linalg.norm(x - y.get()) < 1e-11 * np.linalg.norm(x)


def same_gain(solve, A, B, Q, tol, factored=False, **options):
    moved = Q if np.ndim(Q) == 0 else on_device(Q)
    here = solve(check_lqr(A, B, Q, np.eye(2), factored=factored), **options)
    there = check_lqr(on_device(A), on_device(B), moved, np.eye(2), factored=factored)
    K = solve(there, **options).gain.get()
    assert np.linalg.norm(here.gain - K) < tol * np.linalg.norm(K)


@pytest.mark.gpu
@pytest.mark.parametrize("pi", ["printed", "symmetric"])
@pytest.mark.parametrize("stored", [np.diag, np.array], ids=["dense", "diagonal"])
def test_algorithm5_on_a_device(pi, stored):
    A, B = heat(7)
    # Apart: of repeated eigenvalues rounding decides which copies are met, and which cut off.
    A = stored(A * np.random.default_rng(3).uniform(1.0, 1.5, A.size))
    same_gain(algorithm5, A, B, 1.0, 1e-7, modes=30, pi=pi, start="random")


@pytest.mark.gpu
@pytest.mark.parametrize("Q", ["identity", "diagonal", "factor"])
def test_reduced_on_a_device(Q):
    A, B = heat(6)
    line = np.arange(1.0, len(A) + 1)
    weight = {"identity": 1.0, "diagonal": np.linspace(0.5, 2.0, len(A)), "factor": 1 / line[None]}
    same_gain(reduced, A, B, weight[Q], 1e-8, factored=Q == "factor")
