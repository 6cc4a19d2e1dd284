"""What a further tracer costs on the same feet: steps of one, two and five fields, on one thread.

Steady velocities keep their feet, those of an unsteady formula are computed in every step. The
least processor time of interleaved repetitions; "second" is (T(2) - T(1)) / T(1), "each of five"
(T(5) - T(1)) / (4 T(1)). With kept feet no ratio can fall to what it is where feet are computed: of
the bytes of a bicubic node, 64 of feet and 64 of moments read and written, a further field needs
one half; csl4 reads 32 of feet and 64 of moments in each sweep, so it needs two thirds.

    NUMBA_NUM_THREADS=1 python benchmarks/cip_tracers.py --cells 512 --output benchmarks/results
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Grid, Solver, Velocity

COUNTS = (1, 2, 5)


def times(profile: str, steady: bool, cells: int, repetitions: int) -> dict[int, float]:
    """Seconds of a step at one cell's width of motion, by the number of fields."""
    clock = "" if steady else "*cos(t)"
    wind = Velocity.from_expression(f"1 + 0.5*sin(2*pi*x2){clock}", f"0.5*sin(2*pi*x1){clock}")
    form = "conservative" if profile == "csl4" else "advective"
    solver = Solver(
        Grid([(0, 1)] * 2, (cells, cells), periodic=True), wind, form, profile,
        splitting="strang" if profile == "csl4" else None,
    )  # fmt: skip
    states = {
        count: solver.state({f"u{q}x": f"{q} + sin(2*pi*x1)*cos(2*pi*x2)" for q in range(count)})
        for count in COUNTS
    }
    found = dict.fromkeys(COUNTS, np.inf)
    for _ in range(repetitions):
        for count, state in states.items():
            for _ in range(4):
                begin = time.thread_time()
                state = solver.step(state, 1.0 / cells)
                found[count] = min(found[count], time.thread_time() - begin)
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=512)
    parser.add_argument("--repetitions", type=int, default=4)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    print("profile  velocity  ms of one  second  each of five")
    for profile in ("bicubic", "csl4"):
        for steady in (True, False):
            t = times(profile, steady, options.cells, options.repetitions)
            second, each = (t[2] - t[1]) / t[1], (t[5] - t[1]) / (4 * t[1])
            word = "steady" if steady else "unsteady"
            print(f"{profile:8} {word:9} {1e3 * t[1]:9.1f} {second:7.2f} {each:13.2f}", flush=True)
            row = {"profile": profile, "velocity": word, "cells": options.cells, "seconds": t[1]}
            rows.append(row | {"second": second, "each_of_five": each})
    if options.output:
        record = {"machine": describe(), "rows": rows}
        path = options.output / "cip_tracers.json"
        path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
