"""Pictures and animations of states and velocities; matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError, MissingDependency, NotSupported
from cip.grid import Grid, Sphere
from cip.output.sample import sample
from cip.stages.state import State, values_of
from cip.stages.state_dataset import dated

SECONDS = 5.0  # of an animation
NUMBERS = dated(None)


def plot_states(
    states: Sequence[State],
    ax: Any = None,
    places: Sequence[int] | None = None,
    label: str = "u",
    when: Callable[[float], str] = NUMBERS,
) -> Any:
    """Draw snapshots on one grid by their profiles: curves in one dimension, in two a colour map of
    the last of `places`, which are indices of states (default all), a panel for each field. Returns
    the Axes.
    """
    grid, fields = states[0].grid, states[0].fields
    if grid.dim == 3:
        raise InputError("plot: three dimensions; use to_pyvista() or save('run.pvd')")
    if fields:
        axes = _panels(len(fields), grid) if ax is None else np.atleast_1d(ax)
        if len(axes) != len(fields):
            raise InputError(f"ax: expected one for each of {len(fields)} fields, got {len(axes)}")
        for name, one in zip(fields, axes, strict=True):
            plot_states([state.field(name) for state in states], one, places, name, when)
            one.set_title(f"{name}, {one.get_title()}" if grid.dim == 2 else name)
        return list(axes)
    ax = _axes(ax, figsize=(6, 4))
    if grid.dim == 2:
        state = states[-1 if places is None else places[-1]]
        _map(ax, grid, values_of(state), label, shading="nearest", cmap="viridis")
        ax.set_title(when(state.t))
        return ax
    x = _fine(grid.bounds[0], grid.cells[0])
    for place in range(len(states)) if places is None else places:
        state = states[place]
        ax.plot(x, sample(states[place], x), lw=1.2, label=when(state.t))
    ax.set(xlabel="x", ylabel=label)
    _few_digits(ax, "x")
    ax.legend(frameon=False, fontsize=8)
    return ax


def animate_states(
    states: Sequence[State],
    path: str | Path | None = None,
    fps: float | None = None,
    when: Callable[[float], str] = NUMBERS,
) -> Any:
    """A matplotlib animation of snapshots in one or two dimensions, a panel for each field, written
    to `path` (.gif, or .mp4 by ffmpeg)."""
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, writers

    if states[0].grid.dim == 3:
        raise InputError("animate: three dimensions; use save('run.pvd') and ParaView")
    suffix = ".gif" if path is None else Path(path).suffix
    if suffix not in (".gif", ".mp4"):
        raise InputError(f"path: expected a name that ends in .gif or .mp4, got {str(path)!r}")
    if suffix == ".mp4" and not writers.is_available("ffmpeg"):
        raise MissingDependency(
            "path: .mp4 needs ffmpeg (apt install ffmpeg); take .gif without it"
        )
    if fps is None:
        fps = min(20.0, max(1.0, len(states) / SECONDS))
    fields = states[0].fields
    axes = _panels(len(fields), states[0].grid) if fields else [_axes(None, figsize=(6, 4))]
    parts = [[state.field(name) for state in states] for name in fields] or [list(states)]
    labels = fields or ("u",)
    drawn = [_moving(*one) for one in zip(axes, parts, labels, strict=True)]
    names = [f"{name}, " for name in fields] or [""]

    def draw(place: int) -> list[Any]:
        for ax, name in zip(axes, names, strict=True):
            ax.set_title(name + when(states[place].t))
        return [show(place) for show in drawn]

    figure = axes[0].figure
    draw(0)
    figure.draw_without_rendering()
    figure.set_layout_engine(
        "none"
    )  # the places of the axes stay: finding them takes half the time
    animation = FuncAnimation(figure, draw, frames=len(states), interval=1000 / fps, blit=False)
    if path is not None:
        writer: Any = {"writer": "pillow" if suffix == ".gif" else "ffmpeg", "fps": fps}
        animation.save(str(path), **writer)
        plt.close(figure)
    return animation


def _moving(ax: Any, states: Sequence[State], label: str) -> Callable[[int], Any]:
    """Draw the first of some states of one field; the function that shows another one."""
    grid, values = states[0].grid, [values_of(state) for state in states]
    low, high = float(min(map(np.min, values))), float(max(map(np.max, values)))
    if grid.dim == 2:
        image = _map(ax, grid, values[0], label, shading="nearest", vmin=low, vmax=high)
        return lambda place: image.set_array(values[place].T) or image
    x = _fine(grid.bounds[0], grid.cells[0])
    (line,) = ax.plot(x, sample(states[0], x))
    # A margin of a twentieth of the range; 1e-300 keeps it positive for a constant field.
    room = 0.05 * max(high - low, 1e-300)
    ax.set(xlabel="x", ylabel=label, ylim=(low - room, high + room))
    _few_digits(ax, "x")
    return lambda place: line.set_ydata(sample(states[place], x)) or line


def _panels(count: int, grid: Grid | Sphere) -> list[Any]:
    """Axes of a new figure, at most three in a row, of the shape of the grid."""
    import matplotlib.pyplot as plt

    columns, sides = min(count, 3), [high - low for low, high in grid.bounds]
    rows, shape = -(-count // columns), 0.8 if grid.dim == 1 else sides[1] / sides[0]
    size = (4.2 * columns, (3.2 * min(max(shape, 0.3), 2.0) + 0.8) * rows)
    axes = plt.subplots(rows, columns, layout="constrained", figsize=size, squeeze=False)[1]
    for spare in axes.ravel()[count:]:
        spare.remove()
    return list(axes.ravel()[:count])


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


def _map(
    ax: Any, grid: Grid | Sphere, values: NDArray[np.float64], label: str, **style: Any
) -> Any:
    """Nodal values in the plane, or of a sphere in degrees, as colours, with a bar."""
    globe = isinstance(grid, Sphere)
    lines = map(np.degrees, grid.coordinates) if globe else grid.coordinates
    image = ax.pcolormesh(*lines, values.T, **style)
    bar = ax.inset_axes([1.04, 0.0, 0.05, 1.0])  # as high as the map, whatever its shape
    ax.figure.colorbar(image, cax=bar, label=label)
    names = ("longitude", "latitude") if globe else ("x", "y")
    ax.set(xlabel=names[0], ylabel=names[1], aspect="equal")
    _few_digits(ax, "both")
    return image


def _few_digits(ax: Any, axis: str) -> None:
    """Metres of a continent as 2, 4, 6 beside a power of ten: whole numbers would overlap."""
    with suppress(AttributeError, TypeError):  # axes of the caller may have formats of their own
        ax.ticklabel_format(axis=axis, scilimits=(-3, 4), useMathText=True)
        ax.locator_params(axis=axis, nbins=5)


def _fine(bounds: tuple[float, float], cells: int) -> NDArray[np.float64]:
    return np.linspace(*bounds, 4 * cells + 1)  # the profile is curved inside cells
