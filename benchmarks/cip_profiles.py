r"""Which profile: every one, with every limiter, on flows that bring the field back to its start.

* line: Jiang and Shu's profile (J. Comput. Phys. 126, 1996, 202-228), carried as a density by the
  speed 1 + .9 sin(pi x) once around;
* rotation, one turn: a Gaussian bell, and Zalesak's slotted disk (J. Comput. Phys. 31, 1979,
  335-362);
* swirl (LeVeque, SIAM J. Numer. Anal. 33, 1996, 627-665), a cosine bell, T = 1.5;
* deformation: Smolarkiewicz's vortices (Mon. Weather Rev. 110, 1982, 1968-1983) turned back by a
  cosine, T = 1, a disk with a smooth edge;
* space: LeVeque's deformation, T = 3, a ball with a smooth edge.

Beside them the semi-Lagrangian method with SciPy's cubic splines and a finite-difference WENO5 with
SSP-RK3 (Jiang and Shu; written here in NumPy). Errors are relative, in L1, of the nodal values; the
cost is that of a step in times of one spline with its prefilter: the least processor time of steps
inside a run, on one thread.

Then what limits csl4 in planes: errors at a time at which the field is deformed, against the
exact flow map, with and without shear; and the areas of level sets that return, Zalesak's disk
and the vortex in a box (Enright et al., J. Comput. Phys. 183, 2002, 83-116).

    NUMBA_NUM_THREADS=1 python benchmarks/cip_profiles.py --output benchmarks/results
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

os.environ["NUMBA_NUM_THREADS"] = os.environ.get("NUMBA_NUM_THREADS", "1")
# This folder has a module with the package's name: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe
from scipy import ndimage

from cip import Grid, Solver, State, Velocity, area, flow_map
from cip.profiles.catalogue import CONSERVATIVE, LIMITERS, PLANE

NUMPY = {"sin": np.sin, "cos": np.cos, "pi": np.pi}


def bell(x: Any, y: Any) -> Any:
    """A Gaussian bell."""
    return np.exp(-60 * ((x - 0.5) ** 2 + (y - 0.7) ** 2))


def cosine_bell(x: Any, y: Any) -> Any:
    """LeVeque's cosine bell."""
    return 0.5 * (1 + np.cos(np.pi * np.minimum(np.hypot(x - 0.25, y - 0.5) / 0.15, 1)))


def disk(x: Any, y: Any) -> Any:
    """A disk with a smooth edge."""
    return 0.5 * (1 - np.tanh((np.hypot(x - 0.5, y - 0.75) - 0.15) / 0.03))


def slotted(x: Any, y: Any) -> Any:
    """Zalesak's slotted disk."""
    slot = (np.abs(x - 0.5) < 0.025) & (y < 0.85)
    return np.where((np.hypot(x - 0.5, y - 0.75) < 0.15) & ~slot, 1.0, 0.0)


def ball(x: Any, y: Any, z: Any) -> Any:
    """A ball with a smooth edge."""
    radius = np.sqrt((x - 0.35) ** 2 + (y - 0.35) ** 2 + (z - 0.35) ** 2)
    return 0.5 * (1 - np.tanh((radius - 0.15) / 0.03))


def jiang_shu(x: Any) -> Any:
    """Gaussians, a square, a triangle and half an ellipse, on [-1, 1]."""

    def mean(part: Callable[[float], Any]) -> Any:
        return (part(-0.005) + part(0.005) + 4 * part(0.0)) / 6

    beta = np.log(2) / (36 * 0.005**2)
    ellipse = mean(lambda d: np.sqrt(np.maximum(1 - 100 * (x - 0.5 - d) ** 2, 0)))
    return (
        mean(lambda d: np.exp(-beta * (x + 0.7 + d) ** 2))
        + ((x >= -0.4) & (x <= -0.2))
        + np.maximum(1 - np.abs(10 * (x - 0.1)), 0)
        + np.where((x >= 0.4) & (x <= 0.6), ellipse, 0)
    )


class Case(NamedTuple):
    """A flow that brings the field back, in `steps` steps."""

    flow: tuple[str, ...]
    field: Any
    end: float
    cells: int
    steps: int
    bounds: tuple[float, float] = (0.0, 1.0)
    low: float = 0.0
    walls: bool = False


