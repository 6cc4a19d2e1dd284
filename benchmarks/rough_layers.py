"""Contact of a rough plane with a block of layers, by transforms: from input to certificate.

A self-affine surface (Hurst exponent .8, waves from 1/4 of the period to 1/4 of the Nyquist limit,
root mean square slope about .1) is pressed on a periodic cube of n x n x n bricks, without friction
to a tenth of full contact about, and with friction .4 while it is dragged. Seconds of condensation
and of contact with its certificate.

    python benchmarks/rough_layers.py --sizes 64 128 256 512
    python benchmarks/rough_layers.py --device cuda --sizes 256 512 1024 2048
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

from contact import GridContact, PeriodicLayers, Rigid, Rough, self_affine

FRICTION, NU = 0.4, 0.3


def surface(n: int) -> Rough:
    """Heights below zero, of unit period."""
    heights = self_affine(n, hurst=0.8, rms=5e-3, cutoffs=(4, n // 8), seed=1)
    return Rough(heights - heights.max(), lengths=(1.0, 1.0))


def counted(block: Any) -> dict[str, int]:
    """Count the products of a block."""
    count = {"products": 0}

    def counting(product: Any) -> Any:
        def apply(forces: Any) -> Any:
            count["products"] += 1
            return product(forces)

        return apply

    block.apply, block.apply_normal = counting(block.apply), counting(block.apply_normal)
    return count


def measure(n: int, dragged: bool, xp: Any) -> dict[str, Any]:
    """Condense and solve; a first run on a device compiles and is not counted."""

    def wait() -> float:
        if xp is not np:
            xp.cuda.Device().synchronize()
        return time.perf_counter()

    rough = surface(n)
    begin = wait()
    block = PeriodicLayers((1.0, 1.0), [(1.0, n, 1.0, NU)], (n, n), xp=xp)
    condensed = wait()
    count = counted(block)
    drag = 5e-3 if dragged else 0.0
    ground = Rigid(rough, displacement=(drag, 0.0, None), force=(None, None, 5e-3))
    result = GridContact(block, ground, friction=FRICTION if dragged else 0.0).solve()
    end = wait()
    row = {
        "n": n, "unknowns": block.unknowns, "friction": FRICTION if dragged else 0.0,
        "condense": condensed - begin, "contact": end - condensed, "total": end - begin,
        "steps": len(result.history), "newton": sum(i.phase == "newton" for i in result.history),
        "products": count["products"], "residual": max(result.kkt.values()), "area": result.area,
    }  # fmt: skip
    if xp is not np:
        row["memory"] = xp.get_default_memory_pool().total_bytes() / 1e9
        del block, result, ground
        xp.get_default_memory_pool().free_all_blocks()
    return row


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write the rows of this device to benchmarks/results/rough_layers.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--sizes", type=int, nargs="*", default=[64, 128, 256])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    xp: Any = np
    record: dict[str, Any] = {"machine": describe(), "rows": []}
    if options.device == "cuda":
        import cupy

        xp = cupy
        name = cupy.cuda.runtime.getDeviceProperties(0)["name"]
        record["device"] = name.decode() if isinstance(name, bytes) else str(name)
        for dragged in (False, True):
            measure(64, dragged, xp)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "rough_layers.json"
    for n in options.sizes:
        for dragged in (False, True):
            row = measure(n, dragged, xp)
            record["rows"].append(row)
            print(
                f"{n}^3, friction {row['friction']}: condensation {row['condense']:.3f} s, contact "
                f"{row['contact']:.3f} s, {row['steps']} steps, {row['products']} products, area "
                f"{row['area']:.3f}, residual {row['residual']:.0e}",
                flush=True,
            )
            known = json.loads(path.read_text()) if path.exists() else {"benchmark": "rough_layers"}
            path.write_text(json.dumps(known | {options.device: record}, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
