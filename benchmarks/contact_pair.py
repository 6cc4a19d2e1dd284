"""Two elastic bodies with friction in units of the factorisations of both.

From assembled S and f of both bodies to the certified result,

    ratio = (whole Coulomb solve) / (factorisation + solve of the one body and of the other),

PARDISO for positive definite matrices on both sides, repeats interleaved, medians. In two
dimensions two blocks of n x n Adini cells, in the ratio 1:1.5, pressed and pushed; in three
dimensions two bricks of n^3 and (5n/4)^2 n trilinear cells. Beside it, a step of finite sliding
after the first, in the same units.

    python benchmarks/contact_pair.py
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from contact_block import base
from machine import describe
from skfem import ElementHex1, MeshHex, MeshQuad

from contact import ContactProblem, ElasticBody, LoadStepper
from skfem_adini import ElementQuadAdini
from skfem_adini.ground.pardiso import has_pardiso

FRICTION = 0.3


def blocks(n: int) -> tuple[ElasticBody, ElasticBody]:
    """Two blocks in the plane, the lower one half as wide again."""
    ticks = np.linspace(0, 1, n + 1)
    above = MeshQuad.init_tensor(ticks, 1 + ticks).with_defaults()
    below = MeshQuad.init_tensor(-0.25 + 1.5 * ticks, ticks).with_defaults()
    upper = ElasticBody.from_mesh(above, ElementQuadAdini(), E=1.0, nu=0.3)
    lower = ElasticBody.from_mesh(below, ElementQuadAdini(), E=3.0, nu=0.3)
    upper.fix("top", "x").fix("top", "y", -0.02).load("left", (0.004, 0.0))
    return upper, lower.fix("bottom", "xy").body_force((0.0, -1e-3))


def bricks(n: int) -> tuple[ElasticBody, ElasticBody]:
    """Two bricks in space whose cells do not match."""
    ticks, wide = np.linspace(0, 1, n + 1), np.linspace(0, 1, 5 * n // 4 + 1)
    sides = {"low": lambda x: x[2] < x[2].min() + 1e-9, "high": lambda x: x[2] > x[2].max() - 1e-9}
    above = MeshHex.init_tensor(ticks, ticks, 1 + ticks).with_boundaries(sides)
    below = MeshHex.init_tensor(wide, wide, ticks).with_boundaries(sides)
    upper = ElasticBody.from_mesh(above, ElementHex1(), E=1.0, nu=0.3)
    lower = ElasticBody.from_mesh(below, ElementHex1(), E=3.0, nu=0.3)
    upper.fix("high", "z", -0.02).fix("high", "x", 0.01).fix("high", "y")
    return upper, lower.fix("low", "xyz").body_force((0.0, 0.0, -1e-3))


def whole(upper: ElasticBody, lower: ElasticBody, names: tuple[str, str]) -> dict[str, Any]:
    """Seconds of each part of the contact solve, and what came out."""
    begin = time.perf_counter()
    problem = ContactProblem(upper, names[0], lower.surface(names[1]), friction=FRICTION)
    rows = time.perf_counter()
    problem.condense()
    condensed = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    return {
        "rows": rows - begin,
        "condense": condensed - rows,
        "solve": end - condensed,
        "total": end - begin,
        "points": int(result.mu.size),
        "steps": sum(line.phase == "newton" for line in result.history),
        "residual": max(result.kkt.values()),
    }


def sliding_step(n: int) -> float:
    """Seconds of a step of finite sliding, certificate included, after the first."""
    upper, lower = blocks(n)
    upper.fix("top", "x", 0.0)
    stepper = LoadStepper(
        ContactProblem(upper, "bottom", lower.surface("top"), friction=FRICTION), sliding="finite"
    )
    stepper.move("top", "x", 0.05, body=upper)
    stepper.step(0.5)
    begin = time.perf_counter()
    stepper.step(1.0)
    return time.perf_counter() - begin


def measure(kind: str, n: int, repeats: int) -> dict[str, Any]:
    """Medians of interleaved repeats."""
    make, names = (blocks, ("bottom", "top")) if kind == "blocks" else (bricks, ("low", "high"))
    found, units = [], []
    for _ in range(repeats):
        upper, lower = make(n)
        for body in (upper, lower):
            _ = body.stiffness, body.constraint
        found.append(whole(upper, lower, names))
        units.append(sum(base(body, "pardiso") for body in (upper, lower)))
    row: dict[str, Any] = {key: statistics.median(one[key] for one in found) for key in found[0]}
    row |= {"kind": kind, "n": n, "unknowns": int(upper.f.size + lower.f.size)}
    row |= {"base": statistics.median(units)}
    row["ratio"] = statistics.median(
        one["total"] / unit for one, unit in zip(found, units, strict=True)
    )
    if kind == "blocks":
        row["sliding_step_over_base"] = sliding_step(n) / row["base"]
    return row


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_pair.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blocks", type=int, nargs="*", default=[45, 90])
    parser.add_argument("--bricks", type=int, nargs="*", default=[24])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    if not has_pardiso():
        parser.error("pypardiso is not installed: pip install 'skfem-adini[mkl]'")
    rows = []
    for kind in ("blocks", "bricks"):
        for n in getattr(options, kind):
            row = measure(kind, n, options.repeats)
            rows.append(row)
            print(
                f"{kind} n = {n}: {row['unknowns']} dofs, {row['points']} points, base "
                f"{row['base']:.3f} s, total {row['total']:.3f} s, ratio {row['ratio']:.2f} "
                f"({row['steps']} Newton steps, residual {row['residual']:.0e})",
                flush=True,
            )
    record = {"benchmark": "contact_pair", "machine": describe(), "repeats": options.repeats,
              "rows": rows}  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_pair.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
