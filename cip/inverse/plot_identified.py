"""Pictures of identified velocities."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import NotSupported


def plot_identified(found: Any, ax: Any = None) -> Any:
    """Draw an `IdentifiedVelocity` with two standard deviations, in one or two dimensions."""
    grid = found.grid
    if grid.dim == 3:
        raise NotSupported("plot: velocities in three dimensions are not drawn; draw found.values")
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure(layout="constrained").add_subplot()
    c, spread = found.values, 2.0 * found.value_deviations
    if grid.dim == 1:
        x = grid.coordinates[0]
        ax.fill_between(x, c[0] - spread[0], c[0] + spread[0], alpha=0.3, label="2 deviations")
        ax.plot(x, c[0], label="identified")
        ax.set(xlabel="x", ylabel="velocity c")
        ax.legend()
        return ax
    speed = np.hypot(*c)
    image = ax.pcolormesh(*grid.coordinates, speed.T, shading="gouraud")
    ax.figure.colorbar(image, ax=ax, label="speed")
    every = tuple(slice(None, None, max(1, n // 16)) for n in grid.nodes)
    x, y = grid.mesh()
    ax.quiver(x[every], y[every], c[0][every], c[1][every], color="white")
    ax.set(xlabel="x", ylabel="y", aspect="equal")
    return ax
