"""Contact beside two other packages, in accuracy and time, on identical problems.

* tamaas 2.9 (L. Frerot, G. Anciaux, V. Rey, S. Pham-Ba and J.-F. Molinari, J. Open Source Softw. 5
  (2020)): boundary elements on a periodic half space, by FFT and the constrained conjugate
  gradients of Polonsky and Keer; Hertz' line and point contact. Its period is 20 a (line) and 8 a
  (point): the error that remains is that of the images. The half space is all it can do, and is
  what makes it quick.
* NGSolve 6.2 (J. Schoeberl, TU Wien report 30/2014): `ContactBoundary` with the penalty energy
  k/2 <u_n - d>^2 against a second, clamped body, minimised by Newton's method with a line search;
  the block of `contact_block.py` without friction, triangles of order 3. The penalty is a
  choice: the larger, the less penetration and the worse the condition.

Times are CPU seconds on one thread (OMP_NUM_THREADS=1, NGSolve without its task manager).
Ours is timed from the mesh to the certified result, the others from the mesh (or the surface) to
the solution. The block's reference is ours on 128 x 128 cells; its displacement is compared at 99
points of the bottom.

    pip install tamaas ngsolve && OMP_NUM_THREADS=1 python benchmarks/contact_peers.py
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from numpy.typing import NDArray

Array = NDArray[np.float64]
A, E, NU, RADIUS = 1.0, 1.0, 0.3, 20.0
STAR = E / (1 - NU**2)
PROBES = np.linspace(0.01, 0.99, 99)


def timed(call: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Median of the CPU seconds after a first call, and the last outcome."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = time.process_time()
        outcome = call()
        seconds.append(time.process_time() - begin)
    return statistics.median(seconds), outcome


def of_line(x: Array, pressure: Array, weights: Array) -> dict[str, float]:
    """Errors of p(0), of the pressure (rms over |x| < .8 a, over p0), of the half-width."""
    p0 = STAR * A / (2 * RADIUS)
    inside = np.abs(x) < 0.8 * A
    error = pressure[inside] / p0 - np.sqrt(1 - (x[inside] / A) ** 2)
    width = 2 * np.sqrt((weights * pressure) @ x**2 / (weights @ pressure)) / A
    return {"rms": float(np.sqrt(np.mean(error**2))), "half_width": float(width - 1)}


def our_line(cells: int, functional: str) -> dict[str, float]:
    """Half the contact on a quarter of the half plane's block, 100 a wide."""
    from half_space import half_plane, load_far_field, quarter

    from contact import ContactProblem, Parabola

    force = np.pi * STAR * A**2 / (4 * RADIUS)
    body = half_plane(quarter(A / cells, 1.25 * A, 100 * A), E, NU).fix("left", "x")
    load_far_field(body, (0.0, force), "right top")
    obstacle = Parabola((0.0, 0.0), RADIUS)
    result = ContactProblem(body, "bottom", obstacle, functional=functional).solve()
    errors = of_line(result.x[0], result.pressure, result.system.rows.weights)
    return errors | {"unknowns": float(result.u.size)}


