"""What far tools, wear and adhesion cost: ratios of processor seconds in one process.

* A step of finite sliding over one of small sliding, of the same body under the same tool, and the
  share of the searches for closest points: a roller in the plane, a sphere and a meshed sphere in
  space.
* A step with wear over one without on a grid, with friction.
* The pull-off of a sphere in the JKR limit on a grid, with the ramp that is found: its force over
  that of Maugis (J. Colloid Interface Sci. 150 (1992), 243), and a step over one without adhesion.

Interleaved, least of several; run it with OMP_NUM_THREADS=1.

    python benchmarks/contact_far.py
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
from skfem import ElementHex1, ElementQuad1, MeshHex, MeshQuad

from contact import (
    Adhesion,
    ClosestPoint,
    ContactProblem,
    Cylinder,
    ElasticBody,
    GridContact,
    HalfSpace,
    LoadStepper,
    Moved,
    Parabola,
    PeriodicLayers,
    Rigid,
    Sphere,
    SurfaceMesh,
)
from contact.obstacles.tool import Tool

RADIUS, DEPTH, PULL_OFF = 0.8, 0.02, -1.5097574786  # Maugis' force at lambda = 4, over pi w R


def seconds(way: Callable[[], Any]) -> float:
    """Processor time of a call."""
    begin = time.process_time()
    way()
    return time.process_time() - begin


def block(dim: int, n: int) -> ElasticBody:
    """A block of length two below zero."""
    across, down = np.linspace(-1, 1, n + 1), np.linspace(-0.5, 0, n // 4 + 1)
    mesh: Any = MeshQuad.init_tensor(across, down)
    if dim == 3:
        mesh = MeshHex.init_tensor(across, across[: n // 2 + 1] + 0.5, down)
    mesh = mesh.with_boundaries({"top": lambda x: x[-1] == 0, "bottom": lambda x: x[-1] == -0.5})
    element = ElementQuad1() if dim == 2 else ElementHex1()
    return ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3).fix("bottom")


def meshed(rings: int) -> SurfaceMesh:
    """A sphere of triangles."""
    import pyvista

    sphere = pyvista.Sphere(
        radius=RADIUS, center=(0, 0, RADIUS), theta_resolution=2 * rings, phi_resolution=rings
    )
    return SurfaceMesh(sphere.points.T.astype(float), sphere.faces.reshape(-1, 4)[:, 1:].T)


def far(name: str, n: int, repeats: int) -> dict[str, Any]:
    """Steps of both kinds of sliding, and what of the far ones is the search."""
    dim = 2 if name == "roller" else 3
    centre = (0.0,) * (dim - 1) + (RADIUS,)
    shape: Any = {
        "roller": lambda: Cylinder(centre, RADIUS),
        "sphere": lambda: Sphere(centre, RADIUS),
        "meshed sphere": lambda: meshed(48),
    }[name]()

    def tool(t: float) -> Moved:
        return Moved(shape, (0.02 * t, *(0.0,) * (dim - 2), -DEPTH))

    def steppers() -> tuple[LoadStepper, LoadStepper]:
        body = block(dim, n)
        small = LoadStepper(ContactProblem(body, "top", ClosestPoint(tool(0)), friction=0.2))
        problem = ContactProblem(block(dim, n), "top", tool(0), friction=0.2)
        return small, LoadStepper(problem, sliding="finite").obstacle(tool)

    small, finite = steppers()
    small.move("bottom", "x", -0.02)
    searched, whole = [0.0], (Tool.distance, Tool.curvature)

    def timed(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            begin = time.process_time()
            try:
                return method(*args)
            finally:
                searched[0] += time.process_time() - begin

        return call

    Tool.distance, Tool.curvature = map(timed, whole)  # type: ignore[method-assign]
    found, share = [], []
    try:
        for t in range(1, repeats + 2):
            one = seconds(lambda t=t: small.step(0.05 * t))  # type: ignore[misc]
            searched[0] = 0.0
            other = seconds(lambda t=t: finite.step(float(t)))  # type: ignore[misc]
            found.append((one, other))
            share.append(searched[0] / other)
    finally:
        Tool.distance, Tool.curvature = whole  # type: ignore[method-assign]
    least = np.array(found[1:]).min(axis=0)
    return {
        "tool": name, "n": n, "unknowns": int(finite.problem.body.f.size),
        "points": int(finite.problem.rows.gap.size), "small": float(least[0]),
        "far": float(least[1]), "ratio": float(least[1] / least[0]),
        "share": float(np.median(share[1:])),
        "projections": max(sum(line.phase == "projection" for line in r.history)
                           for r in finite.history.results[1:]),
    }  # fmt: skip


def wear(n: int, repeats: int) -> dict[str, Any]:
    """Histories of four steps on a grid, with friction, with and without wear."""
    ground, ball = HalfSpace((1.0, 1.0), (n, n), 1.0, 0.3), Parabola((0.5, 0.5, 0.0), 2.0)
    steps = [
        Rigid(ball, force=(None, None, 1e-3), displacement=(1e-3 * t, 0.0, None)) for t in range(4)
    ]
    ways = [
        lambda k=k: GridContact(ground, steps[0], 0.3, wear=k).history(steps) for k in (None, 0.1)
    ]
    least = np.min([[seconds(way) for way in ways] for _ in range(repeats)], axis=0)
    return {"n": n, "plain": float(least[0]), "wear": float(least[1]),
            "ratio": float(least[1] / least[0])}  # fmt: skip


def jkr(points: int, repeats: int) -> dict[str, Any]:
    """The sphere that adheres, in units in which pi w = K = 4 E* / 3."""
    E, nu, length = 0.91, 0.3, 6.5
    K = 4 * E / (1 - nu**2) / 3
    layer = [(4 * length / points, 4, E, nu)]
    ground = PeriodicLayers((length,) * 2, layer, (points,) * 2, sides=("x", "y"), base=(E, nu))
    ball = Parabola((0.0, 0.0, 0.0), 1.0)
    steps = [Rigid(ball, displacement=(0.0, 0.0, d)) for d in (-0.2, -0.26, -0.31)]
    glue = Adhesion(2 * K, K / np.pi)
    results: list[Any] = []

    def adhesive() -> None:
        results[:] = GridContact(ground, steps[0], adhesion=glue).history(steps)

    def plain() -> None:
        pressed = [Rigid(ball, displacement=(0.0, 0.0, d)) for d in (0.5, 0.6, 0.7)]
        GridContact(ground, pressed[0]).history(pressed)

    least = np.min([(seconds(plain), seconds(adhesive)) for _ in range(repeats)], axis=0)
    force = min(4 * float(r.forces[0].sum()) for r in results) / K
    return {"points": points, "force": force, "off": force / PULL_OFF - 1.0,
            "plain": float(least[0]), "adhesive": float(least[1]),
            "ratio": float(least[1] / least[0])}  # fmt: skip


def main() -> None:
    """Measure all, print and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("benchmarks/results"))
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    repeats = options.repeats
    found = {
        "benchmark": "contact_far",
        "machine": describe(),
        "far": [
            far("roller", 64, repeats), far("roller", 128, repeats),
            far("sphere", 16, repeats), far("meshed sphere", 16, repeats),
        ],
        "wear": [wear(n, repeats) for n in (64, 128)],
        "jkr": [jkr(points, repeats) for points in (144, 288)],
    }  # fmt: skip
    print(json.dumps(found, indent=1))
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "contact_far.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
