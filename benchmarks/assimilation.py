"""Seconds of a 4D-Var window in the plane, and of its parts in units of the run.

A steady flow on a periodic square of n x n cells, 100 steps, Adini's profile, 50 sensors that
report every tenth step. The window is solved by 50 combinations of reports: each is one tangent and
one adjoint run of the window, with the square root of the background. As many steps are enforced by
a tolerance that they do not reach; the quality of a solution is the business of the tests.

    OMP_NUM_THREADS=2 python benchmarks/assimilation.py --cells 256
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Covariance, Grid, Sensors, Solver, Velocity
from cip.assimilation.assimilation_window import AssimilationWindow
from cip.assimilation.four_d_var import combined_analysis

ROOT = Path(__file__).parents[1]
DT, STEPS = 0.01, 100


def seconds(task: Callable[[], Any], repeat: int = 3) -> float:
    """The least of some times; the first call, which compiles, does not count."""
    task()
    found = []
    for _ in range(repeat):
        begin = time.perf_counter()
        task()
        found.append(time.perf_counter() - begin)
    return min(found)


def window(cells: int) -> AssimilationWindow:
    """A tracer in a rotating flow, with random reports."""
    grid = Grid([(0, 1)] * 2, (cells, cells), periodic=True)
    solver = Solver(
        grid, Velocity.from_expression("sin(2*pi*x2)", "-sin(2*pi*x1)"), profile="adini"
    )
    rng = np.random.default_rng(0)
    times = DT * np.arange(10, STEPS + 1, 10)
    reports = rng.standard_normal((times.size, 50))
    sensors = Sensors(rng.random((2, 50)), times, reports, 0.05)
    B = Covariance.diffusion(grid, "adini", deviation=1.0, length=0.1)
    return AssimilationWindow(solver, solver.state(0.0), B, sensors, DT, None, None)


def measure(cells: int, iterations: int) -> dict[str, Any]:
    """Seconds of the run, of tangent, adjoint and square root, and of the whole window."""
    problem = window(cells)
    begin = time.perf_counter()
    path = problem.path(np.zeros(problem.layout.size))
    linear = problem.linearised(path)
    setup = time.perf_counter() - begin
    A = linear.operator()
    x, y = np.ones(A.shape[1]), np.ones(A.shape[0])
    run = seconds(lambda: problem.solver.run(problem.background, DT * STEPS, dt=DT))
    tangent, adjoint = seconds(lambda: A @ x), seconds(lambda: A.rmatvec(y))
    root = seconds(lambda: problem.covariance.root @ np.ones(cells * cells))
    steps: list[int] = []
    begin = time.perf_counter()
    combined_analysis(A, path.residuals, 1e-15, iterations, 0, lambda step, _: steps.append(step))
    return {
        "cells": cells, "iterations": steps[-1], "setup": setup, "run": run, "tangent": tangent,
        "adjoint": adjoint, "root": root, "window": time.perf_counter() - begin,
    }  # fmt: skip


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Measure, print, and write benchmarks/results/assimilation.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--iterations", type=int, default=50)
    parser.add_argument("--write", action="store_true", help="keep the result in results/")
    options = parser.parse_args(argv)
    found = measure(options.cells, options.iterations)
    print(", ".join(f"{k} {v:.3g}" for k, v in found.items()))
    result = {"machine": describe(), "window": found}
    if options.write:
        path = ROOT / "benchmarks" / "results" / "assimilation.json"
        path.write_text(json.dumps(result, indent=1) + "\n")
    return result


if __name__ == "__main__":
    main()
