"""Contact of a rough plane with a block of layers, by transforms: from input to certificate.

A self-affine surface (Hurst exponent .8, waves from 1/4 of the period to 1/4 of the Nyquist limit,
root mean square slope about .1) is pressed on a periodic cube of n x n x n bricks, without friction
to a tenth of full contact about, and with friction .4 while it is dragged; and a profile on a
square of n x n rectangles of Adini's. Seconds of condensation and of contact with its certificate,
once the plans of the transforms are made; last the growth with the points and with the depth.

    python benchmarks/rough_layers.py --sizes 256 512 1024 --profiles 2048 \\
        --depths 64 256 1024 4096
    python benchmarks/rough_layers.py --device cuda --sizes 256 512 1024 2048 4096 \\
        --profiles 2048 16384 --depths 64 256 1024 4096 16384
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
from skfem_adini import ElementQuadAdini

FRICTION, NU = 0.4, 0.3


def surface(n: int, directions: int = 2) -> Rough:
    """Heights below zero, of unit period."""
    heights = self_affine((n,) * directions, hurst=0.8, rms=5e-3, cutoffs=(4, n // 8), seed=1)
    return Rough(heights - heights.max(), lengths=(1.0,) * directions)


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


def layers(n: int, rows: int, directions: int, xp: Any) -> PeriodicLayers:
    """A block of unit height, of bricks or of Adini's rectangles."""
    element = ElementQuadAdini() if directions == 1 else None
    return PeriodicLayers(
        (1.0,) * directions, [(1.0, rows, 1.0, NU)], (n,) * directions, element=element, xp=xp
    )


def clock(xp: Any) -> float:
    """Seconds, once the device has done what it was told."""
    if xp is not np:
        xp.cuda.Device().synchronize()
    return time.perf_counter()


def measure(rough: Rough, dragged: bool, xp: Any) -> dict[str, Any]:
    """Condense and solve; a first run on a device compiles and plans, and is not counted."""
    n, directions = rough.heights.shape[0], rough.heights.ndim
    begin = clock(xp)
    block = layers(n, n, directions, xp)
    condensed = clock(xp)
    count = counted(block)
    along = (5e-3 if dragged else 0.0, 0.0)[:directions]
    ground = Rigid(rough, displacement=(*along, None), force=(*[None] * directions, 5e-3))
    result = GridContact(block, ground, friction=FRICTION if dragged else 0.0).solve()
    end = clock(xp)
    row = {
        "n": n, "dim": directions + 1, "unknowns": block.unknowns,
        "friction": FRICTION if dragged else 0.0,
        "condense": condensed - begin, "contact": end - condensed, "total": end - begin,
        "steps": len(result.history), "newton": sum(i.phase == "newton" for i in result.history),
        "products": count["products"], "residual": max(result.kkt.values()), "area": result.area,
    }  # fmt: skip
    if xp is not np:
        row["memory"] = xp.get_default_memory_pool().total_bytes() / 1e9
        del block, result, ground
        xp.get_default_memory_pool().free_all_blocks()
    return row


def depth(n: int, rows: int, xp: Any) -> dict[str, Any]:
    """Least seconds of three condensations of a block of n x n x rows bricks."""
    seconds = []
    for _ in range(3):
        begin = clock(xp)
        layers(n, rows, 2, xp)
        seconds.append(clock(xp) - begin)
    return {"n": n, "rows": rows, "condense": min(seconds)}


def growth(rows: list[dict[str, Any]], depths: list[dict[str, Any]]) -> dict[str, float]:
    """Exponents of the time in n^2 log n, and seconds that twice the depth costs.

    Of a product of contact and of condensation, between the two largest cubes, and fitted over all
    of them: small ones take the time of their calls. Condensation is fitted against the binary
    logarithm of the depth; its power of the depth would be 1 without doubling.
    """
    cubes = [row for row in rows if row["dim"] == 3 and not row["friction"]]
    found = {}
    if len(cubes) > 1:
        points = np.log([row["n"] ** 2 * np.log2(row["n"]) for row in cubes])
        for name, seconds in {
            "product": [row["contact"] / row["products"] for row in cubes],
            "condense": [row["condense"] for row in cubes],
        }.items():
            found[name] = float(np.polyfit(points[-2:], np.log(seconds[-2:]), 1)[0])
            found[f"{name} of all sizes"] = float(np.polyfit(points, np.log(seconds), 1)[0])
    if len(depths) > 1:
        doublings = np.log2([row["rows"] for row in depths])
        seconds = [row["condense"] for row in depths]
        slope, level = np.polyfit(doublings, seconds, 1)
        found["doubling"], found["no_doubling"] = float(slope), float(level)
        found["off the line"] = float(
            np.abs(level + slope * doublings - seconds).max() / np.mean(seconds)
        )
        found["power of depth"] = float(np.polyfit(doublings, np.log2(seconds), 1)[0])
    return found


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write the rows of this device to benchmarks/results/rough_layers.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--sizes", type=int, nargs="*", default=[64, 128, 256])
    parser.add_argument("--profiles", type=int, nargs="*", default=[512])
    parser.add_argument("--depths", type=int, nargs="*", default=[64, 1024])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    xp: Any = np
    record: dict[str, Any] = {"machine": describe(), "rows": [], "depths": []}
    if options.device == "cuda":
        import cupy

        xp = cupy
        name = cupy.cuda.runtime.getDeviceProperties(0)["name"]
        record["device"] = name.decode() if isinstance(name, bytes) else str(name)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "rough_layers.json"

    def write() -> None:
        record["growth"] = growth(record["rows"], record["depths"])
        known = json.loads(path.read_text()) if path.exists() else {"benchmark": "rough_layers"}
        path.write_text(json.dumps(known | {options.device: record}, indent=1) + "\n")

    depth(64, 64, xp)
    for rows in options.depths:
        record["depths"].append(depth(1024 if xp is not np else 256, rows, xp))
    for n, directions in [(n, 1) for n in options.profiles] + [(n, 2) for n in options.sizes]:
        rough = surface(n, directions)
        for dragged in (False, True):
            if xp is not np:
                measure(rough, dragged, xp)
            row = measure(rough, dragged, xp)
            record["rows"].append(row)
            print(
                f"{n}^{row['dim']}, friction {row['friction']}: condensation {row['condense']:.3f} "
                f"s, contact {row['contact']:.3f} s, {row['steps']} steps, {row['products']} "
                f"products, area {row['area']:.3f}, residual {row['residual']:.0e}"
                + (f", {row['memory']:.2f} GB" if "memory" in row else ""),
                flush=True,
            )
            write()
    print("growth:", ", ".join(f"{name} {value:.3g}" for name, value in record["growth"].items()))
    return record


if __name__ == "__main__":
    main()
