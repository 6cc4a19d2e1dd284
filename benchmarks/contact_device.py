"""Contact of meshed bodies with friction, condensed on the host and on a CUDA device by cuDSS.

A block of n x n Adini rectangles and a cube of n x n x n trilinear bricks are pressed on a parabola
and dragged. Seconds of assembly, condensation and contact with its certificate; on the device of a
second run in the process, after the kernels are compiled. Differences are between host and device.

    python benchmarks/contact_device.py --adini 64 128 256 --hex1 12 24 32
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import ElementHex1, MeshHex, MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody
from skfem_adini import ElementQuadAdini
from skfem_adini.solvers.pardiso import has_pardiso


def adini(n: int) -> ContactProblem:
    """Block of rectangles, friction .9."""
    return pressed(MeshQuad, ElementQuadAdini(), n, 0.9)


def hex1(n: int) -> ContactProblem:
    """Cube of bricks, friction .3."""
    return pressed(MeshHex, ElementHex1(), n, 0.3)


def pressed(kind: Any, element: Any, n: int, friction: float) -> ContactProblem:
    """Unit block, its top moved down and sideways."""
    dim = element.dim
    mesh = kind.init_tensor(*[np.linspace(0.0, 1.0, n + 1)] * dim)
    ends = {"bottom": lambda x: x[-1] < 1e-9, "top": lambda x: x[-1] > 1.0 - 1e-9}
    body = ElasticBody.from_mesh(mesh.with_boundaries(ends), element, E=2.0, nu=0.3)
    body.fix("top", "xyz"[dim - 1], -0.05).fix("top", "x", lambda x: 0.02 + 0.01 * x[0])

    def bowl(x: Any) -> Any:
        return 0.04 * np.sum((x[:-1] - 0.45) ** 2, axis=0)

    return ContactProblem(body, "bottom", bowl, friction)


def measure(pose: Any, n: int, device: str) -> tuple[dict[str, Any], ContactResult]:
    """Assemble, condense and solve."""
    begin = time.perf_counter()
    problem = pose(n)
    _ = problem.body.stiffness
    assembled = time.perf_counter()
    condensed = problem.condense(device)
    ready = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    row = {
        "body": pose.__name__, "n": n, "device": device, "unknowns": problem.body.f.size,
        "boundary": condensed.unknowns, "assemble": assembled - begin,
        "condense": ready - assembled, "contact": end - ready,
        "residual": max(result.kkt.values()),
    }  # fmt: skip
    return row, result


def difference(ours: ContactResult, host: ContactResult) -> float:
    """Largest difference of the multipliers, relative to the largest."""
    return float(np.abs(ours.mu - host.mu).max() / host.mu.max())


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_device.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--adini", type=int, nargs="*", default=[64, 128, 256])
    parser.add_argument("--hex1", type=int, nargs="*", default=[12, 24])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    import cupy

    name = cupy.cuda.runtime.getDeviceProperties(0)["name"]
    record: dict[str, Any] = {
        "benchmark": "contact_device", "machine": describe(),
        "device": name.decode() if isinstance(name, bytes) else str(name),
        "host solver": "pardiso" if has_pardiso() else "superlu", "rows": [],
    }  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    for pose, sizes in ((adini, options.adini), (hex1, options.hex1)):
        for n in sizes:
            measure(pose, n, "cuda")
            row, there = measure(pose, n, "cuda")
            beside, host = measure(pose, n, "cpu")
            row["difference"] = difference(there, host)
            for one in (row, beside):
                record["rows"].append(one)
                print(one, flush=True)
            path = options.output / "contact_device.json"
            path.write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
