"""Pictures and animations of states; matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.output.sample import sample
from cip.stages.state import State

# Curves are drawn with so many points in each cell, since the profile is curved inside cells.
_PER_CELL = 4


def plot_states(
    states: Sequence[State], ax: Any = None, places: Sequence[int] | None = None
) -> Any:
    """Draw snapshots on one grid by their profiles: curves in one dimension, in two a colour map of
    the last of `places`, which are indices of states (default all). Returns the Axes.
    """
    grid = states[0].grid
    if grid.dim == 3:
        raise InputError("plot: three dimensions; use to_pyvista() or save('run.pvd')")
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    if grid.dim == 2:
        place = -1 if places is None else places[-1]
        state = states[place]
        image = ax.pcolormesh(*grid.coordinates, state["u"].T, shading="nearest", cmap="viridis")
        ax.figure.colorbar(image, ax=ax, label="u")
        ax.set(xlabel="x", ylabel="y", title=f"t = {state.t:.4g}", aspect="equal")
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
    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    values = [state["u"] for state in states]
    low, high = float(min(map(np.min, values))), float(max(map(np.max, values)))
    if grid.dim == 1:
        x = _fine(grid.bounds[0], grid.cells[0])
        (line,) = ax.plot(x, sample(states[0], x))
        # A margin of a twentieth of the range; 1e-300 keeps it positive for a constant field.
        room = 0.05 * max(high - low, 1e-300)
        ax.set(xlabel="x", ylabel="u", ylim=(low - room, high + room))
    else:
        image = ax.pcolormesh(
            *grid.coordinates, values[0].T, shading="nearest", vmin=low, vmax=high
        )
        figure.colorbar(image, ax=ax, label="u")
        ax.set(xlabel="x", ylabel="y", aspect="equal")

    def draw(place: int) -> tuple[Any, ...]:
        ax.set_title(f"t = {states[place].t:.4g}")
        if grid.dim == 1:
            line.set_ydata(sample(states[place], x))
            return (line,)
        image.set_array(values[place].T)
        return (image,)

    animation = FuncAnimation(figure, draw, frames=len(states), interval=1000 / fps, blit=False)
    if path is not None:
        animation.save(str(path), writer="pillow", fps=fps)
        plt.close(figure)
    return animation


def _fine(bounds: tuple[float, float], cells: int) -> NDArray[np.float64]:
    return np.linspace(*bounds, _PER_CELL * cells + 1)
