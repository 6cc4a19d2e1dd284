"""Discrete regulators and Riccati equations beside closed forms, SciPy and 50 digits."""

import mpmath
import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag, solve_discrete_are

from gpu import InputError, NotConverged, RiccatiError, dare, dlqr, lqr
from gpu.riccati.methods import doubling
from gpu.riccati.problem.lqr_problem import check_lqr
from gpu.riccati.proof.discrete import loop_of, residual_of


def system(seed, n=6, m=2, kind="real"):
    """A, B, Q, R, E, S with an unstable A."""
    rng = np.random.default_rng(seed)

    def draw(*shape):
        real = rng.standard_normal(shape)
        return real + 1j * rng.standard_normal(shape) if kind == "complex" else real

    A, B, C, M = draw(n, n), draw(n, m), draw(3, n), draw(m, m)
    A *= 1.4 / np.abs(np.linalg.eigvals(A)).max()
    Q, R = C.conj().T @ C, M @ M.conj().T + np.eye(m)
    if kind == "indefinite":
        Q, R = Q - 1e-3 * np.eye(n), np.diag([1.0, -900.0])
    if kind == "no cost of inputs":
        R = np.zeros((m, m))
    return A, B, Q, R, 2 * np.eye(n) + draw(n, n) / n, 0.1 / n * draw(n, m)


def check(X, A, B, Q, R, E=None, S=None):
    """The equation and the closed loop, from the data alone."""
    E = np.eye(len(A)) if E is None else E
    cross = A.conj().T @ X @ B + (0.0 if S is None else S)
    K = np.linalg.solve(R + B.conj().T @ X @ B, cross.conj().T)
    left = A.conj().T @ X @ A - E.conj().T @ X @ E - cross @ K + Q
    assert np.linalg.norm(left) <= 1e-12 * np.linalg.norm(A.conj().T @ X @ A)
    assert np.abs(np.linalg.eigvals(np.linalg.solve(E, A - B @ K))).max() < 1.0
    np.testing.assert_array_equal(X, X.conj().T)
    return K


@pytest.mark.parametrize("more", ["", "E", "S", "E S"])
@pytest.mark.parametrize(
    ("kind", "n", "m"),
    [("real", 6, 2), ("complex", 6, 2), ("indefinite", 6, 2), ("no cost of inputs", 6, 2),
     ("real", 140, 40)],  # residuals in extended precision up to 128
)  # fmt: skip
def test_beside_scipy(kind, n, m, more):
    A, B, Q, R, E, S = system(3, n, m, kind)
    E, S = E if "E" in more else None, S if "S" in more else None
    X = dare(A, B, Q, R, E, S)
    check(X, A, B, Q, R, E, S)
    if E is not None:  # SciPy's argument e fails here: E is not symmetric
        A, B, X = np.linalg.solve(E, A), np.linalg.solve(E, B), E.conj().T @ X @ E
    theirs = solve_discrete_are(A, B, Q, R, s=S)
    assert np.linalg.norm(X - theirs) <= 1e-9 * np.linalg.norm(theirs)


@pytest.mark.parametrize("r", [0.0, 1e-8, 1.0, 1e8])
@pytest.mark.parametrize("q", [1e-6, 1.0])
@pytest.mark.parametrize("a", [0.0, 0.5, 1.0, -3.0])
def test_scalar(a, q, r):
    """``b^2 x^2 + (r - a^2 r - b^2 q) x - q r = 0``."""
    with mpmath.workdps(50):
        b, A, qq, rr = 2, mpmath.mpf(a), mpmath.mpf(q), mpmath.mpf(r)
        p = rr - A**2 * rr - b**2 * qq
        x = float((-p + mpmath.sqrt(p * p + 4 * b**2 * qq * rr)) / (2 * b**2))
    assert dare([[a]], [[2.0]], [[q]], [[r]])[0, 0] == pytest.approx(x, rel=1e-14)


