"""Forces that the rounding of a fine mesh leaves unbalanced are removed by one more solution."""

import numpy as np
import pytest
from optional_packages import PARDISO
from skfem import MeshQuad

from contact import ContactProblem, ElasticBody
from contact.condensation import sparse
from contact.condensation.condensed_contact import CondensedContact
from contact.problem import solve_system
from skfem_adini import ElementQuadAdini

N = 64  # a power of two: all cells have the same rounding, and the sum of it is n^2 precisions
TOL = 2e-13  # less than the sum of the forces that rounding leaves there


def posed(length=1.0, E=2.0, solver="auto", n=N):
    """A square of Adini cells, pressed on a bowl and dragged by its upper side."""
    x = np.linspace(0.0, length, n + 1)
    mesh = MeshQuad.init_tensor(x, x).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=E, nu=0.3)
    body.fix("top", "y", -0.05 * length).fix("top", "x", lambda x: 0.02 * length + 0.01 * x[0])

    def bowl(x):
        return 0.2 * (x[0] / length - 0.45) ** 2 * length

    return ContactProblem(body, "bottom", bowl, 0.9, solver=solver)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (2.0**-20, 2.0**38), (2.0**13, 2.0**-10)])
def test_the_balance_holds_in_every_unit(monkeypatch, length, E):
    problem = posed(length, E, n=2 * N)  # whatever order of elimination and of sums a version has
    fine = problem.solve(tol=TOL)
    monkeypatch.setattr(solve_system, "RESERVE", np.inf)
    coarse = problem.solve()
    assert coarse.kkt["balance"] > TOL
    assert fine.kkt["balance"] < 0.1 * TOL
    # The condition amplifies what rounding left there, by as much as the version's order of sums.
    assert np.abs(fine.mu - coarse.mu).max() < 1e-10 * coarse.mu.max()
    assert np.abs(fine.u - coarse.u).max() < 1e-10 * np.abs(coarse.u).max()


@pytest.mark.parametrize("solver", ["superlu", pytest.param("pardiso", marks=PARDISO)])
def test_one_more_solution_where_it_is_needed_and_helps(solver, monkeypatch):
    problem, seen, recover = posed(solver=solver), [], CondensedContact.recover
    monkeypatch.setattr(
        CondensedContact, "recover", lambda *given: seen.append(0) or recover(*given)
    )
    before = problem.solve()
    assert len(seen) == 1
    assert problem.solve(tol=TOL).kkt["balance"] < 0.1 * TOL
    assert len(seen) == 3
    monkeypatch.setattr(solve_system, "RESERVE", 0.0)
    monkeypatch.setattr(sparse.SparseBody, "unbalanced", lambda part, rest, u: 1e-3 * rest)
    after = problem.solve()
    assert np.array_equal(after.u, before.u)
    assert np.array_equal(after.mu, before.mu)
