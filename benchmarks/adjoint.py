"""What a gradient costs beside the run it belongs to: the adjoint in the state and the velocity.

A forward run is timed as an optimisation pays for it, with a new solver for new values of the
parameters, so that feet are computed anew; code is compiled before. A gradient is
``solver.adjoint(run) @ weight``, all of it: the run taken once more, its checkpoints, the states
between them, the transposed steps, and the derivatives of the feet. For each case

* the median of forward runs and of gradients, interleaved, and their ratio, with all states kept,
  the default for windows of these sizes, and with as many checkpoints as the square root of the
  number of steps;
* the dot-test, relative to the sum of the magnitudes, on no more nodes than the processor has: the
  tangent in parameters differentiates feet on the host.

    python benchmarks/adjoint.py --json benchmarks/results/adjoint.json
    python benchmarks/adjoint.py --device cuda --json benchmarks/results/adjoint.json

The file keeps what was measured in the other place.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Grid, Solver, Velocity

# Nodes in each direction on the processor, about 100,000 in all.
NODES = {1: 100_000, 2: 316, 3: 46}
FIELDS = {1: "sin(2*pi*x1)", 2: "sin(2*pi*x1)*cos(2*pi*x2)", 3: "sin(2*pi*x1)*cos(2*pi*x2)"}


def velocity(dim: int, parameters: int, steady: bool) -> Velocity:
    """Modes of a periodic flow, each with an amplitude of its own."""
    # Steps cross one to two cells; amplitudes fall, so that all flows are about as steep.
    names = [f"a{k}" for k in range(parameters)]
    values = {name: 0.3 / (1 + k) ** 2 for k, name in enumerate(names)}
    clock = "" if steady else " + t"
    if dim == 1:
        modes = [f"{a}*cos({2 + 2 * k}*pi*x1{clock})" for k, a in enumerate(names)]
        return Velocity.from_expression("1 + " + " + ".join(modes), parameters=values)
    parts: list[list[str]] = [["1.0"], ["0.7"], ["0.4"]][:dim]
    for k, a in enumerate(names):
        m = 1 + k // 4
        parts[k % dim].append(f"{a}*sin({2 * m}*pi*x1{clock})*cos({2 * m}*pi*x2)")
    return Velocity.from_expression(*(" + ".join(part) for part in parts), parameters=values)


def solver_of(dim: int, n: int, profile: str, flow: Velocity, backend: str) -> Solver:
    """A solver on a periodic grid of n nodes in each direction."""
    return Solver(
        Grid([(0, 1)] * dim, (n,) * dim, periodic=True), flow, profile=profile, backend=backend,
        form="advection" if profile.startswith("csl") else "transport",
        splitting="strang" if dim > 1 and profile not in ("adini", "bicubic") else None,
    )  # fmt: skip


def memory(backend: str) -> tuple[Callable[[Any], Any], Callable[[], Any]]:
    """What places a vector where a back end works, and what waits until that has finished."""
    if backend == "cpu":
        return np.asarray, lambda: None
    import cupy

    return cupy.asarray, cupy.cuda.Device().synchronize


def measure(
    dim: int,
    n: int,
    profile: str,
    parameters: int,
    steady: bool,
    steps: int,
    repeats: int,
    backend: str = "cpu",
) -> dict[str, Any]:
    """One row: seconds of a run and of a gradient, and the dot-test."""
    flow, dt = velocity(dim, parameters, steady), 1.5 / n
    place, finish = memory(backend)
    forward, backward, recomputing = [], [], []
    for repeat in range(repeats + 1):
        values = {name: a * (1 + 1e-3 * repeat) for name, a in flow.parameters.items()}
        solver = solver_of(dim, n, profile, flow.with_parameters(**values), backend)
        state = solver.state(FIELDS[dim])
        weight = place(np.random.default_rng(repeat).standard_normal(state.data.size))
        begin = time.perf_counter()
        run = solver.run(state, steps * dt, dt=dt)
        middle = time.perf_counter()
        solver.adjoint(run) @ weight
        finish()
        end = time.perf_counter()
        solver.adjoint(run, checkpoints=math.isqrt(steps)) @ weight
        finish()
        last = time.perf_counter()
        if repeat:  # the first compiles
            forward.append(middle - begin)
            backward.append(end - middle)
            recomputing.append(last - end)
    run_s, gradient_s = statistics.median(forward), statistics.median(backward)
    return {
        "backend": backend, "dim": dim, "nodes": n**dim, "profile": profile,
        "parameters": parameters,
        "steady": steady, "steps": steps, "run_s": run_s, "gradient_s": gradient_s,
        "ratio": gradient_s / run_s, "ratio_recomputed": statistics.median(recomputing) / run_s,
        "dot_test": dot_test(solver_of(dim, min(n, NODES[dim]), profile, flow, backend), place),
    }  # fmt: skip


def dot_test(solver: Solver, place: Callable[[Any], Any]) -> float:
    """The difference of the products of tangent and adjoint, over the sum of the magnitudes."""
    dt, rng = 1.5 / solver.grid.nodes[0], np.random.default_rng(1)
    run = solver.run(solver.state(FIELDS[solver.grid.dim]), 5 * dt, dt=dt)
    adjoint = solver.adjoint(run)
    change, weight = (place(rng.standard_normal(size)) for size in adjoint.shape)
    gradient, found = adjoint @ weight, adjoint.T @ change
    size = float(abs(weight) @ abs(found) + abs(change) @ abs(gradient))
    return abs(float(weight @ found - change @ gradient)) / size


def kept(stored: dict[str, Any], profiles: list[str] | None) -> list[dict[str, Any]]:
    """The stored rows for other profiles than those that are measured, of this commit."""
    if profiles is None or not stored or stored["machine"]["commit"] != describe()["commit"]:
        return []
    return [row for row in stored["rows"] if row["profile"] not in profiles]


def joined(record: dict[str, Any], part: dict[str, Any], cuda: bool) -> dict[str, Any]:
    """A record with a new part: of the processor, or of the device below the key ``cuda``."""
    if not cuda:
        return part | {key: record[key] for key in ("cuda",) if key in record}
    import cupy

    name = cupy.cuda.runtime.getDeviceProperties(0)["name"].decode()
    return record | {"cuda": part | {"device": {"name": name}}}


def main() -> None:
    """Measure all rows; print them, and write them to a file if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--profiles", nargs="+", help="only these; the file keeps its other rows")
    options = parser.parse_args()
    cuda = options.device == "cuda"
    nodes = {1: 4_000_000, 2: 2000, 3: 160} if cuda else NODES
    backend = "cupy" if cuda else "cpu"
    schemes = [(1, nodes[1], "cubic"), (1, nodes[1], "quintic")]
    schemes += [(2, nodes[2], profile) for profile in ("adini", "bicubic", "csl2", "csl4")]
    schemes += [(3, nodes[3], profile) for profile in ("cubic", "csl4")]
    known = options.json is not None and options.json.exists()
    record = json.loads(options.json.read_text()) if known else {}
    rows = kept(record.get("cuda", {}) if cuda else record, options.profiles)
    for scheme in schemes:
        if options.profiles and scheme[2] not in options.profiles:
            continue
        for parameters, steady, steps in ((12, True, 100), (2, False, 5), (12, False, 5)):
            row = measure(*scheme, parameters, steady, steps, options.repeats, backend)
            rows.append(row)
            print(
                f"{row['profile']:8} {row['nodes']:7} nodes {parameters:3} parameters "
                f"{'steady' if steady else 'c(x, t)'}: run {row['run_s']:.3f} s, gradient "
                f"{row['gradient_s']:.3f} s, ratio {row['ratio']:.2f}, recomputed "
                f"{row['ratio_recomputed']:.2f}, dot {row['dot_test']:.1e}",
                flush=True,
            )
    if options.json:
        part = {"machine": describe(), "repeats": options.repeats, "rows": rows}
        options.json.write_text(json.dumps(joined(record, part, cuda), indent=1) + "\n")


if __name__ == "__main__":
    main()