def test_beside_fifty_digits():
    """Newton's steps in 50 digits, from SciPy's solution of a problem with poles near the circle:
    the loss of digits there is SciPy's own."""
    A = np.array([[1.0, 1e-3, 0], [0, 1, 1e-3], [0, 0, 1]])
    B, Q, R = np.array([[0.0], [0], [1e-3]]), np.diag([1.0, 0, 0]), np.array([[1e-4]])
    theirs = solve_discrete_are(A, B, Q, R)
    with mpmath.workdps(50):
        a, b, q, r, x = (mpmath.matrix(M.tolist()) for M in (A, B, Q, R, theirs))
        for _ in range(6):
            k = (r + b.T * x * b) ** -1 * (b.T * x * a)
            c, x = a - b * k, q + k.T * r * k
            while mpmath.mnorm(c) > mpmath.mpf(10) ** -60:
                x, c = x + c.T * x * c, c * c
        exact = np.array(x.tolist(), dtype=float)
    assert np.linalg.norm(dare(A, B, Q, R) - exact) <= 1e-15 * np.linalg.norm(exact)
    assert np.linalg.norm(theirs - exact) > 1e-13 * np.linalg.norm(exact)


def test_inputs_for_nothing_reach_the_origin_at_once():
    A, B, Q, *_ = system(5, 3, 3)
    result = dlqr(A, B, Q, 0.0)
    K, S, E = result
    assert result.info["path"] == "shifted doubling"
    np.testing.assert_allclose(S, Q, rtol=0, atol=1e-14 * np.abs(Q).max())
    np.testing.assert_allclose(K, np.linalg.solve(B, A), rtol=1e-12)
    assert np.abs(E).max() < 1e-13


def test_cost_of_a_simulated_loop():
    A, B, Q, R, E, _ = system(7)
    N = 0.1 * np.ones((6, 2)) * np.sqrt(np.linalg.eigvalsh(Q)[0].clip(0)) + Q[:, :2] * 0.1
    result = dlqr(A, sparse.csr_array(B), Q, R, N, E)
    x, spent = np.arange(1.0, 7.0), 0.0
    for _ in range(400):
        u = -result.K @ x
        spent += x @ Q @ x + 2 * x @ N @ u + u @ R @ u
        x = np.linalg.solve(E, A @ x + B @ u)
    assert result.cost(np.arange(1.0, 7.0)) == pytest.approx(spent, rel=1e-12)
    assert np.allclose(check(result.S, A, B, Q, R, E, N), result.K, rtol=1e-11)
    K, _, poles = result
    found = np.abs(np.linalg.eigvals(np.linalg.solve(E, A - B @ K)))
    np.testing.assert_allclose(np.abs(poles), np.sort(found)[::-1], rtol=1e-9)
    assert result.stable
    assert result.radius == abs(poles[0])
    assert result.residual <= 1e-15
    assert result.error <= 1e-14


def test_diagonals_lists_and_numbers():
    values, b = np.array([1.5, -0.5, 0.2]), np.ones(3)
    want = dlqr(np.diag(values), b[:, None], np.eye(3), np.eye(1))
    for given in (dlqr(values, b, 1.0), dlqr(sparse.diags_array(values), b.tolist(), np.ones(3))):
        np.testing.assert_allclose(given.K, want.K, rtol=1e-13)


CASES = {
    "grows, no input": (np.diag([1.2, 0.5]), [0, 1], np.eye(2), 1.2, "not stabilisable"),
    "stays, no input": (np.diag([1.0, 0.5]), [0, 1], np.eye(2), 1.0, "not stabilisable"),
    "stays, no weight": (np.diag([-1.0, 0.5]), [1, 1], np.diag([0.0, 1]), -1.0, "not detectable"),
    "turns, no weight": (
        block_diag([[0.0, 1], [-1, 0]], 0.5), [1, 1, 1], np.diag([0.0, 0, 1]), 1j, "not detectable",
    ),
}  # fmt: skip


