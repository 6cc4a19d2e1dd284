"""Regulators and filters: every argument, certificates, gains that do not stabilise, bad input."""

import carex_problems as carex
import numpy as np
import pytest
from scipy import sparse
from scipy.integrate import simpson
from scipy.linalg import block_diag, expm, solve_continuous_are

from gpu import LowRankValue, NotConverged, RiccatiError, care, lqe, lqr


def system(seed=0, n=8, m=2, p=3):
    """A, B, Q, R, N, E with a definite cost, A unstable."""
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    M, C = rng.standard_normal((m, m)), rng.standard_normal((p, n))
    R = M @ M.T + np.eye(m)
    D = rng.standard_normal((p, m))
    D *= 0.9 / np.linalg.norm(D, 2)
    N = C.T @ D @ np.linalg.cholesky(R).T
    E = 2 * np.eye(n) + 0.3 * rng.standard_normal((n, n))
    return A, B, C.T @ C, R, N, E


def check(result, A, B, Q, R, N=None, E=None):
    """The equation, the gain and the poles, from the data alone."""
    K, S, poles = result
    N = np.zeros_like(B) if N is None else N
    E = np.eye(len(A)) if E is None else E
    cross = E.T @ S @ B + N
    residual = E.T @ S @ A + A.T @ S @ E + Q - cross @ np.linalg.solve(R, cross.T)
    size = np.linalg.norm(E.T @ S @ A) + np.linalg.norm(Q)
    assert np.linalg.norm(residual) <= 1e-12 * size
    np.testing.assert_allclose(K, np.linalg.solve(R, cross.T), atol=1e-11 * np.abs(K).max())
    found = np.linalg.eigvals(np.linalg.solve(E, A - B @ K))
    assert found.real.max() < 0.0
    np.testing.assert_allclose(np.sort(poles.real), np.sort(found.real), atol=1e-8)
    assert result.converged


@pytest.mark.parametrize("method", ["doubling", "newton"])
@pytest.mark.parametrize("mass", [False, True], ids=["", "E"])
@pytest.mark.parametrize("crossed", [False, True], ids=["", "N"])
def test_every_argument(method, mass, crossed):
    A, B, Q, R, N, E = system(1)
    N, E = N if crossed else None, E if mass else None
    result = lqr(A, B, Q, R, N, E, method=method)
    check(result, A, B, Q, R, N, E)
    X = solve_continuous_are(A, B, Q, R, e=E, s=N)
    np.testing.assert_allclose(result.S, X, atol=1e-10 * np.abs(X).max())
    if N is None:
        C = np.linalg.svd(Q)[1][:3, None] ** 0.5 * np.linalg.svd(Q)[2][:3]
        given = lqr(A, B, C, R, E=E, method=method, factored=True)
        np.testing.assert_allclose(given.S, result.S, atol=1e-11 * np.abs(X).max())


def test_arguments_of_every_kind():
    A, B, Q, R, _, E = system(2)
    want = lqr(A, B, Q, R, E=E).K
    for given in (
        lqr(A.tolist(), B.tolist(), Q.tolist(), R.tolist(), E=E.tolist()),
        lqr(
            A, sparse.csr_array(B), sparse.csr_array(Q), sparse.coo_array(R), E=sparse.csc_array(E)
        ),
    ):
        np.testing.assert_allclose(given.K, want, rtol=1e-10)
    values = np.array([0.5, -1.0, -2.0])
    b = np.ones(3)
    full = lqr(np.diag(values), b[:, None], np.diag([1.0, 2.0, 3.0]), 2.0).K
    np.testing.assert_allclose(
        lqr(np.diag(values), b, np.array([1.0, 2.0, 3.0]), [[2.0]]).K, full, rtol=1e-12
    )
    scalar = lqr([[1.0]], [[1.0]], 3.0)
    np.testing.assert_allclose([scalar.K[0, 0], scalar.S[0, 0], scalar.E[0].real], [3, 3, -2])


