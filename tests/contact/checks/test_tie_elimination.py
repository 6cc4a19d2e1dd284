"""Equations of ties, also dependent ones, solved exactly before other packages see them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact.checks.frozen_problem import TieElimination


@settings(deadline=None, max_examples=60)
@given(
    st.integers(1, 8), st.integers(0, 8), st.integers(0, 3), st.floats(-4, 4), st.integers(0, 999)
)
def test_every_solution_and_the_forces(n, count, copies, decades, seed):
    """Against the pseudo-inverse, in unknowns of several units, with dependent equations."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.uniform(-abs(decades), abs(decades), n)
    A = rng.standard_normal((count, n))
    A = np.vstack((A, rng.standard_normal((copies, count)) @ A))
    E, z = A / unit, unit * rng.standard_normal(n)
    ties = TieElimination.of(E, E @ z, unit)
    rank = min(count, n)
    assert ties.free.shape == (n, n - rank)
    np.testing.assert_allclose(A @ (ties.start / unit), A @ (z / unit), atol=1e-8)
    np.testing.assert_allclose(A @ (ties.free / unit[:, None]), 0.0, atol=1e-10)
    # All solutions are reached.
    y = np.linalg.lstsq(ties.free / unit[:, None], (z - ties.start) / unit, rcond=None)[0]
    np.testing.assert_allclose((ties.start + ties.free @ y) / unit, z / unit, atol=1e-6)
    load = E.T @ rng.standard_normal(len(E))
    forces = ties.forces(load, len(E))
    np.testing.assert_allclose(unit * (E.T @ forces), unit * load, atol=1e-6)
    assert np.count_nonzero(forces) <= rank


def test_equations_alone_may_decide():
    E = np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 0.0]])
    ties = TieElimination.of(E, np.array([3.0, 4.0, 3.0]), np.ones(2))
    assert ties.start == pytest.approx([3.0, 2.0])
    assert ties.free.shape == (2, 0)
    assert TieElimination.of(np.zeros((2, 3)), np.zeros(2), np.ones(3)).free.shape == (3, 3)
