"""The default shift of `lowest_eigenpairs` knows no unit of length."""

import numpy as np
import pytest
from scipy import sparse
from skfem import Basis, BilinearForm, MeshQuad
from skfem.helpers import dd, ddot
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementQuadAdini,
    IndefiniteWarning,
    InputError,
    essential_dofs,
    lowest_eigenpairs,
)

SIDES = [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e7, 1e8, 1e12]


def square(side, n=8):
    ticks = np.linspace(0, side, n + 1)
    return Basis(MeshQuad.init_tensor(ticks, ticks), ElementQuadAdini())


def pair(basis):
    return laplace.assemble(basis), mass.assemble(basis)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("solver", ["auto", "superlu"])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("count", [1, 2, 6])
def test_natural_conditions_on_squares_of_any_size(side, count, solver):
    """3 % wrong at 1e7, nonsense at 1e8, "are essential conditions missing?" at 1e-6."""
    values, x = lowest_eigenpairs(*pair(square(side)), count, solver=solver)
    exact = np.pi**2 * np.array([0, 1, 1, 2, 4, 4])[:count]
    np.testing.assert_allclose(values * side**2, exact, rtol=2e-3, atol=1e-9)
    assert np.isfinite(x).all()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("count", [1, 2, 5])
def test_essential_conditions_on_squares_of_any_size(side, count):
    basis = square(side)
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    values, _ = lowest_eigenpairs(*pair(basis), count, fixed)
    exact = np.pi**2 * np.array([2, 5, 5, 8, 10])[:count]
    np.testing.assert_allclose(values * side**2, exact, rtol=5e-3)


def test_values_are_as_accurate_as_with_a_chosen_shift():
    K, M = pair(square(1.0, 24))
    found = lowest_eigenpairs(K, M, 8)[0]
    np.testing.assert_allclose(found, lowest_eigenpairs(K, M, 8, shift=-5.0)[0], atol=1e-10)


def test_free_plate_with_three_motions_without_energy():
    basis = Basis(MeshQuad().refined(4), ElementQuadAdini(derivatives=2))
    K = BilinearForm(lambda u, v, w: ddot(dd(u), dd(v))).assemble(basis)
    values, _ = lowest_eigenpairs(K, mass.assemble(basis), 6)
    assert np.abs(values[:3]).max() < 1e-6
    assert values[3] > 100


def test_negative_eigenvalues():
    """The problem was refused below -1."""
    K, M = pair(square(1.0))
    with pytest.warns(IndefiniteWarning, match="K: the eigenvalue -50"):
        values, _ = lowest_eigenpairs(K - 50.0 * M, M, 3)
    np.testing.assert_allclose(values, np.pi**2 * np.array([0, 1, 1]) - 50, rtol=1e-3)


def test_weak_support_does_not_cost_the_other_digits():
    """One eigenvalue near 1e-9, the others of the order of ten."""
    K, M = pair(square(1.0))
    values, _ = lowest_eigenpairs(K + 1e-9 * M, M, 3)
    expected = lowest_eigenpairs(K, M, 3, shift=-3.0)[0] + 1e-9
    np.testing.assert_allclose(values, expected, atol=1e-11)


K, M = pair(square(1.0, 3))
BAD = {
    "a whole number, got": [{"count": 2.0}, {"count": "2"}, {"count": None}, {"count": True}],
    "count: expected 1 to 47": [{"count": 0}, {"count": 10**6}, {"count": np.nan}],
    "fixed: expected dofs from 0": [{"fixed": [999]}, {"fixed": [-1]}],
    "fixed: expected numbers": [{"fixed": [1.0]}, {"fixed": "left"}, {"fixed": [None]}],
    "fixed: a mask": [{"fixed": np.ones(3, dtype=bool)}],
    "shift: expected": [{"shift": np.nan}, {"shift": "low"}, {"shift": 1j}],
    "K: expected real": [{"K": K * (1 + 1j)}],
    "M: expected real": [{"M": M * 1j}],
    "K: expected": [{"K": "matrix"}, {"K": None}, {"K": np.ones(3)}],
    "NaN": [{"K": sparse.diags_array(np.full(K.shape[0], np.nan))}],
}
CASES = [(message, each) for message, some in BAD.items() for each in some]


@pytest.mark.parametrize(("message", "wrong"), CASES)
def test_bad_input(message, wrong):
    with pytest.raises(InputError, match=message):
        lowest_eigenpairs(**{"K": K, "M": M, "count": 2} | wrong)


def test_fixed_dofs_in_every_form():
    basis = square(1.0, 4)
    K, M = pair(basis)
    view = basis.get_dofs(lambda x: x[0] == 0)
    mask = np.isin(np.arange(basis.N), view.flatten())
    expected = lowest_eigenpairs(K, M, 2, view.flatten())[0]
    for fixed in (view, mask, list(view.flatten())):
        assert np.array_equal(lowest_eigenpairs(K, M, 2, fixed)[0], expected)
    assert np.array_equal(lowest_eigenpairs(K + 0j, M, 2, view)[0], expected)
    assert lowest_eigenpairs(K, M, 2, [])[0][0] == pytest.approx(0, abs=1e-10)