TURN = ("2*pi*(0.5 - x2)", "2*pi*(x1 - 0.5)")
SWIRL = ("sin(pi*x1)**2*sin(2*pi*x2)*cos(pi*t/1.5)", "-sin(2*pi*x1)*sin(pi*x2)**2*cos(pi*t/1.5)")
CASES = {
    "line": Case(("1 + 0.9*sin(pi*x1)",), jiang_shu, 2 / np.sqrt(1 - 0.81), 200, 250, low=-1.0),
    "rotation": Case(TURN, bell, 1.0, 64, 80, walls=True),
    "zalesak": Case(TURN, slotted, 1.0, 100, 120, walls=True),
    "swirl": Case(SWIRL, cosine_bell, 1.5, 64, 48),
    "deformation": Case(
        ("sin(4*pi*(x1 + 0.5))*sin(4*pi*(x2 + 0.5))*cos(pi*t)",
         "cos(4*pi*(x1 + 0.5))*cos(4*pi*(x2 + 0.5))*cos(pi*t)"), disk, 1.0, 64, 48,
    ),
    "space": Case(
        ("2*sin(pi*x1)**2*sin(2*pi*x2)*sin(2*pi*x3)*cos(pi*t/3)",
         "-sin(2*pi*x1)*sin(pi*x2)**2*sin(2*pi*x3)*cos(pi*t/3)",
         "-sin(2*pi*x1)*sin(2*pi*x2)*sin(pi*x3)**2*cos(pi*t/3)"), ball, 3.0, 24, 24,
    ),
}  # fmt: skip
LEFT_OUT = ("linear", "piecewise_linear", "smoothed")  # of space: of order 1, 2, and for comparison


def grid_of(case: Case) -> Grid:
    """The grid of a case."""
    dim = len(case.flow)
    return Grid([(case.low, 1)] * dim, (case.cells,) * dim, periodic=not case.walls)


def relative(end: Any, start: Any) -> float:
    """The relative error in L1."""
    return float(np.abs(end - start).sum() / np.abs(start).sum())


def profiles(dim: int) -> list[tuple[str, str | None]]:
    """All that a dimension takes, without and with limiters."""
    names = [name for name in LIMITERS if (name not in PLANE or dim == 2)]
    names = [name for name in names if not (dim == 3 and name in LEFT_OUT)]
    return [(name, limiter) for name in names for limiter in (None, *LIMITERS[name])]


def ours(case: Case, profile: str, limiter: str | None) -> dict[str, Any]:
    """Error, change of mass, extrema and processor time of a step."""
    conservative = profile in CONSERVATIVE or len(case.flow) == 1
    solver = Solver(
        grid_of(case), Velocity.from_expression(*case.flow),
        "conservative" if conservative else "advective", profile, limiter,
        "strang" if len(case.flow) > 1 and profile not in PLANE else None,
        0.0 if case.walls else None, bounds=(0.0, np.inf) if len(case.flow) == 1 else case.bounds,
    )  # fmt: skip
    start = solver.state(case.field)
    solver.step(start, case.end / case.steps)
    clock = [time.thread_time()]
    end = solver.run(
        start, case.end, dt=case.end / case.steps,
        callback=lambda state: clock.append(time.thread_time()),
    ).final  # fmt: skip
    return {
        "profile": profile, "limiter": limiter, "error": relative(end["u"], start["u"]),
        "mass": float(end.mass / start.mass - 1), "least": float(end["u"].min()),
        "largest": float(end["u"].max()), "seconds": float(np.diff(clock).min()),
    }  # fmt: skip


def speeds(case: Case) -> Callable[[Any, float], Any]:
    """The velocity as a function of places, shape (dim, ..), and time."""
    codes = [compile(text, "flow", "eval") for text in case.flow]

    def found(x: Any, t: float) -> Any:
        names = {f"x{q + 1}": one for q, one in enumerate(x)} | {"t": t} | NUMPY
        return np.stack([eval(code, names) + 0 * x[0] for code in codes])

    return found


