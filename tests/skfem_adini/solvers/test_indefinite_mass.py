"""Matrices that are not definite are refused or told of, and every pair is checked."""

from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optional_packages import PARDISO
from scipy import linalg, sparse
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementQuadAdini,
    IndefiniteWarning,
    InputError,
    NotConverged,
    essential_dofs,
    lowest_eigenpairs,
)

module = import_module("skfem_adini.solvers.lowest_eigenpairs")
SOLVERS = [pytest.param("pardiso", marks=PARDISO), "superlu"]


def coupled(n, off):
    """Return a matrix of unit diagonal with the eigenvalues 1 + 2 off cos(k pi / (n + 1))."""
    return sparse.diags_array([off, 1.0, off], offsets=[-1, 0, 1], shape=(n, n)).tocsr()


def bar(n):
    return sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("shift", [None, 0.0])
@pytest.mark.parametrize("off", [0.51, 0.6, 0.9, -0.6])
def test_mass_with_positive_diagonal_that_is_not_definite(off, shift, solver):
    """It gave negative eigenvalues of a definite K, as if they were the lowest."""
    n = 100
    assert linalg.eigvalsh(coupled(n, off).toarray())[0] < -1e-3
    with pytest.raises(InputError, match=r"M: .* positive definite"):
        lowest_eigenpairs(bar(n), coupled(n, off), 3, shift=shift, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_negative_direction_among_many(solver):
    """One pair of dofs is coupled too strongly; the lowest eigenvalues do not see it."""
    basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    K, M = laplace.assemble(basis), mass.assemble(basis).tolil()
    i, j = np.setdiff1d(basis.nodal_dofs[0], fixed)[[3, 30]]
    M[i, j] = M[j, i] = 1.01 * np.sqrt(M[i, i] * M[j, j])
    with pytest.raises(InputError, match="M: "):
        lowest_eigenpairs(K, M.tocsr(), 2, fixed, solver=solver)


@settings(max_examples=40, deadline=None)
@given(st.integers(6, 40), st.floats(-0.4, 1.4), st.integers(0, 2**31), st.sampled_from([None, 0]))
def test_random_matrices_are_answered_rightly_or_refused(n, move, seed, shift):
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((n, n))
    K = G @ G.T + np.eye(n)
    B = rng.standard_normal((n, n))
    M = B @ B.T / n
    M += (move - 0.3) * np.eye(n)
    M = M + np.diag(np.maximum(0.01 - np.diag(M), 0))
    least = linalg.eigvalsh(M / np.sqrt(np.outer(np.diag(M), np.diag(M))))[0]
    if abs(least) < 1e-8:
        return
    matrices = sparse.csr_matrix(K), sparse.csr_matrix(M)
    for solver in ("auto", "superlu"):
        if least < 0:
            with pytest.raises(InputError, match="M: "):
                lowest_eigenpairs(*matrices, 2, shift=shift, solver=solver)
        else:
            values, _ = lowest_eigenpairs(*matrices, 2, shift=shift, solver=solver)
            exact = linalg.eigh(K, M, eigvals_only=True)[:2]
            np.testing.assert_allclose(values, exact, rtol=1e-7)


@pytest.mark.parametrize("solver", SOLVERS)
def test_shift_above_an_eigenvalue_is_refused(solver):
    """SuperLU goes on with negative pivots: the eigenvalues next to the shift are not the least."""
    K = bar(50)
    exact = 2 - 2 * np.cos(np.arange(1, 4) * np.pi / 51)
    between = 0.5 * (exact[0] + exact[1])
    with pytest.raises(InputError, match="definite"):
        lowest_eigenpairs(K, sparse.eye_array(50).tocsr(), 1, shift=between, solver=solver)
    values, _ = lowest_eigenpairs(K, sparse.eye_array(50).tocsr(), 3, shift=0.0, solver=solver)
    np.testing.assert_allclose(values, exact, rtol=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("lowest", [-1e-6, -0.5, -3555.0])
def test_negative_eigenvalue_is_said(lowest, solver):
    n = 60
    K = sparse.diags_array(np.append(lowest, np.linspace(1, 4e3, n - 1))).tocsr()
    M = coupled(n, 0.1)
    with pytest.warns(IndefiniteWarning, match="negative"):
        values, _ = lowest_eigenpairs(K, M, 2, solver=solver)
    exact = linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)
    np.testing.assert_allclose(values, exact[:2], rtol=1e-7)


def test_every_pair_is_checked_by_its_residual(monkeypatch):
    given = module.eigsh

    def wrong(*args, **options):
        values, z = given(*args, **options)
        values[-1] *= 1 + 1e-3
        return values, z

    monkeypatch.setattr(module, "eigsh", wrong)
    with pytest.raises(NotConverged, match="residual"):
        lowest_eigenpairs(bar(50), sparse.eye_array(50).tocsr(), 3)


def test_lumped_mass_is_not_factored(monkeypatch):
    """A matrix dominated by its diagonal is definite."""
    calls = []
    given = module.factorize
    monkeypatch.setattr(module, "factorize", lambda *a, **o: calls.append(a) or given(*a, **o))
    lowest_eigenpairs(bar(50), sparse.eye_array(50).tocsr(), 3)
    assert len(calls) == 1
