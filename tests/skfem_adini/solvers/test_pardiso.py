"""The one call of PARDISO: phases, Schur complements, partial solutions, errors, release."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optional_packages import PARDISO
from scipy import sparse

from skfem_adini import AdiniError, factorize
from skfem_adini.errors import SolverError
from skfem_adini.solvers import pardiso
from skfem_adini.solvers.device_triangle import upper_triangle

pytestmark = PARDISO


def definite(n, seed):
    rng = np.random.default_rng(seed)
    A = sparse.random_array((n, n), density=0.3, rng=rng)
    return sparse.csr_array(A + A.T + 2 * n * sparse.eye_array(n))


@given(n=st.integers(2, 30), seed=st.integers(0, 99), loads=st.integers(1, 3))
def test_analysis_factorisation_and_solution(n, seed, loads):
    A = definite(n, seed)
    exact = np.asfortranarray(np.random.default_rng(seed).uniform(-1, 1, (n, loads)))
    b, x = np.asfortranarray(A @ exact), np.zeros((n, loads), order="F")
    given_b = b.copy()
    solver = pardiso.Pardiso(A, pardiso.DEFINITE)
    for phase in (11, 22):
        solver(phase)
    solver(33, b, x)
    np.testing.assert_allclose(x, exact, atol=1e-12)
    np.testing.assert_array_equal(b, given_b)


@given(n=st.integers(3, 25), seed=st.integers(0, 99), share=st.floats(0.1, 0.6))
def test_schur_complement_and_partial_solutions(n, seed, share):
    """Forward elimination leaves the reduced load, backward gives all unknowns from the chosen."""
    A = definite(n, seed)
    chosen = np.sort(np.random.default_rng(seed).permutation(n)[: max(1, int(share * n))])
    inner = np.setdiff1d(np.arange(n), chosen)
    dense = A.toarray()
    coupling = dense[np.ix_(chosen, inner)] @ np.linalg.inv(dense[np.ix_(inner, inner)])
    expected = dense[np.ix_(chosen, chosen)] - coupling @ dense[np.ix_(inner, chosen)]

    solver = pardiso.Pardiso(A, pardiso.DEFINITE, {1: 3, 23: 1, 35: 2}, chosen)
    block = np.zeros((chosen.size, chosen.size))
    solver(11)
    solver(22, x=block)
    np.testing.assert_allclose((block + block.T) / 2, expected, atol=1e-10)

    exact = np.random.default_rng(seed + 1).uniform(-1, 1, n)
    load, half, x = A @ exact, np.zeros(n), np.zeros(n)
    solver(331, load, half)
    reduced = load[chosen] - coupling @ load[inner]
    np.testing.assert_allclose(half[chosen], reduced, atol=1e-10)
    half[chosen] = exact[chosen]
    solver(333, half, x)
    np.testing.assert_allclose(x[inner], exact[inner], atol=1e-11)


def test_zeros_on_the_diagonal_are_stored():
    """Matrices of constrained problems have none there, PARDISO wants them all the same."""
    A = sparse.csr_array([[0.0, 1, 2], [1, 0, 0], [2, 0, 1]])
    upper = upper_triangle(A)
    assert upper.nnz == 5
    x = factorize(A, definite=False, solver="pardiso").solve(A @ [1.0, 2, 3])
    np.testing.assert_allclose(x, [1, 2, 3], atol=1e-12)


def test_pivots_are_told_from_other_errors():
    solver = pardiso.Pardiso(sparse.csr_array([[1.0, 2], [2, 1]]), pardiso.DEFINITE)
    with pytest.raises(SolverError, match="phase 12 failed with code -4") as caught:
        solver(12)
    assert caught.value.pivot
    solver = pardiso.Pardiso(definite(3, 0), pardiso.DEFINITE)
    with pytest.raises(SolverError, match="phase 99") as caught:
        solver(99)
    assert not caught.value.pivot


def test_what_would_end_the_process_is_refused():
    """PARDISO reads whatever memory it is pointed at."""
    solver = pardiso.Pardiso(definite(4, 0), pardiso.DEFINITE)
    b, x = np.ones(4), np.zeros(4)
    with pytest.raises(AdiniError, match="phase 33 needs a factorisation"):
        solver(33, b, x)
    solver(12)
    columns = np.ones((4, 2))
    for bad in (None, np.ones(3), np.ones(4, dtype=np.float32), np.ones(8)[::2], columns):
        with pytest.raises(AdiniError, match="float64 in Fortran order with 4 rows"):
            solver(33, bad, x)
    solver(33, b, x)
    np.testing.assert_allclose(definite(4, 0) @ x, b)


def test_memory_is_given_back(monkeypatch):
    phases = []
    library = pardiso._library()

    def watched(*arguments):
        phases.append(arguments[4]._obj.value)
        return library(*arguments)

    monkeypatch.setattr(pardiso, "_library", lambda: watched)
    solver = pardiso.Pardiso(definite(5, 0), pardiso.DEFINITE)
    solver(12)
    del solver
    assert phases == [12, -1]


def test_memory_is_given_back_where_nothing_can_be_imported(monkeypatch):
    """The garbage collector may release a factor anywhere, with any modules hidden."""
    phases = []
    library = pardiso._library()
    monkeypatch.setattr(
        pardiso, "_library", lambda: lambda *a: (phases.append(a[4]._obj.value), library(*a))
    )
    solver = pardiso.Pardiso(definite(5, 0), pardiso.DEFINITE)
    solver(12)
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    del solver
    assert phases == [12, -1]
