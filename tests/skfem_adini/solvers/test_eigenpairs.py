"""Lowest eigenpairs: extended precision, the shift, matrices that are not definite."""

from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optional_packages import PARDISO
from scipy import linalg, sparse
from skfem import Basis, BilinearForm, ElementVector, MeshHex, MeshQuad
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import ElementQuadAdini, InputError, lowest_eigenpairs, refine_eigenpair

SOLVERS = [pytest.param("pardiso", marks=PARDISO), "superlu"]
PI = 4 * np.arctan(np.longdouble(1))
needs_long_double = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="numpy.longdouble is double here"
)


def square(n, lengths=(1.0, 1.0)):
    ticks = [np.linspace(0, l, n + 1) for l in lengths]
    return Basis(MeshQuad.init_tensor(*ticks), ElementQuadAdini())


def pair(basis):
    return laplace.assemble(basis), mass.assemble(basis)


def modes(basis, count, fixed=None):
    return lowest_eigenpairs(*pair(basis), count, fixed)


@pytest.mark.turns(4)
@needs_long_double
def test_first_neumann_eigenvalue_to_round_off():
    """At n = 128 shift and invert alone is two orders of magnitude away from these numbers."""
    basis = square(128)
    values, x = modes(basis, 4)
    assert 2e-14 < abs(values[1] / np.pi**2 - 1) < 1e-11
    for place, square_sum, error in ((1, 1, 7.12e-15), (3, 2, 2.06e-13)):
        pair = refine_eigenpair(basis, x[:, place])
        assert float(pair.value / (square_sum * PI**2) - 1) == pytest.approx(error, rel=0.01)
        assert abs(values[place] - pair.value) < 1e-10
        assert pair.residual < 1e-10


LOWEST = (1, 1), (1, 2), (2, 1), (2, 2)
GRIDS = [((n, n), (1.0, 1.0), dict(enumerate(LOWEST))) for n in (4, 8, 16, 32, 64)]
GRIDS += [((8, 8), (1.0, 0.5), {1: (2, 1)}), ((4, 4, 4), (1.0, 1.0, 1.0), {0: (1, 1, 1)})]


@needs_long_double
@pytest.mark.parametrize(("cells", "lengths", "places"), GRIDS)
def test_dirichlet_eigenvalues_are_those_of_the_symbol(cells, lengths, places):
    """Halved steps are exact in binary, so that the mesh is the solver's grid to the last bit."""
    solid, refinements = len(cells) == 3, int(np.log2(cells[0]))
    mesh = (MeshHex if solid else MeshQuad)().refined(refinements).scaled(lengths)
    basis = Basis(mesh, skfem_adini.ElementHexAdini() if solid else ElementQuadAdini())
    fixed = skfem_adini.essential_dofs(basis, mesh.boundary_facets())
    values, x = modes(basis, 4, fixed)
    solver = skfem_adini.UniformSolver(cells, lengths)
    for place, mode in places.items():
        exact = np.longdouble(str(solver.eigenvalue(*mode, digits=25)))
        found = refine_eigenpair(basis, x[:, place], fixed).value
        assert abs(found / exact - 1) < (1e-15 if solid else 1e-17)
        assert abs(values[place] / exact - 1) < 2e-12


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


@pytest.mark.parametrize("solver", ["auto", "superlu"])
def test_eigenvectors_are_orthonormal_and_solve_the_equation(solver):
    basis = square(6, (1.0, 1.3))
    K, M = pair(basis)
    values, x = lowest_eigenpairs(K, M, 6, solver=solver)
    np.testing.assert_allclose(x.T @ M @ x, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(x.T @ K @ x, np.diag(values), atol=1e-10)
    assert (np.diff(values) > 0).all()
    fixed = skfem_adini.essential_dofs(basis, basis.mesh.boundary_facets())
    values, x = lowest_eigenpairs(K, M, 3, fixed, solver=solver)
    np.testing.assert_array_equal(x[fixed], 0)
    again = lowest_eigenpairs(K, M, 3, fixed, solver=solver)
    np.testing.assert_array_equal(again[0], values)
    np.testing.assert_array_equal(again[1], x)


@pytest.mark.parametrize("side", [1.0, 1e5])
@pytest.mark.parametrize("dim", [2, 3])
def test_rigid_modes_of_free_bodies_have_small_residuals(dim, side):
    """Rigid modes alone, all equal, next to a shift that is nearly zero."""
    ticks = [np.linspace(0, side, 3)] * dim
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*ticks)
    basis = Basis(
        mesh, ElementVector(ElementQuadAdini() if dim == 2 else skfem_adini.ElementHexAdini())
    )
    K = linear_elasticity(1.0, 1.0).assemble(basis)
    M = BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    exact = linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)
    for count in (2, 6, 8):
        values, x = lowest_eigenpairs(K, M, count)
        np.testing.assert_allclose(values, exact[:count], rtol=1e-9, atol=1e-13 * exact[-1])
        energies = np.diag(x.T @ K @ x)
        np.testing.assert_allclose(energies, values, rtol=1e-9, atol=1e-13 * exact[-1])


