"""GMRES beside dense solutions, in any unit of the right-hand side."""

import numpy as np
import pytest

from contact.arrays.krylov import gmres


@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e20])
@pytest.mark.parametrize("n", [12, 60])
def test_solutions_do_not_depend_on_units(unit, n):
    """As many products in any unit: nothing is compared with the size of the right-hand side."""
    rng = np.random.default_rng(n)
    A = np.eye(n) + 0.1 * rng.standard_normal((n, n))
    M = np.diag(rng.uniform(0.5, 2.0, n))
    b = rng.standard_normal(n)
    x, products = gmres(lambda v: A @ v, unit * b, lambda v: M @ v, 1e-12, 300)
    assert np.linalg.norm(A @ x / unit - b) <= 1.1e-12 * np.linalg.norm(b)
    assert products == gmres(lambda v: A @ v, b, lambda v: M @ v, 1e-12, 300)[1]
    assert products < 120


def test_a_space_that_is_exhausted_ends_the_basis():
    """Two eigenvalues, two products, and one for the residual."""
    A, b = np.diag([1.0, 1.0, 3.0, 3.0]), 1e15 * np.arange(1.0, 5.0)
    x, products = gmres(lambda v: A @ v, b, lambda v: v, 1e-15, 50)
    assert x == pytest.approx(b / np.diag(A), rel=1e-14)
    assert products <= 6