def splines(case: Case) -> dict[str, Any]:
    """Semi-Lagrangian steps by the cubic splines of SciPy, paths by Runge-Kutta's method."""
    grid, speed = grid_of(case), speeds(case)
    x, h = np.stack(grid.mesh()), grid.spacing[0]
    u = start = case.field(*x)
    mode, clock, dt = "constant" if case.walls else "grid-wrap", np.inf, case.end / case.steps
    for k in range(case.steps):
        foot, t, inner, J = x, (k + 1) * dt, dt / 8, 1.0
        for _ in range(8):
            a = speed(foot, t)
            b = speed(foot - inner / 2 * a, t - inner / 2)
            c = speed(foot - inner / 2 * b, t - inner / 2)
            foot, t = (
                foot - inner / 6 * (a + 2 * b + 2 * c + speed(foot - inner * c, t - inner)),
                t - inner,
            )
        if len(x) == 1:  # a density changes with the width of what it moves with: steady in 1-D
            J = speed(foot, t)[0] / speed(x, t)[0]
        begin = time.thread_time()
        u = ndimage.map_coordinates(u, (foot - case.low) / h, order=3, mode=mode) * J
        clock = min(clock, time.thread_time() - begin)
    return {
        "profile": "splines", "limiter": None, "error": relative(u, start), "seconds": clock,
        "mass": float(u.sum() / start.sum() - 1), "least": float(u.min()),
        "largest": float(u.max()),
    }  # fmt: skip


def rebuilt(a: Any, b: Any, c: Any, d: Any, e: Any) -> Any:
    """WENO5's value at the right end of cell c from five means."""
    s0 = 13 / 12 * (a - 2 * b + c) ** 2 + (a - 4 * b + 3 * c) ** 2 / 4
    s1 = 13 / 12 * (b - 2 * c + d) ** 2 + (b - d) ** 2 / 4
    s2 = 13 / 12 * (c - 2 * d + e) ** 2 + (3 * c - 4 * d + e) ** 2 / 4
    w0, w1, w2 = (w / (1e-6 + s) ** 2 for w, s in ((0.1, s0), (0.6, s1), (0.3, s2)))
    first, second, third = 2 * a - 7 * b + 11 * c, -b + 5 * c + 2 * d, 2 * c + 5 * d - e
    return (w0 * first + w1 * second + w2 * third) / (6 * (w0 + w1 + w2))


def weno(case: Case) -> dict[str, Any]:
    """WENO5 with Lax and Friedrichs's splitting and SSP-RK3 at Courant number .5."""
    grid, speed = grid_of(case), speeds(case)
    x, h = np.stack(grid.mesh()), grid.spacing[0]
    p = start = case.field(*x)

    def rate(p: Any, t: float) -> Any:
        total = np.zeros_like(p)
        for axis, c in enumerate(speed(x, t)):
            top = np.abs(c).max()
            plus, minus = 0.5 * (c * p + top * p), 0.5 * (c * p - top * p)
            flux = rebuilt(*(np.roll(plus, -k, axis) for k in (-2, -1, 0, 1, 2)))
            flux += rebuilt(*(np.roll(minus, -k, axis) for k in (3, 2, 1, 0, -1)))
            total -= (flux - np.roll(flux, 1, axis)) / h
        return total

    fastest = np.abs(speed(x, 0.0)).max(axis=tuple(range(1, x.ndim))).sum()
    steps = int(np.ceil(case.end * fastest / (0.5 * h)))
    dt, clock = case.end / steps, np.inf
    for k in range(steps):
        begin, t = time.thread_time(), k * dt
        first = p + dt * rate(p, t)
        second = 0.75 * p + 0.25 * (first + dt * rate(first, t + dt))
        p = p / 3 + 2 / 3 * (second + dt * rate(second, t + dt / 2))
        clock = min(clock, time.thread_time() - begin)
    return {
        "profile": "WENO5", "limiter": None, "error": relative(p, start),
        "seconds": clock * steps / case.steps, "steps": steps,
        "mass": float(p.sum() / start.sum() - 1), "least": float(p.min()),
        "largest": float(p.max()),
    }  # fmt: skip


