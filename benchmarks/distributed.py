"""Contact, systems and assembly on many processes, and what they would take at 10^8 unknowns.

The script starts itself by mpiexec on one and on two processes. Measured are

* a block of 256 x 256 Adini cells pressed and dragged with friction .9, from its matrices to the
  certified result, by MUMPS's Schur complement, in units of MUMPS's plain factor and solve;
* a brick of 32^3 trilinear cells under its weight, by conjugate gradients with multigrid;
* a brick of some 10^6 unknowns on a ball, friction .3, without any dense matrix, by stage;
* the assembly of stiffness matrices.

A model takes the constants from these runs; it claims no run that was not made.

    python benchmarks/distributed.py
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import ElementHex1, ElementVector, LinearForm
from skfem.models.elasticity import lame_parameters, linear_elasticity

from contact import ContactProblem, DistributedBody, Sphere
from skfem_adini import ElementQuadAdini
from skfem_adini.distributed import DistributedBasis, DistributedSolver, TensorGrid, world

UNKNOWNS = 1e8  # of the model


class Clock:
    """Seconds between calls, with all processes waiting for the last."""

    def __init__(self) -> None:
        self.comm: Any = world()
        self.comm.allgather(0)
        self._last = time.perf_counter()

    def __call__(self) -> float:
        """Seconds since the last call."""
        self.comm.allgather(0)
        now = time.perf_counter()
        passed, self._last = now - self._last, now
        return passed


def peak() -> float:
    """Largest memory of all processes together, in GB."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else ["VmHWM: nan"]
    own = next(float(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return float(sum(world().allgather(own)) / 1e6)


def block(n: int) -> dict[str, Any]:
    """Coulomb's friction on a block in the plane, and a plain factor and solve of it."""
    clock = Clock()
    ticks = np.linspace(0, 1, n + 1)
    grid = TensorGrid(ticks, ticks)
    body = DistributedBody(
        grid, ElementQuadAdini(), contact="bottom", E=2.0, nu=0.3, backend="mumps"
    )
    body.fix("left", "x").load("top", (0.05, -0.1))
    problem = ContactProblem(body, "bottom", 0.0, friction=0.9)
    _ = body.rows
    found: dict[str, Any] = {"assembly": clock()}
    problem.condense()
    found["condense"] = clock()
    result = problem.solve()
    found["solve"] = clock()
    found |= {"unknowns": body.space.N, "points": int(result.mu.size), "memory": peak()}
    found |= {"residual": max(result.kkt.values()), "total": found["condense"] + found["solve"]}
    del problem, result
    space = DistributedBasis(grid, ElementVector(ElementQuadAdini()))
    clock()
    K = space.assemble(linear_elasticity(*lame_parameters(2.0, 0.3)))
    found["matrix"] = clock()
    fixed, load = space.boundary_dofs("left"), np.zeros(space.basis.N)
    load[space.boundary_dofs("top")] = 1.0
    clock()
    solver = DistributedSolver(K, fixed, "mumps")
    found["factor"] = clock()
    solver.solve(load)
    found["base"] = found["factor"] + clock()
    return found


def brick(n: int) -> dict[str, Any]:
    """A brick under its weight by multigrid, residual 1e-8."""
    clock = Clock()
    space = DistributedBasis(
        TensorGrid(*[np.linspace(0, 1, n + 1)] * 3), ElementVector(ElementHex1()), intorder=2
    )
    found: dict[str, Any] = {"basis": clock()}
    K = space.assemble(linear_elasticity(*lame_parameters(2.0, 0.3)))
    found["matrix"] = clock()
    load = space.assemble(LinearForm(lambda v, w: -v[2]))
    fixed = space.boundary_dofs("front")
    clock()
    solver = DistributedSolver(K, fixed, "gamg", tol=1e-8)
    found["setup"] = clock()
    solver.solve(load)
    found["solve"] = clock()
    found |= {"unknowns": space.N, "iterations": solver.iterations, "memory": peak()}
    return found | {"total": found["setup"] + found["solve"]}


def million(n: int) -> dict[str, Any]:
    """Contact of a brick with a ball, rows as unknowns, by stage."""
    clock = Clock()
    ticks = np.linspace(0, 1, n + 1)
    grid = TensorGrid(ticks, ticks, ticks)
    body = DistributedBody(grid, contact="front", E=2.0, nu=0.3, backend="krylov", intorder=2)
    body.fix("back", "z", -0.02).fix("back", "x", 0.01).fix("back", "y")
    problem = ContactProblem(body, "front", Sphere((0.5, 0.5, -2.0), 2.0), friction=0.3)
    found: dict[str, Any] = {"body": clock()}
    condensed: Any = problem.condense()
    found["matrices"] = clock()
    result = problem.solve()
    found["solve"] = clock()
    found |= {
        "unknowns": body.space.N,
        "points": int(result.mu.size),
        "in_contact": int((result.mu > 0).sum()),
        "steps": len(result.history),
        "iterations": condensed._system.iterations,
        "residual": max(result.kkt.values()),
        "memory": peak(),
    }
    return found | {"total": found["body"] + found["matrices"] + found["solve"]}


TASKS = {"block": block, "brick": brick, "million": million}


def started(task: str, n: int, processes: int) -> dict[str, Any]:
    """What a task measures on a number of processes."""
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    environment["OMPI_MCA_btl_vader_single_copy_mechanism"] = "none"
    command = ["mpiexec", "-n", str(processes), sys.executable, __file__]
    done = subprocess.run(
        [*command, "--task", task, "--n", str(n)],
        env=environment, capture_output=True, text=True, timeout=1800,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(done.stderr[-3000:])
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    if found.pop("processes") != processes:
        raise SystemExit("mpiexec belongs to another MPI library than mpi4py")
    return found | {"n": n, "processes": processes}


def median_of(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The median of each figure."""
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def model(rows: dict[str, Any]) -> list[dict[str, Any]]:
    """Core seconds and memory at 10^8 unknowns, with the growth that each rests on."""
    plane, space, contact = rows["block"][-1], rows["brick"][-1], rows["million"][-1]

    def line(what: str, row: Any, seconds: float, memory: float, growth: float) -> dict[str, Any]:
        larger = UNKNOWNS / row["unknowns"]
        core = seconds * row["processes"] * larger**growth
        return {
            "what": what,
            "unknowns": row["unknowns"],
            "core_seconds": seconds * row["processes"],
            "growth": growth,
            "core_seconds_then": core,
            "terabytes_then": memory * 1e-3 * larger ** (4 / 3 if growth == 2.0 else 1.0),
        }

    return [
        line("plane: MUMPS's factor with its Schur complement", plane, plane["condense"],
             plane["memory"] * math.log2(UNKNOWNS) / math.log2(plane["unknowns"]), 1.5),
        line("space: assembly", space, space["basis"] + space["matrix"], space["memory"], 1.0),
        line("space: a system by multigrid", space, space["total"], space["memory"], 1.0),
        line("space: contact by multigrid", contact, contact["matrices"] + contact["solve"],
             contact["memory"], 1.0),
    ]  # fmt: skip


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/distributed.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=TASKS)
    parser.add_argument("--n", type=int)
    parser.add_argument("--block", type=int, default=256)
    parser.add_argument("--brick", type=int, default=32)
    parser.add_argument("--million", type=int, default=69)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    if options.task:
        found = TASKS[options.task](options.n)
        if world().rank == 0:
            print(json.dumps(found | {"processes": world().size}))
        return found
    rows: dict[str, Any] = {}
    for task, sizes in (("block", (1, 2)), ("brick", (1, 2)), ("million", (2,))):
        repeats, n = (1 if task == "million" else options.repeats), getattr(options, task)
        runs: dict[int, list[dict[str, Any]]] = {size: [] for size in sizes}
        for _ in range(repeats):
            for size in sizes:
                runs[size].append(started(task, n, size))
        rows[task] = [median_of(runs[size]) for size in sizes]
        for row in rows[task]:
            told = ", ".join(f"{key} {value:.4g}" for key, value in row.items())
            print(f"{task}: {told}", flush=True)
    record = {"benchmark": "distributed", "machine": describe(), "repeats": options.repeats}
    record |= {"rows": rows, "model": model(rows)}
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "distributed.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
