"""A load step of large strain on a CUDA device beside the host of the same machine.

A block of rubber (neo-Hooke, trilinear bricks) is pressed by a tenth onto a plane with friction .3
in two steps. One run measures the second: seconds of its tangents, of its factors with the Schur
complement of the contact points, of the certificate, which the host computes, and of all.

    python benchmarks/contact_nonlinear_device.py --cells 16 24 48
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from contact_materials import Timed
from machine import describe
from skfem import ElementHex1, MeshHex

from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane
from contact.nonlinear import boundary_factor
from contact.nonlinear.body_forces import BodyForces
from skfem_adini.ground.pardiso import has_pardiso

DEPTH = 0.1


def clock() -> float:
    """Seconds, after the device has finished."""
    import cupy

    cupy.cuda.Device().synchronize()
    return time.perf_counter()


def row(n: int, device: str, parts: dict[str, Timed]) -> tuple[dict[str, Any], Any]:
    """Seconds of the second of two steps, and its result."""
    mesh = MeshHex.init_tensor(*[np.linspace(0.0, 1.0, n + 1)] * 3).with_defaults()
    body = NonlinearBody.from_mesh(mesh, ElementHex1(), stress=NeoHooke(1.0, 9.0)).fix("top")
    problem = ContactProblem(body, "bottom", Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), friction=0.3)
    stepper = NonlinearStepper(problem, device=device).move("top", "y", -DEPTH)
    stepper.run([0.5])
    for part in parts.values():
        part.spent = 0.0
    begin = clock()
    result = stepper.run([1.0]).results[-1]
    total = clock() - begin
    assert max(result.certificate[name] for name in ("balance", "contact", "support")) < 1e-9
    return {
        "device": device,
        "unknowns": body.ndofs,
        "points": int(result.mu.size),
        "iterations": len(result.history),
        "step": total,
        **{name: part.spent for name, part in parts.items()},
    }, result


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_nonlinear_device.json."""
    import cupy

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="*", default=[16, 24, 40])
    parser.add_argument("--most-on-host", type=int, default=24)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    parts = {
        "tangent": Timed(BodyForces, "tangent", clock),
        "factor": Timed(boundary_factor.BoundaryFactor, "__init__", clock),
        "certificate": Timed(NonlinearStepper, "_certified", clock),
    }
    rows = []
    for n in options.cells:
        results = {}
        for device in ("cuda", "cpu"):
            if device == "cpu" and n > options.most_on_host:
                continue
            found, results[device] = row(n, device, parts)
            rows.append(found)
            print(found, flush=True)
        if len(results) == 2:
            here, there = results["cpu"], results["cuda"]
            rows[-2]["difference"] = float(np.abs(here.u - there.u).max())
    record = {
        "benchmark": "contact_nonlinear_device",
        "machine": describe(),
        "device": cupy.cuda.runtime.getDeviceProperties(0)["name"].decode(),
        "factoriser": "PARDISO" if has_pardiso() else "SuperLU",
        "rows": rows,
    }
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_nonlinear_device.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
