"""Seeded convex quadratic programs of every kind, and checks that know nothing of the solver."""

from types import SimpleNamespace

import numpy as np

KINDS = ("strict", "semidefinite", "ill", "linear", "low rank")
SHAPES = ("few", "many", "two-sided", "boxes", "equalities", "degenerate", "duplicated", "fixed")
FATES = ("solvable",) * 8 + ("infeasible", "unbounded")


def _matrix(rng, n, kind):
    M = rng.standard_normal((n, n))
    if kind == "strict":
        return M @ M.T / n + 0.1 * np.eye(n)
    if kind == "linear":
        return np.zeros((n, n))
    if kind == "low rank":
        M = rng.standard_normal((n, max(1, n // 10)))
        return M @ M.T
    Q = np.linalg.qr(M)[0]
    values = np.logspace(0.0, -8.0, n)
    if kind == "semidefinite":
        values = rng.uniform(0.1, 1.0, n) * (rng.random(n) < 0.6)
    return (Q * values) @ Q.T


def convex_problem(seed, n_max=200):
    """One problem: P, q, G, h, h_low, A, b, lb, ub, and its fate."""
    rng = np.random.default_rng([7, seed])
    n = 2 + int((n_max - 2) * rng.random() ** 2)
    kind, shape = str(rng.choice(KINDS)), str(rng.choice(SHAPES))
    fate = str(rng.choice(FATES))
    P = _matrix(rng, n, kind)
    P = (P + P.T) / 2
    most = {"many": 5 * n, "boxes": 0, "equalities": 0}.get(shape, n)
    l = int(rng.integers(1, most + 1)) if most else 0
    m = int(rng.integers(0, n // 2 + 1)) if shape != "boxes" else 0
    G, A = rng.standard_normal((l, n)), rng.standard_normal((m, n))
    if rng.random() < 0.3:
        G, A = G * (rng.random(G.shape) < 0.2), A * (rng.random(A.shape) < 0.3)
    if shape == "duplicated":
        if l > 1:
            G[l // 2 :] = G[rng.integers(0, l // 2, l - l // 2)]
        if m > 1:
            A[-1] = rng.standard_normal(m - 1) @ A[:-1]
    x = rng.standard_normal(n)
    active = rng.random(l) < rng.choice([0.1, 0.5])
    if shape == "degenerate":
        active[:] = True
    z = np.where(active, rng.exponential(1.0, l), 0.0)
    if shape == "degenerate":
        z *= rng.random(l) < 0.3
    slack = np.where(active, 0.0, rng.exponential(1.0, l))
    side = rng.choice([-1.0, 1.0], l) if shape == "two-sided" else np.ones(l)
    value = G @ x
    h = np.where(side > 0, value + slack, value + rng.exponential(1.0, l))
    h_low = np.where(side < 0, value - slack, value - rng.exponential(1.0, l))
    if shape != "two-sided":
        h_low = np.full(l, -np.inf)
    boxed = rng.random(n) < (0.9 if shape == "boxes" else rng.choice([0.0, 0.5]))
    held = boxed & (rng.random(n) < 0.4)
    where = rng.choice([-1.0, 1.0], n)
    lb = np.where(boxed, x - np.where(held & (where < 0), 0.0, rng.exponential(1.0, n)), -np.inf)
    ub = np.where(boxed, x + np.where(held & (where > 0), 0.0, rng.exponential(1.0, n)), np.inf)
    ub[boxed & (rng.random(n) < 0.3) & ~(held & (where > 0))] = np.inf
    z_box = np.where(held, where * rng.exponential(1.0, n), 0.0)
    if shape == "fixed":
        fixed = rng.random(n) < 0.2
        lb[fixed] = ub[fixed] = x[fixed]
    y = rng.standard_normal(m)
    q = -(P @ x + G.T @ (side * z) + A.T @ y + z_box)
    b = A @ x
    if fate == "unbounded":
        # A direction without curvature that meets no side, and along which q falls.
        d = np.zeros(n)
        d[:2] = 1.0, rng.choice([-1.0, 1.0])
        lb[:2], ub[:2] = -np.inf, np.inf
        project = np.eye(n) - np.outer(d, d) / 2
        P, A = project @ P @ project, A @ project
        P = (P + P.T) / 2
        h, h_low = h - G @ x, h_low - G @ x
        G = G @ project
        # What should cancel does so exactly: a row of rounding errors would be a row.
        A, G = (np.where(abs(M) < 1e-14, 0.0, M) for M in (A, G))
        b = A @ x
        h, h_low = h + G @ x, h_low + G @ x
        q = project @ q - d
    if fate == "infeasible":
        # The rows say c'x <= s, a combination of them says c'x >= s + 1; or b is no image of A.
        if m and rng.random() < 0.3:
            weight = rng.standard_normal(m)
            A, b = np.vstack([A, weight @ A]), np.append(b, weight @ b + 1.0)
        elif not l:
            G, h = np.ones((2, n)), np.array([x.sum(), np.inf])
            h_low = np.array([-np.inf, x.sum() + 1.0])
        else:
            weight = rng.exponential(1.0, l) * (rng.random(l) < 0.5)
            weight[0] = 1.0
            c, top = weight @ G, weight @ h
            G, h, h_low = np.vstack([G, c]), np.append(h, np.inf), np.append(h_low, top + 1.0)
    if rng.random() < 0.4:
        unit, cost = 10.0 ** rng.uniform(-3, 3, n), 10.0 ** rng.uniform(-6, 6)
        P, q = cost * unit[:, None] * P * unit, cost * unit * q
        G, A, lb, ub = G * unit, A * unit, lb / unit, ub / unit
        row = 10.0 ** rng.uniform(-3, 3, len(h))
        G, h, h_low = row[:, None] * G, row * h, row * h_low
        row = 10.0 ** rng.uniform(-3, 3, len(b))
        A, b = row[:, None] * A, row * b
    P = (P + P.T) / 2
    return SimpleNamespace(
        P=P, q=q, G=G, h=h, h_low=h_low, A=A, b=b, lb=lb, ub=ub, fate=fate,
        kind=f"{kind}/{shape}/{fate}",
    )  # fmt: skip


def arguments(p):
    """Positional and keyword arguments of solve_qp."""
    G = (p.G, p.h) if len(p.h) else (None, None)
    A = (p.A, p.b) if len(p.b) else (None, None)
    return (p.P, p.q, *G, *A, p.lb, p.ub), {"h_low": p.h_low if len(p.h) else None}


def error_of(p, r):
    """Largest violation of the optimality conditions, each over the terms that make it up."""
    x, y, z, z_box = r.x, r.y, r.z, r.z_box
    assert x.shape == p.q.shape
    assert z.shape == p.h.shape
    size = abs(x)
    dual = abs(p.P @ x + p.q + p.A.T @ y + p.G.T @ z + z_box).max()
    dual /= (abs(p.P) @ size + abs(p.q) + abs(p.A.T) @ abs(y) + abs(p.G.T) @ abs(z)).max() or 1
    rows = [0.0]
    if len(p.b):
        rows.append((abs(p.A @ x - p.b)).max() / ((abs(p.A) @ size + abs(p.b)).max() or 1))
    if len(p.h):
        value = p.G @ x
        outside = np.maximum(np.maximum(value - p.h, p.h_low - value), 0.0)
        rows.append(outside.max() / ((abs(p.G) @ size).max() or 1))
    assert np.all(x >= p.lb)
    assert np.all(x <= p.ub)
    gap, terms = x @ p.P @ x + p.q @ x + p.b @ y, abs(x @ p.P @ x) + abs(p.q @ x) + abs(p.b @ y)
    for value, low, high in ((z, p.h_low, p.h), (z_box, p.lb, p.ub)):
        side = np.where(value > 0, high, np.where(value < 0, low, 0.0))
        assert np.isfinite(side).all(), "a multiplier points to an infinite side"
        gap += value @ side
        terms += abs(value @ side)
    floor = 1e-4 * (abs(p.q) @ size + abs(p.b) @ abs(y))
    return max(dual, *rows, abs(gap) / (max(terms, floor) or 1.0))


def refutes(p, certificate):
    """Whether a Farkas pair excludes every x of the box."""
    y, z = certificate[: len(p.b)], certificate[len(p.b) :]
    c = p.A.T @ y + p.G.T @ z
    c[abs(c) <= 1e-11 * (abs(p.A.T) @ abs(y) + abs(p.G.T) @ abs(z))] = 0.0
    corner = np.where(c > 0, p.ub, np.where(c < 0, p.lb, 0.0))
    side = np.where(z > 0, p.h_low, np.where(z < 0, p.h, 0.0))
    return c @ corner < y @ p.b + z @ side


def descends(p, d):
    """Whether the objective falls for ever along a feasible direction."""
    size = abs(d)
    # In units where columns have entries of size one, rounding is that of a row's own entries.
    column = abs(np.vstack([p.P, p.A, p.G])).max(axis=0)
    unit = 1.0 / np.where(column > 0.0, column, 1.0)
    longest = (size / unit).max()

    def small(value, M):
        terms, rounding = abs(M) @ size, 1e-15 * (abs(M) * unit).max(axis=1, initial=0.0) * longest
        return np.all(value <= 1e-9 * terms + rounding)

    value = p.G @ d
    return (
        p.q @ d < -1e-9 * (abs(p.q) @ size)
        and small(abs(p.P @ d), p.P)
        and small(abs(p.A @ d), p.A)
        and small(np.where(np.isfinite(p.h), value, 0.0), p.G)
        and small(np.where(np.isfinite(p.h_low), -value, 0.0), p.G)
        and np.all(d[np.isfinite(p.lb)] >= 0.0)
        and np.all(d[np.isfinite(p.ub)] <= 0.0)
    )
