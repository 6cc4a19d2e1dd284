"""Ours beside numbers that others have published, on as many cells, in the norms that they took.

* sphere: one revolution of the cosine bell of radius 1/3 and height 1 about an axis that leans by
  0, 45 and 90 degrees; the root of the mean squared error. MPAS-Ocean's flux of third order with
  beta = .25 (Skamarock and Gassmann, Mon. Weather Rev. 139, 2011, 2962-2975) on its quasi-uniform
  meshes of 240 and 120 km, 720 and 1440 steps: pull request 583 of github.com/MPAS-Dev/MPAS-Model,
  A. Bradley on 2020-08-19; the norm is that of cosine_bell/analysis.py of MPAS-Dev/compass. A
  hexagonal mesh of 240 km has about as many cells as 144 x 72.
* vortex: a circle of radius .2 is stretched and brought back in a period of 15; the mean of the
  change of the fractions of cells. Basilisk's volume of fluid on adaptive cells of at most 64^2
  and 128^2: src/test/reversed.c and reversed.ref of basilisk (github.com/slitvinov/basilisk).

    NUMBA_NUM_THREADS=1 python benchmarks/cip_cited.py --output benchmarks/results/cip_cited.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import machine
import numpy as np
from cip_sphere import PROFILES, T, bell, rotation

from cip import Grid, Solver, Sphere, SphereSolver, State, Velocity, area

MPAS, BASILISK = "MPAS-Ocean, order 3", "Basilisk, volume of fluid"
CITED = {
    ("bell", 72): (MPAS, 0.00471197, 720), ("bell", 144): (MPAS, 0.00106989, 1440),
    ("vortex", 64): (BASILISK, 0.0108781, None), ("vortex", 128): (BASILISK, 0.00159635, None),
}  # fmt: skip


def row(
    case: str, cells: int, scheme: str, error: float, steps: Any, **more: Any
) -> dict[str, Any]:
    """Return a row and print it."""
    found = {"case": case, "cells": cells, "scheme": scheme, "error": error, "steps": steps, **more}
    print(*found.values(), flush=True)
    return found


def bells(cells: int) -> list[dict[str, Any]]:
    """Return the errors of the bell, and how much the mass changed."""
    sphere, steps, found = Sphere(2 * cells, cells), 11 * cells // 10, []
    for profile in ("csl2_spline", "csl4_spline", "quintic_spline"):
        for angle in (0, 45, 90):
            wind = rotation(np.radians(angle))
            solver = SphereSolver(sphere, wind, PROFILES[profile], profile)
            start = solver.state(lambda lon, lat: bell(lon, lat) / 1000.0)
            end = solver.run(start, T, dt=T / steps).final
            squares = (sphere.weights * (end.data[0] - start.data[0]) ** 2).sum()
            error, lost = float(np.sqrt(squares / (4 * np.pi))), abs(end.mass / start.mass - 1)
            found.append(row("bell", cells, profile, error, steps, angle=angle, mass=lost))
    return found


def fractions(state: State, run: Any, place: int, parts: int = 8) -> Any:
    """Return the fraction of each cell in which a level set function is negative."""
    n = state.grid.cells[0]
    line = (np.arange(parts * n) + 0.5) / (parts * n)
    below = run.sample(np.stack(np.meshgrid(line, line, indexing="ij")), place) < 0.0
    return below.reshape(n, parts, n, parts).mean((1, 3))


def vortex(cells: int) -> list[dict[str, Any]]:
    """Return the change of the fractions of cells, and of the area: by a level set function, and by
    the fractions themselves as a density within its bounds."""
    wind = Velocity.from_expression(
        "1.5*sin(2*pi*t/15)*sin(pi*x1)*cos(pi*x2)", "-1.5*sin(2*pi*t/15)*cos(pi*x1)*sin(pi*x2)"
    )
    grid, steps, found = Grid([(0, 1)] * 2, (cells, cells)), 4 * cells, []
    x, y = grid.mesh()
    solver = Solver(grid, wind, profile="bicubic", boundary=1.0)
    start = State.from_function(np.hypot(x - 0.3, y - 0.263662) - 0.2, grid, "bicubic")
    run = solver.run(start, 15.0, dt=15.0 / steps)
    first = fractions(start, run, 0)
    change = float(np.abs(fractions(start, run, -1) - first).mean())
    lost = area(run.final) / area(start) - 1
    found.append(row("vortex", cells, "bicubic level set", change, steps, area=lost))
    solver = Solver(grid, wind, "conservative", "csl4", "bounds", boundary=0.0, bounds=(0, 1))
    begin = solver.state(lambda x, y: 1.0 * (np.hypot(x - 0.3, y - 0.263662) < 0.2))
    begin.data[-1][: grid.cells[0], : grid.cells[1]] = first
    end = solver.run(begin, 15.0, dt=15.0 / steps).final
    change = float(np.abs(end["mean"] - begin["mean"]).mean())
    lost = end.mass / begin.mass - 1
    found.append(row("vortex", cells, "csl4, bounds", change, steps, area=lost))
    return found


def main(arguments: list[str] | None = None) -> None:
    """Measure ours, print it beside the others and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path)
    output = parser.parse_args(arguments).output
    rows = []
    for (case, cells), (scheme, error, steps) in CITED.items():
        rows.append(row(case, cells, scheme, error, steps))
        rows += bells(cells) if case == "bell" else vortex(cells)
    if output:
        record = {"machine": machine.describe(), "rows": rows}
        output.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
