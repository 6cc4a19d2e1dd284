"""What gradients of contact cost beside solutions and differences, and heat beside mechanics.

Processor seconds, interleaved, least of several: a gradient by all data but moduli and vertices,
by moduli, by vertices, over a solution with its factorisation; a history of fifty steps backward,
with all states and with checkpoints, over the steps; a step of finite sliding; a step of heat and
contact over a step of contact, with a mild and with a steep conductance.

    OMP_NUM_THREADS=1 python benchmarks/contact_derivatives.py
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import ElementQuad1, MeshQuad

from contact import (
    ContactProblem,
    ContactWarning,
    Cylinder,
    ElasticBody,
    LoadStepper,
    Rigid,
    Sphere,
    ThermalContact,
)


def least(tasks: dict[str, Callable[[], Any]], times: int = 3) -> dict[str, float]:
    """Least processor seconds of each task, taken in turn."""
    found = dict.fromkeys(tasks, np.inf)
    for _ in range(times):
        for name, task in tasks.items():
            begin = time.process_time()
            task()
            found[name] = min(found[name], time.process_time() - begin)
    return found


def block(n: int, E: float = 2.0) -> ElasticBody:
    """A square of n by n cells."""
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2).with_defaults()
    return ElasticBody.from_mesh(mesh, ElementQuad1(), E=E, nu=0.3)


def pressed(n: int, E: float = 2.0) -> ContactProblem:
    """On a ball, with friction."""
    body = block(n, E).fix("top", "x", 0.01).fix("top", "y", -0.02)
    return ContactProblem(body, "bottom", Sphere((0.4, -1.0), 1.0), friction=0.3)


def gradients(n: int) -> dict[str, Any]:
    """Of one solution, over that solution and its factorisation."""
    problem = pressed(n)
    result = problem.solve()
    weights = {"pressure": np.ones(result.mu.size), "resultant": (0.0, 1.0)}
    tasks: dict[str, Callable[[], Any]] = {
        "solve": lambda: pressed(n).solve(),
        "again": problem.solve,
        "gradient": lambda: result.vjp(**weights),
        "moduli": lambda: result.vjp(**weights).E,
        "vertices": lambda: result.vjp(**weights).vertices,
        "difference": lambda: [pressed(n, 2.0 + s).solve() for s in (1e-5, -1e-5)],
    }
    for name in tasks:
        tasks[name]()
    seconds = least(tasks)
    ratios = {f"{k}_over_solve": v / seconds["solve"] for k, v in seconds.items() if k != "solve"}
    return {"n": n, "unknowns": problem.body.ndofs, "seconds": seconds, **ratios}


def history(n: int, steps: int = 50) -> dict[str, Any]:
    """Pressed and dragged to and fro; backward over forward, and states that are kept."""
    problem = ContactProblem(block(n).fix("top", "xy"), "bottom", Sphere((0.4, -1.0), 1.0), 0.3)
    times, weights = np.linspace(1 / steps, 1.0, steps), np.ones((steps, 2))

    def stepper() -> LoadStepper:
        made = LoadStepper(problem, halvings=0).move("top", "y", -0.02, lambda t: min(1.0, 4 * t))
        return made.move("top", "x", 0.02, lambda t: np.sin(7 * t))

    done = stepper().run(times)
    tasks: dict[str, Callable[[], Any]] = {
        "run": lambda: stepper().run(times),
        "backward": lambda: done.vjp(resultant=weights).friction,
        "checkpoints": lambda: stepper().vjp(
            times, lambda k, _: {"resultant": weights[k]}, lambda _, step: step.friction
        ),
    }
    seconds = least(tasks, 2)
    ratios = {f"{k}_over_run": seconds[k] / seconds["run"] for k in ("backward", "checkpoints")}
    return {"n": n, "steps": steps, "seconds": seconds, **ratios}


def sliding(n: int, steps: int = 5) -> dict[str, Any]:
    """A roller that is dragged over the block by finite sliding."""
    roller = Cylinder((0.3, 1.25), 0.25)

    def at(t: float) -> Rigid:
        return Rigid(roller, (0.3 * t, -0.02), rotation=0.5 * t)

    problem = ContactProblem(block(n).fix("bottom"), "top", at(0.0), friction=0.3)
    times, weights = np.linspace(1 / steps, 1.0, steps), np.ones((steps, 2))

    def run() -> Any:
        return LoadStepper(problem, sliding="finite", halvings=0).obstacle(at).run(times)

    done = run()
    seconds = least({"run": run, "backward": lambda: done.vjp(resultant=weights).friction}, 2)
    return {"n": n, "seconds": seconds, "backward_over_run": seconds["backward"] / seconds["run"]}


def heat(n: int, width: float) -> dict[str, Any]:
    """A hot bar that grows to a cold wall, whose conductance rises within `width` of the gap."""
    body = block(n).fix("left", "xy")
    problem = ContactProblem(body, "right", lambda x: 4e-3 + 2e-3 * np.cos(9 * x[1]))

    def law(p: Any, gap: Any) -> Any:
        return 10 * np.clip(1 - gap / width, 0, 1) + 0 * p

    model = ThermalContact(problem, 1.0, law, expansion=1e-2, obstacle_temperature=0.0)
    model.fix("left", 1.0)
    result = model.solve(stability=False)
    tasks: dict[str, Callable[[], Any]] = {
        "mechanical": lambda: problem.solve(),
        "thermal": lambda: model.solve(stability=False),
    }
    seconds = least(tasks)
    count = len(result.history)
    ratio = seconds["thermal"] / seconds["mechanical"]
    return {
        "n": n, "width": width, "iterations": count, "seconds": seconds, "ratio": ratio,
        "iteration_over_mechanical": ratio / count, "history": result.history,
    }  # fmt: skip


def main() -> None:
    """Measure all, print and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("benchmarks/results"))
    parser.add_argument("--quick", action="store_true", help="coarse, for a look")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ContactWarning)
    n = 16 if options.quick else 80
    found = {
        "machine": describe(),
        "gradients": gradients(n),
        "history": history(n // 2),
        "sliding": sliding(n // 2),
        "heat": [heat(n // 2, width) for width in (1e-3, 1e-5)],
    }
    print(json.dumps(found, indent=1))
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_derivatives.json"
    path.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
