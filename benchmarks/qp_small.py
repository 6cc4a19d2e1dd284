"""Small dense quadratic programs: one, in a sequence, and in batches, beside quadprog, daqp, PIQP.

Each solver gets the problem as its interface wants it; stacking bounds and sides into rows is part
of its time, as it is of a user's, and so are our checks and our certificate. Times are medians over
problems of the least of some repeats, all solvers by turns in one process on one thread; `wrong`
counts answers of peers that miss ours, which is certified, by more than 1e-6 of its size.

With `--device` also a batch of 100,000 problems with n = 30 and 60 rows on one GPU, beside quadprog
on all cores of the host, with its arrays stacked beforehand.

    OMP_NUM_THREADS=1 python benchmarks/qp_small.py [--device]
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

from gpu import QPFactor, batch_solve_qp, solve_qp

Problem = dict[str, Any]  # arguments of solve_qp
FREE = {"G": None, "h": None, "h_low": None, "lb": None, "ub": None}


def random(rng: Any, n: int, m: int) -> Problem:
    """A strictly convex problem with m rows (none: a box), a good part of them active."""
    M = rng.standard_normal((n, n))
    P, q = M @ M.T / n + 0.1 * np.eye(n), rng.standard_normal(n)
    P = (P + P.T) / 2
    if not m:
        side = np.full(n, 0.3)
        return FREE | {"P": P, "q": q, "lb": -side, "ub": side}
    G = rng.standard_normal((m, n))
    h = G @ rng.standard_normal(n) + 0.3 * rng.random(m)
    return FREE | {"P": P, "q": q, "G": G, "h": h}


def control(rng: Any, steps: int, states: int = 2) -> tuple[Problem, np.ndarray]:
    """Condensed model predictive control with bounds of inputs and of all states, and the matrix
    that multiplies the initial state in q, h and h_low."""
    A = np.eye(states) + 0.1 * np.diag(np.ones(states - 1), 1)
    B = 0.1 * np.eye(states)[:, -1:] + 0.01 * rng.standard_normal((states, 1))
    free, forced = [np.eye(states)], [np.zeros((states, steps))]
    for k in range(steps):
        free.append(A @ free[-1])
        forced.append(A @ forced[-1])
        forced[-1][:, k] += B[:, 0]
    X, Phi = np.concatenate(free[1:]), np.concatenate(forced[1:])
    P = Phi.T @ Phi + 0.05 * np.eye(steps)
    P = (P + P.T) / 2
    # The goal is 1.5 for all states, of which 1 is the largest: the bounds are met.
    start, room = 0.5 * rng.random(states), np.ones(len(Phi))
    bounds = {"lb": np.full(steps, -6.0), "ub": np.full(steps, 6.0)}
    moved = {"q": Phi.T @ (X @ start - 1.5), "h": room - X @ start, "h_low": -room - X @ start}
    return FREE | {"P": P, "G": Phi} | bounds | moved, X


def degenerate(rng: Any, n: int) -> Problem:
    """Twice as many rows as unknowns through the solution, each of them twice."""
    p = random(rng, n, 2 * n)
    x = solve_qp(**p).x
    G = np.concatenate([p["G"], p["G"]])
    return p | {"G": G, "h": G @ x}


def stacked(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """All sides as rows C x <= d."""
    n, rows, sides = p["q"].size, [], []
    for M, side, sign in (
        (p["G"], p["h"], 1.0), (p["G"], p["h_low"], -1.0),
        (np.eye(n), p["ub"], 1.0), (np.eye(n), p["lb"], -1.0),
    ):  # fmt: skip
        if side is not None:
            rows.append(sign * M)
            sides.append(sign * side)
    return np.concatenate(rows), np.concatenate(sides)


def by_quadprog(quadprog: Any, p: Problem) -> np.ndarray:
    """Rows C'x >= d, given by columns."""
    C, d = stacked(p)
    return quadprog.solve_qp(p["P"], -p["q"], -C.T, -d, 0)[0]


