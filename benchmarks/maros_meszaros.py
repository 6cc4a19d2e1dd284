"""The quadratic programs of Maros and Meszaros (1999) by `solve_qp`, checked from outside.

I. Maros, C. Meszaros, A repository of convex quadratic programming problems, Optimization Methods
and Software 11 (1999) 671-681: 138 real problems, to 300,000 unknowns, badly scaled, degenerate,
semidefinite. They are not part of this repository. The folder holds them as MATLAB files, one a
problem, with the arrays P, q, A, l, u: minimise x'Px/2 + q'x over l <= Ax <= u, where the last rows
of A are the identity and stand for the bounds; so they come with the benchmarks of proxsuite.

Every problem runs in a process of its own, on one thread, and its answer is judged by the residuals
of `qpsolvers.Solution` in units of the problem (`plain`), and by those divided by their largest
terms (`relative`). A second run with ``polish="digits"`` gives `absolute` and its seconds.

    python benchmarks/maros_meszaros.py FOLDER --limit 300 [--names HS21 CONT-050]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
import warnings
from math import fsum
from pathlib import Path
from typing import Any

import numpy as np
import qpsolvers
from machine import describe
from numpy.typing import NDArray
from scipy import io, sparse

from gpu import GpuError, register_qpsolvers

Array = NDArray[np.float64]
INFINITE = 9e19  # the files write 1e20
EQUAL = 1e-10
RESIDUALS = "relative", "plain", "absolute"


def read(path: Path) -> qpsolvers.Problem:
    """Read a problem, rows with equal sides as equations and one-sided rows as G x <= h."""
    data = io.loadmat(path)
    A = sparse.csr_array(data["A"].astype(float))
    low, high = (data[name].ravel().astype(float) for name in "lu")
    low[low < -INFINITE], high[high > INFINITE] = -np.inf, np.inf
    n = data["q"].size
    rows = A[:-n]
    equal = high[:-n] - low[:-n] < EQUAL
    sides = np.r_[high[:-n][~equal], -low[:-n][~equal]]
    G = sparse.vstack([rows[~equal], -rows[~equal]], format="csr")[np.isfinite(sides)]
    h, b = sides[np.isfinite(sides)], high[:-n][equal]
    return qpsolvers.Problem(
        sparse.csc_matrix(data["P"].astype(float)),
        data["q"].ravel().astype(float),
        sparse.csc_matrix(G) if h.size else None,
        h if h.size else None,
        sparse.csc_matrix(rows[equal]) if b.size else None,
        b if b.size else None,
        low[-n:],
        high[-n:],
    )


def largest(*vectors: Array) -> float:
    """Largest modulus of all entries; 0 of none."""
    return max(float(np.abs(v).max(initial=0.0)) for v in vectors)


def relative(solution: qpsolvers.Solution) -> list[float]:
    """Primal and dual residual, gap and sign, each over its largest terms.

    The gap is the sum of all products of multiplier and distance, none of them negative.
    """
    problem, x, box = solution.problem, solution.x, solution.z_box
    P, q = problem.P, problem.q
    none = sparse.csr_array((0, q.size)), np.zeros(0)
    A, b = (problem.A, problem.b) if problem.b is not None else none
    G, h = (problem.G, problem.h) if problem.h is not None else none
    y = solution.y if problem.b is not None else np.zeros(0)
    z = solution.z if problem.h is not None else np.zeros(0)
    Px, Ax, Gx = P @ x, A @ x, G @ x
    forces = Px, q, A.T @ y, G.T @ z, box
    force, length = largest(*forces) or 1.0, largest(Ax, b, Gx, h, x) or 1.0
    out = np.concatenate([np.abs(Ax - b), Gx - h, problem.lb - x, x - problem.ub])
    side = np.where(box > 0, problem.ub, np.where(box < 0, problem.lb, 0.0))
    terms = np.concatenate([x * Px, q * x, b * y, h * z, side * box])
    size = max(abs(fsum(x * Px)), abs(fsum(q * x)), abs(fsum(x * Px) / 2 + fsum(q * x)))
    return [
        float(out.max(initial=0.0)) / length,
        largest(sum(forces[1:], forces[0])) / force,
        abs(fsum(terms)) / (size or 1.0),
        float(np.maximum(-z, 0.0).max(initial=0.0)) / force,
    ]


def plain(solution: qpsolvers.Solution) -> list[float]:
    """Primal and dual residual and gap in units of the problem."""
    residuals = (solution.primal_residual, solution.dual_residual, solution.duality_gap)
    return [float(residual()) for residual in residuals]


def attempt(path: Path, answer: Any) -> None:
    """Solve one problem and send its row, then the same with the digits of a second run."""
    warnings.simplefilter("ignore")
    register_qpsolvers()
    problem = read(path)
    rows = [0 if side is None else int(side.size) for side in (problem.b, problem.h)]
    row: dict[str, Any] = {"name": path.stem, "n": problem.q.size, "rows": rows}
    start = time.perf_counter()
    solution = qpsolvers.solve_problem(problem, "pdas")
    row["seconds"] = round(time.perf_counter() - start, 2)
    if not solution.found:
        error = solution.extras["error"]
        row |= {"outcome": type(error).__name__ if isinstance(error, GpuError) else repr(error)}
    else:
        row |= {
            "outcome": "solved",
            "path": solution.extras["path"],
            "plain": plain(solution),
            "relative": relative(solution),
            "objective": float(problem.q @ solution.x + solution.x @ (problem.P @ solution.x) / 2),
        }
    answer.send(row)
    if not solution.found:
        return
    start = time.perf_counter()
    solution = qpsolvers.solve_problem(problem, "pdas", polish="digits")
    row["digits_seconds"] = round(time.perf_counter() - start, 2)
    answer.send(row | {"absolute": plain(solution)})


def run(path: Path, limit: float) -> dict[str, Any]:
    """Solve one problem in its own process; a row that says so where it takes too long."""
    context = multiprocessing.get_context("spawn")
    mine, theirs = context.Pipe(duplex=False)
    process = context.Process(target=attempt, args=(path, theirs))
    process.start()
    theirs.close()
    row: dict[str, Any] = {"name": path.stem, "seconds": limit, "outcome": "time is up"}
    try:
        if mine.poll(limit):
            row = mine.recv()
            if row["outcome"] == "solved" and mine.poll(limit):
                row = mine.recv()
    except EOFError:
        row["outcome"] = "died"
    process.kill()
    process.join()
    return row


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Solve, print a line each and the counts, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=float, default=300.0, help="seconds a problem")
    parser.add_argument("--names", nargs="*")
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    paths = sorted(options.folder.glob("*.mat"), key=lambda path: path.stat().st_size)
    if options.names is not None:
        paths = [path for path in paths if path.stem in options.names]
    if not paths:
        parser.error(f"no problem of these names in {options.folder}")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # read by the processes of the problems
    rows = []
    for path in paths:
        rows.append(row := run(path, options.limit))
        worst = [f"{max(row[kind]):.0e}" for kind in RESIDUALS if kind in row]
        print(f"{row['name']:10} {row['outcome']:12} {row['seconds']:8.2f} s", *worst, flush=True)
    solved = [row for row in rows if row["outcome"] == "solved"]
    small = [row for row in rows if row.get("n", 1001) <= 1000]
    record = {
        "benchmark": "maros_meszaros",
        "machine": describe(),
        "limit": options.limit,
        "problems": len(rows),
        "solved": len(solved),
        **{
            f"{kind}_1e-9": sum(max(row.get(kind, [1.0])) <= 1e-9 for row in solved)
            for kind in RESIDUALS
        },
        "to_1000_unknowns": len(small),
        "to_1000_unknowns_relative_1e-9": sum(
            max(row.get("relative", [1.0])) <= 1e-9 for row in small
        ),
        "rows": rows,
    }
    print({key: value for key, value in record.items() if isinstance(value, int)})
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "maros_meszaros.json").write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
