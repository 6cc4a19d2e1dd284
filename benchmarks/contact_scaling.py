"""How contact grows with size: time by stage, memory, load histories, nearly incompressible bodies.

Four tables, each in a process of its own a row, so that the largest memory is that row's:

* 2-D: the block of `examples/contact_block.py` at n x n Adini cells,
* 3-D: a cube of n^3 trilinear hexahedra pressed on a paraboloid with friction,

stages: basis, assembly of S, contact rows, condensation (one sparse factorisation), solution of the
boundary problem with recovery and certificate; beside them one plain factorisation and solve of the
same S by the same factoriser, and the growth exponents of all, fitted over the sizes; and the steps
of Newton's and of the active-set method that a cold start and a nested one (from the solution at
n / 2) take with all contact points, for several friction coefficients;

* history: 100 load steps (press, then drag to and fro) in units of a cold solve from assembled S;
* incompressible: Hertz' line contact for nu up to .4999, error of the pressure.

    python benchmarks/contact_scaling.py --planar 32 64 128 256 512 --solid 8 12 16 20 24 32 40

Rows of other sizes, and tables whose list is empty, stay in the JSON; each row names its commit.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

FRICTIONS = {"planar": (0.3, 0.9, 1.5, 3.0), "solid": (0.1, 0.3, 0.6, 1.0)}
STAGES = ("basis", "assembly", "rows", "condense", "solve", "base")


def planar(n: int) -> dict[str, Any]:
    """The Coulomb block at n x n Adini cells."""
    from contact_block import FRICTION, OBSTACLE, base, block

    base(block(8)[0], "pardiso")  # libraries loaded
    stages(block(8)[0], OBSTACLE, FRICTION)
    body, seconds = block(n)
    seconds |= stages(body, OBSTACLE, FRICTION)
    seconds["steps"] = steps([block(n // 2)[0], body], OBSTACLE, FRICTIONS["planar"])
    return {**seconds, "base": base(body, "pardiso")}


def solid(n: int) -> dict[str, Any]:
    """A cube of n^3 hexahedra on a paraboloid."""
    from contact_block import base

    base(cube(3)[0], "pardiso")
    stages(cube(3)[0], dish, 0.3)
    body, seconds = cube(n)
    seconds |= stages(body, dish, 0.3)
    seconds["steps"] = steps([cube(n // 2)[0], body], dish, FRICTIONS["solid"])
    return {**seconds, "base": base(body, "pardiso")}


def dish(x: np.ndarray) -> np.ndarray:
    """Gap of the cube."""
    return 0.05 * ((x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2)


def cube(n: int) -> tuple[Any, dict[str, float]]:
    """The cube, its top pushed down and sideways; seconds of each part."""
    from skfem import ElementHex1, MeshHex

    from contact import ElasticBody

    ticks = np.linspace(0, 1, n + 1)
    begin = time.perf_counter()
    mesh = MeshHex.init_tensor(ticks, ticks, ticks).with_boundaries(
        {"foot": lambda x: x[2] < 1e-9, "head": lambda x: x[2] > 1 - 1e-9}
    )
    body = ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3)
    body.fix("head", "z", -0.01).fix("head", "x", 0.002).fix("head", "y")
    basis = time.perf_counter()
    _ = body.stiffness, body.constraint
    return body, {"basis": basis - begin, "assembly": time.perf_counter() - basis}


def stages(body: Any, obstacle: Any, friction: float) -> dict[str, Any]:
    """Seconds from assembled S to the certified result."""
    from contact import ContactProblem

    boundary = "foot" if "foot" in body.mesh.boundaries else "bottom"
    begin = time.perf_counter()
    problem = ContactProblem(body, boundary, obstacle, friction)
    rows = time.perf_counter()
    problem.condense()
    condensed = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    return {
        "unknowns": int(body.constraint[0].shape[1]),
        "points": int(result.mu.size),
        "rows": rows - begin,
        "condense": condensed - rows,
        "solve": end - condensed,
        "iterations": len(result.history),
        "kkt": max(result.kkt.values()),
    }


def steps(bodies: list[Any], obstacle: Any, frictions: tuple[float, ...]) -> dict[str, Any]:
    """Steps with all contact points of the second body: cold, and nested from the first one."""
    from contact import ContactProblem

    boundary = "foot" if "foot" in bodies[0].mesh.boundaries else "bottom"
    first = [ContactProblem(body, boundary, obstacle, frictions[0]) for body in bodies]
    found: dict[str, Any] = {}
    for friction in frictions:
        coarse, fine = (ContactProblem(p.body, boundary, obstacle, friction) for p in first)
        for problem, condensed in zip((coarse, fine), first, strict=True):
            condensed.condense()
            problem._condensed = condensed._condensed  # friction plays no part in it
        cold, nested = fine.solve(), fine.solve(start=coarse.solve())
        apart = float(np.abs(cold.u - nested.u).max() / np.abs(cold.u).max())
        found[str(friction)] = {
            "cold": sum(not line.phase.startswith("coarse") for line in cold.history),
            "cold_newton": sum(line.phase == "newton" for line in cold.history),
            "coarse": sum(line.phase.startswith("coarse") for line in cold.history),
            "nested": len(nested.history),
            "apart": apart,
        }
    return found


def history(n: int, steps: int = 100) -> dict[str, Any]:
    """Load steps on one factorisation against cold solves, both from assembled S."""
    from contact_block import FRICTION, OBSTACLE, block

    from contact import ContactProblem, LoadStepper

    body, _ = block(n)
    cold = []
    for _ in range(3):
        begin = time.perf_counter()
        problem = ContactProblem(body, "bottom", OBSTACLE, FRICTION)
        problem.solve()
        cold.append(time.perf_counter() - begin)
    stepper = LoadStepper(problem)
    stepper.load("left", (0.05, 0.0), lambda t: np.sin(2 * np.pi * t))
    stepper.load("top", (0.0, -0.3), lambda t: t)
    begin = time.perf_counter()
    found = stepper.run(np.linspace(0, 1, steps + 1)[1:])
    seconds = time.perf_counter() - begin
    return {
        "steps": steps,
        "cold": float(np.median(cold)),
        "seconds": seconds,
        "step_over_cold": seconds / steps / float(np.median(cold)),
        "over_cold": seconds / float(np.median(cold)),
        "iterations": float(np.mean([len(result.history) for result in found.results])),
        "kkt": max(max(result.kkt.values()) for result in found.results),
    }


def incompressible(cells: int) -> dict[str, Any]:
    """Hertz' pressure (rms over p0, |x| < .8 a) for each nu, Adini, both functionals and Q1, Q2."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    from half_space import load_far_field, quarter
    from skfem import ElementQuad1, ElementQuad2

    from contact import ContactProblem, ElasticBody, Parabola
    from skfem_adini import ElementQuadAdini

    table: dict[str, Any] = {}
    kinds = (
        (ElementQuadAdini, "bernstein", "pointwise"),
        (ElementQuadAdini, "gauss", "pointwise"),
        (ElementQuad2, "bernstein", "pointwise"),
        (ElementQuad1, "nodal", "pointwise"),
        (ElementQuad1, "nodal", "mean"),
    )
    for element, functional, dilatation in kinds:
        for nu in (0.3, 0.45, 0.49, 0.499, 0.4999):
            mesh = quarter(1 / cells, 1.25, 100.0)
            body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=nu, dilatation=dilatation)
            force = np.pi / (1 - nu**2) / 80
            load_far_field(body.fix("left", "x"), (0.0, force), "right top")
            obstacle = Parabola((0.0, 0.0), 20.0)
            result = ContactProblem(body, "bottom", obstacle, functional=functional).solve()
            x = result.x[0]
            inside = x < 0.8
            error = result.pressure[inside] * np.pi / (2 * force) - np.sqrt(1 - x[inside] ** 2)
            name = f"{element.__name__}, {functional}"
            name += ", mean dilatation" if dilatation == "mean" else ""
            table.setdefault(name, {})[str(nu)] = float(np.sqrt(np.mean(error**2)))
    return table


