"""Riccati equations with known solutions, and the benchmark collection beside SciPy and SLICOT."""

import carex_problems as carex
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from gpu import InputError, RiccatiError, care, lqr

# The published weight of 1.4 is indefinite: an equation, no regulator.
EQUATIONS = carex.UNKNOWN | {"1.4": carex.example_1_4()}


def distance(X, wanted):
    return np.linalg.norm(X - wanted) / np.linalg.norm(wanted)


@pytest.mark.parametrize("name", carex.BENIGN | carex.HARD)
def test_closed_forms(name):
    """Hard parameters beside SciPy."""
    A, B, Q, R, X = (carex.BENIGN | carex.HARD)[name]
    theirs = distance(solve_continuous_are(A, B, Q, R), X)
    bound = 1e-13 if name in carex.BENIGN else max(10 * theirs, 1e-14)
    assert distance(care(A, B, Q, R), X) <= bound


@pytest.mark.parametrize("e", [1e-8, 1e-9, 1e-10])
def test_a_pole_nearly_on_the_axis(e):
    """Example 2.4 where the residual of its slow mode, of size e^2, is below that of its terms in
    extended precision."""
    A, B, Q, R, X = carex.example_2_4(e)
    found = care(A, B, Q, R)
    assert distance(found, X) <= 1e-9
    if e == 1e-9:  # found by exact residuals: this mode has digits, those of S in doubles
        # The mode of the doubles that A holds: x^2 - 2 d x - q = 0.
        d = A[0, 0] - 1.0
        x = d + np.hypot(d, np.sqrt(Q[0, 0]))
        assert found[0, 0] - found[0, 1] == pytest.approx(x, rel=1e-6)


@pytest.mark.parametrize("name", carex.UNKNOWN)
def test_certified_where_no_solution_is_known(name):
    A, B, Q, R, _ = carex.UNKNOWN[name]
    result = lqr(A, B, Q, R)
    assert result.converged
    assert result.residual <= 1e-12
    assert np.linalg.eigvals(A - B @ result.K).real.max() < 0.0
    np.testing.assert_array_equal(result.S, result.S.T)


@pytest.mark.parametrize(
    "name", ["1.3", "1.4", "1.5", "2.2 e=1.0", "2.7 e=1.0", "2.8 e=1.0", "3.1 l=20", "4.3 l=30"]
)
def test_agrees_with_scipy_and_slycot(name):
    A, B, Q, R, _ = EQUATIONS[name]
    X = care(A, B, Q, R)
    assert distance(X, solve_continuous_are(A, B, Q, R)) <= 1e-10
    slycot = pytest.importorskip("slycot")
    theirs = slycot.sb02md(len(A), A, B @ np.linalg.solve(R, B.T), Q, "C")[0]
    assert distance(X, theirs) <= 1e-9


def test_an_equation_without_a_regulator():
    """Some states of example 1.4 are paid for: the equation has its solution, the cost none."""
    A, B, Q, R, _ = EQUATIONS["1.4"]
    X = care(A, B, Q, R)
    assert np.linalg.eigvalsh(Q)[0] < 0.0
    assert np.linalg.eigvals(A - B @ B.T @ X).real.max() < 0.0
    residual = A.T @ X + X @ A - X @ B @ B.T @ X + Q
    assert np.linalg.norm(residual) <= 1e-14 * np.linalg.norm(Q)
    with pytest.raises(InputError, match=r"gpu\.care"):
        lqr(A, B, Q, R)


def test_a_chain_of_integrators_an_indefinite_weight_and_a_diagonal():
    A, B, Q, R, _ = carex.example_4_1(12, q=4.0, r=9.0)
    assert care(A, B, Q, R)[0, -1] == pytest.approx(6.0, rel=1e-12)
    A, B, Q, R, X = carex.example_2_5(0.1)
    assert np.linalg.eigvalsh(Q)[0] < 0.0
    assert distance(care(A, B, Q, R), X) <= 1e-12
    A, B, Q, R, X = carex.example_2_1(1.0)
    assert distance(care(np.diag(A), B, Q, R), X) <= 1e-13


@pytest.mark.parametrize("n", [512, pytest.param(4096, marks=pytest.mark.slow)])
def test_circulant(n):
    A, B, Q, R, X = carex.example_3_2(n)
    result = lqr(A, B, Q, R)
    assert distance(result.S, X) <= 1e-12
    assert result.converged
    assert result.abscissa == pytest.approx(-1.0, rel=1e-12)


def test_mass_matrix_of_the_heat_equation():
    (A, B, Q, R, _), E = carex.example_4_2(60)
    X = care(A, B, Q, R, E)
    assert distance(X, solve_continuous_are(A, B, Q, R, e=E)) <= 1e-9
    K = B.T @ X @ E
    assert np.linalg.eigvals(np.linalg.solve(E, A - B @ K)).real.max() < 0.0


def test_no_solution_where_the_closed_loop_would_swing_forever():
    A, B, Q, R, _ = carex.example_2_5(0.0)
    with pytest.raises(RiccatiError, match="imaginary axis") as caught:
        care(A, B, Q, R)
    assert caught.value.eigenvalue == pytest.approx(1j, abs=1e-6)