def orders() -> list[dict[str, Any]]:
    """Errors of deformed fields in the plane against the exact flow map: where each component of
    the velocity varies across its own direction (shear), and where it does not."""
    found = []
    flows = {
        "shear": ("sin(pi*x1)**2*sin(2*pi*x2)", "-sin(2*pi*x1)*sin(pi*x2)**2"),
        "none": ("0.5 + 0.3*sin(2*pi*x1)", "0.4 + 0.2*cos(2*pi*x2)"),
    }
    for flow, texts in flows.items():
        wind = Velocity.from_expression(*texts)
        for profile in ("bicubic", "csl4"):
            for n, steps in ((16, 64), (32, 128), (64, 256), (32, 8), (32, 32)):
                grid = Grid([(0, 1)] * 2, (n, n), periodic=True)
                split = None if profile in PLANE else "strang"
                solver = Solver(grid, wind, "conservative", profile, splitting=split)
                start = solver.state(bell_in_the_middle)
                end = solver.run(start, 0.5, dt=0.5 / steps).final
                back = flow_map(wind, grid, 0.5, 0.0)
                exact = bell_in_the_middle(*back.positions) * determinant(back.gradient)
                row = {"flow": flow, "profile": profile, "cells": n, "steps": steps}
                found.append(row | {"error": relative(end["u"], exact)})
    return found


def bell_in_the_middle(x: Any, y: Any) -> Any:
    """A periodic bell."""
    return np.exp(7 * (np.cos(2 * np.pi * (x - 0.5)) + np.cos(2 * np.pi * (y - 0.65)) - 2) / 4)


def determinant(gradient: Any) -> Any:
    """That of the gradient of a map of the plane."""
    return gradient[0, 0] * gradient[1, 1] - gradient[0, 1] * gradient[1, 0]


def distance_to_slotted(x: Any, y: Any) -> Any:
    """A function that is negative in Zalesak's disk of Enright et al., a hundredth of its size."""
    slot = np.maximum(np.abs(x - 0.5) - 0.025, y - 0.85)
    return np.maximum(np.hypot(x - 0.5, y - 0.75) - 0.15, -slot)


def distance_to_circle(x: Any, y: Any) -> Any:
    """A function that is negative in the circle of the vortex in a box."""
    return np.hypot(x - 0.5, y - 0.75) - 0.15


def areas() -> list[dict[str, Any]]:
    """The change of the area inside level sets after one turn and in the vortex of period 8."""
    vortex = tuple(text.replace("1.5", "8") for text in SWIRL)
    found = []
    for name, texts, field, end, sizes in (
        ("zalesak", TURN, distance_to_slotted, 1.0, (50, 100)),
        ("vortex", vortex, distance_to_circle, 8.0, (64, 128)),
    ):
        for profile in ("bicubic", "adini"):
            for n in sizes:
                grid = Grid([(0, 1)] * 2, (n, n))
                wind = Velocity.from_expression(*texts)
                solver = Solver(grid, wind, profile=profile, boundary=1.0)
                start = State.from_function(field(*grid.mesh()), grid, profile)
                run = solver.run(start, end, dt=end / (2 * n))
                first, last = area(start), area(run.final)
                row = {"case": name, "profile": profile, "cells": n, "area": first}
                found.append(row | {"change": last / first - 1})
    return found


def main(arguments: list[str] | None = None) -> None:
    """Run all cases, print and write them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path)
    parts: dict[str, Callable[[], Any]] = {"orders": orders, "areas": areas}
    parser.add_argument("--cases", nargs="*", default=[*CASES, *parts], help="others are kept")
    options = parser.parse_args(arguments)
    path = None if options.output is None else options.output / "cip_profiles.json"
    record: dict[str, Any] = json.loads(path.read_text()) if path and path.exists() else {}
    record["machine"] = describe()
    for name in options.cases:
        if name in parts:
            record[name] = parts[name]()
            for row in record[name]:
                print(*row.values(), flush=True)
            continue
        case, rows = CASES[name], []
        peers: list[Callable[[], dict[str, Any]]] = [
            lambda c=case: splines(c),
            lambda c=case: weno(c),
        ]
        mine = [lambda c=case, p=p: ours(c, *p) for p in profiles(len(case.flow))]
        for make in (*peers, *mine):
            rows.append(make())
            rows[-1]["cost"] = rows[-1]["seconds"] / rows[0]["seconds"]
            shown = {k: f"{v:.3g}" if isinstance(v, float) else v for k, v in rows[-1].items()}
            print(name, *shown.values(), flush=True)
        record[name] = {"cells": case.cells, "steps": case.steps, "rows": rows}
    if path:
        path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
