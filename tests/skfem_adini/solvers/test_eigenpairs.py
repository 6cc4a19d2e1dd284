"""Lowest eigenpairs, and what the extended-precision Rayleigh quotient adds."""

import numpy as np
import pytest
from optional_packages import PARDISO
from scipy import linalg
from skfem import Basis, BilinearForm, ElementQuad1, ElementVector, MeshHex, MeshQuad
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    InputError,
    UniformSolver,
    essential_dofs,
    lowest_eigenpairs,
    refine_eigenpair,
)

FINE = MeshQuad().refined(3)
SOLVERS = [
    pytest.param("pardiso", marks=PARDISO),
    "superlu",
]
PI = 4 * np.arctan(np.longdouble(1))
needs_long_double = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="numpy.longdouble is double here"
)


def square(n, lengths=(1.0, 1.0)):
    ticks = [np.linspace(0, l, n + 1) for l in lengths]
    return Basis(MeshQuad.init_tensor(*ticks), ElementQuadAdini())


def modes(basis, count, fixed=None):
    return lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), count, fixed)


@pytest.mark.turns(4)
@needs_long_double
def test_first_neumann_eigenvalue_to_round_off():
    """At n = 128 shift and invert alone is two orders of magnitude away from these numbers."""
    basis = square(128)
    values, x = modes(basis, 4)
    for place, square_sum, error in ((1, 1, 7.12e-15), (3, 2, 2.06e-13)):
        pair = refine_eigenpair(basis, x[:, place])
        assert float(pair.value / (square_sum * PI**2) - 1) == pytest.approx(error, rel=0.01)
        assert abs(values[place] - pair.value) < 1e-10
        assert pair.residual < 1e-10


@needs_long_double
@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
def test_shift_and_invert_alone_stalls(solver):
    """The discretisation error of the (1, 0) eigenvalue is 7.1e-15; rounding is far above it."""
    basis = square(128)
    K, M = laplace.assemble(basis), mass.assemble(basis)
    values, x = lowest_eigenpairs(K, M, 2, solver=solver)
    assert 2e-14 < abs(values[1] / np.pi**2 - 1) < 1e-11
    assert 0 < float(refine_eigenpair(basis, x[:, 1]).value / PI**2 - 1) <= 8e-15


@pytest.mark.turns(4)
@needs_long_double
def test_order_six_where_double_precision_stalls():
    errors = []
    for n in (16, 32, 64):
        basis = square(n)
        errors.append(float(refine_eigenpair(basis, modes(basis, 2)[1][:, 1]).value / PI**2 - 1))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, [5.89, 5.95], atol=0.01)
    assert errors[2] == pytest.approx(4.479e-13, rel=1e-3)


@needs_long_double
@pytest.mark.parametrize("n", [4, 8, 16, 32, 64])
def test_dirichlet_eigenvalues_are_those_of_the_symbol(n):
    basis = square(n)
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    values, x = modes(basis, 4, fixed)
    solver = UniformSolver((n, n))
    for place, mode in ((0, (1, 1)), (1, (1, 2)), (2, (2, 1)), (3, (2, 2))):
        exact = np.longdouble(str(solver.eigenvalue(*mode, digits=25)))
        assert abs(refine_eigenpair(basis, x[:, place], fixed).value / exact - 1) < 1e-17
        assert abs(values[place] / exact - 1) < 2e-12


@needs_long_double
def test_rectangular_cells_of_any_numbering():
    """Halved steps are exact in binary, so that the mesh is the solver's grid to the last bit."""
    basis = Basis(MeshQuad(FINE.p * [[1.0], [0.5]], FINE.t), ElementQuadAdini())
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    _, x = modes(basis, 2, fixed)
    exact = UniformSolver((8, 8), (1.0, 0.5)).eigenvalue(2, 1, digits=25)
    value = refine_eigenpair(basis, x[:, 1], fixed).value
    assert abs(value / np.longdouble(str(exact)) - 1) < 1e-17


def test_graded_cells():
    ticks = np.array([0, 0.1, 0.25, 0.5, 0.7, 1.0])
    basis = Basis(MeshQuad.init_tensor(ticks, ticks**2), ElementQuadAdini())
    values, x = modes(basis, 6)
    for place in range(1, 6):
        assert refine_eigenpair(basis, x[:, place]).value == pytest.approx(values[place], rel=1e-12)
    constant = refine_eigenpair(basis, x[:, 0])
    assert abs(constant.value) < 1e-20
    assert constant.residual < 1e-9


@pytest.mark.parametrize("width", ["double", "longdouble"])
def test_constant_has_no_energy_at_all(width, monkeypatch):
    """The mean of u is subtracted cell by cell, so that not even rounding is left of a constant."""
    monkeypatch.setattr(np, "longdouble", getattr(np, width))
    basis = square(7)
    x = basis.zeros()
    x[basis.nodal_dofs[0]] = 0.1
    pair = refine_eigenpair(basis, x)
    assert pair.value == 0
    assert pair.residual == 0


