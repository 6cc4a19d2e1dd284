"""Data for identifications by another method than the schemes: exact starts at DOP853's feet."""

import numpy as np
from scipy.integrate import solve_ivp

from cip import Grid

FIELD = "sin(2*pi*x1) + 0.5*cos(6*pi*x1)"


def field(x):
    """The start of which `FIELD` is the text."""
    return np.sin(2 * np.pi * x) + 0.5 * np.cos(6 * np.pi * x)


def waves(x):
    """A speed with three waves, the test case of the table of errors."""
    return (
        1 + 0.35 * np.sin(2 * np.pi * x) + 0.2 * np.cos(4 * np.pi * x) + 0.1 * np.sin(6 * np.pi * x)
    )


def feet(c, times, *points):
    """Where the characteristics through points at each time began; shape (times, dim, points)."""
    points = np.stack([np.ravel(x) for x in points])

    def back(_, y):
        return -np.ravel(c(*y.reshape(points.shape)))

    run = solve_ivp(
        back, (0, max(times)), points.ravel(), method="DOP853", rtol=1e-11, atol=1e-12,
        t_eval=sorted(times),
    )  # fmt: skip
    return run.y.T.reshape(len(times), *points.shape)


def snapshots(c, times, grid: Grid, noise=0.0, seed=0, u=field):
    """Fields carried by a steady velocity, at the nodes, with noise."""
    rng = np.random.default_rng(seed)
    found = {}
    for t, at in zip(sorted(times), feet(c, times, *grid.mesh()), strict=True):
        found[t] = u(*at).reshape(grid.nodes) + noise * rng.standard_normal(grid.nodes)
    return found
