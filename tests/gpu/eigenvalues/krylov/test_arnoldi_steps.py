"""Projected matrices from products with vectors beside the basis, as sweeps on a device give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from gpu.eigenvalues.krylov.arnoldi import ArnoldiSteps


def decomposition(n, size, kept, rng):
    """A of order n, orthonormal rows V with ``A V = V S`` and S an arrow before `kept`."""
    V = np.linalg.qr(rng.standard_normal((n, n)))[0].T
    S = np.triu(rng.standard_normal((n, n)), -1)
    S[:kept, :kept] = rng.standard_normal((kept, kept))
    S[kept, :kept] = rng.standard_normal(kept)
    return V.T @ S @ V, V[: size + 1], S


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 6), st.integers(1, 12), st.floats(-16.0, 0.0), st.integers(0, 2**32 - 1))
def test_coefficients_are_turned_into_those_of_the_basis(kept, count, power, seed):
    """However large what lies beside the basis vectors is."""
    rng = np.random.default_rng(seed)
    size, n = kept + count, kept + count + 5
    A, V, S = decomposition(n, size, kept, rng)
    rows = np.full((count, 2, size + 2), np.nan)
    for i in range(count):
        j = kept + i
        r = 10.0**power * rng.standard_normal(j)
        image = V @ A @ (V[j] + r @ V[:j])
        rows[i, 0, : j + 1], rows[i, 0, -1] = image[: j + 1], image[j + 1]
        rows[i, 1, :j] = r
    rows = np.nan_to_num(rows)
    found = np.zeros((n, n))
    found[: kept + 1, :kept] = S[: kept + 1, :kept]
    if kept:
        found[kept, kept - 1] = S[kept, kept - 1]
    ArnoldiSteps.of(rows).project(found, kept, size)
    growth = np.linalg.cond(np.eye(size) + 10.0**power * np.triu(np.ones((size, size)), 1))
    assert found[:size, kept:size] == pytest.approx(
        S[:size, kept:size], abs=1e-13 * growth * np.abs(S).max() * size
    )


def test_locked_vectors_are_left_out():
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((3, 2, 10))
    rows[:, 1] *= 1e-3
    rows[:, 1, 4:7] *= np.tri(3, 3, -1)
    S, expected = np.zeros((2, 5, 5))
    ArnoldiSteps.of(rows).project(S, 0, 3, locked=4)
    H = rows[:, 0, 4:7].T.copy()
    H[[1, 2], [0, 1]] = rows[:2, 0, -1]
    R = np.eye(3) + rows[:, 1, 4:7].T
    expected[:3, :3] = linalg.solve_triangular(R, H.T, trans="T", unit_diagonal=True).T
    assert np.abs(S - expected).max() < 1e-15


def test_what_ends_a_sweep():
    rows = np.ones((4, 1, 6))
    assert ArnoldiSteps.of(rows).ended is None
    rows[2, 0, -1] = 1e-15
    steps = ArnoldiSteps.of(rows)
    assert steps.ended == 2
    assert steps.finite
    assert steps.beside is None
    rows[3, 0, 1] = np.inf
    assert not ArnoldiSteps.of(rows).finite