def test_cost_of_a_simulated_loop():
    A, B, Q, R, N, E = system(4, n=4)
    result = lqr(A, B, Q, R, N, E)
    loop = np.linalg.solve(E, A - B @ result.K)
    weight = Q + result.K.T @ R @ result.K - N @ result.K - result.K.T @ N.T
    x = np.arange(1.0, 5.0)
    # Simpson's rule along the exact flow, fourth order in the step.
    step, density = 2e-3, []
    flow = expm(step * loop)
    for _ in range(20001):
        density.append(x @ weight @ x)
        x = flow @ x
    spent = simpson(density, dx=step)
    assert result.cost(np.arange(1.0, 5.0)) == pytest.approx(spent, rel=1e-7)


def test_filter_is_the_dual():
    A, B, _, V, _, E = system(5, m=2)
    rng = np.random.default_rng(5)
    G, C, F = rng.standard_normal((8, 3)), B.T, rng.standard_normal((3, 3))
    W = F @ F.T
    N = 0.1 * F @ rng.standard_normal((3, 2))
    L, P, poles = lqe(A, G, C, W, V, N, E)
    gain = (E @ P @ C.T + G @ N) @ np.linalg.inv(V)
    np.testing.assert_allclose(L, gain, atol=1e-10 * np.abs(L).max())
    balance = A @ P @ E.T + E @ P @ A.T - L @ V @ L.T + G @ W @ G.T
    assert np.linalg.norm(balance) <= 1e-11 * np.linalg.norm(A @ P @ E.T)
    assert np.linalg.eigvals(np.linalg.solve(E, A - L @ C)).real.max() == pytest.approx(
        poles[0].real
    )
    same = lqe(A, G, C, F, V, N, E, factored=True)
    np.testing.assert_allclose(same.K, L, atol=1e-10 * np.abs(L).max())
    assert np.linalg.eigvalsh(P)[0] > 0.0


def rotated(A, B, Q, seed=0):
    T = np.linalg.qr(np.random.default_rng(seed).standard_normal(A.shape))[0]
    Q = T @ Q @ T.T
    return T @ A @ T.T, T @ B, (Q + Q.T) / 2


CASES = {
    "unstable, no input": (np.diag([1.0, -1]), [0, 1], np.eye(2), 1.0, "not stabilisable"),
    "at zero, no input": (np.diag([0.0, -1]), [0, 1], np.eye(2), 0.0, "not stabilisable"),
    "at zero, no weight": (np.diag([0.0, -1]), [1, 1], np.diag([0.0, 1]), 0.0, "not detectable"),
    "swings, no weight": (
        block_diag([[0.0, 2], [-2, 0]], -1), [1, 1, 1], np.diag([0.0, 0, 1]), 2j, "not detectable",
    ),
    "swings, no input": (
        block_diag([[0.1, 2], [-2, 0.1]], -1), [0, 0, 1], np.eye(3), 0.1 + 2j, "not stabilisable",
    ),
}  # fmt: skip


@pytest.mark.parametrize("turned", [False, True], ids=["", "rotated"])
@pytest.mark.parametrize("method", ["doubling", "newton"])
@pytest.mark.parametrize("name", CASES)
def test_the_mode_in_the_way_is_named(name, method, turned):
    A, b, Q, mode, cause = CASES[name]
    A, B, Q = A, np.array(b, dtype=float)[:, None], Q
    if turned:
        A, B, Q = rotated(A, B, Q)
    with pytest.raises(RiccatiError, match=cause) as caught:
        lqr(A, B, Q, 1.0, method=method)
    assert isinstance(caught.value, np.linalg.LinAlgError)
    assert caught.value.cause == cause
    assert caught.value.eigenvalue == pytest.approx(mode, abs=1e-6)


STORED = {"diagonal": lambda a: a, "sparse": lambda a: sparse.csr_array(np.diag(a))}
MODES = {
    "unstable, no input": (1.0, 0.0, 1.0, "not stabilisable"),
    "at zero, no input": (0.0, 0.0, 1.0, "not stabilisable|eigenvalue 0 of A"),
    "at zero, no weight": (0.0, 1.0, 0.0, "not detectable|eigenvalue"),
}


@pytest.mark.parametrize("stored", STORED)
@pytest.mark.parametrize("method", ["auto", "hamiltonian"])
@pytest.mark.parametrize("name", MODES)
def test_the_mode_in_the_way_is_named_of_sparse_problems(name, method, stored):
    A, B, Q = -np.arange(30.0), np.ones(30), np.ones(30)
    A[0], B[0], Q[0], message = MODES[name]
    for weight, factored in ((Q, False), (Q[None, :], True)):
        with pytest.raises(RiccatiError, match=message):
            lqr(STORED[stored](A), B, weight, factored=factored, method=method)


