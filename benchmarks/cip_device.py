"""The two-dimensional kernels on a CUDA device beside the copy bandwidth and a cubic-spline peer.

One run measures, with device events and medians:

* the bandwidth of a device-to-device copy, bytes read plus written;
* one step of Adini's and of the bicubic profile with stored feet, float64 and float32: nodes a
  second, and bytes a second at 96 (Adini, float64) bytes a node: moments in and out, feet;
* the same with feet computed in the kernel, for the rotation and for a time-dependent velocity;
* a step of the cubic-spline semi-Lagrangian method with cupyx's `map_coordinates`, which updates
  one moment;
* the largest difference between CPU and device after ten steps, by profile.

    python benchmarks/cip_device.py --cells 2048 8192
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Grid, Solver, Velocity

# About the centre, and periodic with its derivatives.
ROTATION = ("x2*(1 - x2*x2)", "x1*(x1*x1 - 1)")
SWIRL = ("sin(pi*x1)**2*sin(2*pi*x2)*cos(pi*t)", "-sin(pi*x2)**2*sin(2*pi*x1)*cos(pi*t)")
DIRECT = ("adini", "bicubic")
# Numbers a node: moments in and out, and the feet where they are stored.
BYTES = {("adini", True): 12, ("adini", False): 6, ("bicubic", True): 16, ("bicubic", False): 8}


def seconds(action: Any, repeats: int = 20) -> float:
    """Median time of an action on the device."""
    import cupy as cp

    for _ in range(3):
        action()
    times = []
    for _ in range(repeats):
        begin, end = cp.cuda.Event(), cp.cuda.Event()
        begin.record()
        action()
        end.record()
        end.synchronize()
        times.append(cp.cuda.get_elapsed_time(begin, end) / 1e3)
    return statistics.median(times)


def copy_bandwidth(size: int) -> float:
    """Bytes read and written a second by a copy of `size` float64 numbers."""
    import cupy as cp

    source = cp.random.random(size)
    target = cp.empty_like(source)
    return 2 * source.nbytes / seconds(lambda: cp.copyto(target, source))


def kernels(n: int, dtype: Any, bandwidth: float) -> list[dict[str, Any]]:
    """Rows for stored and computed feet on n x n nodes."""
    grid = Grid([(-1, 1)] * 2, (n, n), periodic=True)
    return [
        kernel_row(grid, profile, velocity, stored, dtype, bandwidth)
        for profile in ("adini", "bicubic")
        for velocity, stored in ((ROTATION, True), (ROTATION, False), (SWIRL, False))
    ]


def kernel_row(
    grid: Grid, profile: str, velocity: Any, stored: bool, dtype: Any, bandwidth: float
) -> dict[str, Any]:
    """One kernel: nodes and bytes a second."""
    import cupy as cp

    n = grid.nodes[0]
    field = Velocity.from_expression(*velocity)
    solver = Solver(grid, field, profile=profile, backend="cupy", dtype=dtype, store_feet=stored)
    stage, run = solver._stages[0], solver._kernels
    cp.random.seed(3)
    m = cp.random.random(len(stage_moments(profile)) * grid.size).astype(dtype)
    out = cp.full_like(m, cp.nan)
    dt, count = 2.0 * 2.0 / n, 0
    if stored:
        feet = random_feet(stage, grid, dtype)
        time = seconds(lambda: run.launch(stage, m, out, feet))
    else:
        count = stage.substeps(0.0, dt)
        time = seconds(lambda: run.launch_path(stage, m, out, dt, dt, count))
    moved = BYTES[profile, stored] * np.dtype(dtype).itemsize * grid.size / time
    return {
        "profile": profile, "nodes": n, "dtype": np.dtype(dtype).name,
        "feet": "stored" if stored else "computed", "substeps": count,
        "velocity": "rotation" if velocity is ROTATION else "swirl(t)",
        "gnodes_per_s": grid.size / time / 1e9, "tb_per_s": moved / 1e12,
        "of_copy": moved / bandwidth, "finite": bool(cp.isfinite(out).all()),
    }  # fmt: skip


def stage_moments(profile: str) -> tuple[str, ...]:
    """Moments of a direct profile."""
    return ("u", "u_x", "u_y") if profile == "adini" else ("u", "u_x", "u_y", "u_xy")


def random_feet(stage: Any, grid: Grid, dtype: Any) -> Any:
    """Smooth displacements up to two cells and Jacobians near the identity, made on the device."""
    import cupy as cp

    n = grid.nodes[0]
    x = cp.arange(n) / n * 2 * np.pi
    wave = cp.sin(x)[:, None] * cp.cos(x)[None, :]
    feet = cp.empty((len(stage.jets), n, n), dtype=dtype)
    feet[:] = wave * 0.01
    feet[0] = 2 * wave
    feet[1] = 2 * wave.T - 0.3
    feet[2] += 1
    feet[5] += 1
    return feet.reshape(-1)


def spline_peer(n: int) -> dict[str, Any]:
    """One step of the cubic-spline semi-Lagrangian method: prefilter and interpolation."""
    import cupy as cp
    from cupyx.scipy import ndimage

    cp.random.seed(3)
    u = cp.random.random((n, n))
    place = cp.stack(cp.meshgrid(cp.arange(n), cp.arange(n), indexing="ij")).astype(float) + 0.4
    time = seconds(lambda: ndimage.map_coordinates(u, place, order=3, mode="grid-wrap"), 10)
    return {"nodes": n, "gnodes_per_s": n * n / time / 1e9}


def field(*x: Any) -> Any:
    """A smooth periodic field."""
    return 2 + np.sin(2 * np.pi * x[0]) * np.cos(4 * np.pi * x[-1])


def agreement() -> dict[str, float]:
    """Largest difference of CPU and device after ten steps, relative to the largest moment."""
    found = {}
    swirl = ("0.4 + 0.2*sin(2*pi*x1)*cos(t)", "0.3*cos(2*pi*x1)", "0.2*sin(2*pi*x2)")
    cases = [
        ("linear", 1, "transport"), ("piecewise_linear", 1, "transport"),
        ("cubic", 1, "advection"), ("quintic", 1, "advection"), ("csl2", 1, "advection"),
        ("csl4", 1, "advection"), ("adini", 2, "transport"), ("adini", 2, "advection"),
        ("bicubic", 2, "transport"), ("bicubic", 2, "advection"), ("cubic", 3, "transport"),
        ("quintic", 2, "transport"), ("csl2", 2, "advection"), ("csl2", 3, "advection"),
        ("csl4", 2, "advection"), ("csl4", 3, "advection"),
    ]  # fmt: skip
    for profile, dim, form in cases:
        grid = Grid([(0, 1)] * dim, (32,) * dim, periodic=True)
        names = (
            swirl[:dim]
            if not profile.startswith("csl")
            else (*(part.replace("*cos(t)", "") for part in swirl[:dim]),)
        )
        ends = []
        for backend in ("cpu", "cupy"):
            solver = Solver(
                grid, Velocity.from_expression(*names), form, profile, backend=backend,
                splitting="strang" if dim > 1 and profile not in DIRECT else None,
            )  # fmt: skip
            start = solver.state(
                lambda *x: 2 + np.sin(2 * np.pi * x[0]) * np.cos(4 * np.pi * x[-1])
            )
            ends.append(solver.run(start, 0.5, dt=0.05).final.data)
        scale = np.abs(ends[0]).reshape(len(ends[0]), -1).max(axis=1)
        error = np.abs(ends[0] - ends[1]).reshape(len(ends[0]), -1).max(axis=1)
        found[f"{profile} {dim}-D {form}"] = float(np.max(error / scale))
    return found


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the tables and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[2048, 8192])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    import cupy as cp

    results: dict[str, Any] = {"machine": describe()}
    name = cp.cuda.runtime.getDeviceProperties(0)["name"].decode()
    results["device"] = {"name": name, "cupy": cp.__version__}
    results["agreement"] = agreement()
    for case, error in results["agreement"].items():
        print(f"CPU - device, {case:32s} {error:.1e}", flush=True)
    results["copy_tb_per_s"] = copy_bandwidth(2**28) / 1e12
    print(f"\n{name}: copy {results['copy_tb_per_s']:.2f} TB/s", flush=True)
    results["kernels"], results["spline"] = [], []
    for n in options.cells:
        for dtype in (np.float64, np.float32):
            for row in kernels(n, dtype, 1e12 * results["copy_tb_per_s"]):
                results["kernels"].append(row)
                print(
                    f"{row['profile']:8s} {n:5d}^2 {row['dtype']} {row['feet']:8s} "
                    f"{row['velocity']:8s} ({row['substeps']:2d}) {row['gnodes_per_s']:7.2f} "
                    f"Gn/s {row['tb_per_s']:5.2f} TB/s, {100 * row['of_copy']:5.1f} % of copy",
                    flush=True,
                )
        results["spline"].append(spline_peer(n))
        peer = results["spline"][-1]["gnodes_per_s"]
        print(f"cupyx cubic spline {n:5d}^2 {peer:.2f} Gnode/s", flush=True)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "cip_device.json"
    path.write_text(json.dumps(results, indent=1) + "\n")
    return results


if __name__ == "__main__":
    main()