@pytest.mark.parametrize("turned", [False, True], ids=["", "rotated"])
@pytest.mark.parametrize("name", CASES)
def test_the_mode_in_the_way_is_named(name, turned):
    A, b, Q, mode, cause = CASES[name]
    B = np.array(b, dtype=float)[:, None]
    if turned:
        T = np.linalg.qr(np.random.default_rng(0).standard_normal(A.shape))[0]
        A, B, Q = T @ A @ T.T, T @ B, T @ Q @ T.T
        Q = (Q + Q.T) / 2
    for solve in (dlqr, dare):
        with pytest.raises(RiccatiError, match=cause) as caught:
            solve(A, B, Q, np.eye(1))
        assert caught.value.cause == cause
        assert caught.value.eigenvalue == pytest.approx(mode, abs=1e-6)


def test_no_solution_where_poles_meet_on_the_circle():
    """The pencil's eigenvalues satisfy ``z + 1/z = (1 + a^2 + q b^2 / r) / a``."""
    for q in (-1.0, -1.0 - 1e-3):
        with pytest.raises(RiccatiError, match="unit circle"):
            dare([[2.0]], [[1.0]], [[q]], [[1.0]])
    x = dare([[2.0]], [[1.0]], [[-0.5]], [[1.0]])[0, 0]
    assert x == pytest.approx((2.5 + np.sqrt(2.5**2 - 2)) / 2, rel=1e-14)


def test_a_solution_of_few_digits_near_the_circle_is_not_called_stable():
    """(x - 1)^2 = 0 of a = 2, q = -1 has its pole at one; x = 1 + 1e-9 seems to be inside."""
    problem = check_lqr([[2.0]], [[1.0]], [[-1.0]], [[1.0]], None, None, discrete=True)
    S, unit = np.array([[1.0 + 1e-9]]), np.ones(1)
    loop = loop_of(problem, S, unit, residual_of(problem, S, unit))
    assert loop.radius < 1.0 - 1e-10
    assert not loop.is_stable()


BAD = {
    "Q is not positive semidefinite": ([[0.5]], [[1.0]], -0.1, 1.0),
    "R is not positive semidefinite": ([[0.5]], [[1.0]], 1.0, -10.0),
    "R is singular": ([[2.0]], [[1.0, 1.0]], 1.0, 0.0),
    "E is singular": ([[2.0]], [[1.0]], 1.0, 1.0, None, [[0.0]]),
    "Q is not symmetric": (np.eye(2), np.eye(2), [[1.0, 1.0], [0.0, 1.0]]),
    "A holds complex": ([[1j]], [[1.0]], 1.0),
    "expected .1, m., a row": ([[2.0]], [[1.0], [1.0]], 1.0),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input(message):
    with pytest.raises(InputError, match=message):
        dlqr(*BAD[message])


def test_a_solution_that_does_not_stabilise_is_refused(monkeypatch):
    """S = 0 solves the equation of a = 2, q = 0, and leaves the pole where it is."""
    wrong = lambda *_, **__: (np.zeros((1, 1)), {"iterations": 1, "path": "doubling"})  # noqa: E731
    monkeypatch.setattr(doubling, "_by_discrete_doubling", wrong)
    assert dare([[2.0]], [[1.0]], [[0.0]], [[1.0]]) == 3.0  # by QZ
    monkeypatch.setattr(doubling, "_by_qz", wrong)
    with pytest.raises(NotConverged, match="spectral radius 2"):
        dare([[2.0]], [[1.0]], [[0.0]], [[1.0]])


@pytest.mark.parametrize("solve", [lqr, dlqr])
@pytest.mark.parametrize(
    "x0", [[1.0], [1j, 0.0], [np.nan, 1.0], np.ma.masked_equal([1.0, 2.0], 2.0), [[1.0], [2.0]]]
)
def test_what_is_no_state_has_no_cost(solve, x0):
    with pytest.raises(InputError, match="x0"):
        solve(0.5 * np.eye(2), np.eye(2), 1.0).cost(x0)
