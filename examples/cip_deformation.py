r"""A ball in LeVeque's three-dimensional deformation flow, back at its start after the period 3.

    p_t + div(c p) = 0,  c = cos(pi t / 3) (2 sin^2(pi x) sin(2 pi y) sin(2 pi z), ...),

on the unit cube (LeVeque, SIAM J. Numer. Anal. 33, 1996, section 9). The conservative profiles move
values, line means, face means and cell means by Strang's splitting: the integral is kept to
rounding. Beside them stands the semi-Lagrangian method with tricubic splines, which keeps nothing.
The end should be the start. Errors are relative in L1 and L2, absolute in the maximum norm: of the
cell means (what a conservative scheme keeps; of the splines their exact means) and at the nodes.

With 64 cells a direction the ball is drawn out to sheets of about a cell:

    64^3 cells    steps    cell means: L1, L2, max    nodes: L1, L2, max
    csl4             30     .093   .116   .381         .133   .170   .752
    splines          30     .253   .235   .494         .265   .248   .583
    csl4             60     .107   .128   .396         .147   .178   .667
    splines          60     .288   .255   .503         .300   .268   .533
    csl4            120     .111   .132   .407         .150   .176   .591
    splines         120     -      -      -            .312   .271   .483

    cosine bell of the same radius, (1 + cos(pi r / .15)) / 2:
    csl4             60     .326   .299   .640         .444   .373   .718
    splines          60     .681   .489   .752         .708   .503   .771

    sharp ball, 1 inside, 0 outside:
    csl4             60     .257   .207   .505         .386   .300   .704
    splines          60     .500   .362   .754         .606   .414   .732

Whatever the step, the means of csl4 are nearer in all three norms, its nodal values in L1 and L2;
in the maximum norm those of bell and sharp ball are, those of the smoothed ball are not.

    python examples/cip_deformation.py --cells 32 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from cip import Grid, Solver, Trajectory, Velocity

FLOW = (
    "2*sin(pi*x1)**2*sin(2*pi*x2)*sin(2*pi*x3)*cos(pi*t/3)",
    "-sin(2*pi*x1)*sin(pi*x2)**2*sin(2*pi*x3)*cos(pi*t/3)",
    "-sin(2*pi*x1)*sin(2*pi*x2)*sin(pi*x3)**2*cos(pi*t/3)",
)
Norms = tuple[float, float, float]


def ball(x: Any, y: Any, z: Any) -> Any:
    """Return a ball of radius .15 at (.35, .35, .35) with a smooth edge."""
    radius = np.sqrt((x - 0.35) ** 2 + (y - 0.35) ** 2 + (z - 0.35) ** 2)
    return (1 - np.tanh((radius - 0.15) / 0.03)) / 2


def simulate(cells: int, steps: int, profile: str, limiter: str | None = None) -> Trajectory:
    """Run to t = 3 by the splitting."""
    grid = Grid((0, 1), (cells,) * 3, periodic=True)
    velocity = Velocity.from_expression(*FLOW)
    solver = Solver(grid, velocity, "advection", profile, limiter, splitting="strang")
    run: Trajectory = solver.run(solver.state(ball), 3.0, dt=3 / steps, snapshots=4)
    return run


def speed(q: np.ndarray, t: float) -> np.ndarray:
    """Return the velocity at points of shape (3, ...)."""
    once, twice = np.sin(np.pi * q), np.sin(2 * np.pi * q)
    c = np.stack([2 * once[0] ** 2 * twice[1] * twice[2], -twice[0] * once[1] ** 2 * twice[2],
                  -twice[0] * twice[1] * once[2] ** 2])  # fmt: skip
    return np.cos(np.pi * t / 3) * c


def splines(cells: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return start and end of the semi-Lagrangian method with tricubic splines: nodal values."""
    line = np.arange(cells) / cells
    nodes = np.stack(np.meshgrid(line, line, line, indexing="ij"))
    u = start = ball(*nodes)
    inner = max(2, int(np.ceil(150 / steps)))  # Runge-Kutta steps of at most .02
    h = 3 / steps / inner
    for k in range(steps):
        foot, t = nodes, 3 * (k + 1) / steps
        for _ in range(inner):
            a = speed(foot, t)
            b = speed(foot - h / 2 * a, t - h / 2)
            c = speed(foot - h / 2 * b, t - h / 2)
            d = speed(foot - h * c, t - h)
            foot, t = foot - h / 6 * (a + 2 * b + 2 * c + d), t - h
        u = ndimage.map_coordinates(u, foot * cells, order=3, mode="grid-wrap")
    return start, u


