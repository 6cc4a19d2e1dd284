"""A disk in a vortex that draws it out to a spiral and winds it back (LeVeque, SIAM J. Numer. Anal.
33, 1996; Rider and Kothe, J. Comput. Phys. 141, 1998).

The disk is where a level set function is negative, carried with its gradient. The table says how
much the area changes and how far the contour ends from the circle, in cells.

    python examples/cip_level_set.py --cells 64 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cip import Grid, Solver, State, Trajectory, Velocity, area, contour

CENTRE, RADIUS = (0.5, 0.75), 0.15


def vortex(period: float) -> Velocity:
    """Return a vortex in the unit square that turns back after half a period."""
    wave = f"cos(pi*t/{period})"
    return Velocity.from_expression(
        f"-2*sin(pi*x1)**2*sin(pi*x2)*cos(pi*x2)*{wave}",
        f"2*sin(pi*x2)**2*sin(pi*x1)*cos(pi*x1)*{wave}",
    )


def misfit(state: State) -> float:
    """Return the largest distance of the contour from the circle, in cells."""
    points = np.concatenate(contour(state))
    away = np.hypot(*(points - CENTRE).T) - RADIUS
    return float(np.abs(away).max() / state.grid.spacing[0])


def main(argv: list[str] | None = None) -> dict[str, float]:
    """Print the table, draw the spiral and the disk that comes back, return the losses."""
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=64)
    parser.add_argument("--period", type=float, default=4.0)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    grid = Grid([(0, 1)] * 2, (options.cells,) * 2)
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 3.4), layout="constrained", sharey=True)
    losses = {}
    for ax, profile in zip(axes, ("bicubic", "adini"), strict=True):
        solver = Solver(grid, vortex(options.period), profile=profile)
        start = solver.state(f"sqrt((x1 - 0.5)**2 + (x2 - 0.75)**2 + 1e-12) - {RADIUS}")
        run = solver.run(start, options.period, cfl=2.0, snapshots=2)
        losses[profile] = 1.0 - area(run.final) / area(start)
        print(
            f"{profile:8s} area changed by {-100 * losses[profile]:+.2f} %, contour off by "
            f"{misfit(run.final):.2f} cells"
        )
        draw(ax, run)
        ax.set(title=profile, aspect="equal", xlim=(0, 1), ylim=(0, 1), xlabel="x")
    axes[0].set_ylabel("y")
    axes[0].legend(frameon=False, fontsize=8, loc="lower left")
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "cip_level_set.png", dpi=160)
    return losses


def draw(ax: object, run: Trajectory) -> None:
    """Draw the contours of all snapshots."""
    for state, style in zip(run.states, ("k--", "C0", "C3"), strict=True):
        for number, line in enumerate(contour(state)):
            label = f"t = {state.t:g}" if number == 0 else None
            ax.plot(*line.T, style, lw=1.2, label=label)  # type: ignore[attr-defined]


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
