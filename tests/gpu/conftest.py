"""Seeded quadratic programs and an independent measure of their optimality."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

# The suite imports test modules by path; `carex_problems` and `convex_problems` lie beside them.
sys.path.insert(0, str(Path(__file__).parent))


def spd_matrix(rng, n, kind):
    if kind == "identity":
        return np.eye(n)
    if kind == "gram":
        M = rng.standard_normal((n, n))
        return M @ M.T / n + rng.choice([1.0, 0.01]) * np.eye(n)
    if kind == "ill":
        P = np.diag(np.logspace(0.0, -rng.uniform(4.0, 8.0), n))
        for v in rng.standard_normal((4, n)):
            v /= np.linalg.norm(v)
            P -= 2 * np.outer(v, v @ P)
            P -= 2 * np.outer(P @ v, v)
        return P
    if kind == "stiffness":
        P = np.diag(rng.uniform(2.0, 2.5, n))
        i = np.arange(n - 1)
        P[i, i + 1] = P[i + 1, i] = -1.0
        return P
    # Flexibility of a half-plane: what a contact problem leaves after condensation.
    t = np.sort(rng.uniform(0.0, 1.0, n))
    K = np.exp(-np.abs(t[:, None] - t) * rng.uniform(1.0, 20.0)) + 1e-4 * np.eye(n)
    return 10.0 ** rng.uniform(-12.0, 12.0) * K


MATRICES = ("identity", "gram", "ill", "stiffness", "flexibility")
ROWS = ("none", "none", "independent", "dependent", "tight", "infeasible", "contradictory")


def random_problem(seed, n_max=200):
    """One problem of a random kind: P, q, A, b, lb, ub, and whether it has a feasible point."""
    rng = np.random.default_rng(seed)
    n = 1 + int(n_max * rng.random() ** 2)
    kind = rng.choice(MATRICES)
    P = spd_matrix(rng, n, kind)
    P = (P + P.T) / 2
    size = np.abs(P).max()

    inside = rng.standard_normal(n)
    lb = np.where(rng.random(n) < 0.7, inside - rng.exponential(0.5, n), -np.inf)
    ub = np.where(rng.random(n) < 0.5, inside + rng.exponential(0.5, n), np.inf)
    if rng.random() < 0.3:
        lb, ub = np.zeros(n), np.where(ub < np.inf, 1.0, np.inf)
        inside = np.clip(inside, lb, ub)
    fixed = (rng.random(n) < 0.2) & (rng.random() < 0.3)
    lb[fixed] = ub[fixed] = inside[fixed]
    q = rng.choice([0.1, 1.0, 10.0]) * size * rng.standard_normal(n)
    if rng.random() < 0.3:
        # Degenerate: a third of the multipliers vanish at the solution.
        target = np.where(rng.random(n) < 0.5, np.clip(lb, -9, 9), np.clip(ub, -9, 9))
        force = size * rng.exponential(1.0, n) * (rng.random(n) < 0.6)
        q = -P @ target - np.where(target == lb, -force, np.where(target == ub, force, 0.0))

    rows = str(rng.choice(ROWS))
    m = 0 if rows == "none" else int(rng.integers(1, min(6, n) + 1))
    A = rng.standard_normal((m, n))
    if rows == "dependent" and m:
        A = np.vstack([A, rng.standard_normal((2, m)) @ A])
    b = A @ inside
    if rows in ("tight", "infeasible"):
        # The last row is maximal at one corner of the box, and asked for that or for more.
        corner = np.where(rng.random(n) < 0.5, np.clip(lb, -9, 9), np.clip(ub, -9, 9))
        corner = np.where(np.isfinite(np.where(corner > 0, ub, lb)), corner, 0.0)
        lb, ub = np.maximum(lb, -9), np.minimum(ub, 9)
        A = A[-1:]
        corner = np.where(A[0] > 0, ub, lb)
        b = A @ corner + (rng.choice([1e-3, 1.0, 1e3]) if rows == "infeasible" else 0.0)
    if rows == "contradictory":
        A = np.vstack([A, rng.standard_normal(m) @ A])
        b = np.append(b, A[-1] @ inside + rng.choice([-1.0, 1.0]) * rng.choice([1e-3, 1.0]))
    if rng.random() < 0.4:
        unit = 10.0 ** rng.uniform(-6.0, 6.0, n)
        P, q, lb, ub, A = unit[:, None] * P * unit, unit * q, lb / unit, ub / unit, A * unit
        row = 10.0 ** rng.uniform(-6.0, 6.0, len(b))
        A, b = row[:, None] * A, row * b
    return SimpleNamespace(
        P=P, q=q, A=A, b=b, lb=lb, ub=ub, kind=f"{kind}/{rows}",
        feasible=rows not in ("infeasible", "contradictory"),
    )  # fmt: skip


def optimality_error(p, result):
    """Largest violation of any optimality condition, in units that make the diagonal of P one."""
    x, y, z = result.x, result.y, result.z_box
    root = np.sqrt(np.diag(p.P))
    terms = abs(p.P) @ abs(x) + abs(p.q) + abs(p.A.T) @ abs(y)
    force = (terms / root).max() or 1.0
    length = (root * abs(x)).max() or 1.0
    residual = (abs(p.P @ x + p.q + p.A.T @ y + z) / root).max() / force
    # A row at x = 0 has no size: forces may leave 1e-4 * 1e-9 of what they would cause there.
    row_size = abs(p.A) @ abs(x) + abs(p.b) + 1e-4 * abs(p.A) @ (force / root)
    rows = abs(p.A @ x - p.b) / np.maximum(row_size, 1e-300)
    outside = (root * np.maximum(np.maximum(p.lb - x, x - p.ub), 0.0)).max() / length
    # z < 0 only at a lower bound, z > 0 only at an upper bound.
    gap = np.where(z < 0, x - p.lb, np.where(z > 0, p.ub - x, 0.0))
    with np.errstate(invalid="ignore"):
        product = np.minimum(abs(z) / root / force, np.where(gap > 0, root * gap / length, 0.0))
    return max(residual, rows.max(initial=0.0), outside, product.max())


def certifies(p, y):
    """Whether max over the box of (A'y)'x is below y'b, infinite bounds included."""
    c = p.A.T @ y
    c[abs(c) <= 1e-12 * (abs(p.A.T) @ abs(y))] = 0.0  # rounding of the sum over the rows
    corner = np.where(c > 0, p.ub, np.where(c < 0, p.lb, 0.0))
    return c @ corner < y @ p.b


@pytest.fixture(scope="session")
def qps():
    """The functions of this module."""
    return SimpleNamespace(
        random=random_problem, error=optimality_error, certifies=certifies, matrix=spd_matrix
    )
