"""Impact and sliding of bodies with inertia against closed forms, and what a step costs.

* A bar thrown at a wall, at Courant numbers .5, 1 and 5: contact lasts 2 L / c, the speed is
  reversed, and the pressure over the middle four fifths of the contact is rho c v.
* Two equal bars, which exchange their velocities; a block that slides v^2 / (2 F g).
* The impact of a ball: duration 2.943 d / v and force 4/3 E* R^(1/2) d^(3/2) with d^(5/2) =
  15 m v^2 / (16 E* R^(1/2)) (K. L. Johnson, Contact Mechanics, 1985, section 11.4); the difference
  from a half space is fitted by a power of a / R.
* Processor seconds of a step over those of two solutions by the factor of K + 4 M / dt^2 and the
  boundary problem, and of a hundred steps over the factorisation, interleaved, least of several;
  run it with OMP_NUM_THREADS=1.

    python benchmarks/contact_dynamics.py
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import ElementQuad1, ElementTriP2, MeshQuad, MeshTri, MeshTri2

from contact import ContactProblem, DynamicStepper, ElasticBody, Pair, Plane
from skfem_adini import factorize

SPEED, NEVER = 0.01, 10**9


def velocity(stepper: DynamicStepper, body: int, component: int) -> float:
    """Mean velocity of a body with the mass of the steps."""
    step, bodies = stepper.history[-1], stepper.problem.body
    one = bodies.bodies[body]
    e = np.zeros(step.u.size)
    e[bodies.slices[body]] = one.are_values * (np.arange(one.ndofs) % bodies.dim == component)
    M = stepper._of.M
    return float(e @ (M @ step.v) / (e @ (M @ e)))


def thrown(
    problem: ContactProblem, dt: float, steps: int, velocity: Any, **options: Any
) -> tuple[DynamicStepper, dict[str, float]]:
    """Run, and how well the ledger closes."""
    stepper = DynamicStepper(problem, 1.0, dt, velocity=velocity, keep=NEVER, **options)
    history = stepper.run(steps)
    size = np.abs(history.table[:, :3]).sum(axis=1).max()
    return stepper, {
        "ledger": float(np.abs(history.residual).max() / size),
        "grown": float(max(np.diff(history.total).max(), 0.0) / size),
        "lost": float(1.0 - history.total[-1] / history.total[0]),
    }


def strip(cells: int, x: float = 0.0) -> ElasticBody:
    """A bar of length one, one cell high."""
    mesh = MeshQuad.init_tensor(np.linspace(x, x + 1, cells + 1), [0.0, 1.0 / cells])
    return ElasticBody.from_mesh(mesh.with_defaults(), ElementQuad1(), E=1.0, nu=0.0)


def bar(cells: int, courant: float, scheme: str) -> dict[str, Any]:
    """A bar on a wall: duration, speed and pressure over the exact ones."""
    dt = courant / cells
    problem = ContactProblem(strip(cells), "left", 0.0)
    stepper, found = thrown(problem, dt, int(2.4 / dt), (-SPEED, 0.0), scheme=scheme)
    history = stepper.history
    middle, pressure = history.times[1:] - 0.5 * dt, history.force[1:, 0] * cells / SPEED
    inside = (middle > 0.2) & (middle < 1.8)
    return found | {
        "cells": cells,
        "courant": courant,
        "scheme": scheme,
        "duration": float((middle[pressure > 0.5][-1] + 0.5 * dt) / 2.0),
        "rebound": velocity(stepper, 0, 0) / SPEED,
        "pressure_rms": float(np.sqrt(np.mean((pressure[inside] - 1.0) ** 2))),
        "pressure_most": float(pressure.max()),
    }


def bars(cells: int) -> dict[str, float]:
    """Two equal bars, one at rest: velocity of the second over that of the first."""
    one, two = strip(cells), strip(cells, 1.0)
    problem = ContactProblem([one, two], [Pair(one, "right", two.surface("left"))])
    stepper, found = thrown(problem, 0.5 / cells, 5 * cells, [(SPEED, 0.0), None])
    left, right = (velocity(stepper, k, 0) / SPEED for k in (0, 1))
    return found | {"first": left, "second": right}


def block(dt: float) -> dict[str, float]:
    """A block on a rough floor: its way over v^2 / (2 F g)."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 21), np.linspace(0, 0.3, 7)).with_defaults()

    def made() -> ElasticBody:
        return ElasticBody.from_mesh(mesh, ElementQuad1(), E=100.0, nu=0.3).body_force((0, -1.0))

    rest = ContactProblem(made().constrain(np.eye(1, 2 * mesh.nvertices)), "bottom", 0.0).solve()
    problem = ContactProblem(made(), "bottom", 0.0, friction=0.3)
    stepper, found = thrown(problem, dt, int(2.2 / dt), (0.5, 0.0), displacement=rest)
    M, e = stepper._of.M, np.arange(rest.u.size) % 2 == 0.0
    way = float(e @ (M @ (stepper.history[-1].u - rest.u)) / (e @ (M @ e)))
    return found | {"dt": dt, "way": way / (0.5**2 / 0.6)}


