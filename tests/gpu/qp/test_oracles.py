"""Agreement with enumeration of all active sets and with other solvers."""

import itertools

import numpy as np
import pytest
import qpsolvers
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from gpu import GpuError, Infeasible, Unbounded, solve_qp


def enumerate_states(p):
    """Least objective among the stationary feasible points of all 3^n active sets, or None."""
    n, m = p.q.size, p.b.size
    best, argument = np.inf, None
    for state in itertools.product((-1, 0, 1), repeat=n):
        s = np.array(state)
        x = np.where(s < 0, p.lb, np.where(s > 0, p.ub, 0.0))
        if not np.isfinite(x).all():
            continue
        F = np.flatnonzero(s == 0)
        K = np.block([[p.P[np.ix_(F, F)], p.A[:, F].T], [p.A[:, F], np.zeros((m, m))]])
        right = np.concatenate([-(p.P[F] @ x + p.q[F]), p.b - p.A @ x])
        # Least squares, because rows may depend on each other within the free columns.
        step = np.linalg.lstsq(K, right, rcond=1e-12)[0]
        x[F] = step[: F.size]
        feasible = (
            np.all(np.abs(p.A @ x - p.b) <= 1e-9 * (np.abs(p.A) @ np.abs(x) + np.abs(p.b)) + 1e-12)
            and np.all(x >= p.lb - 1e-9)
            and np.all(x <= p.ub + 1e-9)
        )
        objective = x @ p.P @ x / 2 + p.q @ x
        if feasible and objective < best:
            best, argument = objective, x
    return argument


@pytest.mark.parametrize("seed", range(40))
def test_enumeration(qps, seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 6)), int(rng.integers(0, 3))
    p = qps.random(seed, n_max=1)
    p.P = qps.matrix(rng, n, "gram")
    p.P = (p.P + p.P.T) / 2
    # Small integers: ties, vanishing multipliers, dependent and contradictory rows are common.
    p.q = rng.integers(-3, 4, n).astype(float)
    p.lb = rng.choice([-np.inf, -1.0, 0.0], n)
    p.ub = rng.choice([np.inf, 1.0, 0.0], n)
    p.A = rng.integers(-1, 2, (m, n)).astype(float)
    p.b = rng.integers(-1, 2, m).astype(float)
    expected = enumerate_states(p)
    if expected is None:
        with pytest.raises(Infeasible) as caught:
            solve_qp(p.P, p.q, A=p.A, b=p.b, lb=p.lb, ub=p.ub)
        assert qps.certifies(p, caught.value.certificate)
    else:
        result = solve_qp(p.P, p.q, A=p.A, b=p.b, lb=p.lb, ub=p.ub)
        # The enumeration accepts points up to 1e-9 outside.
        np.testing.assert_allclose(result.x, expected, atol=1e-7)
        assert qps.error(p, result) < 4e-9


