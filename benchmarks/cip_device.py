"""The two-dimensional kernels on a CUDA device beside the copy bandwidth and a cubic-spline peer.

One run measures, with device events and medians:

* the bandwidth of a device-to-device copy, bytes read plus written;
* one step of Adini's and of the bicubic profile with stored feet, float64 and float32: nodes a
  second, and bytes a second at 96 (Adini, float64) bytes a node: moments in and out, feet;
* the same with feet computed in the kernel, for the rotation, and in each step for a velocity that
  depends on time, by a formula or by snapshots; csl4 counts the bytes of moments in each sweep;
* their arithmetic floor: operations of float64 in the machine code, over the measured rate;
* what a second tracer costs on the same feet, beside the copy of its moments;
* a step of the cubic-spline semi-Lagrangian method with cupyx's `map_coordinates`, which updates
  one moment;
* the largest difference between CPU and device after ten steps, by profile.

    python benchmarks/cip_device.py --cells 2048 8192
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Grid, Solver, Velocity
from cip.engines.cuda_kernels import device_source
from cip.engines.displacement_source import FollowSource, update_source

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
    rows = [
        kernel_row(grid, profile, stored, dtype, bandwidth)
        for profile in DIRECT
        for stored in (True, False)
    ]
    coarse = min(n // 4, 1024)
    winds = {"swirl(t)": Velocity.from_expression(*SWIRL)}
    if dtype == np.float64:
        winds["snapshots"] = snapshots(coarse)
        winds["cubic snapshots"] = snapshots(coarse, 3)
    return rows + [
        step_row(grid, profile, name, velocity, dtype, bandwidth)
        for profile in (*DIRECT, "csl4")
        for name, velocity in winds.items()
        if not (profile == "csl4" and name == "cubic snapshots")
    ]


@cache
def snapshots(cells: int, degree: int = 5, drift: float = 0.0) -> Velocity:
    """Five snapshots of the swirl, at intervals longer than a step."""
    grid = Grid([(-1, 1)] * 2, (cells, cells), periodic=True)
    (x, y), times = grid.mesh(), np.linspace(0, 1, 5)
    u = drift + np.sin(np.pi * x) ** 2 * np.sin(2 * np.pi * y)
    v = drift - np.sin(np.pi * y) ** 2 * np.sin(2 * np.pi * x)
    arrays = np.cos(np.pi * times)[:, None, None, None] * np.array([u, v])
    return Velocity.from_snapshots(times, arrays, grid, degree)


def kernel_row(
    grid: Grid, profile: str, stored: bool, dtype: Any, bandwidth: float
) -> dict[str, Any]:
    """One kernel of a steady velocity: nodes and bytes a second."""
    import cupy as cp

    n = grid.nodes[0]
    field = Velocity.from_expression(*ROTATION)
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
    feet_of = "stored" if stored else "computed"
    moved = BYTES[profile, stored] * np.dtype(dtype).itemsize * grid.size
    row = {"profile": profile, "velocity": "rotation", "feet": feet_of, "substeps": count}
    return (
        row | rates(grid, dtype, time, moved, bandwidth) | {"finite": bool(cp.isfinite(out).all())}
    )


def rates(grid: Grid, dtype: Any, time: float, moved: float, bandwidth: float) -> dict[str, Any]:
    """Nodes and bytes a second."""
    return {
        "nodes": grid.nodes[0], "dtype": np.dtype(dtype).name,
        "gnodes_per_s": grid.size / time / 1e9, "tb_per_s": moved / time / 1e12,
        "of_copy": moved / time / bandwidth,
    }  # fmt: skip


def step_row(
    grid: Grid, profile: str, name: str, velocity: Any, dtype: Any, bandwidth: float
) -> dict[str, Any]:
    """Whole steps of an unsteady velocity, of one field and of two."""
    n = grid.nodes[0]
    times, split = {}, "strang" if profile == "csl4" else None
    form = "advection" if split else "transport"
    solver = Solver(grid, velocity, form, profile, backend="cupy", dtype=dtype, splitting=split)
    for fields in (1, 2):
        times[fields], finite = step_seconds(solver, fields, 2.0 * 2.0 / n)
    counts = {key: found[1] for key, found in solver._kernels.substep_counts.items()}
    moments = 4 if profile == "csl4" else len(stage_moments(profile))
    moved = 2 * moments * len(solver._stages) * np.dtype(dtype).itemsize * grid.size
    further = times[2] - times[1]
    row = {"profile": profile, "velocity": name, "feet": "computed"}
    row |= {"substeps": max(counts.values()), "finite": finite, "second": further / times[1]}
    row |= rates(grid, dtype, times[1], moved, bandwidth)
    return row | {"second_of_copy": moved / further / bandwidth, "seconds": times[1]}


def step_seconds(solver: Solver, fields: int, dt: float) -> tuple[float, bool]:
    """Seconds of a step of random moments, and whether the result is finite."""
    import cupy as cp

    cp.random.seed(3)
    start = solver.state({f"u{q}x": 0.0 for q in range(fields)} if fields > 1 else 0.0)
    m, run = cp.random.random(start.data.shape).astype(solver._kernels.dtype), solver._kernels
    last = [m]

    def step() -> None:
        last[0] = m
        for stage in solver._stages:
            last[0] = run.apply(stage, last[0], 0.1, dt)

    return seconds(step), bool(cp.isfinite(last[0]).all())


def arithmetic_rate() -> float:
    """Fused multiply-adds in float64 a second."""
    import cupy as cp

    lines = "".join(f"a{q} = a{q} * x + y; " for q in range(8))
    source = f"""extern "C" __global__ void run(double* out, double x, double y) {{
        double {", ".join(f"a{q} = threadIdx.x + {q}" for q in range(8))};
        for (int n = 0; n < 4096; n++) {{ {lines} }}
        out[blockIdx.x * blockDim.x + threadIdx.x] = {" + ".join(f"a{q}" for q in range(8))};
    }}"""
    kernel, blocks = cp.RawModule(code=source).get_function("run"), 132 * 32
    out = cp.empty(blocks * 256)
    return blocks * 256 * 8 * 4096 / seconds(lambda: kernel((blocks,), (256,), (out, 0.5, 0.5)))


def operations(source: str) -> int:
    """Instructions of float64 in the machine code of a kernel whose loop takes two sub-steps."""
    loop = "for (n = 0; n < count; n++)"
    source = source.replace(loop, f"#pragma unroll\n{loop.replace('count', '2')}")
    with tempfile.TemporaryDirectory() as folder:
        text, code = Path(folder) / "kernel.cu", Path(folder) / "kernel.cubin"
        text.write_text(f"namespace kernels {{\n{source}\n}}")  # `index` is a name of the library
        make = ["nvcc", "-std=c++14", "-arch=sm_90", "-cubin", text, "-o", code]
        subprocess.run(make, check=True, capture_output=True)
        show = ["cuobjdump", "--dump-sass", code]
        found = subprocess.run(show, check=True, capture_output=True, text=True).stdout
    return len(re.findall(r"\bD(?:FMA|MUL|ADD|SETP|MNMX)\b", found))


def floors(rate: float) -> list[dict[str, Any]]:
    """For computed feet the operations of float64 a node, of both kernels where the velocity is not
    steady, and the nodes a second that these allow."""
    found, grid = [], Grid([(-1, 1)] * 2, (2048, 2048), periodic=True)
    for profile in DIRECT:
        for name, text in (("rotation", ROTATION), ("swirl(t)", SWIRL)):
            field = Velocity.from_expression(*text)
            solver = Solver(grid, field, profile=profile, backend="cupy", store_feet=False)
            stage, run = solver._stages[0], solver._kernels
            node, moved = run.name(stage), run._displaced(stage)
            sources = [device_source(stage, node, 0, True, "double", "int")]
            if moved is not None:
                sources = [
                    FollowSource(moved, moved._flow(0), 0, "int").every(),
                    update_source(moved, node, 0, "double", "int"),
                ]
            counts = [operations(source) for source in sources]
            row = {"profile": profile, "velocity": name, "operations": counts}
            found.append(row | {"gnodes_per_s": rate / sum(counts) / 1e9})
    return found


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
    return found | unsteady_agreement()


def unsteady_agreement() -> dict[str, float]:
    """The same for winds whose feet each step computes."""
    found, grid = {}, Grid([(-1, 1)] * 2, (160, 144), periodic=True)
    # A drift: where a path ends at its own node, rounding chooses the cell of second derivatives.
    drifting = (f"0.3*cos(pi*t) + {text}" for text in SWIRL)
    winds = {"swirl(t)": Velocity.from_expression(*drifting), "snapshots": snapshots(64, 5, 0.3)}
    cases = [(profile, form) for profile in DIRECT for form in ("transport", "advection")]
    for profile, form in [*cases, ("csl2", "advection"), ("csl4", "advection")]:
        for name, velocity in winds.items():
            ends = []
            for backend in ("cpu", "cupy"):
                split = "strang" if profile not in DIRECT else None
                solver = Solver(grid, velocity, form, profile, backend=backend, splitting=split)
                start = solver.state({"a": field, "b": lambda *x: np.cos(np.pi * x[1])})
                ends.append(solver.run(start, 0.1, dt=0.02).final.data)
            scale = np.abs(ends[0]).max(axis=(2, 3), keepdims=True)
            error = float(np.max(np.abs(ends[1] - ends[0]) / scale))
            found[f"{profile} 2-D {form} {name}"] = error
    return found


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the tables and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[2048, 8192])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    import cupy as cp

    options.output.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": describe()}
    name = cp.cuda.runtime.getDeviceProperties(0)["name"].decode()
    results["device"] = {"name": name, "cupy": cp.__version__}
    results["agreement"] = agreement()
    for case, error in results["agreement"].items():
        print(f"CPU - device, {case:36s} {error:.1e}", flush=True)
    results["copy_tb_per_s"] = copy_bandwidth(2**28) / 1e12
    rate = arithmetic_rate()
    results["float64_gops"] = rate / 1e9
    results["floors"] = floors(rate)
    print(f"\n{name}: copy {results['copy_tb_per_s']:.2f} TB/s, {rate / 1e12:.1f}e12 DFMA/s")
    for floor in results["floors"]:
        print(floor, flush=True)
    results["kernels"], results["spline"] = [], []
    for n in options.cells:
        for dtype in (np.float64, np.float32):
            for row in kernels(n, dtype, 1e12 * results["copy_tb_per_s"]):
                for floor in results["floors"]:
                    same = all(row[key] == floor[key] for key in ("profile", "velocity"))
                    if same and (row["feet"], row["dtype"]) == ("computed", "float64"):
                        row["of_floor"] = row["gnodes_per_s"] / floor["gnodes_per_s"]
                results["kernels"].append(row)
                print(
                    f"{row['profile']:8s} {n:5d}^2 {row['dtype']} {row['feet']:8s} "
                    f"{row['velocity']:17s} ({row['substeps']:2d}) {row['gnodes_per_s']:7.2f} "
                    f"Gn/s {row['tb_per_s']:5.2f} TB/s, {100 * row['of_copy']:5.1f} % of copy"
                    f", {100 * row.get('of_floor', np.nan):3.0f} % of the floor"
                    f", second {row.get('second', np.nan):.2f}"
                    f" ({100 * row.get('second_of_copy', np.nan):.0f} % of copy)",
                    flush=True,
                )
        results["spline"].append(spline_peer(n))
        peer = results["spline"][-1]["gnodes_per_s"]
        print(f"cupyx cubic spline {n:5d}^2 {peer:.2f} Gnode/s", flush=True)
        path = options.output / "cip_device.json"
        path.write_text(json.dumps(results, indent=1) + "\n")
    return results


if __name__ == "__main__":
    main()