@pytest.mark.parametrize("stored", STORED)
def test_sparse_problems_with_an_unstable_mode_without_weight(stored):
    A, B, Q = -np.arange(30.0), np.ones(30), np.ones(30)
    A[0], Q[0] = 1.0, 0.0
    for weight, factored in ((Q, False), (Q[None, :], True)):
        full = np.outer(Q, Q) if factored else np.diag(Q)
        X = solve_continuous_are(np.diag(A), B[:, None], full, np.eye(1))
        result = lqr(STORED[stored](A), B, weight, factored=factored)
        np.testing.assert_allclose(result.K, B[None, :] @ X, atol=1e-8 * np.abs(X).max())
        assert result.abscissa < -0.9


def test_an_unstable_mode_without_weight_is_stabilised():
    result = lqr(np.diag([1.0, -1.0]), np.ones((2, 1)), np.diag([0.0, 1.0]), 1.0)
    check(result, np.diag([1.0, -1]), np.ones((2, 1)), np.diag([0.0, 1]), np.eye(1))
    # No weight at all: unstable poles are mirrored.
    poles = lqr(np.diag([2.0, -1.0]), np.ones((2, 1)), np.zeros((2, 2)), 1.0).E
    np.testing.assert_allclose(np.sort(poles.real), [-2.0, -1.0], rtol=1e-10)


@pytest.fixture(scope="module", params=[60, pytest.param(100, marks=pytest.mark.slow)])
def springs(request):
    """A lightly damped chain of masses, free to move as a whole, and its energy."""
    n = request.param
    (A, B, Q, R, _), K = carex.example_4_3(n, delta=0.05, mu=1.0)
    return A, B, Q, R, block_diag(K + np.ones((n, n)) / n, np.eye(n))


@pytest.mark.parametrize("modes", [20, 100])
def test_springs_are_flagged_and_refined(springs, modes):
    A, B, Q, R, _ = springs
    with pytest.warns(RuntimeWarning, match="does not stabilise"):
        result = lqr(A, B, Q, R, method="hamiltonian", pi="printed", modes=modes)
    assert not result.stable
    assert not result.converged
    assert np.linalg.eigvals(A - B @ result.K).real.max() > 1e-3
    if modes == 20:
        best = result.refined()
        check(best, A, B, Q, R)
        np.testing.assert_allclose(best.K, lqr(A, B, Q, R).K, rtol=1e-6, atol=1e-8)


def test_springs_in_the_product_of_energy(springs):
    A, B, Q, R, energy = springs
    result = lqr(A, B, Q, R, method="hamiltonian", pi="printed", modes=20, inner=energy)
    assert result.stable
    assert result.abscissa == pytest.approx(np.linalg.eigvals(A - B @ result.K).real.max())
    refined = result.refined()
    assert refined.converged
    with pytest.raises(NotConverged, match="does not stabilise"):
        lqr(A, B, Q, R, method="hamiltonian", pi="printed", modes=20, unstable="raise")
    quiet = lqr(A, B, Q, R, method="hamiltonian", pi="printed", modes=20, unstable="ignore")
    assert not quiet.stable


def test_newton_from_a_given_gain():
    A, B, Q, R, _, _ = system(7)
    best = lqr(A, B, Q, R)
    check(lqr(A, B, Q, R, method="newton", start=1.01 * best.K), A, B, Q, R)


def test_low_rank_value():
    Z, M = np.random.default_rng(0).standard_normal((5, 2)), np.array([[2.0, 1], [1, 3]])
    S = LowRankValue(Z, M)
    np.testing.assert_allclose(S @ np.eye(5), S.toarray(), atol=1e-14)
    np.testing.assert_allclose(S.diagonal(), np.diag(Z @ M @ Z.T), atol=1e-14)
    assert (S.shape, S.rank) == ((5, 5), 2)


@pytest.mark.parametrize("solve", [lqr, care])
def test_an_unstable_mode_without_any_input_is_named(solve):
    """The zero matrix came up as a solution, and a step was divided by it."""
    with pytest.raises(RiccatiError, match="no input moves it"):
        solve([[2, -1], [2, 2]], np.zeros((2, 1)), [[1, -1], [-1, 2]], [[2]])