SOLVERS = {
    "osqp": ({"eps_abs": 1e-9, "eps_rel": 1e-9, "polishing": True, "max_iter": 100_000}, 1e-7),
    "proxqp": ({"eps_abs": 1e-10, "eps_rel": 0.0}, 1e-7),
    "clarabel": ({"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}, 1e-4),
}


@pytest.mark.filterwarnings("ignore:The default value of raise_error:PendingDeprecationWarning")
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("rows", [0, 3])
def test_other_solvers(solver, rows):
    rng = np.random.default_rng(rows)
    n = 60
    M = rng.standard_normal((n, n))
    P = M @ M.T / n + 0.1 * np.eye(n)
    P = (P + P.T) / 2
    q = rng.standard_normal(n)
    lb, ub = np.full(n, -0.3), rng.uniform(0.0, 1.0, n)
    A = rng.standard_normal((rows, n)) if rows else None
    b = A @ rng.uniform(lb, ub) if rows else None
    options, tolerance = SOLVERS[solver]
    problem = qpsolvers.Problem(P, q, None, None, A, b, lb, ub)
    stored = csc_matrix if solver != "proxqp" else np.asarray
    theirs = qpsolvers.Problem(
        stored(P), q, None, None, None if A is None else stored(A), b, lb, ub
    )
    other = qpsolvers.solve_problem(theirs, solver=solver, **options)
    assert other.found
    result = solve_qp(P, q, A=A, b=b, lb=lb, ub=ub)
    assert 0 < np.count_nonzero(result.active) < n
    np.testing.assert_allclose(result.x, other.x, atol=tolerance)
    np.testing.assert_allclose(result.z_box, other.z_box, atol=10 * tolerance)
    if rows:
        np.testing.assert_allclose(result.y, other.y, atol=10 * tolerance)
    # The signs of the multipliers are those of qpsolvers: its own residuals vanish for ours.
    ours = qpsolvers.Solution(
        problem,
        found=True, x=result.x, y=result.y, z=result.z, z_box=result.z_box,
    )  # fmt: skip
    assert ours.primal_residual() < 1e-12
    assert ours.dual_residual() < 1e-12
    assert ours.duality_gap() < 1e-11


def random_program(seed):
    """A small program of few different numbers, feasible or not, bounded or not; P may be zero."""
    rng = np.random.default_rng([seed, 3])
    n, m, l = (int(rng.integers(least, most)) for least, most in ((1, 6), (0, 4), (0, 6)))
    A, G = (rng.integers(-2, 3, (rows, n)).astype(float) for rows in (m, l))
    x = rng.integers(-2, 3, n) / 2
    b = A @ x + (rng.random(m) < 0.3) * rng.integers(-2, 3, m) / 2
    h = G @ x + rng.integers(-2, 4, l) / 2
    lb = np.where(rng.random(n) < 0.4, x - rng.integers(-1, 4, n) / 2, -np.inf)
    ub = np.where(rng.random(n) < 0.4, x + rng.integers(-1, 4, n) / 2, np.inf)
    M = rng.integers(-1, 2, (max(1, n // 2), n)) * (seed % 3 == 0)
    return M.T @ M * 1.0, rng.integers(-2, 3, n) * 1.0, G, h, A, b, lb, np.maximum(lb, ub)


def fate(P, q, G, h, A, b, lb, ub):
    """What HiGHS says: a point first, then a ray among the directions that are feasible."""
    n, sides = q.size, list(zip(lb, ub, strict=True))
    if linprog(np.zeros(n), G, h, A, b, sides).status == 2:
        return Infeasible
    low, high = np.where(np.isfinite(lb), 0.0, -1.0), np.where(np.isfinite(ub), 0.0, 1.0)
    flat = np.vstack([A, P])
    ray = linprog(q, G, 0.0 * h, flat, np.zeros(len(flat)), list(zip(low, high, strict=True)))
    return Unbounded if ray.fun < -1e-9 else None


@pytest.mark.parametrize("stored", [np.asarray, csc_matrix], ids=["dense", "sparse"])
@pytest.mark.parametrize(
    "seeds", [range(0, 40), pytest.param(range(40, 2100), marks=pytest.mark.slow)], ids=str
)
def test_feasibility_is_known_before_a_ray_counts(stored, seeds):
    """Infeasible programs whose objective falls along a ray were called unbounded."""
    for seed in seeds if stored is np.asarray else seeds[::5]:
        P, q, G, h, A, b, lb, ub = program = random_program(seed)
        found = None
        try:
            solve_qp(stored(P), q, stored(G), h, stored(A), b, lb, ub)
        except GpuError as error:
            found = type(error)
        assert found is fate(*program), seed


@pytest.mark.parametrize("stored", [np.asarray, csc_matrix], ids=["dense", "sparse"])
@pytest.mark.parametrize("start", [None, np.zeros(3)], ids=["cold", "warm"])
def test_an_infeasible_program_with_a_ray(stored, start):
    A, b = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -1.0]]), np.array([-0.5, 1.0])
    lb, ub = [-3.0, -np.inf, -np.inf], [-2.0, np.inf, np.inf]
    with pytest.raises(Infeasible) as caught:
        solve_qp(
            stored(np.zeros((3, 3))), [0.0, -1.0, -1.0], A=stored(A), b=b, lb=lb, ub=ub, start=start
        )
    y = caught.value.certificate
    c = A.T @ y
    assert c[1] == c[2] == 0.0
    assert max(c[0] * lb[0], c[0] * ub[0]) < y @ b
