"""Equations of H-infinity type and with complex data, beside closed forms, SciPy and a rotation."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from gpu import InputError, RiccatiError, care, lqr


def system(seed, n=7, level=30.0, complex_too=False):
    """A, B, Q, R, E, S: two inputs that cost, two disturbances that are bounded by `level`."""
    rng = np.random.default_rng(seed)

    def draw(*shape):
        real = rng.standard_normal(shape)
        return real + 1j * rng.standard_normal(shape) if complex_too else real

    A, B = draw(n, n) / np.sqrt(n) - 0.7 * np.eye(n), draw(n, 4) / np.sqrt(n)
    C, U = draw(3, n) / np.sqrt(n), np.linalg.qr(draw(4, 4))[0]
    R = U.conj().T @ np.diag([1.0, 2.0, -(level**2), -(level**2)]) @ U
    E, S = 2 * np.eye(n) + draw(n, n) / n, 0.1 / n * draw(n, 4)
    return A, B @ U, C.conj().T @ C, (R + R.conj().T) / 2, E, S


def check(X, A, B, Q, R, E=None, S=None):
    E = np.eye(len(A)) if E is None else E
    cross = E.conj().T @ X @ B + (0.0 if S is None else S)
    K = np.linalg.solve(R, cross.conj().T)
    half = E.conj().T @ X @ A
    left = half + half.conj().T - cross @ K + Q
    assert np.linalg.norm(left) <= 1e-11 * max(np.linalg.norm(half), np.linalg.norm(Q))
    assert np.linalg.eigvals(np.linalg.solve(E, A - B @ K)).real.max() < 0.0
    np.testing.assert_array_equal(X, X.conj().T)


@pytest.mark.parametrize("more", ["", "E", "S", "E S"])
@pytest.mark.parametrize("complex_too", [False, True], ids=["real", "complex"])
@pytest.mark.parametrize("n", [1, 7, 70])
def test_beside_scipy(n, complex_too, more):
    A, B, Q, R, E, S = system(1, n, 100.0, complex_too)
    E, S = E if "E" in more else None, S if "S" in more else None
    X = care(A, B, Q, R, E, S)
    check(X, A, B, Q, R, E, S)
    if E is not None:  # SciPy's argument e loses digits where it is not symmetric
        A, B, X = np.linalg.solve(E, A), np.linalg.solve(E, B), E.conj().T @ X @ E
    theirs = solve_continuous_are(A, B, Q, R, s=S)
    assert np.linalg.norm(X - theirs) <= 1e-8 * np.linalg.norm(theirs)


@pytest.mark.parametrize("level", [1.01, 2.0, 100.0])
@pytest.mark.parametrize("a", [-1.0, 0.0, 3.0])
def test_scalar(a, level):
    """``2 a x - (1 - level^-2) x^2 + 1 = 0``; SciPy is not asked."""
    g = 1 - level**-2
    x = care([[a]], [[1.0, 1.0]], [[1.0]], np.diag([1.0, -(level**2)]))[0, 0]
    assert x == pytest.approx((a + np.hypot(a, np.sqrt(g))) / g, rel=1e-13)


def test_below_the_least_level_there_is_none():
    """At 1 / sqrt(2) the Hamiltonian of a = -1 has its eigenvalue at zero."""
    for level in (0.5, 0.7):
        with pytest.raises(RiccatiError, match="imaginary axis"):
            care([[-1.0]], [[1.0, 1.0]], [[1.0]], np.diag([1.0, -(level**2)]))
    level = 0.75  # between 1 / sqrt(2) and 1 the quadratic term has the other sign
    g = 1 - level**-2
    x = care([[-1.0]], [[1.0, 1.0]], [[1.0]], np.diag([1.0, -(level**2)]))[0, 0]
    assert x == pytest.approx((-1 + np.sqrt(1 + g)) / g, rel=1e-12)


def test_a_rotation_of_real_data_rotates_the_solution():
    A, B, Q, R, _, _ = system(2)
    T = np.linalg.qr(np.random.default_rng(0).standard_normal((7, 7)))[0]
    T = T * np.exp(1j * np.arange(7))
    X = care(T.conj().T @ A @ T, T.conj().T @ B, T.conj().T @ Q @ T, R)
    want = care(A, B, Q, R)
    assert np.linalg.norm(T @ X @ T.conj().T - want) <= 1e-12 * np.linalg.norm(want)


def test_diagonals_and_vectors():
    a, b = np.array([1.0 + 2j, -1.0]), np.array([1.0, 1j])
    X = care(a, b, np.ones(2), [[1.0]])
    check(X, np.diag(a), b[:, None], np.eye(2), np.eye(1))


def test_what_is_refused():
    A, B, Q, R, _, _ = system(3)
    with pytest.raises(InputError, match="R is not positive definite"):
        lqr(A, B, Q, R)
    with pytest.raises(InputError, match="R is singular"):
        care(A, B, Q, np.diag([1.0, -1.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="Q is not symmetric"):
        care(A + 0j, B, Q + 1j * np.eye(7), R)
    with pytest.raises(InputError, match=r"A holds complex.*gpu\.care"):
        lqr(A + 0j, B, Q)
    with pytest.raises(RiccatiError, match=r"1\.5 .- 2i of A is not stabilisable"):
        care([[1.5 - 2j, 0], [0, -1]], [[0.0], [1.0]], np.eye(2), [[1.0]])
