"""A jet of a tracer meets an island: p_t + div(c p) = 0 in a channel, open to west and east."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from cip import Grid, Solver


def current(x, y):
    """Flow of the stream function (y - 1) (1 - B); B falls from 1 at r = .3 to 0 at r = .8."""
    dx, dy = x - 1.3, y - 1
    r = np.sqrt(dx**2 + dy**2 + 1e-4)
    s = (np.abs((0.8 - r) / 0.5) - np.abs((0.3 - r) / 0.5) + 1) / 2
    slope = -60 * s**2 * (1 - s) ** 2 / r
    return 1 - s**3 * (10 - 15 * s + 6 * s**2) - dy**2 * slope, dx * dy * slope


def main(arguments=None):
    """Run the example, print and return the budget."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"))
    (output := parser.parse_args(arguments).output).mkdir(parents=True, exist_ok=True)
    grid = Grid([(0, 3), (0, 2)], (60, 40))
    land = np.hypot.outer(grid.edges[0][1:] - 1.325, grid.edges[1][1:] - 1.025) < 0.29
    jet = {"x-": "exp(-30*(x2 - 1 - 0.2*sin(4*t))**2)", "y-": "closed", "y+": "closed"}
    solver = Solver(grid, current, "advection", "csl4", "bounds", "strang", jet, land=land)
    run = solver.run(solver.state(0.0), 4.0, dt=0.025, snapshots=8)
    print(run.budget, f"unaccounted {np.abs(run.budget.residual).max():.0e}")
    plt.figure(figsize=(7.5, 4.2), layout="constrained").gca().set(facecolor="tan", aspect="equal")
    plt.pcolormesh(*grid.edges, np.where(land, np.nan, run.final["mean"]).T)
    plt.colorbar(label="mean of each cell at t = 4")
    plt.savefig(output / "cip_regional.png", dpi=120)
    return run.budget


if __name__ == "__main__":
    main()
