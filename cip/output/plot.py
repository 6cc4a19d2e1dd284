"""Pictures and animations of states and velocities; matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError, NotSupported
from cip.grid import Grid
from cip.output.sample import sample
from cip.stages.state import State


def plot_states(
    states: Sequence[State], ax: Any = None, places: Sequence[int] | None = None
) -> Any:
    """Draw snapshots on one grid by their profiles: curves in one dimension, in two a colour map of
    the last of `places`, which are indices of states (default all). Returns the Axes.
    """
    grid = states[0].grid
    if grid.dim == 3:
        raise InputError("plot: three dimensions; use to_pyvista() or save('run.pvd')")
    ax = _axes(ax, figsize=(6, 4))
    if grid.dim == 2:
        state = states[-1 if places is None else places[-1]]
        _map(ax, grid, state["u"], "u", shading="nearest", cmap="viridis")
        ax.set_title(f"t = {state.t:.4g}")
        return ax
    x = _fine(grid.bounds[0], grid.cells[0])
    for place in range(len(states)) if places is None else places:
        state = states[place]
        ax.plot(x, sample(states[place], x), lw=1.2, label=f"t = {state.t:.4g}")
    ax.set(xlabel="x", ylabel="u")
    ax.legend(frameon=False, fontsize=8)
    return ax


def animate_states(states: Sequence[State], path: str | Path | None = None, fps: int = 20) -> Any:
    """A matplotlib animation of snapshots in one or two dimensions, written to `path` (.gif)."""
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    grid = states[0].grid
    if grid.dim == 3:
        raise InputError("animate: three dimensions; use save('run.pvd') and ParaView")
    if path is not None and Path(path).suffix != ".gif":
        raise InputError(f"path: expected a name that ends in .gif, got {str(path)!r}")
    ax = _axes(None, figsize=(6, 4))
    values = [state["u"] for state in states]
    low, high = float(min(map(np.min, values))), float(max(map(np.max, values)))
    if grid.dim == 1:
        x = _fine(grid.bounds[0], grid.cells[0])
        (line,) = ax.plot(x, sample(states[0], x))
        # A margin of a twentieth of the range; 1e-300 keeps it positive for a constant field.
        room = 0.05 * max(high - low, 1e-300)
        ax.set(xlabel="x", ylabel="u", ylim=(low - room, high + room))
    else:
        image = _map(ax, grid, values[0], "u", shading="nearest", vmin=low, vmax=high)

    def draw(place: int) -> tuple[Any, ...]:
        ax.set_title(f"t = {states[place].t:.4g}")
        if grid.dim == 1:
            line.set_ydata(sample(states[place], x))
            return (line,)
        image.set_array(values[place].T)
        return (image,)

    animation = FuncAnimation(ax.figure, draw, frames=len(states), interval=1000 / fps, blit=False)
    if path is not None:
        animation.save(str(path), writer="pillow", fps=fps)
        plt.close(ax.figure)
    return animation


def plot_identified(found: Any, ax: Any = None) -> Any:
    """Draw an `IdentifiedVelocity` with two standard deviations, in one or two dimensions."""
    grid = found.grid
    if grid.dim == 3:
        raise NotSupported("plot: velocities in three dimensions are not drawn; draw found.values")
    ax = _axes(ax)
    c, spread = found.values, 2.0 * found.value_deviations
    if grid.dim == 1:
        x = grid.coordinates[0]
        ax.fill_between(x, c[0] - spread[0], c[0] + spread[0], alpha=0.3, label="2 deviations")
        ax.plot(x, c[0], label="identified")
        ax.set(xlabel="x", ylabel="velocity c")
        ax.legend()
        return ax
    speed = np.hypot(*c)
    _map(ax, grid, speed, "speed", shading="gouraud")
    every = tuple(slice(None, None, max(1, n // 16)) for n in grid.nodes)
    x, y = grid.mesh()
    ax.quiver(x[every], y[every], c[0][every], c[1][every], color="white")
    return ax


def plot_map(grid: Grid, values: NDArray[np.float64], label: str, ax: Any, **style: Any) -> Any:
    """Draw nodal values in the plane as colours; returns the Axes."""
    ax = _axes(ax, figsize=(6, 4))
    _map(ax, grid, values, label, **style)
    return ax


def _axes(ax: Any, **figure: Any) -> Any:
    """The axes given, or those of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained", **figure)[1]


def _map(ax: Any, grid: Grid, values: NDArray[np.float64], label: str, **style: Any) -> Any:
    """Nodal values in the plane as colours, with a bar."""
    image = ax.pcolormesh(*grid.coordinates, values.T, **style)
    ax.figure.colorbar(image, ax=ax, label=label)
    ax.set(xlabel="x", ylabel="y", aspect="equal")
    return image


def _fine(bounds: tuple[float, float], cells: int) -> NDArray[np.float64]:
    return np.linspace(*bounds, 4 * cells + 1)  # the profile is curved inside cells
