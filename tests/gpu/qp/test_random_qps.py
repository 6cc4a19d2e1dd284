"""Nothing wrong is ever called solved, and hardly any convex problem is given up."""

import convex_problems as problems
import numpy as np
import pytest
import qpsolvers
from scipy import sparse

from gpu import Infeasible, NotConverged, Unbounded, solve_qp

# Ours is 1e-9; the sizes of two implementations differ by a small factor.
ACCEPTED = 4e-9


def outcome(p, storage=np.asarray):
    """What came of a problem, or None where it was given up; asserts that it is right."""
    arguments, keywords = problems.arguments(p)
    try:
        result = solve_qp(storage(arguments[0]), *arguments[1:], **keywords)
    except Infeasible as error:
        right = p.fate == "infeasible" and problems.refutes(p, error.certificate)
        assert right, "a feasible problem, or no proof"
        return "infeasible"
    except Unbounded as error:
        right = p.fate == "unbounded" and problems.descends(p, error.ray)
        assert right, "a bounded problem, or no ray"
        return "unbounded"
    except NotConverged:
        return None
    assert p.fate == "solvable"
    assert problems.error_of(p, result) <= ACCEPTED
    return "solved"


def run(seeds, n_max, storage=np.asarray):
    given_up = []
    for seed in seeds:
        p = problems.convex_problem(seed, n_max)
        try:
            if outcome(p, storage) is None:
                given_up.append((seed, p.kind))
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {p.kind}, n = {p.q.size}") from error
    return given_up


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seeds", [range(k, k + 100) for k in range(0, 500, 100)], ids=str)
def test_random_problems(seeds):
    # Every kind is met in small sizes; larger ones are drawn where seeds begin with 3.
    assert run(seeds, n_max=30 if seeds.start == 300 else 10) == []


@pytest.mark.parametrize("seed", [382, 2748, 3679, 4128, 4536, 8042])
def test_larger_problems_that_were_given_up_once(seed):
    assert run([seed], n_max=200) == []


# No rows at all, a last digit outside the box, rows that depend on each other.
@pytest.mark.parametrize("seed", [30023, 34174, 30352, 30368, 40844])
def test_larger_problems_that_failed_once(seed):
    assert run([seed], n_max=200) == []


@pytest.mark.turns(4)
def test_random_sparse_problems():
    # Rounding of the factoriser decides about one: a certificate that just misses its margin.
    assert len(run(range(400, 425), 30, sparse.csr_array)) <= 1


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", [423, 870, 1450, 6328, 17184])
def test_iterates_that_run_away_are_no_solution(seed):
    """Beside an x of 1e15 to 1e68 every residual is small; rounding decided who got there."""
    rng, p = np.random.default_rng(0), problems.convex_problem(seed, 30)
    assert p.fate == "unbounded"
    P = p.P.copy()
    for _ in range(8):
        assert outcome(p, sparse.csr_array) in ("unbounded", None)
        p.P[...] = P * (1 + 2e-16 * rng.integers(-1, 2, P.shape))
        p.P[...] = (p.P + p.P.T) / 2


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(k, k + 100) for k in range(0, 400, 100)], ids=str)
def test_400_larger_problems(seeds):
    assert run(seeds, n_max=30) == []


@pytest.mark.slow
def test_more_random_sparse_problems():
    assert len(run(range(425, 500), 30, sparse.csr_array)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(k, k + 500) for k in range(1000, 11000, 500)], ids=str)
def test_10000_random_problems(seeds):
    # 99.9 %: ten of ten thousand, and no part takes more than two of them.
    assert len(run(seeds, n_max=200)) <= 2


@pytest.mark.filterwarnings("ignore:Clarabel.rs terminated")
@pytest.mark.parametrize("seed", range(12))
def test_objective_of_another_solver(seed):
    p = problems.convex_problem(2000 + seed, 25)
    if p.fate != "solvable":
        pytest.skip("no solution to compare")
    arguments, keywords = problems.arguments(p)
    result = solve_qp(*arguments, **keywords)
    finite = np.isfinite(p.h_low)
    G, h = np.vstack([p.G, -p.G[finite]]), np.concatenate([p.h, -p.h_low[finite]])
    other = qpsolvers.Problem(
        sparse.csc_matrix(p.P), p.q,
        *((sparse.csc_matrix(G), h) if len(h) else (None, None)),
        *((sparse.csc_matrix(p.A), p.b) if len(p.b) else (None, None)),
        p.lb, p.ub,
    )  # fmt: skip
    theirs = qpsolvers.solve_problem(other, "clarabel")
    if not theirs.found:
        pytest.skip("the other solver has no solution")

    def objective(x):
        return x @ p.P @ x / 2 + p.q @ x

    size = abs(p.q) @ abs(result.x)
    # The other solver stops at 1e-8.
    assert abs(objective(result.x) - objective(theirs.x)) <= 1e-5 * size
