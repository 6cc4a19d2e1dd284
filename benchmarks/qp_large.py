"""Larger quadratic programs on one thread: 500 unknowns with 1500 rows, and sparse ones of 10,000.

- dense: a random program, of which almost as many rows as unknowns hold at the solution;
- obstacle: a membrane of 100 x 100 points above a paraboloid;
- portfolio: 10,000 assets with 100 factors, half of whose weights are zero;
- MPC: states and inputs of a controller, 2 + 1, 8 + 4 and 12 + 6 in each of many stages, all of
  them bounded; and one from whose first state no inputs lead back into the bounds.

Ours with its checks and its certificate, beside PIQP, Clarabel, OSQP and, dense only (sparse it
takes 11 s for the obstacle, minutes for the portfolio), ProxQP, all asked for 1e-9; setting up
counts. Times are the least of some repeats by turns in one process, of processor seconds.
`violation` is that of the rows and bounds over the largest entry of x, `excess` the distance of the
objective from ours over its size.

    OMP_NUM_THREADS=1 python benchmarks/qp_large.py
"""

from __future__ import annotations

import argparse
import importlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from qp_small import Problem, random
from scipy import sparse

from gpu import Infeasible, solve_qp

EMPTY: Problem = dict.fromkeys(("G", "h", "A", "b", "lb", "ub"))


def obstacle(side: int = 100) -> Problem:
    """Bounds from below on a membrane under a uniform load."""
    line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    one = sparse.eye_array(side)
    P = sparse.csc_array(sparse.kron(line, one) + sparse.kron(one, line))
    s = np.arange(1, side + 1) / (side + 1)
    low = 0.3 - 4.0 * ((s[:, None] - 0.5) ** 2 + (s - 0.5) ** 2)
    return EMPTY | {"P": P, "q": np.full(side**2, 4.0 / (side + 1) ** 2), "lb": low.ravel()}


def portfolio(assets: int = 10_000, factors: int = 100) -> Problem:
    """Risk by factors y = F'x and of each asset, against a return; weights sum to one."""
    rng = np.random.default_rng(0)
    F = sparse.random_array(
        (assets, factors), density=0.5, rng=rng, data_sampler=rng.standard_normal
    )
    own = sparse.diags_array(np.sqrt(factors) * rng.random(assets))
    A = sparse.block_array(
        [[sparse.csr_array(np.ones((1, assets))), None], [F.T, -sparse.eye_array(factors)]]
    )
    return EMPTY | {
        "P": sparse.block_diag((own, sparse.eye_array(factors)), format="csc"),
        "q": np.concatenate([-rng.standard_normal(assets), np.zeros(factors)]),
        "A": sparse.csc_array(A),
        "b": np.concatenate([[1.0], np.zeros(factors)]),
        "lb": np.concatenate([np.zeros(assets), np.full(factors, -np.inf)]),
    }


def control(states: int, inputs: int, steps: int, start: float = 0.5) -> Problem:
    """Inputs and states of all stages, with the dynamics as rows."""
    rng = np.random.default_rng(states)
    M, B = rng.standard_normal((states, states)), rng.standard_normal((states, inputs))
    M /= abs(np.linalg.eigvals(M)).max()
    here = sparse.kron(sparse.eye_array(steps), np.hstack([-B, np.eye(states)]))
    before = sparse.diags_array(np.ones(steps - 1), offsets=-1, shape=(steps, steps))
    A = here + sparse.kron(before, np.hstack([np.zeros((states, inputs)), -M]))
    b = np.zeros(states * steps)
    b[:states] = M @ (start * rng.uniform(-1.0, 1.0, states))
    weight = rng.uniform(0.1, 10.0, states) * (rng.random(states) < 0.7)
    goal = np.concatenate([np.zeros(inputs), weight])
    bound = np.tile(np.concatenate([np.full(inputs, 0.1), np.ones(states)]), steps)
    return EMPTY | {
        "P": sparse.csc_array(
            sparse.diags_array(np.tile(goal + np.repeat([0.1, 0.0], [inputs, states]), steps))
        ),
        "q": np.kron(rng.standard_normal(steps), goal),
        "A": sparse.csc_array(A),
        "b": b,
        "lb": -bound,
        "ub": bound,
    }


def sides(p: Problem, equal: bool = True) -> tuple[Any, np.ndarray, np.ndarray]:
    """Rows and bounds as ``low <= C x <= high``, without equality rows if not `equal`."""
    n, none = p["q"].size, np.inf
    rows, low, high = [], [], []
    if p["A"] is not None and equal:
        rows, low, high = [p["A"]], [p["b"]], [p["b"]]
    if p["G"] is not None:
        rows.append(sparse.csc_array(p["G"]))
        low.append(np.full(p["h"].size, -none))
        high.append(p["h"])
    if p["lb"] is not None or p["ub"] is not None:
        rows.append(sparse.eye_array(n))
        low.append(np.full(n, -none) if p["lb"] is None else p["lb"])
        high.append(np.full(n, none) if p["ub"] is None else p["ub"])
    return sparse.csc_array(sparse.vstack(rows)), np.concatenate(low), np.concatenate(high)


