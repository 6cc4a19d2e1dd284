"""What a load step of large strain costs beside its assemblies and factorisations.

Half a cylinder of rubber on P2 triangles is pressed onto a plane with friction .3, two steps of a
tenth of its radius after a first one, by Newton's method alone. The unit is what its iterations
spend on tangents and on factors with the Schur complement of the contact points, both in the same
run, processor seconds; run it with OMP_NUM_THREADS=1. Beside it stand the same steps where factors
of earlier iterates serve, as they do by default (`contact.nonlinear.chord`). Where felupe is
installed, its assembly of the same tangent stands beside ours, interleaved, least of several.

    python benchmarks/contact_materials.py
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import ElementQuad1, ElementTriP2, MeshQuad, MeshTri

from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane
from contact.nonlinear import boundary_factor
from contact.nonlinear.body_forces import BodyForces
from contact.nonlinear.chord import Tangent
from skfem_adini.ground.pardiso import has_pardiso

RUBBER = NeoHooke(1.0, 9.0)
PRICE = Tangent.price


def half_cylinder(fine: int) -> NonlinearBody:
    """Half a disk of radius one below its flat top."""
    mesh = MeshTri.init_circle(fine)
    mesh = mesh.restrict(np.flatnonzero(mesh.p[1][mesh.t].mean(axis=0) < 0.0))
    names = {"top": lambda x: np.isclose(x[1], 0.0), "arc": lambda x: x[1] < -1e-9}
    mesh = MeshTri(mesh.p, mesh.t).with_boundaries(names)
    return NonlinearBody.from_mesh(mesh, ElementTriP2(), stress=RUBBER).fix("top")


class Timed:
    """Adds up the time of a method, of the processor unless another clock is given."""

    def __init__(
        self, owner: Any, name: str, clock: Callable[[], float] = time.process_time
    ) -> None:
        self.spent, self.calls, method = 0.0, 0, getattr(owner, name)

        def timed(*arguments: Any, **more: Any) -> Any:
            begin = clock()
            found = method(*arguments, **more)
            self.spent += clock() - begin
            self.calls += 1
            return found

        setattr(owner, name, timed)


def steps(fine: int, parts: dict[str, Timed], chords: bool) -> dict[str, Any]:
    """Times of two steps and of their parts, by Newton's method or with chords."""
    Tangent.price = PRICE if chords else property(lambda tangent: 0.0)  # type: ignore[assignment]
    body = half_cylinder(fine)
    problem = ContactProblem(body, "arc", Plane((0.0, -1.0), (0.0, 1.0)), friction=0.3)
    stepper = NonlinearStepper(problem).move("top", "y", -0.4)
    stepper.run([0.1])
    for part in parts.values():
        part.spent = 0.0
    begin = time.process_time()
    history = stepper.run([0.2, 0.3])
    total = time.process_time() - begin
    row = {name: part.spent for name, part in parts.items()}
    return row | {
        "unknowns": body.ndofs,
        "points": int(history.results[-1].mu.size),
        "iterations": sum(len(result.history) for result in history.results[1:]),
        "total": total,
        "ratio": total / (row["assembly"] + row["factor"]),
    }


def least(function: Callable[[], Any], repeats: int) -> float:
    """Least processor time of several calls."""
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        function()
        found.append(time.process_time() - begin)
    return min(found)


def beside_felupe(n: int, repeats: int) -> dict[str, Any] | None:
    """Seconds of one tangent of n by n Q1 cells, ours and felupe's; None where it is missing."""
    try:
        import felupe as fe
    except ImportError:
        return None
    mesh = fe.Rectangle(n=n + 1)
    region = fe.RegionQuad(mesh, quadrature=fe.GaussLegendre(order=2, dim=2))
    field = fe.FieldContainer([fe.FieldPlaneStrain(region, dim=2)])
    solid = fe.SolidBody(fe.NeoHookeCompressible(mu=1.0, lmbda=9.0), field)
    own = MeshQuad(mesh.points.T.copy(), mesh.cells.T.copy(), sort_t=False)
    body = NonlinearBody.from_mesh(own, ElementQuad1(), stress=RUBBER)
    u = np.zeros(body.ndofs)
    body.cells.tangent(u, {}, 0.0)
    ours, theirs = np.inf, np.inf
    for _ in range(repeats):
        ours = min(ours, least(lambda: body.cells.tangent(u, {}, 0.0), 1))
        theirs = min(theirs, least(lambda: solid.assemble.matrix(), 1))
    return {"cells": n * n, "ours": ours, "felupe": theirs, "version": fe.__version__}


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_materials.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fine", type=int, nargs="*", default=[5, 6])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    parts = {
        "assembly": Timed(BodyForces, "tangent"),
        "factor": Timed(boundary_factor.BoundaryFactor, "__init__"),
    }
    rows = []
    for fine in options.fine:
        pairs = [[steps(fine, parts, way) for way in (False, True)] for _ in range(options.repeats)]
        ways = zip(*pairs, strict=True)
        newton, chord = (min(found, key=lambda row: row["total"]) for found in ways)
        names = ("assembly", "factor", "total", "iterations")
        rows.append(newton | {"chords": {name: chord[name] for name in names}})
        print(rows[-1], flush=True)
    record = {
        "benchmark": "contact_materials",
        "machine": describe(),
        "factoriser": "PARDISO" if has_pardiso() else "SuperLU",
        "rows": rows,
        "felupe": beside_felupe(64, 5),
    }
    print(record["felupe"])
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_materials.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