def means(u: np.ndarray) -> np.ndarray:
    """Return the exact cell means of the interpolating periodic tricubic spline."""
    u = ndimage.spline_filter(u, order=3, mode="grid-wrap")
    for axis in range(3):
        weights = zip((1, 0, -1, -2), (1 / 24, 11 / 24, 11 / 24, 1 / 24), strict=True)
        u = sum(weight * np.roll(u, shift, axis) for shift, weight in weights)
    return u


def norms(end: np.ndarray, start: np.ndarray) -> Norms:
    """Return the relative error in L1 and in L2, and the largest one."""
    e = np.abs(end - start)
    return (
        float(e.sum() / np.abs(start).sum()),
        float(np.linalg.norm(e) / np.linalg.norm(start)),
        float(e.max()),
    )


def picture(run: Trajectory, u: np.ndarray, output: Path) -> None:
    """Draw the field from above, half way and at the end, beside the start and the splines."""
    from matplotlib.figure import Figure

    middle = len(run) // 2
    fields = {
        "start": run[0]["u"],
        f"csl4, t = {run.times[middle]:g}": run[middle]["u"],
        f"csl4, t = {run.times[-1]:g}": run.final["u"],
        f"splines, t = {run.times[-1]:g}": u,
    }
    figure = Figure(figsize=(11, 3.2), layout="constrained")
    axes = figure.subplots(1, len(fields), sharey=True)
    for ax, (title, field) in zip(axes, fields.items(), strict=True):
        # The largest value along x3, as the ball leaves any plane on its way.
        image = ax.imshow(
            field.max(axis=2).T, origin="lower", extent=(0, 1, 0, 1), vmin=0, vmax=1, cmap="viridis"
        )
        ax.set(title=title, xlabel="$x_1$", xticks=[0, 0.5, 1])
    axes[0].set_ylabel("$x_2$")
    label = "largest p along $x_3$,\narbitrary units"
    figure.colorbar(image, ax=axes, label=label, shrink=0.8, extend="both")
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "cip_deformation.png", dpi=120)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print errors and mass, write the series and a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=24)
    parser.add_argument("--steps", type=int, default=16)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the files")
    options = parser.parse_args(argv)
    found: dict[str, Any] = {}
    print(f"{options.cells}^3 cells, {options.steps} steps")
    print(
        "                cell means: L1     L2    max   nodes: L1     L2    max      mass   least"
    )
    for profile, limiter in (("csl2", "bounds"), ("csl4", None)):
        run = simulate(options.cells, options.steps, profile, limiter)
        start, end = run[0], run.final
        name = f"{profile} {limiter or ''}".strip()
        found[name] = {
            "means": norms(end["mean"], start["mean"]),
            "nodes": norms(end["u"], start["u"]),
            "mass": end.mass / start.mass - 1,
            "least": float(end["u"].min()),
        }
        if profile == "csl4":
            written = run.save(options.output / "cip_deformation.pvd")
    begin, u = splines(options.cells, options.steps)
    found["splines"] = {
        "means": norms(means(u), means(begin)),
        "nodes": norms(u, begin),
        "mass": float(u.sum() / begin.sum() - 1),
        "least": float(u.min()),
    }
    for name, row in found.items():
        errors = "".join(f"{e:7.3f}" for e in row["means"])
        nodal = "".join(f"{e:7.3f}" for e in row["nodes"])
        print(f"{name:23s}{errors}   {nodal} {row['mass']:9.1e} {row['least']:7.3f}")
    picture(run, u, options.output)
    print(f"written: {written[0].name} and {len(written) - 1} snapshots in {options.output}")
    return found


if __name__ == "__main__":
    main()
