"""The condensed stiffness is the Schur complement, whichever factoriser computes it."""

import numpy as np
import pytest
from optional_packages import PARDISO
from scipy import sparse
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP2

from contact import ElasticBody, InputError
from contact.body.rigid_modes import rigid_modes
from contact.condensation import schur as schur_module
from contact.condensation.schur import SuperLUSchur, schur_factor
from contact.errors import MissingDependency
from skfem_adini import ElementQuadAdini

ELEMENTS = [ElementQuadAdini, ElementQuad1, ElementTriP2, ElementTetP1, ElementHex1]
solvers = pytest.mark.parametrize("solver", ["superlu", pytest.param("pardiso", marks=PARDISO)])


def matrix(make, element, floating=False):
    """Stiffness of a small body without its fixed dofs, and which of them lie on the bottom."""
    ticks = np.linspace(0, 1, 5 if element().dim == 2 else 4)
    mesh = make.box(element, *(ticks,) * element().dim)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    fixed = np.zeros(body.basis.N, dtype=bool)
    if not floating:
        fixed[body.basis.get_dofs("top").flatten()] = True
    on_bottom = np.zeros(body.basis.N, dtype=bool)
    on_bottom[body.basis.get_dofs("bottom").flatten()] = True
    S = sparse.csr_array(body.stiffness[~fixed][:, ~fixed])
    return body, S, np.flatnonzero(on_bottom[~fixed]).astype(np.int64)


def random_order(n, seed=3):
    return lambda: np.random.default_rng(seed).permutation(n)


@solvers
@pytest.mark.parametrize("floating", [False, True], ids=["held", "floating"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_against_dense(element, floating, solver, make):
    body, S, boundary = matrix(make, element, floating)
    full = S.toarray()
    inner = np.setdiff1d(np.arange(full.shape[0]), boundary)
    S_ii, S_ib = full[np.ix_(inner, inner)], full[np.ix_(inner, boundary)]
    solve = np.linalg.solve(S_ii, S_ib)
    factor = schur_factor(S, boundary, random_order(S.shape[0]), solver)
    # Condition of the inner block (1e3) times rounding, relative to the largest entry.
    tol = 1e-12 * np.abs(full).max()
    expected = full[np.ix_(boundary, boundary)] - S_ib.T @ solve
    assert np.abs(factor.schur - expected).max() < tol
    assert np.array_equal(factor.schur, factor.schur.T)
    load = np.random.default_rng(0).standard_normal(S.shape[0])
    z_b = np.random.default_rng(1).standard_normal(boundary.size)
    carried = load[boundary] - solve.T @ load[inner]
    np.testing.assert_allclose(factor.reduce(load), carried, atol=1e-11 * np.abs(carried).max())
    z = factor.expand(load, z_b)
    assert np.array_equal(z[boundary], z_b)
    expected = np.linalg.solve(S_ii, load[inner]) - solve @ z_b
    np.testing.assert_allclose(z[inner], expected, atol=1e-11 * np.abs(expected).max())
    if floating:  # S_b N = 0 exactly; rounding and the shift of the boundary block cost digits
        assert np.abs(factor.schur @ rigid_modes(body)[boundary]).max() < tol
        zero = np.linalg.eigvalsh(factor.schur) < 1e-10 * np.abs(factor.schur).max()
        assert zero.sum() == body.dim * (body.dim + 1) // 2


@solvers
def test_nothing_inside(solver, make):
    """A strip of one layer of cells, in contact above and below."""
    _, S, _ = matrix(make, ElementQuad1)
    factor = schur_factor(S, np.arange(S.shape[0]), random_order(S.shape[0]), solver)
    full, load = S.toarray(), np.random.default_rng(4).standard_normal(S.shape[0])
    assert np.abs(factor.schur - full).max() < 1e-12 * np.abs(full).max()
    assert np.array_equal(factor.reduce(load), load)
    assert np.array_equal(factor.expand(load, 2 * load), 2 * load)


@solvers
def test_a_load_is_eliminated_once_and_alone(solver, make, monkeypatch):
    """`expand` takes over what `reduce` found; no result depends on the loads before it."""
    _, S, boundary = matrix(make, ElementQuadAdini)
    order = random_order(S.shape[0])
    factor = schur_factor(S, boundary, order, solver)
    count, eliminate = [], type(factor)._eliminate
    monkeypatch.setattr(factor, "_eliminate", lambda f: count.append(1) or eliminate(factor, f))
    loads = [*np.random.default_rng(2).standard_normal((3, S.shape[0]))]
    loads += [3.0 * loads[0], loads[0] - 1e9 * loads[1]]
    for load in loads:
        z_b = factor.reduce(load)
        both = z_b, factor.expand(load, z_b)
        fresh = schur_factor(S, boundary, order, solver)
        assert np.array_equal(both[0], fresh.reduce(load))
        assert np.array_equal(both[1], fresh.expand(load, z_b))
    assert len(count) == len(loads)


def test_auto_takes_pardiso_when_there(monkeypatch, make):
    _, S, boundary = matrix(make, ElementQuad1)
    order = random_order(S.shape[0])
    monkeypatch.setattr(schur_module, "has_pardiso", lambda: False)
    assert isinstance(schur_factor(S, boundary, order), SuperLUSchur)
    with pytest.raises(MissingDependency, match="pip install"):
        schur_factor(S, boundary, order, "pardiso")


@solvers
def test_a_loose_piece_and_an_indefinite_inner_block_are_refused(solver, make):
    """A second body that touches neither supports nor contact; an entry of the wrong sign."""
    _, S, boundary = matrix(make, ElementQuad1)
    loose = sparse.csr_array(sparse.block_diag((S, [[1.0, -1.0], [-1.0, 1.0]])))
    indefinite = S.tolil()
    inner = np.setdiff1d(np.arange(S.shape[0]), boundary)[3]
    indefinite[inner, inner] = -5.0
    for wrong in (loose, sparse.csr_array(indefinite)):
        with pytest.raises(InputError, match="not positive definite"):
            schur_factor(wrong, boundary, lambda n=wrong.shape[0]: np.arange(n), solver)