def test_some_cells_of_a_mesh():
    """An IndexError came for a basis with elements=; the half is a domain of its own."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 2, 17), np.linspace(0, 1, 9))
    left = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 1)
    part = Basis(mesh, ElementQuadAdini(), elements=left)
    alone = mesh.restrict(left)
    values, x = modes(Basis(alone, ElementQuadAdini()), 4)
    whole = part.zeros()
    of_place = {tuple(p): k for k, p in enumerate(mesh.p.T)}
    mine, its = part.nodal_dofs, Basis(alone, ElementQuadAdini()).nodal_dofs
    for k, p in enumerate(alone.p.T):
        whole[mine[:, of_place[tuple(p)]]] = x[its[:, k], 1]
    found = refine_eigenpair(part, whole)
    assert float(found.value) == pytest.approx(values[1], rel=1e-10)
    assert found.residual < 1e-8


# The default shift of `lowest_eigenpairs` knows no unit of length.


SIDES = [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e7, 1e8, 1e12]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["auto", "superlu"])
@pytest.mark.parametrize("side", SIDES)
def test_squares_of_any_size(side, solver):
    """3 % wrong at 1e7, nonsense at 1e8, "are essential conditions missing?" at 1e-6."""
    basis = square(8, (side, side))
    K, M = pair(basis)
    fixed = skfem_adini.essential_dofs(basis, basis.mesh.boundary_facets())
    for count in (1, 2, 5, 6):
        values, x = lowest_eigenpairs(K, M, count, solver=solver)
        exact = np.pi**2 * np.array([0, 1, 1, 2, 4, 4])[:count]
        np.testing.assert_allclose(values * side**2, exact, rtol=2e-3, atol=1e-9)
        assert np.isfinite(x).all()
        if count < 6:
            values, _ = lowest_eigenpairs(K, M, count, fixed, solver=solver)
            exact = np.pi**2 * np.array([2, 5, 5, 8, 10])[:count]
            np.testing.assert_allclose(values * side**2, exact, rtol=5e-3)


def test_values_are_as_accurate_as_with_a_chosen_shift():
    """A weak support, an eigenvalue near 1e-9, does not cost the digits of the others."""
    K, M = pair(square(24))
    expected = lowest_eigenpairs(K, M, 8, shift=-5.0)[0]
    np.testing.assert_allclose(lowest_eigenpairs(K, M, 8)[0], expected, atol=1e-10)
    K, M = pair(square(8))
    expected = lowest_eigenpairs(K, M, 3, shift=-3.0)[0] + 1e-9
    np.testing.assert_allclose(lowest_eigenpairs(K + 1e-9 * M, M, 3)[0], expected, atol=1e-11)


def test_fixed_dofs_in_every_form():
    basis = square(4)
    K, M = pair(basis)
    view = basis.get_dofs(lambda x: x[0] == 0)
    mask = np.isin(np.arange(basis.N), view.flatten())
    expected = lowest_eigenpairs(K, M, 2, view.flatten())[0]
    for fixed in (view, mask, list(view.flatten())):
        assert np.array_equal(lowest_eigenpairs(K, M, 2, fixed)[0], expected)
    assert np.array_equal(lowest_eigenpairs(K + 0j, M, 2, view)[0], expected)
    assert lowest_eigenpairs(K, M, 2, [])[0][0] == pytest.approx(0, abs=1e-10)


# Matrices that are not definite are refused or told of, and every pair is checked.


module = import_module("skfem_adini.solvers.lowest_eigenpairs")


def coupled(n, off):
    """Return a matrix of unit diagonal with the eigenvalues 1 + 2 off cos(k pi / (n + 1))."""
    return sparse.diags_array([off, 1.0, off], offsets=[-1, 0, 1], shape=(n, n)).tocsr()


def bar(n):
    return sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()


@pytest.mark.parametrize("solver", SOLVERS)
def test_mass_with_positive_diagonal_that_is_not_definite(solver):
    """It gave negative eigenvalues of a definite K, as if they were the lowest."""
    n = 100
    for off in (0.51, 0.6, 0.9, -0.6):
        assert linalg.eigvalsh(coupled(n, off).toarray())[0] < -1e-3
        for shift in (None, 0.0):
            with pytest.raises(InputError, match=r"M: .* positive definite"):
                lowest_eigenpairs(bar(n), coupled(n, off), 3, shift=shift, solver=solver)
    # One pair of dofs is coupled too strongly; the lowest eigenvalues do not see it.
    basis = square(8)
    fixed = skfem_adini.essential_dofs(basis, basis.mesh.boundary_facets())
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
def test_negative_eigenvalue_is_said(solver):
    """The problem was refused below -1."""
    n = 60
    for lowest in (-1e-6, -0.5, -3555.0):
        K = sparse.diags_array(np.append(lowest, np.linspace(1, 4e3, n - 1))).tocsr()
        M = coupled(n, 0.1)
        with pytest.warns(skfem_adini.IndefiniteWarning, match="K: the eigenvalue -.* negative"):
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
    with pytest.raises(skfem_adini.NotConverged, match="residual"):
        lowest_eigenpairs(bar(50), sparse.eye_array(50).tocsr(), 3)
