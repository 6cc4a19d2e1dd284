"""What a step costs, and a further tracer on the same feet, on one thread.

A step over one cell's width, in times of one cubic spline of SciPy with its prefilter at as many
points: of a steady velocity, whose feet are kept, of an unsteady formula and of winds from 11
snapshots, by splines of degree 5 and 3. Then "second" is (T(2) - T(1)) / T(1) for steps of one and
two fields, "each of five" (T(5) - T(1)) / (4 T(1)). The least processor time of interleaved
repetitions. With kept feet no ratio can fall to what it is where feet are computed: of the bytes of
a bicubic node, 64 of feet and 64 of moments read and written, a further field needs one half; csl4
reads 32 of feet and 64 of moments in each sweep, so it needs two thirds.

    python benchmarks/cip_tracers.py --cells 512 --output benchmarks/results
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from itertools import product
from pathlib import Path
from typing import Any

os.environ["NUMBA_NUM_THREADS"] = "1"
# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe
from scipy import ndimage

from cip import Grid, Solver, Velocity

COUNTS = (1, 2, 5)
SWIRL = (
    "0.3 + 1.2*sin(2*pi*x1)*cos(2*pi*x2)*cos({t})",
    "-1.2*cos(2*pi*x1)*sin(2*pi*x2)*cos({t}) + 0.3*cos({t})",
)


def velocities(grid: Grid) -> dict[str, Velocity]:
    """The same velocity, at rest in time, as a formula and from snapshots."""
    moving, still = ([c.format(t=t) for c in SWIRL] for t in ("t", "0"))
    times, (x1, x2) = np.linspace(0, 1, 11), grid.mesh()
    names = {"sin": np.sin, "cos": np.cos, "pi": np.pi, "x1": x1, "x2": x2}
    winds = [[eval(c, names | {"t": t}) for c in moving] for t in times]
    return {
        "steady": Velocity.from_expression(*still),
        "formula": Velocity.from_expression(*moving),
        "winds, degree 5": Velocity.from_snapshots(times, winds, grid),
        "winds, degree 3": Velocity.from_snapshots(times, winds, grid, 3),
    }


def times(profile: str, cells: int, repetitions: int) -> dict[Any, float]:
    """Seconds of a step by velocity and number of fields, and of the spline."""
    grid = Grid([(0, 1)] * 2, (cells, cells), periodic=True)
    more: Any = {"form": "conservative", "splitting": "strang"} if profile == "csl4" else {}
    solvers = {
        kind: Solver(grid, velocity, profile=profile, **more)
        for kind, velocity in velocities(grid).items()
    }
    found: dict[Any, float] = dict.fromkeys(["unit", *product(solvers, COUNTS)], np.inf)
    text = "{} + sin(2*pi*x1)*cos(2*pi*x2)"
    starts = {
        count: solvers["steady"].state({f"u{q}x": text.format(q) for q in range(count)})
        for count in COUNTS
    }
    place = np.stack(np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")) + 0.4
    u = grid.mesh()[0]
    for turn in range(repetitions + 1):
        begin = time.thread_time()
        ndimage.map_coordinates(u, place, order=3, mode="grid-wrap")
        found["unit"] = min(found["unit"], time.thread_time() - begin)
        for kind, count in product(solvers, COUNTS):
            state = starts[count]
            for step in range(4):  # the first of a run finds its sub-steps
                begin = time.thread_time()
                state = solvers[kind].step(state, 1.0 / cells)
                if turn and step:
                    found[kind, count] = min(found[kind, count], time.thread_time() - begin)
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=512)
    parser.add_argument("--repetitions", type=int, default=4)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args(arguments)
    rows = []
    print("profile  velocity         ms of one  splines  of formula  second  each of five")
    for profile in ("bicubic", "adini", "csl4"):
        found = times(profile, options.cells, options.repetitions)
        for kind in ("steady", "formula", "winds, degree 5", "winds, degree 3"):
            one, two, five = (found[kind, count] for count in COUNTS)
            row = {"profile": profile, "velocity": kind, "cells": options.cells, "seconds": one}
            row |= {"splines": one / found["unit"], "of_formula": one / found["formula", 1]}
            row |= {"second": (two - one) / one, "each_of_five": (five - one) / (4 * one)}
            rows.append(row)
            numbers = (row[key] for key in ("splines", "of_formula", "second", "each_of_five"))
            words = f"{profile:8} {kind:16} {1e3 * one:9.1f}"
            print(words + "".join(f" {number:8.2f}" for number in numbers), flush=True)
    if options.output:
        record = {"machine": describe(), "load": os.getloadavg()[0], "rows": rows}
        path = options.output / "cip_tracers.json"
        path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