@pytest.mark.parametrize("size", [1e-140, 1e-100, 1e99, 1e101, 1e149])
@pytest.mark.parametrize("n", [1, 3])
def test_residuals_of_huge_and_tiny_models_are_numbers(size, n):
    """Squares of the terms overflow, the terms do not; unstable: K = 2 a."""
    result = lqr(size * np.eye(n), np.eye(n), size**2 * np.zeros((n, n)), np.eye(n))
    np.testing.assert_allclose(result.K, 2 * size * np.eye(n), rtol=1e-12)
    assert result.residual < 1e-12


def device_problem(seed, n=40, m=3):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n)) / np.sqrt(n) - 0.8 * np.eye(n)
    B, C = rng.standard_normal((n, m)), rng.standard_normal((n, n))
    E = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
    return A, B, C.T @ C / n, np.diag(rng.uniform(0.5, 2.0, m)), 0.05 * C.T @ C @ B / n, E


@pytest.mark.gpu
@pytest.mark.parametrize("method", ["doubling", "newton"])
@pytest.mark.parametrize("seed", range(3))
def test_same_answer_on_a_device(seed, method):
    cupy = pytest.importorskip("cupy")
    data = device_problem(seed)
    host, device = lqr(*data, method=method), lqr(*map(cupy.asarray, data), method=method)
    assert device.converged
    for name in ("K", "S"):
        found, known = getattr(device, name), getattr(host, name)
        assert isinstance(found, cupy.ndarray)
        np.testing.assert_allclose(found.get(), known, atol=1e-9 * np.abs(known).max())


@pytest.mark.gpu
def test_equations_filters_and_large_circulants_on_a_device():
    cupy = pytest.importorskip("cupy")
    A, B, Q, R, _, _ = map(cupy.asarray, device_problem(5))
    X = care(A, B, Q, R)
    residual = A.T @ X + X @ A - X @ B @ cupy.linalg.inv(R) @ B.T @ X + Q
    assert float(cupy.linalg.norm(residual)) <= 1e-12 * float(cupy.linalg.norm(X))
    L, P, _ = lqe(A.T, cupy.eye(len(A)), B.T, Q, R)
    assert float(cupy.linalg.norm(P - X)) <= 1e-10 * float(cupy.linalg.norm(X))
    assert L.shape == (40, 3)
    A, B, _, _, X = carex.example_3_2(2048)
    S = lqr(cupy.asarray(A), cupy.asarray(B), 1.0).S.get()
    assert np.linalg.norm(S - X) <= 1e-12 * np.linalg.norm(X)
    with pytest.raises(RiccatiError, match="not stabilisable"):
        lqr(cupy.diag(cupy.asarray([1.0, -1.0])), cupy.asarray([[0.0], [1.0]]), cupy.eye(2), 1.0)


@pytest.mark.gpu
@pytest.mark.parametrize("crossed", [False, True], ids=["", "N"])
@pytest.mark.parametrize("weight", ["factor", "diagonal"])
def test_sparse_matrices_on_a_device(weight, crossed):
    cupy, device = (pytest.importorskip(name) for name in ("cupy", "cupyx.scipy.sparse"))
    n = 60
    lines = [np.full(n - 1, 40.0), np.full(n, -70.0), np.full(n - 1, 30.0)]
    A = sparse.csr_matrix(sparse.diags(lines, [-1, 0, 1]))
    B, C = np.zeros((n, 1)), np.zeros((1, n))
    B[20:25], C[0, 30:50] = 1.0, 3.0
    Q, factored = (C, True) if weight == "factor" else (np.linspace(1, 2, n), False)
    N = None if not crossed else 0.8 * C.T if factored else 0.3 * B
    host = lqr(A, B, Q, None, N, factored=factored)
    moved = [None if M is None else cupy.asarray(M) for M in (B, Q, N)]
    found = lqr(device.csr_matrix(A), *moved[:2], None, moved[2], factored=factored)
    assert isinstance(found.K, cupy.ndarray)
    assert found.stable
    np.testing.assert_allclose(found.K.get(), host.K, atol=1e-8 * np.abs(host.K).max())
