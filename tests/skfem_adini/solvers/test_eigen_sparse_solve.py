"""Factorisations of symmetric sparse matrices, with PARDISO and with SuperLU."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optional_packages import PARDISO
from scipy import sparse
from skfem import Basis, LinearForm, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementQuadAdini, InputError, MissingDependency, UniformSolver, factorize
from skfem_adini.solvers import factorize as sparse_solve

SOLVERS = [
    pytest.param("pardiso", marks=PARDISO),
    "superlu",
]


def random_matrix(n, seed, definite=True):
    rng = np.random.default_rng(seed)
    A = sparse.random_array((n, n), density=0.2, rng=rng)
    size = 10.0 ** rng.uniform(-6, 6, n)
    sign = np.ones(n) if definite else rng.choice([-1.0, 1.0], n)
    D = sparse.diags_array(size)
    return (D @ (A + A.T + sparse.diags_array(n * sign)) @ D).tocsr()


@pytest.mark.parametrize("definite", [True, False])
@pytest.mark.parametrize("solver", SOLVERS)
@given(n=st.integers(1, 40), seed=st.integers(0, 999), loads=st.integers(0, 3))
def test_solution_of_badly_scaled_matrices(solver, definite, n, seed, loads):
    A = random_matrix(n, seed, definite)
    exact = np.random.default_rng(seed).uniform(1, 2, (n, loads) if loads else n)
    D = 1 / np.sqrt(np.abs(A.diagonal()))
    exact = (exact.T * D).T
    x = factorize(A, definite, solver).solve(A @ exact)
    np.testing.assert_allclose(x, exact, rtol=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
def test_poisson(solver):
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 21)] * 2), ElementQuadAdini())
    uniform = UniformSolver((20, 20))
    I = uniform.free
    f = LinearForm(lambda v, w: np.exp(w.x[0]) * v).assemble(basis)
    x = factorize(laplace.assemble(basis)[I][:, I], solver=solver).solve(f[I])
    expected = uniform.solve(f)[I]
    np.testing.assert_allclose(x, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_shifted_into_the_spectrum(solver):
    basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    A = laplace.assemble(basis) - 30.0 * mass.assemble(basis)
    x = np.random.default_rng(0).uniform(-1, 1, basis.N)
    y = factorize(A, definite=False, solver=solver).solve(A @ x)
    np.testing.assert_allclose(y, x, atol=1e-10)


@PARDISO
def test_pardiso_and_superlu_agree():
    A, b = random_matrix(50, 0), np.ones(50)
    x, y = (factorize(A, solver=solver).solve(b) for solver in ("pardiso", "superlu"))
    np.testing.assert_allclose(x, y, rtol=1e-12)


def test_without_pypardiso(monkeypatch):
    monkeypatch.setattr(sparse_solve, "has_pardiso", lambda: False)
    assert factorize(sparse.eye_array(2)).solve(np.ones(2)).tolist() == [1, 1]
    with pytest.raises(MissingDependency, match=r"pip install 'skfem-adini\[mkl\]'"):
        factorize(sparse.eye_array(2), solver="pardiso")


NEUMANN = laplace.assemble(Basis(MeshQuad().refined(2), ElementQuadAdini()))
ASYMMETRIC = sparse.csr_array([[2.0, 1.0], [0.0, 2.0]])

CASES = {
    "singular": (lambda s: factorize(NEUMANN, True, s), "singular"),
    "zero row": (lambda s: factorize(sparse.diags_array([1.0, 0.0]), False, s), "row is zero"),
    "zero pivot": (lambda s: factorize(sparse.diags_array([1.0, 0.0]), True, s), "diagonal"),
    "not symmetric": (lambda s: factorize(ASYMMETRIC, True, s), "symmetric"),
    "not square": (lambda s: factorize(ASYMMETRIC[:1], True, s), "square"),
    "empty": (lambda s: factorize(sparse.csr_array((0, 0)), True, s), "square"),
    "NaN": (lambda s: factorize(sparse.diags_array([1.0, np.nan]), True, s), "NaN"),
    "wrong load": (lambda s: factorize(sparse.eye_array(3), True, s).solve(np.ones(2)), "3 rows"),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("case", CASES)
def test_error(case, solver):
    attempt, message = CASES[case]
    with pytest.raises(InputError, match=message):
        attempt(solver)


def test_unknown_solver():
    with pytest.raises(InputError, match="umfpack"):
        factorize(sparse.eye_array(2), solver="umfpack")


@PARDISO
def test_pardiso_finds_an_indefinite_matrix():
    A = sparse.csr_array([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(InputError, match="definite"):
        factorize(A, definite=True, solver="pardiso")
    np.testing.assert_allclose(factorize(A, definite=False).solve(A @ [3.0, 4.0]), [3, 4])