@pytest.mark.turns(4)
def test_double_precision_alone(monkeypatch):
    """Where long double is double, exact cell matrices and the subtracted mean are enough."""
    basis = square(64)
    _, x = modes(basis, 2)
    monkeypatch.setattr(np, "longdouble", np.float64)
    value = refine_eigenpair(basis, x[:, 1]).value
    assert value / np.pi**2 - 1 == pytest.approx(4.479e-13, abs=2e-15)


@pytest.mark.turns(4)
@needs_long_double
def test_cube():
    """The error of the lowest Neumann eigenvalue at n = 8 is 8.78e-8."""
    basis = Basis(MeshHex().refined(3), ElementHexAdini())
    _, x = modes(basis, 2)
    error = float(refine_eigenpair(basis, x[:, 1]).value / PI**2 - 1)
    assert error == pytest.approx(8.78e-8, rel=0.01)


def test_dirichlet_cube():
    basis = Basis(MeshHex().refined(2), ElementHexAdini())
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    _, x = modes(basis, 2, fixed)
    exact = float(UniformSolver((4, 4, 4)).eigenvalue(1, 1, 1))
    assert float(refine_eigenpair(basis, x[:, 0], fixed).value) == pytest.approx(exact, rel=1e-15)


@pytest.mark.parametrize("solver", ["auto", "superlu"])
def test_eigenvectors_are_orthonormal_and_solve_the_equation(solver):
    basis = square(6, (1.0, 1.3))
    K, M = laplace.assemble(basis), mass.assemble(basis)
    values, x = lowest_eigenpairs(K, M, 6, solver=solver)
    np.testing.assert_allclose(x.T @ M @ x, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(x.T @ K @ x, np.diag(values), atol=1e-10)
    assert (np.diff(values) > 0).all()


def test_fixed_dofs_are_zero_and_results_repeat():
    basis = square(5)
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    values, x = modes(basis, 3, fixed)
    np.testing.assert_array_equal(x[fixed], 0)
    again = modes(basis, 3, fixed)
    np.testing.assert_array_equal(again[0], values)
    np.testing.assert_array_equal(again[1], x)


def test_free_body_has_three_rigid_modes():
    basis = square(4).with_element(ElementVector(ElementQuadAdini()))
    K = linear_elasticity(1.0, 1.0).assemble(basis)
    M = BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    values, _ = lowest_eigenpairs(K, M, 7)
    np.testing.assert_allclose(values[:3], 0, atol=1e-9)
    np.testing.assert_allclose(values[4:6], 17.81, rtol=2e-3)


@pytest.mark.parametrize("side", [1.0, 1e5])
@pytest.mark.parametrize("count", [2, 6, 8])
@pytest.mark.parametrize("dim", [2, 3])
def test_rigid_modes_of_free_bodies_have_small_residuals(dim, count, side):
    """Rigid modes alone, all equal, next to a shift that is nearly zero."""
    ticks = [np.linspace(0, side, 3)] * dim
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*ticks)
    basis = Basis(mesh, ElementVector(ElementQuadAdini() if dim == 2 else ElementHexAdini()))
    K = linear_elasticity(1.0, 1.0).assemble(basis)
    M = BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    values, x = lowest_eigenpairs(K, M, count)
    exact = linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)
    np.testing.assert_allclose(values, exact[:count], rtol=1e-9, atol=1e-13 * exact[-1])
    energies = np.diag(x.T @ K @ x)
    np.testing.assert_allclose(energies, values, rtol=1e-9, atol=1e-13 * exact[-1])


BASIS = square(3)
K, M = laplace.assemble(BASIS), mass.assemble(BASIS)
MODE = lowest_eigenpairs(K, M, 2)[1][:, 1]
SHEARED = Basis(MeshQuad(np.array([[1, 0.4], [0, 1]]) @ FINE.p, FINE.t), ElementQuadAdini())

CASES = {
    "vector too short": (lambda: refine_eigenpair(BASIS, np.ones(5)), r"x: .*\(48,\)"),
    "zero vector": (lambda: refine_eigenpair(BASIS, BASIS.zeros()), "not zero"),
    "NaN vector": (lambda: refine_eigenpair(BASIS, np.full(48, np.nan)), "finite"),
    "no eigenvector": (lambda: refine_eigenpair(BASIS, MODE + 1e-3 * MODE**2), "no eigenvector"),
    "sheared cells": (lambda: refine_eigenpair(SHEARED, np.ones(SHEARED.N)), "axis-parallel"),
    "another element": (
        lambda: refine_eigenpair(BASIS.with_element(ElementQuad1()), np.ones(16)),
        "Adini's element",
    ),
    "too many": (lambda: lowest_eigenpairs(K, M, 48), "count: expected 1 to 47"),
    "none": (lambda: lowest_eigenpairs(K, M, 0), "count"),
    "matrices of two sizes": (lambda: lowest_eigenpairs(K, M[1:][:, 1:], 2), "K, M"),
    "shift in the spectrum": (lambda: lowest_eigenpairs(K, M, 2, shift=20.0), "definite"),
    "NaN shift": (lambda: lowest_eigenpairs(K, M, 2, shift=np.nan), "shift"),
    "negative mass": (lambda: lowest_eigenpairs(K, -M, 2), "M: "),
}


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    attempt, message = CASES[case]
    with pytest.raises(InputError, match=message):
        attempt()
