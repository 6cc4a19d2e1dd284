"""CIP schemes on the CPU: nodes a second beside peers, cost against N, error against time.

One run measures, with best-of-many times of the kernels on precomputed feet:

* nodes a second and core of the one-dimensional cubic and of the two-dimensional Adini and bicubic
  kernels, all moments, beside `scipy.ndimage.map_coordinates` of order 3 (the cubic-spline
  semi-Lagrangian method, one moment) and a copy of the same bytes;
* the exponent of the cost in N, fitted;
* error against seconds for the Jiang-Shu profile after four periods: CSL4, the essentially
  non-oscillatory cubic, WENO5 with SSP-RK3 (compiled too), cubic splines, and PhiFlow's
  semi-Lagrangian and MacCormack steps where PhiFlow is installed.

    python benchmarks/cip.py
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["NUMBA_NUM_THREADS"] = os.environ.get("NUMBA_NUM_THREADS", "1")
# This file has the package's name: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe
from scipy import ndimage

from cip import Grid, Solver, Velocity


def best(action: Callable[[], Any], seconds: float = 1.0) -> float:
    """Shortest time of an action repeated for about so many seconds."""
    action()
    found, begin = np.inf, time.perf_counter()
    while time.perf_counter() - begin < seconds:
        start = time.perf_counter()
        action()
        found = min(found, time.perf_counter() - start)
    return float(found)


def kernel_rate(profile: str, shape: tuple[int, ...], dtype: Any = np.float64) -> float:
    """Nodes a second of one kernel with stored feet, on one core."""
    grid = Grid([(0, 1)] * len(shape), shape, periodic=True)
    formula = (
        ("0.5*sin(2*pi*x2)", "0.5*cos(2*pi*x1)") if len(shape) == 2 else ("1+0.5*sin(2*pi*x)",)
    )
    solver = Solver(grid, Velocity.from_expression(*formula), profile=profile, dtype=dtype)
    state = solver.state("sin(2*pi*x1)" + ("*cos(2*pi*x2)" if len(shape) == 2 else ""))
    stage = solver._stages[0]
    feet = solver.feet(stage, 0.0, 2.3 / shape[0])
    m, out = state.data.reshape(-1), np.empty_like(state.data).reshape(-1)
    return grid.size / best(lambda: solver._kernels.launch(stage, m, out, feet.data))


def spline_rate(shape: tuple[int, ...]) -> float:
    """Nodes a second of one cubic-spline semi-Lagrangian step of one moment."""
    u = np.random.default_rng(1).random(shape)
    place = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij")) + 0.4
    action = best(lambda: ndimage.map_coordinates(u, place, order=3, mode="grid-wrap"))
    return u.size / action


def copy_rate(numbers: int, size: int) -> float:
    """Nodes a second if only the bytes of the moments and feet were copied."""
    source = np.ones(numbers * size // 2)
    target = np.empty_like(source)
    return size / best(lambda: np.copyto(target, source))


def speeds() -> dict[str, Any]:
    """Rates in million nodes a second."""
    line, plane = 1 << 16, (256, 256)
    found = {
        "cubic 1-D": kernel_rate("cubic", (line,)),
        "cubic 1-D, copy of its bytes": copy_rate(6, line),
        "spline 1-D": spline_rate((line,)),
        "adini": kernel_rate("adini", plane),
        "adini float32": kernel_rate("adini", plane, np.float32),
        "adini, copy of its bytes": copy_rate(12, plane[0] * plane[1]),
        "bicubic": kernel_rate("bicubic", plane),
        "bicubic, copy of its bytes": copy_rate(16, plane[0] * plane[1]),
        "spline 2-D": spline_rate(plane),
    }
    rates = {name: rate / 1e6 for name, rate in found.items()}
    rates["adini / spline"] = rates["adini"] / rates["spline 2-D"]
    rates["bicubic / spline"] = rates["bicubic"] / rates["spline 2-D"]
    rates["cubic / spline"] = rates["cubic 1-D"] / rates["spline 1-D"]
    return rates


def cost_exponent() -> float:
    """Exponent of the seconds of an Adini step in the number of nodes, fitted."""
    sizes = (128, 256, 512, 1024)
    seconds = [n * n / kernel_rate("adini", (n, n)) for n in sizes]
    return float(np.polyfit(np.log(np.square(sizes)), np.log(seconds), 1)[0])


def weno() -> Callable[[np.ndarray, int, float], np.ndarray]:
    """WENO5 (Jiang and Shu 1996) with three-stage SSP Runge-Kutta for u_t + u_x = 0, periodic."""
    from numba import njit

    @njit
    def rate(u: np.ndarray, flux: np.ndarray, out: np.ndarray) -> None:
        n = u.size
        for i in range(n):
            a, b, c = u[(i - 2) % n], u[(i - 1) % n], u[i]
            d, e = u[(i + 1) % n], u[(i + 2) % n]
            s0 = 13 / 12 * (a - 2 * b + c) ** 2 + 0.25 * (a - 4 * b + 3 * c) ** 2
            s1 = 13 / 12 * (b - 2 * c + d) ** 2 + 0.25 * (b - d) ** 2
            s2 = 13 / 12 * (c - 2 * d + e) ** 2 + 0.25 * (3 * c - 4 * d + e) ** 2
            w0, w1, w2 = 0.1 / (1e-6 + s0) ** 2, 0.6 / (1e-6 + s1) ** 2, 0.3 / (1e-6 + s2) ** 2
            value = w0 * (2 * a - 7 * b + 11 * c) + w1 * (-b + 5 * c + 2 * d)
            flux[i] = (value + w2 * (2 * c + 5 * d - e)) / (6 * (w0 + w1 + w2))
        for i in range(n):
            out[i] = flux[(i - 1) % n] - flux[i]

    @njit
    def run(u: np.ndarray, steps: int, cfl: float) -> np.ndarray:
        flux, slope = np.empty_like(u), np.empty_like(u)
        for _ in range(steps):
            rate(u, flux, slope)
            v = u + cfl * slope
            rate(v, flux, slope)
            v = 0.75 * u + 0.25 * (v + cfl * slope)
            rate(v, flux, slope)
            u = u / 3 + 2 / 3 * (v + cfl * slope)
        return u

    run(np.zeros(8), 1, 0.1)
    return run


def error_against_time() -> list[dict[str, Any]]:
    """Rows for the Jiang-Shu profile, T = 8: L1 error of values and seconds of the steps."""
    profile = importlib.import_module("cip_jiang_shu")
    rows, run = [], weno()
    for n in (100, 200, 400):
        h = 2.0 / n
        grid = profile.grid(n)
        for name, limiter, cfl in (
            ("csl4", "bounds", 0.4), ("csl4", "bounds", 3.7), ("cubic", "eno", 3.7),
            ("cubic", None, 3.7),
        ):  # fmt: skip
            solver = profile.solver(grid, name, limiter)
            start = profile.start(solver)
            solver.step(start, cfl * h)
            begin = time.perf_counter()
            end = solver.run(start, 8.0, dt=cfl * h).final
            seconds = time.perf_counter() - begin
            error = h * np.abs(end["u"] - start["u"]).sum()
            label = f"{name} {limiter or ''} CFL {cfl}"
            rows.append({"scheme": label, "n": n, "seconds": seconds, "l1": error})
        values = profile.exact(grid.coordinates[0])
        begin = time.perf_counter()
        final = run(values, round(8 / (0.4 * h)), 0.4)
        seconds = time.perf_counter() - begin
        rows.append(
            {"scheme": "WENO5-RK3 CFL 0.4", "n": n, "seconds": seconds,
             "l1": h * np.abs(final - values).sum()}
        )  # fmt: skip
        u = values.copy()
        steps = round(8 / (3.7 * h))
        shift = 8 / steps / h
        place = (np.arange(n) - shift)[None]
        begin = time.perf_counter()
        for _ in range(steps):
            u = ndimage.map_coordinates(u, place, order=3, mode="grid-wrap")
        seconds = time.perf_counter() - begin
        rows.append(
            {"scheme": "cubic spline CFL 3.7", "n": n, "seconds": seconds,
             "l1": h * np.abs(u - values).sum()}
        )  # fmt: skip
        rows += phiflow(n, values)
    return rows


def phiflow(n: int, values: np.ndarray) -> list[dict[str, Any]]:
    """The same profile by PhiFlow, if it is installed."""
    try:
        flow = importlib.import_module("phi.flow")
    except ImportError:
        return []
    h, rows = 2.0 / n, []
    steps = round(8 / (0.8 * h))
    for name in ("semi_lagrangian", "mac_cormack"):
        field = flow.CenteredGrid(
            flow.tensor(values, flow.spatial("x")), flow.extrapolation.PERIODIC, x=n,
            bounds=flow.Box(x=(-1, 1)),
        )  # fmt: skip
        wind = flow.CenteredGrid(1.0, flow.extrapolation.PERIODIC, x=n, bounds=flow.Box(x=(-1, 1)))
        advance = getattr(flow.advect, name)
        begin = time.perf_counter()
        for _ in range(steps):
            field = advance(field, wind, 8 / steps)
        seconds = time.perf_counter() - begin
        error = h * float(np.abs(field.values.numpy("x") - values).sum())
        rows.append({"scheme": f"PhiFlow {name} CFL .8", "n": n, "seconds": seconds, "l1": error})
    return rows


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the tables and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    results: dict[str, Any] = {"machine": describe(), "speeds": speeds()}
    print("million nodes a second on one core, all moments, stored feet")
    for name, rate in results["speeds"].items():
        print(f"  {name:30s} {rate:8.1f}", flush=True)
    results["cost_exponent"] = cost_exponent()
    print(f"cost of an Adini step ~ nodes^{results['cost_exponent']:.3f}", flush=True)
    results["jiang_shu"] = error_against_time()
    print("\nJiang-Shu profile, T = 8\nscheme                          n   seconds       L1")
    for row in results["jiang_shu"]:
        print(f"{row['scheme']:28s} {row['n']:5d} {row['seconds']:9.4f} {row['l1']:8.4f}")
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "cip.json").write_text(json.dumps(results, indent=1) + "\n")
    return results


if __name__ == "__main__":
    main()