def half_ball(fine: float, ratio: float) -> MeshTri2:
    """Half of the section of a ball, cells of `ratio` times the distance from its pole."""
    mesh = MeshTri(np.array([[0, 0, 1, 0], [0, -1, 0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3]]).T)

    def rounded(mesh: MeshTri) -> MeshTri:
        p, rim = mesh.p.copy(), np.unique(mesh.facets[:, mesh.boundary_facets()])
        rim = rim[p[0, rim] > 1e-12]
        p[:, rim] /= np.linalg.norm(p[:, rim], axis=0)
        return MeshTri(p, mesh.t)

    for _ in range(3):
        mesh = rounded(mesh.refined())
    while True:
        far = np.linalg.norm(mesh.p[:, mesh.t].mean(axis=1) - [[0.0], [-1.0]], axis=0)
        large = np.sqrt(2 * np.abs(mesh.mapping().detA)) > np.maximum(fine, ratio * far)
        if not large.any():
            break
        mesh = rounded(mesh.refined(np.flatnonzero(large)))
    curved = MeshTri2.from_mesh(mesh)
    place, rim = curved.doflocs.copy(), mesh.boundary_facets()
    rim = rim[mesh.p[0, mesh.facets[:, rim]].max(axis=0) > 1e-9] + mesh.nvertices
    place[:, rim] /= np.linalg.norm(place[:, rim], axis=0)
    return MeshTri2(place, curved.t)


NU, STAR, MASS = 0.3, 1 / (1 - 0.3**2), 4 * np.pi / 3  # of a ball of radius, E and density one


def pressed(reach: float, coarse: float, off: float) -> ContactProblem:
    """A ball over a plane at the distance `off`, with points as far as 2.5 times a / R = reach."""
    mesh = half_ball(reach * coarse / 3.2, coarse)
    rim = mesh.facets_satisfying(
        lambda x: (np.hypot(*x) > 0.99) & (x[0] > 1e-9) & (np.hypot(x[0], x[1] + 1) < 2.5 * reach),
        boundaries_only=True,
    )
    body = ElasticBody.from_mesh(mesh, ElementTriP2(), E=1.0, nu=NU, plane="axisymmetric")
    return ContactProblem(body, rim, Plane((0.0, -1.0 - off), (0.0, 1.0)))


def quasistatic(reach: float, coarse: float) -> dict[str, float]:
    """The same impact of a mass on the static compliance of this very ball, over Hertz'.

    Its own weight presses it by F; the mean displacement is ``x (1 - c sqrt(x))`` with Hertz'
    ``F = 4 / 3 E* x^1.5``. Energy and time of the approach are integrals.
    """
    problem, peak = pressed(reach, coarse, 0.0), 4 / 3 * STAR * reach**3
    body = problem.body
    weight = body.body_force((0.0, -1.0)).f.copy()
    mass = -weight @ (np.arange(weight.size) % 2 * body.are_values)
    root, lost = [], []
    for part in (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.15):
        body.f = weight * (part * peak / mass)
        x = (part * peak / (4 / 3 * STAR)) ** (2 / 3)
        moved = weight @ problem.solve().u / mass
        root.append(np.sqrt(x))
        lost.append((1 - moved / x) / np.sqrt(x))
    c = np.polyfit(root, lost, 1)
    s = np.linspace(0.0, 1.2 * reach, 20001)  # sqrt(x)
    way, force = s**2 * (1 - np.polyval(c, s) * s), 4 / 3 * STAR * s**3
    work = np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(way))))
    v2 = reach**5 * 16 * STAR / (15 * MASS)
    top = float(np.interp(0.5 * MASS * v2, work, s))
    theta = (np.arange(2000) + 0.5) * np.pi / 4000  # s^2.5 = top^2.5 sin(theta): no singular end
    at = top * np.sin(theta) ** 0.4
    slope = np.interp(at, s, np.gradient(way, s)) * 0.4 * at / np.tan(theta)
    left = np.sqrt(v2 - 2 * np.interp(at, s, work) / MASS)
    lasts = 2 * np.sum(slope / left) * np.pi / 4000
    return {
        "quasistatic_duration": float(lasts / (2.943 * reach**2 / np.sqrt(v2))),
        "quasistatic_force": float((top / reach) ** 3),
    }


def ball(reach: float, steps: int, coarse: float) -> dict[str, float]:
    """The impact of a ball with a / R = reach: duration and largest force over Hertz'; cells of
    `coarse` times the distance from its pole."""
    depth = reach**2
    v = np.sqrt(depth**2.5 * 16 * STAR / (15 * MASS))
    lasts, peak, off = 2.943 * depth / v, 4 / 3 * STAR * depth**1.5, 4e-4 * depth
    problem = pressed(reach, coarse, off)
    stepper, found = thrown(problem, lasts / steps, int(1.1 * steps), (0.0, -v))
    history = stepper.history
    force, middle = history.force[1:, 1], history.times[1:] - 0.5 * history.dt
    a, b = np.flatnonzero(force > 0)[-2:]
    f = force[[a, b]] ** (2 / 3)  # linear in time where contact ends
    end = middle[a] + f[0] * (middle[b] - middle[a]) / (f[0] - f[1]) - off / v
    k = int(np.argmax(force))
    bend = np.polyfit([-1.0, 0.0, 1.0], force[k - 1 : k + 2], 2)
    most = bend[2] - bend[1] ** 2 / (4 * bend[0])
    return found | {
        **quasistatic(reach, coarse),
        "reach": reach,
        "coarse": coarse,
        "unknowns": problem.body.ndofs,
        "steps": steps,
        "duration": float(end / lasts),
        "force": float(most / peak),
        "rebound": velocity(stepper, 0, 1) / v,
    }