def by_piqp(piqp: Any, p: Problem) -> Any:
    """Dense or sparse, with bounds of its own."""
    full = isinstance(p["P"], np.ndarray)
    solver = piqp.DenseSolver() if full else piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    make = np.asarray if full else sparse.csc_matrix
    A, G = (make(np.zeros((0, p["q"].size)) if p[k] is None else p[k]) for k in ("A", "G"))
    b, h = (np.zeros(0) if p[k] is None else p[k] for k in ("b", "h"))
    solver.setup(make(p["P"]), p["q"], A, b, G, None, h, p["lb"], p["ub"])
    solver.solve()
    return solver.result.x


def by_proxsuite(proxsuite: Any, p: Problem) -> Any:
    """Dense, bounds as rows."""
    C, low, high = sides(p)
    A, b = np.zeros((0, p["q"].size)), np.zeros(0)
    low, high = np.maximum(low, -1e20), np.minimum(high, 1e20)
    options = {"eps_abs": 1e-9, "eps_rel": 0.0}
    solve = proxsuite.proxqp.dense.solve
    return solve(p["P"], p["q"], A, b, C.toarray(), low, high, **options).x


def by_clarabel(clarabel: Any, p: Problem) -> Any:
    """Zero cone of equality rows, then one-sided rows."""
    C, low, high = sides(p, equal=False)
    up, down = np.isfinite(high), np.isfinite(low)
    rows, right = [C[up], -C[down]], [high[up], -low[down]]
    cones = [clarabel.NonnegativeConeT(int(up.sum() + down.sum()))]
    if p["A"] is not None:
        rows, right = [p["A"], *rows], [p["b"], *right]
        cones = [clarabel.ZeroConeT(p["b"].size), *cones]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    P = sparse.csc_matrix(sparse.triu(sparse.csc_array(p["P"])))
    C = sparse.csc_matrix(sparse.vstack(rows))
    data = P, p["q"], C, np.concatenate(right), cones, settings
    return np.array(clarabel.DefaultSolver(*data).solve().x)


def by_osqp(osqp: Any, p: Problem) -> Any:
    """First order, with its polish."""
    C, low, high = sides(p)
    solver = osqp.OSQP()
    P = sparse.csc_matrix(sparse.triu(sparse.csc_array(p["P"])))
    options = {"eps_abs": 1e-9, "eps_rel": 1e-9, "polishing": True}
    options |= {"max_iter": 100_000, "time_limit": 3.0}
    solver.setup(P, p["q"], sparse.csc_matrix(C), low, high, verbose=False, **options)
    return solver.solve(raise_error=False).x


PEERS: dict[str, Callable[[Any, Problem], Any]] = {
    "piqp": by_piqp, "proxsuite": by_proxsuite, "clarabel": by_clarabel, "osqp": by_osqp,
}  # fmt: skip


def ours(p: Problem) -> Any:
    """`solve_qp`; None where it proves that there is no solution."""
    try:
        return solve_qp(**p).x
    except Infeasible:
        return None


def errors(p: Problem, x: Any, known: Any) -> dict[str, float]:
    """How far x is outside, and how far its objective is off."""
    if x is None or not np.isfinite(np.asarray(x, dtype=float)).all():
        return {"violation": np.inf, "excess": np.inf}
    C, low, high = sides(p)
    outside = np.maximum(low - C @ x, C @ x - high).max()
    value, best = (0.5 * v @ (p["P"] @ v) + p["q"] @ v for v in (x, known))
    size = float(abs(known).max())
    return {"violation": float(outside) / size, "excess": float(abs(value - best) / abs(best))}


def row(name: str, p: Problem, repeats: int) -> dict[str, Any]:
    """Processor seconds of all solvers by turns, and their errors where there is a solution."""
    solvers: dict[str, Callable[[Problem], Any]] = {"ours": ours}
    for peer, run in PEERS.items():
        if peer == "proxsuite" and sparse.issparse(p["P"]):
            continue
        try:
            module = importlib.import_module(peer)
        except ImportError:
            continue
        solvers[peer] = lambda p, run=run, module=module: run(module, p)
    seconds, found = dict.fromkeys(solvers, np.inf), {}
    for again in range(repeats):
        for key, solve in solvers.items():
            if again and seconds[key] > 5.0 * seconds["ours"]:
                continue
            begin = time.process_time()
            found[key] = solve(p)
            seconds[key] = min(seconds[key], time.process_time() - begin)
    result: dict[str, Any] = {"case": name, "unknowns": p["q"].size, "seconds": seconds}
    if found["ours"] is not None:
        result["errors"] = {key: errors(p, x, found["ours"]) for key, x in found.items()}
    return result


def main() -> None:
    """Measure, print and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    cases = {
        f"500 unknowns, 1500 rows, seed {seed}": EMPTY
        | {
            key: value
            for key, value in random(np.random.default_rng(seed), 500, 1500).items()
            if key in ("P", "q", "G", "h")
        }
        for seed in range(4)
    }
    cases |= {
        "obstacle": obstacle(),
        "portfolio": portfolio(),
        "MPC, 2 states": control(2, 1, 3333),
        "MPC, 8 states": control(8, 4, 833),
        "MPC, 12 states": control(12, 6, 555),
        "MPC, 8 states, infeasible": control(8, 4, 833, start=8.0),
    }
    record: dict[str, Any] = {"benchmark": "qp_large", "machine": describe(), "rows": []}
    for name, p in cases.items():
        record["rows"].append(one := row(name, p, options.repeats))
        times = {key: round(1e3 * value, 1) for key, value in one["seconds"].items()}
        print(name, times, one.get("errors", ""), flush=True)
    path = Path(__file__).parent / "results" / "qp_large.json"
    path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