KINDS = {"planar": planar, "solid": solid, "history": history, "incompressible": incompressible}


def row(kind: str, n: int) -> dict[str, Any]:
    """One row in a process of its own."""
    command = [sys.executable, __file__, "--row", kind, str(n)]
    output = subprocess.run(command, capture_output=True, text=True, check=False)
    if output.returncode != 0:
        return {"n": n, "failed": output.stderr.strip().splitlines()[-1:]}
    found: dict[str, Any] = json.loads(output.stdout.splitlines()[-1])
    return found


def exponents(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Growth of each stage with the number of unknowns, fitted over the rows."""
    good = [r for r in rows if "failed" not in r]
    if len(good) < 2:
        return {}
    size = np.log([r["unknowns"] for r in good])
    return {
        name: float(np.polyfit(size, np.log([r[name] for r in good]), 1)[0])
        for name in (*STAGES, "memory")
    }


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_scaling.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--planar", type=int, nargs="*", default=[32, 64, 128, 256, 512])
    parser.add_argument("--solid", type=int, nargs="*", default=[8, 12, 16, 20, 24, 32, 40])
    parser.add_argument("--history", type=int, nargs="*", default=[128])
    parser.add_argument("--incompressible", type=int, nargs="*", default=[8, 16])
    parser.add_argument("--row", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    if options.row:
        kind, n = options.row[0], int(options.row[1])
        found = {"n": n, **KINDS[kind](n)}
        kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(json.dumps(found | {"memory": kilobytes / 2**20}))
        return found

    path = options.output / "contact_scaling.json"
    record: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    record |= {"benchmark": "contact_scaling", "machine": describe()}
    for kind in ("planar", "solid"):
        sizes = getattr(options, kind)
        if not sizes:
            continue
        print(f"{kind}: seconds of {', '.join(STAGES)}; GiB")
        earlier = record.get(kind, {}).get("rows", [])
        rows = [line for line in earlier if "commit" in line and line["n"] not in sizes]
        for n in sizes:
            line = row(kind, n) | {"commit": record["machine"]["commit"]}
            rows.append(line)
            if "failed" in line:
                print(f"n = {n:4d}: {line['failed']}", flush=True)
                continue
            parts = "  ".join(f"{line[name]:7.3f}" for name in STAGES)
            total = line["rows"] + line["condense"] + line["solve"]
            print(
                f"n = {n:4d}, {line['unknowns']:8d} unknowns:  {parts}   {line['memory']:.2f} GiB, "
                f"{total / line['base']:.2f} x base",
                flush=True,
            )
            for friction, taken in line["steps"].items():
                print(
                    f"{'':>10}friction {friction}: cold {taken['cold']} steps ({taken['coarse']} "
                    f"with fewer points before), nested {taken['nested']}, same to "
                    f"{taken['apart']:.0e}",
                    flush=True,
                )
        rows.sort(key=lambda line: line["n"])
        record[kind] = {"rows": rows, "exponents": exponents(rows)}
        fitted = ", ".join(f"{k} {v:.2f}" for k, v in record[kind]["exponents"].items())
        print(f"growth with the unknowns: {fitted}\n")
    for n in options.history:
        line = row("history", n)
        record.setdefault("history", {})[str(n)] = line
        print(f"history at n = {n}: {json.dumps(line)}", flush=True)
    for cells in options.incompressible:
        table = row("incompressible", cells)
        record.setdefault("incompressible", {})[str(cells)] = table
        print(f"nearly incompressible, a / h = {cells}: rms pressure error over p0")
        for name, errors in table.items():
            if isinstance(errors, dict):
                print(f"  {name:>30}: " + "  ".join(f"{k}: {v:.1e}" for k, v in errors.items()))
    options.output.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