def by_daqp(daqp: Any, p: Problem) -> np.ndarray:
    """Bounds of all variables, or of none, then rows, both with two sides."""
    n, G = p["q"].size, p["G"]
    G = np.zeros((0, n)) if G is None else G
    parts: list[list[np.ndarray]] = [[], []]
    if p["lb"] is not None:
        parts = [[p["lb"]], [p["ub"]]]
    if len(G):
        low = np.full(len(G), -1e30) if p["h_low"] is None else p["h_low"]
        parts = [[*parts[0], low], [*parts[1], p["h"]]]
    low, high = (np.concatenate(part) for part in parts)
    return daqp.solve(p["P"], p["q"], G, high, low, np.zeros(high.size, dtype=np.int32))[0]


def by_piqp(piqp: Any, p: Problem) -> np.ndarray:
    """Two-sided rows and bounds; its interior point is asked for 1e-9."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    n = p["q"].size
    empty = np.zeros((0, n)), np.zeros(0)
    G, h, low = (p[k] for k in ("G", "h", "h_low"))
    if G is None:
        G, h = empty
    solver.setup(p["P"], p["q"], *empty, G, low, h, p["lb"], p["ub"])
    solver.solve()
    return np.asarray(solver.result.x)


PEERS: dict[str, Callable[[Any, Problem], np.ndarray]] = {
    "quadprog": by_quadprog, "daqp": by_daqp, "piqp": by_piqp,
}  # fmt: skip


def peers() -> dict[str, Callable[[Problem], np.ndarray]]:
    """Those that can be imported."""
    found = {}
    for name, run in PEERS.items():
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        found[name] = lambda p, run=run, module=module: run(module, p)
    return found


def ours(p: Problem) -> np.ndarray:
    """`solve_qp`, certificate included."""
    return solve_qp(**p).x


def row(name: str, problems: list[Problem], repeats: int) -> dict[str, Any]:
    """Median microseconds of all solvers, by turns, and how often a peer is wrong."""
    solvers = {"ours": ours} | peers()
    seconds = {key: np.full(len(problems), np.inf) for key in solvers}
    wrong = dict.fromkeys(solvers, 0)
    for i, p in enumerate(problems):
        known = ours(p)
        for again in range(repeats):
            for key, solve in solvers.items():
                begin = time.perf_counter()
                try:
                    x = solve(p)
                except Exception:  # a peer's failure is a wrong answer
                    x = np.full(known.size, np.nan)
                seconds[key][i] = min(seconds[key][i], time.perf_counter() - begin)
                wrong[key] += not again and not abs(x - known).max() <= 1e-6 * abs(known).max()
    times = {key: 1e6 * float(np.median(value)) for key, value in seconds.items()}
    return {"case": name, "microseconds": times, "wrong": wrong, "problems": len(problems)}


def sequence(rng: Any, steps: int, length: int) -> dict[str, Any]:
    """A control loop: ours from the last active set, peers from scratch."""
    p, X = control(rng, steps)
    factor = QPFactor(p["P"], G=p["G"])
    sides = {key: p[key] for key in ("h", "lb", "ub", "h_low")}
    solvers = {"ours": lambda p: factor.solve(p["q"], **{key: p[key] for key in sides}).x}
    solvers |= peers()
    seconds: dict[str, list[float]] = {key: [] for key in solvers}
    moved = 0.0
    for _ in range(length):
        moved = 0.9 * moved + 0.02 * rng.standard_normal(X.shape[1])
        shift = X @ moved
        now = p | {
            "q": p["q"] + p["G"].T @ shift, "h": p["h"] - shift, "h_low": p["h_low"] - shift
        }  # fmt: skip
        for key, solve in solvers.items():
            begin = time.perf_counter()
            solve(now)
            seconds[key].append(time.perf_counter() - begin)
    times = {key: 1e6 * float(np.median(value)) for key, value in seconds.items()}
    return {"case": f"MPC sequence, {steps} inputs, warm", "microseconds": times}


def batch(rng: Any, count: int, n: int, m: int) -> dict[str, Any]:
    """Microseconds a problem of one call, beside a loop over peers."""
    problems = [random(rng, n, m) for _ in range(count)]
    data = {key: np.stack([p[key] for p in problems]) for key in ("P", "q", "G", "h")}
    batch_solve_qp(**data)
    begin = time.perf_counter()
    found = batch_solve_qp(**data)
    times = {"ours": 1e6 * (time.perf_counter() - begin) / count}
    assert not found.errors
    for key, solve in peers().items():
        begin = time.perf_counter()
        for p in problems:
            solve(p)
        times[key] = 1e6 * (time.perf_counter() - begin) / count
    name = f"batch of {count}, n = {n}, {m} rows"
    return {"case": name, "microseconds": times, "threads": len(os.sched_getaffinity(0))}


_DATA: Any = None  # of the processes that run quadprog


def _part(ends: tuple[int, int]) -> None:
    import quadprog

    P, q, C, d = _DATA
    for i in range(*ends):
        quadprog.solve_qp(P[i], -q[i], C[i], -d[i], 0)


def on_device(count: int = 100_000, n: int = 30, m: int = 60) -> dict[str, Any]:
    """A batch on one GPU, beside quadprog on all cores of its host."""
    global _DATA
    import cupy

    rng = np.random.default_rng(0)
    M, G = rng.standard_normal((count, n, n)), rng.standard_normal((count, m, n))
    P = M @ M.transpose(0, 2, 1) / n + 0.1 * np.eye(n)
    P = (P + P.transpose(0, 2, 1)) / 2
    h = np.einsum("kij,kj->ki", G, rng.standard_normal((count, n))) + 0.3 * rng.random((count, m))
    data = {"P": P, "q": rng.standard_normal((count, n)), "G": G, "h": h}
    there = {key: cupy.asarray(value) for key, value in data.items()}
    best = np.inf
    for _ in range(4):
        cupy.cuda.Device().synchronize()
        begin = time.perf_counter()
        found = batch_solve_qp(**there)
        cupy.cuda.Device().synchronize()
        best = min(best, time.perf_counter() - begin)
    some = rng.choice(count, 10_000, replace=False)
    alone = [solve_qp(P[i], data["q"][i], G[i], h[i]) for i in some]
    x = found.x.get()[some]
    apart = max(abs(r.x - y).max() / abs(r.x).max() for r, y in zip(alone, x, strict=True))
    statuses = all(r.status is found.status[i] for r, i in zip(alone, some, strict=True))
    result = {
        "count": count, "n": n, "rows": m, "seconds": best, "failed": len(found.errors),
        "worst": float(found.kkt.max()), "apart": float(apart), "same_statuses": statuses,
        "device": cupy.cuda.runtime.getDeviceProperties(0)["name"].decode(),
    }  # fmt: skip
    try:
        import quadprog  # noqa: F401
    except ImportError:
        return result
    _DATA = P, data["q"], np.ascontiguousarray(-G.transpose(0, 2, 1)), h
    cores = len(os.sched_getaffinity(0))
    ends = np.linspace(0, count, 8 * cores + 1).astype(int)
    with multiprocessing.get_context("fork").Pool(cores) as pool:
        pool.map(abs, range(4 * cores), 1)
        begin = time.perf_counter()
        pool.map(_part, list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)), 1)
        result["quadprog"] = time.perf_counter() - begin
    return result


def main() -> None:
    """Measure, print and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--device", action="store_true")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    rng, rows = np.random.default_rng(2026), []
    for n in (10, 20, 50):
        for m, name in ((0, "box"), (n, "n rows"), (3 * n, "3n rows")):
            many = [random(rng, n, m) for _ in range(12)]
            rows.append(row(f"n = {n}, {name}", many, options.repeats))
    for steps in (10, 20, 30):
        many = [control(rng, steps)[0] for _ in range(8)]
        rows.append(row(f"MPC with state rows, {steps} inputs", many, options.repeats))
    for n in (20, 40, 60):
        many = [degenerate(rng, n) for _ in range(4)]
        rows.append(row(f"degenerate, n = {n}", many, options.repeats))
    rows.append(sequence(rng, 30, 200))
    rows += [batch(rng, 200, n, m) for n, m in ((30, 60), (60, 100))]
    rows.append(row("n = 500, 1500 rows", [random(rng, 500, 1500)], 3))
    record: dict[str, Any] = {"machine": describe(), "rows": rows}
    if options.device:
        record["batch"] = on_device()
    for one in rows:
        times = {key: round(value, 1) for key, value in one["microseconds"].items()}
        print(one["case"], times, one.get("wrong"))
    print(record.get("batch", ""))
    path = Path(__file__).parent / "results" / "qp_small.json"
    path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