def cost(cells: int, friction: float, repeats: int) -> dict[str, float]:
    """Seconds of the parts of a step of a square with about 2 cells^2 unknowns."""
    ticks = np.linspace(0, 1, cells + 1)
    mesh = MeshQuad.init_tensor(ticks, ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3)
    problem = ContactProblem(body, "bottom", 0.0, friction=friction)
    options = {"velocity": (0.0005, -0.001), "keep": NEVER}
    stepper = DynamicStepper(problem, 1.0, 0.5 / cells, **options)
    begin = time.process_time()
    condensed = stepper._of.condensed
    condensing = time.process_time() - begin
    stepper.run(5)
    A, rng = condensed.body.stiffness, np.random.default_rng(1)
    part = condensed.parts[0]
    seconds: dict[str, list[float]] = {name: [] for name in ("factor", "solve", "boundary", "step")}

    def clock(name: str, work: Any) -> Any:
        begin = time.process_time()
        result = work()
        seconds[name].append(time.process_time() - begin)
        return result

    for _ in range(repeats):
        if len(seconds["factor"]) < 3:
            clock("factor", lambda: factorize(A))
        clock("solve", partial(solution, part, rng.random(A.shape[0])))
        clock("step", stepper.step)
        seconds["boundary"].append(boundary_seconds(stepper))
    best = {name: min(found) for name, found in seconds.items()}
    begin = time.process_time()
    stepper.run(100)
    hundred = time.process_time() - begin
    return {
        "unknowns": int(A.shape[0]),
        "friction": friction,
        "condensing_s": condensing,
        **{f"{name}_s": value for name, value in best.items()},
        "hundred_steps_s": hundred,
        "step_over_two_solutions_and_boundary": best["step"]
        / (2 * best["solve"] + best["boundary"]),
        "step_over_one_solution_and_boundary": best["step"] / (best["solve"] + best["boundary"]),
        "hundred_steps_over_factor": 100 * best["step"] / best["factor"],
        "hundred_steps_over_condensing": 100 * best["step"] / condensing,
    }


def solution(part: Any, load: np.ndarray) -> np.ndarray:
    """Forward and backward through the factors of a condensation."""
    return part._factor.expand(load, part._factor.reduce(load))


def boundary_seconds(stepper: DynamicStepper) -> float:
    """Seconds of the boundary problem of the next step, which is repeated alone."""
    from contact.laws import methods
    from contact.problem import solve_system

    found, whole = [0.0], methods.solve_boundary

    def timed(*arguments: Any) -> Any:
        begin = time.process_time()
        result = whole(*arguments)
        found[0] += time.process_time() - begin
        return result

    solve_system.solve_boundary = timed  # type: ignore[assignment]
    try:
        stepper.step()
    finally:
        solve_system.solve_boundary = whole
    return found[0]


def main() -> None:
    """Measure all, print and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("benchmarks/results"))
    parser.add_argument("--only", nargs="*", help="measure these parts of the JSON anew")
    parser.add_argument("--quick", action="store_true", help="coarse, for a look")
    options = parser.parse_args()
    few, path = options.quick, options.output / "contact_dynamics.json"
    found: dict[str, Any] = {} if options.only is None else json.loads(path.read_text())
    found["machine"] = describe()
    reaches = (0.05, 0.025) if few else (0.05, 0.025, 0.0125, 0.00625)
    waves = [(60, 1.0)] if few else [(100, 0.5), (200, 1.0), (800, 5.0)]
    sizes = (60,) if few else (60, 223)
    parts: dict[str, Any] = {
        "bar": lambda: [bar(*wave, way) for way in ("midpoint", "stabilised") for wave in waves],
        "bars": lambda: bars(50 if few else 100),
        "block": lambda: [block(dt) for dt in (0.01, 0.02, 0.04)],
        "ball": lambda: [ball(reach, 100, 0.2 if few else 0.1) for reach in reaches],
        "fine_ball": lambda: ball(reaches[0], 100, 0.1 if few else 0.05),
        "cost": lambda: [cost(cells, friction, 20) for cells in sizes for friction in (0.0, 0.3)],
    }
    for name in options.only or parts:
        found[name] = parts[name]()
        print(name, json.dumps(found[name], indent=1), flush=True)
    for name in ("duration", "force"):
        off = [abs(one[name] - 1.0) for one in found["ball"]]
        found[f"ball_order_{name}"] = float(np.polyfit(np.log(reaches), np.log(off), 1)[0])
    options.output.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