def tamaas_line(cells: int) -> dict[str, float]:
    """The same on a period of 20 a."""
    import tamaas as tm

    period, n = 20 * A, 20 * cells
    force = np.pi * STAR * A**2 / (4 * RADIUS)
    x = (np.arange(n) - n // 2) * period / n
    tm.set_log_level(tm.LogLevel.warning)
    model = tm.ModelFactory.createModel(tm.model_type.basic_1d, [period], [n])
    model.E, model.nu = E, NU
    tm.PolonskyKeerRey(model, -(x**2) / (2 * RADIUS), 1e-12).solve(force / period)
    pressure = np.array(model.traction).ravel()
    return of_line(x, pressure, np.full(n, period / n)) | {"unknowns": float(n)}


def of_point(r: Array, pressure: Array, weights: Array) -> dict[str, float]:
    """Errors of p0 (from p^2, linear in r^2, over r < .75 a) and of the radius of contact."""
    p0 = 2 * STAR * A / (np.pi * RADIUS)
    near = r < 0.75 * A
    centre = np.sqrt(np.polyfit(r[near] ** 2, pressure[near] ** 2, 1)[1])
    force = weights * pressure
    return {
        "p0": float(centre / p0 - 1),
        "radius": float(np.sqrt(2.5 * (force @ r**2) / force.sum()) / A - 1),
    }


def our_point(cells: int) -> dict[str, float]:
    """A quarter of the half space cut off at 12 a, quadratic hexahedra."""
    from validation_hertz_sphere import sphere

    result = sphere(cells).result
    errors = of_point(np.hypot(*result.x[:2]), result.pressure, result.system.rows.weights)
    return errors | {"unknowns": float(result.u.size)}


def tamaas_point(cells: int) -> dict[str, float]:
    """The whole contact on a period of 8 a."""
    import tamaas as tm

    period, n = 8 * A, 8 * cells
    x = (np.arange(n) - n // 2) * period / n
    square = x[:, None] ** 2 + x**2
    force = 4 * STAR * A**3 / (3 * RADIUS)
    tm.set_log_level(tm.LogLevel.warning)
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, [period, period], [n, n])
    model.E, model.nu = E, NU
    tm.PolonskyKeerRey(model, -square / (2 * RADIUS), 1e-12).solve(force / period**2)
    pressure = np.array(model.traction).ravel()
    errors = of_point(np.sqrt(square).ravel(), pressure, np.full(n * n, (period / n) ** 2))
    return errors | {"unknowns": float(n * n)}


def our_block(n: int) -> dict[str, Any]:
    """Frictionless block: contact force, bottom displacement, penetration over the gap."""
    from contact_block import OBSTACLE, block

    from contact import ContactProblem

    result = ContactProblem(block(n)[0], "bottom", OBSTACLE).solve()
    u = result.sample(np.array([PROBES, 0 * PROBES]))
    return {
        "force": result.contact_force,
        "u": u,
        "penetration": float(np.max(-u[1] - 0.03)) / 0.03,
        "unknowns": int(result.system.body.constraint[0].shape[1]),
        "steps": len(result.history),
    }


def ngsolve_block(n: int, penalty: float, order: int = 3) -> dict[str, Any]:
    """The same by a penalty energy between the block and a clamped foundation .03 below it."""
    import ngsolve as ngs
    from netgen.geom2d import SplineGeometry

    geometry = SplineGeometry()
    sides = {"brick": ("bottom", "right", "top", "left"), "ground": ("under", "o", "floor", "o")}
    for number, (y0, y1, name) in enumerate(((0.0, 1.0, "brick"), (-0.13, -0.03, "ground"))):
        left, right = (0.0, 1.0) if name == "brick" else (-0.1, 1.1)
        corners = [
            geometry.AppendPoint(*xy)
            for xy in ((left, y0), (right, y0), (right, y1), (left, y1))
        ]  # fmt: skip
        for k, side in enumerate(sides[name]):
            ends = ["line", corners[k], corners[(k + 1) % 4]]
            geometry.Append(ends, leftdomain=number + 1, rightdomain=0, bc=side)
        geometry.SetMaterial(number + 1, name)
    geometry.SetDomainMaxH(2, 0.2)
    mesh = ngs.Mesh(geometry.GenerateMesh(maxh=1.0 / n))
    fixed = {"dirichletx": "top|under|o|floor", "dirichlety": "left|right|under|o|floor"}
    fes = ngs.VectorH1(mesh, order=order, **fixed)
    u = fes.TrialFunction()
    modulus, ratio = 2.0, 0.3
    mu = modulus / (2 * (1 + ratio))
    lam = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))
    eps = ngs.Sym(ngs.Grad(u))
    a = ngs.BilinearForm(fes)
    a += ngs.Variation((mu * ngs.InnerProduct(eps, eps) + 0.5 * lam * ngs.Trace(eps) ** 2) * ngs.dx)
    a += ngs.Variation(u[1] * ngs.ds("top"))
    contact = ngs.ContactBoundary(mesh.Boundaries("bottom"), mesh.Boundaries("floor"))
    X = ngs.CF((ngs.x, ngs.y))
    through = (X + u - (X.Other() + u.Other())) * ngs.specialcf.normal(2)
    contact.AddEnergy(0.5 * penalty * ngs.IfPos(through, through * through, 0.0))
    field = ngs.GridFunction(fes)
    field.vec[:] = 0.0
    contact.Update(field, a, intorder=2 * order, maxdist=0.2)
    _, steps = ngs.solvers.NewtonMinimization(
        a, field, maxit=100, maxerr=1e-10, inverse="sparsecholesky", printing=False
    )
    below = ngs.IfPos(-field[1] - 0.03, -field[1] - 0.03, 0.0)
    bottom = mesh.Boundaries("bottom")
    force = penalty * ngs.Integrate(below, mesh, definedon=bottom, order=2 * order)
    values = np.array([field(mesh(x, 0.0)) for x in PROBES]).T
    return {
        "force": float(force),
        "u": values,
        "penetration": float(np.max(-values[1] - 0.03)) / 0.03,
        "unknowns": int(sum(fes.FreeDofs())),
        "steps": int(steps),
    }


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_peers.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--line", type=int, nargs="*", default=[8, 16, 32])
    parser.add_argument("--point", type=int, nargs="*", default=[2, 4])
    parser.add_argument("--block", type=int, nargs="*", default=[16, 32])
    parser.add_argument("--penalties", type=float, nargs="*", default=[1e2, 1e4, 1e6])
    parser.add_argument("--reference", type=int, default=128)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    sys.path.append(str(Path(__file__).parents[1] / "examples"))
    installed = {name: bool(importlib.util.find_spec(name)) for name in ("tamaas", "ngsolve")}
    record: dict[str, Any] = {"benchmark": "contact_peers", "machine": describe()}
    record["threads"] = os.environ.get("OMP_NUM_THREADS", "all")
    record["peers"] = {name: version(name) for name, here in installed.items() if here}

    def row(case: str, name: str, call: Callable[[], dict[str, Any]], **extra: Any) -> None:
        seconds, found = timed(call, options.repeats)
        found.pop("u", None)
        found |= {"name": name, "seconds": seconds, **extra}
        record.setdefault(case, []).append(found)
        figures = "  ".join(
            f"{key} {value:.2e}" for key, value in found.items() if isinstance(value, float)
        )
        print(f"{case:>6} {name:>28} {extra}  {figures}", flush=True)

    for cells in options.line:
        for functional in ("bernstein", "gauss"):
            row(
                "line",
                f"Adini, {functional}",
                lambda c=cells, f=functional: our_line(c, f),
                h=cells,
            )
        if installed["tamaas"]:
            row("line", "tamaas", lambda c=cells: tamaas_line(c), h=cells)
    for cells in options.point:
        row("point", "Hex2", lambda c=cells: our_point(c), h=cells)
        if installed["tamaas"]:
            row("point", "tamaas", lambda c=cells: tamaas_point(c), h=cells)
    if options.block:
        exact = our_block(options.reference)

        def against(found: dict[str, Any]) -> dict[str, Any]:
            size = np.abs(exact["u"]).max()
            found["u_error"] = float(np.abs(found["u"] - exact["u"]).max() / size)
            found["force_error"] = found.pop("force") / exact["force"] - 1
            return found

        record["block_reference"] = {"n": options.reference, "force": exact["force"]}
        for n in options.block:
            row("block", "Adini", lambda n=n: against(our_block(n)), n=n)
            for k in options.penalties if installed["ngsolve"] else ():
                name = f"NGSolve, penalty {k:.0e}"
                row("block", name, lambda n=n, k=k: against(ngsolve_block(n, k)), n=n)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_peers.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
