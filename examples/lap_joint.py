"""A bolted lap joint in three dimensions: two plates and a bolt, friction on all faces.

Two square plates with a hole lie on each other, clamped by a bolt whose shank is too short by an
amount that presses its heads onto them. One plate is held, the other pulled. Friction between the
plates carries the pull: at first all of the clamped annulus sticks, then slip grows inwards from
its rim, until F times the clamping force is reached. What the pull rises by after that goes through
the heads and the shank, which bends; it does not touch the hole. Clamping squeezes the plates
sideways against their supports, so the pull starts below zero.

Half of the joint is computed; y = 0 is a plane of symmetry. The meshes of the plates and of the
bolt do not match. Lengths are in mm, stresses in MPa.

    python examples/lap_joint.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from skfem import ElementHex1, MeshHex

from contact import ContactProblem, ElasticBody, LoadHistory, LoadStepper, Pair, Status

E, NU = 210e3, 0.3
HOLE, WIDTH, THICK = 5.0, 24.0, 6.0  # radius of the hole, half-width and thickness of a plate
BORE, SHANK, HEAD, HIGH = 1.5, 4.5, 9.0, 4.0  # radii of the bolt, height of its heads
SHORT = 0.012  # by this the shank is too short
FRICTION = 0.2


def plate(cells: int, low: float, turn: float) -> ElasticBody:
    """Half a square plate with a hole, from z = low; `turn` shifts its meridians."""
    t = np.linspace(0, 1, 3 * cells + 1)
    mesh = MeshHex.init_tensor(
        np.linspace(0, 1, 2 * cells + 1) ** 1.3,
        np.pi * (t + turn * np.sin(2 * np.pi * t) / (2 * np.pi)),
        low + THICK * np.linspace(0, 1, 3),
    )
    s, angle, z = mesh.p
    ray = np.array([-np.cos(angle), np.sin(angle)])  # from left to right over the top
    rim = WIDTH * ray / np.abs(ray).max(axis=0)
    x, y = (1 - s) * HOLE * ray + s * rim
    names = {
        "left": lambda x: x[0] < -WIDTH * (1 - 1e-9),
        "right": lambda x: x[0] > WIDTH * (1 - 1e-9),
        "symmetry": lambda x: x[1] < 1e-9 * WIDTH,
        "bottom": lambda x: x[2] < low + 1e-9 * THICK,
        "top": lambda x: x[2] > low + THICK * (1 - 1e-9),
    }
    mesh = MeshHex(np.array([x, y, z]), mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, ElementHex1(), E=E, nu=NU).fix("symmetry", "y")


def bolt(cells: int) -> ElasticBody:
    """Half a hollow bolt with two heads."""
    mesh = MeshHex.init_tensor(
        np.array([BORE, 3.0, SHANK, 5.5, 7.0, HEAD]),
        np.linspace(0, np.pi, 2 * cells + 2),
        np.concatenate(
            (
                np.linspace(-THICK - HIGH, -THICK, 3)[:-1],
                np.linspace(-THICK, THICK, 5),
                np.linspace(THICK, THICK + HIGH, 3)[1:],
            )
        ),
    )
    r, _, z = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.remove_elements(np.flatnonzero((r > SHANK) & (np.abs(z) < THICK)))
    r, angle, z = mesh.p
    outside = SHANK + 1e-9 * SHANK
    names = {
        "symmetry": lambda x: x[1] < 1e-9 * HEAD,
        "upper head": lambda x: (np.abs(x[2] - THICK) < 1e-9) & (np.hypot(x[0], x[1]) > outside),
        "lower head": lambda x: (np.abs(x[2] + THICK) < 1e-9) & (np.hypot(x[0], x[1]) > outside),
    }
    p = np.array([-r * np.cos(angle), r * np.sin(angle), z])
    mesh = MeshHex(p, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, ElementHex1(), E=E, nu=NU).fix("symmetry", "y")


def joint(cells: int) -> tuple[ContactProblem, dict[str, ElasticBody]]:
    """The three bodies and their pairs."""
    upper, lower = plate(cells, 0.0, 0.0).named("upper"), plate(cells + 1, -THICK, 0.2)
    screw = bolt(cells).named("bolt")
    lower.named("lower").fix("left", "xyz")
    upper.fix("right", "xz")
    pairs = [
        Pair(upper, "bottom", lower, "top", friction=FRICTION),
        Pair(screw, "upper head", upper, "top", friction=FRICTION, clearance=-SHORT),
        Pair(screw, "lower head", lower, "bottom", friction=FRICTION, clearance=-SHORT),
    ]
    bodies = {"upper": upper, "lower": lower, "bolt": screw}
    return ContactProblem([upper, lower, screw], pairs), bodies


def pulled(cells: int, steps: int, travel: float) -> tuple[LoadHistory, dict[str, ElasticBody]]:
    """Clamped first, then pulled by the right side of the upper plate."""
    problem, bodies = joint(cells)
    stepper = LoadStepper(problem)
    stepper.move("right", "x", travel, lambda t: max(t - 1.0, 0.0), body=bodies["upper"])
    return stepper.run(np.r_[1.0, 1.0 + np.linspace(0, 1, steps + 1)[1:]]), bodies


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Clamp, pull, print the certificate, draw pressure, slip and the force over the travel."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=5)
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--travel", type=float, default=0.012, help="of the pulled side, mm")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    history, bodies = pulled(options.cells, options.steps, options.travel)
    clamp = [float(result.mu[result.part == 1].sum()) for result in history.results]
    # Twice the half: forces along x between the plates, and from the bolt on the lower plate.
    plates = np.array([-2 * result.resultants[0, 0] for result in history.results])
    shank = np.array([-2 * result.resultants[2, 0] for result in history.results])
    last = history.results[-1]
    print(last.certificate())
    print(f"\nclamping force {2 * clamp[0] / 1e3:.1f} kN, at the end {2 * clamp[-1] / 1e3:.1f} kN")
    print(f"pull at the end {(plates + shank)[-1] / 1e3:.2f} kN")
    picture(history, (plates, shank), clamp, options.travel, options.output)
    found = {"history": history, "plates": plates, "shank": shank, "clamp": clamp}
    return SimpleNamespace(**found, bodies=bodies)


def picture(
    history: LoadHistory,
    shares: tuple[np.ndarray, np.ndarray],
    clamp: list[float],
    travel: float,
    output: Path,
) -> None:
    """Pressure between the plates, where they slip, and the force over the travel."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    figure = Figure(figsize=(12, 4), layout="constrained")
    pressure, state, force = figure.subplots(1, 3)
    counts = [np.bincount(r.status[r.part == 0], minlength=3) for r in history.results]
    mixed = history.results[int(np.argmax([min(n[1:3]) for n in counts]))]
    own = mixed.part == 0
    x, p, status = mixed.x_nominal[:, own], mixed.pressure[own], mixed.status[own]
    x = np.hstack((x, x * np.array([[1.0], [-1.0], [1.0]])))
    levels = np.linspace(0, p.max(), 11)
    drawn = pressure.tricontourf(x[0], x[1], np.r_[p, p], levels[1:], cmap="viridis")
    figure.colorbar(drawn, ax=pressure, label="pressure, MPa", shrink=0.85)
    kinds = ((Status.STICK, "#1f6f8b", "stick"), (Status.SLIP, "#d1495b", "slip"))
    for value, colour, name in kinds:
        at = np.r_[status, status] == value
        state.plot(*x[:2, at], "o", color=colour, ms=4, label=name)
    for ax, title in ((pressure, "between the plates"), (state, "stick and slip there")):
        ax.add_patch(Circle((0, 0), HOLE, fc="white", ec="0.3"))
        ax.add_patch(Circle((0, 0), HEAD, fc="none", ec="0.3", ls="--"))
        ax.set(aspect="equal", xlim=(-12, 12), ylim=(-12, 12), xlabel="x, mm", title=title)
    state.legend(loc="upper right")
    way = 1e3 * travel * np.maximum(history.times - 1.0, 0.0)
    plates, shank = (part / 1e3 for part in shares)
    force.plot(way, plates + shank, "ko-", ms=4, label="pull")
    force.plot(way, plates, "s-", ms=4, color="#1f6f8b", label="between the plates")
    force.plot(way, shank, "d-", ms=4, color="#d1495b", label="through the bolt")
    limit = 2 * FRICTION * np.array(clamp) / 1e3
    force.plot(way, limit, "k--", lw=1, label="F times the clamping force")
    force.set(xlabel="travel of the pulled side, micrometres", ylabel="force, kN")
    force.legend(fontsize=8)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "lap_joint.png", dpi=120)


if __name__ == "__main__":
    main()
