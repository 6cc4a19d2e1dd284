"""A rough surface on a half space and on a thick block beside tamaas and Polonsky-Keer's iteration.

The same self-affine heights under the same mean pressure: accuracy is the largest difference of
the pressure to a reference (ours at a certificate of 1e-12), over the largest pressure; seconds are
from heights to pressure at the loosest of the tolerances 1e-2, 1e-3, ... that reaches an accuracy.
tamaas (https://gitlab.com/tamaas/tamaas, AGPL-3.0; installed and imported by this script alone)
solves by Polonsky and Keer's conjugate gradients in C++, on one core; the same iteration in NumPy,
with SciPy's transforms as ours, tells the method from the language.

The half space has the same symbol here and there. A block of trilinear bricks, as deep as its
period, has it for waves of many cells only: its difference is measured on one surface, refined.

    python benchmarks/rough_peers.py --sizes 128 256 512 1024      # pip install tamaas
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
from machine import describe

from contact import GridContact, HalfSpace, PeriodicLayers, Rigid, self_affine
from contact.spectral.grid_result import corrected_area

E, NU, PRESSURE, DEPTH = 1.0, 0.3, 5e-3, 1.0
TOLERANCES = [10.0**-k for k in range(2, 13)]
GOALS = (1e-4, 1e-8)
Array = np.ndarray


def surface(n: int, cutoffs: tuple[int, int]) -> Array:
    """Heights of rms 5e-3 periods, of waves between the cutoffs, which n points sample."""
    return self_affine(n, hurst=0.8, rms=5e-3, cutoffs=cutoffs, seed=1)


def ours(heights: Array, tol: float, block: Any = None) -> Array:
    """Pressure by active sets on the half space, or on a block."""
    space = HalfSpace((1.0, 1.0), heights.shape, E, NU) if block is None else block
    ground = Rigid(heights.max() - heights, force=(None, None, PRESSURE))
    return GridContact(space, ground).solve(tol=tol).pressure


def ours_on_one_core(heights: Array, tol: float) -> Array:
    """The same by one thread."""
    all_of_them = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(all_of_them)})
    try:
        return ours(heights, tol)
    finally:
        os.sched_setaffinity(0, all_of_them)


def tamaas_pressure(heights: Array, tol: float) -> Array:
    """Pressure by tamaas."""
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    model = tamaas.ModelFactory.createModel(
        tamaas.model_type.basic_2d, [1.0, 1.0], list(heights.shape)
    )
    model.E, model.nu = E, NU
    solver = tamaas.PolonskyKeerRey(model, heights, tol)
    solver.max_iter = 100_000
    solver.solve(PRESSURE)
    return np.array(model.traction)


def polonsky_keer(heights: Array, tol: float) -> Array:
    """Polonsky and Keer, Wear 231 (1999) 206, section 3, in NumPy."""
    n = heights.shape[0]
    k = np.hypot(*np.meshgrid(scipy.fft.fftfreq(n, 1 / n), scipy.fft.rfftfreq(n, 1 / n),
                              indexing="ij"))  # fmt: skip
    symbol = np.where(k > 0, (1 - NU**2) / (np.pi * E * np.maximum(k, 1)), 0.0)

    def displacement(p: Array) -> Array:
        return scipy.fft.irfft2(symbol * scipy.fft.rfft2(p), s=p.shape)

    p, t = np.full_like(heights, PRESSURE), np.zeros_like(heights)
    before, delta, spread = 1.0, 0.0, float(np.ptp(heights))
    for _ in range(100_000):
        g = displacement(p) - heights
        inside = p > 0
        g -= g[inside].mean()
        if np.sum(p * np.abs(g)) <= tol * spread * p.sum() and g.min() > -tol * spread:
            break
        size = np.sum(g[inside] ** 2)
        t = np.where(inside, g + delta * size / before * t, 0.0)
        before = size
        r = displacement(t)
        r -= r[inside].mean()
        p = np.maximum(p - np.sum(g[inside] * t[inside]) / np.sum(r[inside] * t[inside]) * t, 0.0)
        joins = (p == 0) & (g < 0)
        delta = 0.0 if joins.any() else 1.0
        p[joins] -= np.sum(g[inside] * t[inside]) / np.sum(r[inside] * t[inside]) * g[joins]
        p *= PRESSURE / p.mean()
    return p


def seconds_to(solve: Callable[[Array, float], Array], heights: Array, wanted: Array) -> Any:
    """Seconds and tolerance that each goal takes, least of two runs."""
    found: dict[str, Any] = {}
    goals = list(GOALS)

    def timed(tol: float) -> tuple[float, Array]:
        begin = time.perf_counter()
        pressure = solve(heights, tol)
        return time.perf_counter() - begin, pressure

    for tol in TOLERANCES:
        seconds, pressure = timed(tol)
        error = float(np.abs(pressure - wanted).max() / wanted.max())
        if error > goals[0]:
            continue
        seconds = min(seconds, timed(tol)[0])
        while goals and error <= goals[0]:
            found[f"{goals.pop(0):.0e}"] = {
                "seconds": seconds, "tolerance": tol, "error": error,
                "area": float((pressure > 0).mean()), "force": float(pressure.mean() / PRESSURE),
                "force_off": off_in_squares(pressure, wanted),
            }  # fmt: skip
        if not goals:
            break
    return found


def beside(n: int, solvers: dict[str, Any]) -> dict[str, Any]:
    """Times on the half space: a surface whose shortest wave has eight points."""
    heights = surface(n, (2, n // 8))
    wanted = ours(heights, 1e-12)
    row: dict[str, Any] = {"n": n, "area": float((wanted > 0).mean())}
    for name, solve in solvers.items():
        row[name] = seconds_to(solve, heights, wanted)
        print(n, name, row[name], flush=True)
    return row


def in_squares(pressure: Array, squares: int = 16) -> Array:
    """Forces of 16 x 16 equal parts of the surface."""
    m = pressure.shape[0] // squares
    return pressure.reshape(squares, m, squares, m).sum(axis=(1, 3))


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def off_in_squares(pressure: Array, wanted: Array) -> float:
    """Difference of the forces on the squares, over their root mean square."""
    return rms(in_squares(pressure) - in_squares(wanted)) / rms(in_squares(wanted))


def thick_block(n: int, peer: Any) -> dict[str, Any]:
    """Differences of a block of bricks to the half space: n / 4 points in the shortest wave."""
    heights = surface(n, (2, 4))
    begin = time.perf_counter()
    block = PeriodicLayers((1.0, 1.0), [(DEPTH, round(DEPTH * n), E, NU)], (n, n))
    mine = ours(heights, 1e-10, block)
    seconds = time.perf_counter() - begin
    wanted = peer(heights, 1e-8)
    areas = {
        name: [corrected_area(p > 0, (1 / n, 1 / n)), float((p > 0).mean())]
        for name, p in (("block", mine), ("half space", wanted))
    }
    row = {
        "n": n, "seconds": seconds, "areas": areas,
        "area_off": areas["block"][1] / areas["half space"][1] - 1,
        "corrected_off": areas["block"][0] / areas["half space"][0] - 1,
        "force_off": off_in_squares(mine, wanted), "pressure_off": rms(mine - wanted) / rms(wanted),
    }  # fmt: skip
    print("block", row, flush=True)
    return row


def orders(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Powers of the spacing with which the differences of the block vanish, fitted."""
    sizes = np.log([row["n"] for row in rows])
    return {
        name: -float(np.polyfit(sizes, np.log([abs(row[name]) for row in rows]), 1)[0])
        for name in ("area_off", "corrected_off", "force_off", "pressure_off")
    }


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write results/rough_peers.json; without sizes it keeps the rows of old there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="*", default=[128, 256, 512])
    parser.add_argument("--block", type=int, nargs="*", default=[64, 128, 256, 512])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    solvers = {
        "ours": ours, "ours, one core": ours_on_one_core,
        "tamaas": tamaas_pressure, "Polonsky-Keer, NumPy": polonsky_keer,
    }  # fmt: skip
    path = options.output / "rough_peers.json"
    record: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    record |= {"benchmark": "rough_peers", "machine": describe()}
    record["peers"] = {"tamaas": importlib.metadata.version("tamaas")}
    if options.sizes:
        record["rows"] = [beside(n, solvers) for n in options.sizes]
    if options.block:
        record["block"] = [thick_block(n, tamaas_pressure) for n in options.block]
        record["orders"] = orders(record["block"])
        print("orders", record["orders"])
    options.output.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
