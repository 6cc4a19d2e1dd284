"""Flow maps of velocities, their gradients, and finite-time Lyapunov exponents."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.feet import integrate, time_scale
from cip.characteristics.flow_derivatives import System, foot
from cip.errors import InputError
from cip.formulas.snapshots import snapshots_of
from cip.formulas.velocity import Velocity, check_periodic
from cip.grid import Array, Grid, check_grid
from cip.output.plot import plot_map
from skfem_adini.ground.arguments import real_number

CELLS = 32.0  # that the fastest node crosses in a piece of the map; gradients are multiplied


@dataclass(frozen=True, eq=False)
class FlowMap:
    """Where the points of a grid are carried, and how their neighbourhoods are stretched.

    `flow_map` returns it.

    Attributes
    ----------
    grid : Grid
        Its nodes are the points at `t_start`.
    t_start, t_end : float
    positions : ndarray, shape (dim,) + nodes
        Their places at `t_end`, in periodic directions not reduced to the box; of points that left
        the box, where they left it.
    gradient : ndarray, shape (dim, dim) + nodes
        Entry [i, k] is d positions[i] / dx_k; NaN for points that left.
    left : ndarray of bool, shape nodes
        Whether a point left the box through a wall.

    References
    ----------
    S. C. Shadden, F. Lekien and J. E. Marsden, Definition and properties of Lagrangian coherent
    structures from finite-time Lyapunov exponents, Physica D 212 (2005), 271-304.

    Examples
    --------
    A turn neither stretches nor moves the centre:

    >>> from cip import Grid, flow_map
    >>> found = flow_map(lambda x, y: (-y, x), Grid([(-1, 1)] * 2, (8, 8)), 0.0, 0.1)
    >>> float(found.stretch[4, 4].round(9)), float(abs(found.positions[:, 4, 4]).max())
    (1.0, 0.0)
    """

    grid: Grid
    t_start: float
    t_end: float
    positions: Array
    gradient: Array
    left: NDArray[np.bool_]

    def __repr__(self) -> str:
        gone = f", {int(self.left.sum())} points left" if self.left.any() else ""
        return f"FlowMap({self.grid}, t = {self.t_start:.6g} to {self.t_end:.6g}{gone})"

    @property
    def stretch(self) -> Array:
        """The largest singular value of the gradient: by how much the longest axis of a small ball
        grows. Shape nodes."""
        matrices = np.moveaxis(self.gradient, (0, 1), (-2, -1))
        found = np.full(self.grid.nodes, np.nan)
        found[~self.left] = np.linalg.svd(matrices[~self.left], compute_uv=False)[..., 0]
        return found

    @property
    def lyapunov(self) -> Array:
        """Finite-time Lyapunov exponents, `ln(stretch)` over the length of time; shape nodes.
        Ridges repel over the time of a map forward, attract over that of a map backward."""
        exponents: Array = np.log(self.stretch) / abs(self.t_end - self.t_start)
        return exponents

    def plot(self, ax: Any = None) -> Any:
        """Draw the exponents of a map in the plane, the largest 2 % of them in one colour.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError
            A map in one or three dimensions.
        """
        if self.grid.dim != 2:
            raise InputError(f"plot: {self.grid.dim} dimensions; draw `lyapunov` yourself")
        exponents = self.lyapunov
        style = {"shading": "nearest", "cmap": "magma", "vmax": np.nanpercentile(exponents, 98)}
        ax = plot_map(self.grid, exponents, "Lyapunov exponent", ax, **style)
        ax.set_title(f"t = {self.t_start:.4g} to {self.t_end:.4g}")
        return ax


def flow_map(
    velocity: Any, grid: Grid, t_start: float, t_end: float, tolerance: float = 1e-8
) -> FlowMap:
    """Carry the nodes of a grid along a velocity, forward or backward in time.

    Places and gradient follow from the characteristics and their variational equations together,
    by Runge-Kutta steps with an error estimate (`cip.characteristics`); no neighbours are
    subtracted, so the gradient is exact at any resolution of the grid.

    Parameters
    ----------
    velocity : Velocity, or what `Velocity` takes
    grid : Grid
    t_start, t_end : float
        A map backward in time has `t_end` before `t_start`.
    tolerance : float
        Error of the places in cells, and of the gradient relative to its largest entry, in each
        piece of the time in which points cross some 30 cells.

    Returns
    -------
    FlowMap

    Raises
    ------
    InputError
        Equal or infinite times, or times that snapshots of the velocity do not cover.
    NotConverged
        The velocity is not smooth enough for the tolerance.

    References
    ----------
    S. C. Shadden, F. Lekien and J. E. Marsden, Definition and properties of Lagrangian coherent
    structures from finite-time Lyapunov exponents, Physica D 212 (2005), 271-304.

    Examples
    --------
    Near a saddle x grows as exp(t):

    >>> from cip import Grid, flow_map
    >>> saddle = lambda x, y: (x, -y)
    >>> run = flow_map(saddle, Grid([(-10, 10)] * 2, (20, 20)), 0.0, 0.5)
    >>> float(run.lyapunov[10, 10].round(8))
    1.0
    """
    check_grid(grid)
    start, end = real_number("t_start", t_start), real_number("t_end", t_end)
    if not (np.isfinite(start) and np.isfinite(end) and start != end):
        raise InputError(f"t_end: expected finite times that differ, got {start!r} and {end!r}")
    if not 0.0 < real_number("tolerance", tolerance) < 1.0:
        raise InputError(f"tolerance: expected a number of cells in (0, 1), got {tolerance!r}")
    given = velocity if isinstance(velocity, Velocity) else Velocity(velocity)
    formulas = given.on(grid)
    check_periodic(formulas, grid)
    known = snapshots_of(formulas)
    if known is not None:
        known.check_times(min(start, end), max(start, end))
    axes = range(grid.dim)
    pairs = [(i, k) for i in axes for k in axes]
    system = System([c.expression for c in formulas], axes, [foot(*pair) for pair in pairs])
    places = np.stack([x.ravel() for x in grid.mesh()])
    gradient = np.zeros((grid.dim, grid.dim, grid.size))
    gradient[axes, axes] = 1.0
    left = np.zeros(grid.size, bool)
    count = int(np.ceil(abs(end - start) / (CELLS * time_scale(grid, formulas, start))))
    times = np.linspace(start, end, max(count, 1) + 1)
    for t, after in pairwise(times):
        active = np.flatnonzero(~left)
        points = [x[active] for x in places]
        # Paths lead from t_end back by dt: with a negative dt forward.
        found = integrate(grid, formulas, system, points, t, t - after, float(tolerance))
        for axis in axes:
            places[axis, active] += found.jets[foot(axis)]
        piece = np.reshape([found.jets[foot(*pair)] for pair in pairs], (grid.dim, grid.dim, -1))
        gradient[..., active] = np.einsum("ijn,jkn->ikn", piece, gradient[..., active])
        if found.exits is not None:
            gone = active[found.exits.nodes]
            left[gone], gradient[..., gone] = True, np.nan
    shape = (grid.dim, *grid.nodes)
    return FlowMap(
        grid, start, end, places.reshape(shape), gradient.reshape(grid.dim, *shape),
        left.reshape(grid.nodes),
    )  # fmt: skip
