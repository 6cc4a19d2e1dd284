"""A problem has the same answer however its matrices are stored."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import solve_continuous_are
from scipy.sparse.linalg import LinearOperator, splu

from gpu import NotConverged, NotSupported, RiccatiError, lqe, lqr

SLOW = pytest.mark.slow
N = 20  # elements of the models


def chain(n):
    """Second differences of a rod held at its ends."""
    return (n + 1) ** 2 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))


def second_order(stiffness, damping):
    n = len(stiffness)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping * np.eye(n)]])
    return A, np.r_[np.zeros(2 * n - 1), 1.0][:, None]


def wave():
    return second_order(chain(N), 0.02)


def beam():
    return second_order(chain(N) @ chain(N) / 100, 0.1)


def oscillators():
    turns = np.linspace(0.3, 20.0, N)
    A = np.kron(np.diag(turns), [[0.0, 1.0], [-1.0, 0.0]]) - 1e-3 * np.eye(2 * N)
    return A, np.kron(np.ones((N, 1)), [[0.0], [1.0]])


def advection():
    A = -0.02 * chain(N) - 5 * (N + 1) * (np.eye(N) - np.eye(N, k=-1))
    return A, (np.arange(N) < 4).astype(float)[:, None]


def a_weak_input():
    """Dense problems of this kind are solved down to inputs of 1e-12."""
    return np.diag(np.r_[1.0, -np.arange(1.0, N)]), np.r_[1e-8, np.ones(N - 1)][:, None]


def as_operators(A):
    """A as an operator, and its inverse."""
    lu, shape = splu(sparse.csc_array(A)), A.shape
    inverse = LinearOperator(
        shape,
        lambda x: lu.solve(x.ravel()),
        rmatvec=lambda x: lu.solve(x.ravel(), "T"),
        dtype=float,
    )
    product = LinearOperator(shape, lambda x: A @ x, rmatvec=lambda x: A.T @ x, dtype=float)
    return product, inverse


@pytest.mark.parametrize("rank", ["full", "one"])
@pytest.mark.parametrize("model", [wave, beam, oscillators, advection, a_weak_input])
def test_same_gain_however_it_is_stored(model, rank):
    A, B = model()
    n = len(A)
    C = np.eye(n) if rank == "full" else np.ones((1, n))
    X = solve_continuous_are(A, B, C.T @ C, np.eye(1))
    product, inverse = as_operators(A)
    weight = {"factored": rank == "one"}
    Q = C if rank == "one" else 1.0
    for result in (
        lqr(A, B, Q, 1.0, **weight),
        lqr(sparse.csr_array(A), B, Q, 1.0, **weight),
        lqr(product, B, Q, 1.0, inverse=inverse, **weight),
    ):
        # Of the weak input SciPy has half of the digits.
        atol = (1e-3 if model is a_weak_input else 1e-7) * np.abs(B.T @ X).max()
        np.testing.assert_allclose(result.K, B.T @ X, rtol=0, atol=atol)
        assert result.converged
        assert result.bound < 0.0
        assert len(result.E) == n


def test_a_slow_stable_mode_without_weight_is_no_obstacle():
    values, weight = -np.r_[1e-7, np.arange(1.0, 40.0)], np.r_[0.0, np.ones(39)]
    X = solve_continuous_are(np.diag(values), np.ones((40, 1)), np.diag(weight), np.eye(1))
    for A in (values, sparse.diags_array(values), np.diag(values)):
        result = lqr(A, np.ones(40), weight, 1.0)
        np.testing.assert_allclose(result.K, X.sum(axis=0)[None], atol=1e-9 * np.abs(X).max())
        assert result.abscissa == pytest.approx(-1e-7, rel=1e-6)


def test_no_gain_of_an_operator_is_called_optimal_that_is_not():
    """The space of A and B holds the gain where A is symmetric; elsewhere it takes shifts."""
    A, B = np.array([[-1.0, 1.0], [0.0, -2.0]]), np.array([[1.0], [0.0]])
    product, inverse = as_operators(A)
    first = np.sqrt(2.0) - 1.0
    best = [[first, first / (3.0 + first)]]
    np.testing.assert_allclose(lqr(product, B, 1.0, 1.0, inverse=inverse).K, best, rtol=1e-12)
    with pytest.raises(NotSupported, match="refine=False"):
        lqr(product, B, 1.0, 1.0, method="reduced", inverse=inverse)
    # What is asked for by name is done: the second state is out of the space.
    rough = lqr(product, B, 1.0, 1.0, method="reduced", inverse=inverse, refine=False)
    np.testing.assert_allclose(rough.K, [[first, 0.0]], atol=1e-12)


UNSTABLE = {
    "real": [[30.0, 0.0], [0.0, -1.0]],
    "slow": [[0.01, 0.0], [0.0, -1.0]],
    "swinging": [[0.1, 5.0], [-5.0, 0.1]],
}


@pytest.mark.parametrize(
    "modes",
    ["swinging", "stable", *(pytest.param(name, marks=SLOW) for name in ("real", "slow"))],
)
def test_poles_of_large_loops_right_of_the_axis_are_looked_for(modes):
    """Modes without an input or a weight are poles of every loop, wherever they are."""
    n = 1600
    rest = sparse.diags_array([-6.5, 3.0, 2.7], offsets=[0, 1, -1], shape=(n - 2, n - 2))
    pair = np.array(UNSTABLE.get(modes, -np.eye(2)))
    A = sparse.block_diag([rest, pair], format="csr")
    B, C = np.zeros((n, 1)), np.zeros((1, n))
    B[:50], C[0, 60:70] = 1.0, 1.0
    if modes == "stable":
        result = lqr(A, B, C, 1.0, factored=True)
        assert result.stable
        assert result.abscissa < 0.0
        return
    with pytest.warns(RuntimeWarning, match="does not stabilise.*doubling"):
        result = lqr(A, B, C, 1.0, factored=True)
    assert not result.stable
    assert not result.converged
    want = np.linalg.eigvals(pair).real.max()
    assert result.abscissa == pytest.approx(want, rel=1e-6)


@pytest.mark.parametrize("rank", ["full", pytest.param("one", marks=SLOW)])
def test_a_projection_without_a_solution_ends_soon(rank):
    stiffness = 801**2 * sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(800, 800))
    eye = sparse.eye_array(800)
    A = sparse.block_array([[None, eye], [-stiffness, -eye]], format="csr")
    Q, factored = (1.0, False) if rank == "full" else (np.eye(1, 1600, 400), True)
    with pytest.raises(RiccatiError, match="stabilis"):
        lqr(A, np.eye(1600)[:, 1200], Q, 1.0, factored=factored)


def test_options_of_a_projection_are_kept():
    A, B = wave()
    with pytest.raises(NotConverged, match="raise rank"):
        lqr(sparse.csr_array(A), B, np.ones((1, 2 * N)), 1.0, factored=True, rank=10)


def test_a_filter_can_be_refined():
    A, G, C = np.diag(-np.arange(1.0, 6.0)), np.eye(5), np.ones((1, 5))
    rough = lqe(A, G, C, np.eye(5), 1.0, method="hamiltonian", modes=4)
    best = rough.refined()
    X = solve_continuous_are(A.T, C.T, np.eye(5), np.eye(1))
    np.testing.assert_allclose(best.K, X @ C.T, atol=1e-12)
    assert best.refined().K.shape == rough.K.shape == (5, 1)
