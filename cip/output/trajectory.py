"""Results of a run: snapshots, diagnostics, samples, and export to other tools."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cip.errors import InputError, NotSupported
from cip.output.budget import Budget
from cip.output.sample import sample, sample_sea
from cip.output.state_dataset import state_dataset
from cip.profiles.catalogue import moments
from cip.stages.state import State
from skfem_adini.ground.vtk_files import write_series

Array = NDArray[np.float64]


class Scheme(Protocol):
    """The attributes of a solver that a trajectory reads."""

    form: Any
    land: Any


@dataclass(frozen=True)
class Diagnostics:
    r"""Sums over the grid at every snapshot, with the weight w of each node (`Grid.weights`).

    `minimum` and `maximum` have the unit of the field, `mass` and `l1` this times length^dim, `l2`
    this times length^(dim/2), `total_variation` this times length^(dim-1).

    Attributes
    ----------
    t, mass, total_variation, minimum, maximum, l1, l2 : ndarray
        One entry for each snapshot. `mass` is `State.mass`; `l1` is ``sum w |u|``, `l2` is
        sqrt(sum w u^2); the total variation is the sum of ``|u_{i+1} - u_i|`` over all grid lines,
        weighted with the widths of the other directions.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> solver = Solver(Grid((0, 1), 20, periodic=True), 1.0, form="advection", profile="csl2")
    >>> run = solver.run(solver.state(lambda x: 1 + np.sin(2 * np.pi * x)), 0.5, dt=0.05)
    >>> bool(np.ptp(run.diagnostics.mass) < 1e-12)
    True
    """

    t: Array
    mass: Array
    total_variation: Array
    minimum: Array
    maximum: Array
    l1: Array
    l2: Array

    def __repr__(self) -> str:
        return (
            f"Diagnostics({self.t.size} snapshots, mass {self.mass[0]:.6g} to {self.mass[-1]:.6g}, "
            f"values in [{self.minimum.min():.6g}, {self.maximum.max():.6g}])"
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Snapshots of a run.

    `Solver.run` returns it.

    Attributes
    ----------
    states : tuple of State
        In host memory, the start first.
    solver : Solver
        The solver that made the run.
    dt : float
        Length of the full steps.
    interrupted : bool
        Whether the run was stopped before its end; then the last state is the last one reached.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    >>> run = solver.run(solver.state(lambda x: np.sin(2 * np.pi * x)), 0.5, dt=0.05, snapshots=2)
    >>> run.times.tolist(), run.final["u"].shape
    ([0.0, 0.25, 0.5], (20,))
    """

    states: tuple[State, ...]
    solver: Scheme
    dt: float
    interrupted: bool = False
    _budget: Budget | None = None

    def __repr__(self) -> str:
        first, last = self.states[0], self.states[-1]
        left = ", interrupted" if self.interrupted else ""
        return (
            f"Trajectory({len(self)} snapshots of {first.profile!r} on {first.grid} from t = "
            f"{first.t:.6g} to {last.t:.6g}, dt = {self.dt:.6g}{left})"
        )

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, place: int) -> State:
        return self.states[place]

    @property
    def final(self) -> State:
        """The last snapshot."""
        return self.states[-1]

    @property
    def times(self) -> Array:
        """Times of the snapshots."""
        return np.array([state.t for state in self.states])

    @property
    def diagnostics(self) -> Diagnostics:
        """Mass, total variation, extrema and norms of every snapshot."""
        rows = []
        for state in self.states:
            u = np.asarray(state["u"], dtype=float)
            w = state.grid.weights
            rows.append(
                (
                    state.t,
                    state.mass,
                    total_variation(state),
                    u.min(),
                    u.max(),
                    np.sum(w * np.abs(u)),
                    np.sqrt(np.sum(w * u**2)),
                )
            )
        return Diagnostics(*np.array(rows, dtype=float).T)

    @property
    def budget(self) -> Budget:
        """What came in and left by each wall, was added and decayed, up to each snapshot.

        Raises
        ------
        NotSupported
            A profile that does not keep the integral.
        """
        if self._budget is None:
            raise NotSupported(
                f"budget: {self.states[0].profile!r} does not keep the integral; take 'csl2' or "
                "'csl4' with form='advection'"
            )
        return self._budget

    def sample(self, points: ArrayLike, place: int = -1) -> Array:
        """The field of one snapshot between the nodes, by its profile.

        Parameters
        ----------
        points : array_like
            Coordinates, shape (dim, ...); in one dimension shape (...) is accepted too.
        place : int
            Index of the snapshot, default the last.

        Returns
        -------
        ndarray
            Shape (...). See `cip.output.sample.sample` for the profile used with a splitting.

        Examples
        --------
        >>> import numpy as np
        >>> from cip import Grid, Solver
        >>> solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
        >>> run = solver.run(solver.state(lambda x: np.sin(2 * np.pi * x)), 1.0, dt=0.05)
        >>> print(f"{run.sample([0.013])[0]:.4f}")  # the exact value is 0.0816
        0.0816
        """
        if self.solver.land is not None:
            return sample_sea(self.states[place], points, self.solver.land)
        return sample(self.states[place], points)

    def to_xarray(self) -> Any:
        """An xarray.Dataset: each moment over t and the coordinates, diagnostics over t.

        In a direction over which a moment is averaged its coordinate is the midpoint of the cell,
        named ``x_cell``, ``y_cell`` or ``z_cell``.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingDependency
            xarray is not installed.
        """
        found, of = state_dataset(self.states), self.diagnostics
        for name in ("mass", "total_variation", "minimum", "maximum", "l1", "l2"):
            found[name] = (["t"], getattr(of, name))
        return found.assign_attrs(form=self.solver.form, dt=self.dt)

    def to_pyvista(self, place: int = -1) -> Any:
        """One snapshot as a pyvista grid, a periodic direction closed by its first nodes again.

        Means over whole cells become cell data. Means over some of the directions become point
        data at the node where the averaged interval begins, NaN at nodes where none begins.

        Parameters
        ----------
        place : int
            Index of the snapshot, the last by default.

        Returns
        -------
        pyvista.RectilinearGrid
        """
        import pyvista

        state = self.states[place]
        grid = state.grid
        lines = [*grid.edges, *([np.zeros(1)] * (3 - grid.dim))]
        mesh = pyvista.RectilinearGrid(*lines)
        for moment in moments(state.profile, grid.dim):
            values = np.asarray(state[moment.name])
            if len(moment.averaged) == grid.dim:
                mesh.cell_data[moment.name] = values.ravel(order="F")
                continue
            for axis, periodic in enumerate(grid.periodic):
                if periodic:
                    values = np.concatenate([values, np.take(values, [0], axis)], axis)
                elif axis in moment.averaged:
                    none = np.full_like(np.take(values, [0], axis), np.nan)
                    values = np.concatenate([values, none], axis)
            mesh.point_data[moment.name] = values.ravel(order="F")
        mesh.field_data["t"] = [state.t]
        return mesh

    def save(self, path: str | Path) -> list[Path]:
        """Write every snapshot as .vtr and the series as .pvd, for pyvista and ParaView.

        Parameters
        ----------
        path : path
            Name of the series, ending in .pvd; the snapshots are written beside it.

        Returns
        -------
        list of Path
            The files written, the series first.

        Raises
        ------
        OSError
            No space left, or no permission to write; snapshots written before it remain.
        InputError
            A name that does not end in .pvd.
        """
        try:
            series = Path(path)
        except TypeError:
            raise InputError(f"path={path!r}: expected the name of a series") from None
        if series.suffix != ".pvd":
            raise InputError(f"path: expected a name that ends in .pvd, got {series.name!r}")
        series.parent.mkdir(parents=True, exist_ok=True)
        return write_series(series, ((s.t, self.to_pyvista(k)) for k, s in enumerate(self.states)))

    def plot(self, ax: Any = None, places: Sequence[int] | None = None) -> Any:
        """Draw snapshots: curves in one dimension, a map of the last one in two.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        places : sequence of int, optional
            Indices of the snapshots to draw.

        Returns
        -------
        matplotlib Axes
        """
        from cip.output.plot import plot_states

        return plot_states(self.states, ax, places)

    def animate(self, path: str | Path | None = None, fps: int = 20) -> Any:
        """An animation of the snapshots, written to `path` (.gif) if given.

        Parameters
        ----------
        path : str or Path, optional
            Ends in .gif.
        fps : int
            Frames per second.

        Returns
        -------
        matplotlib.animation.FuncAnimation
        """
        from cip.output.plot import animate_states

        return animate_states(self.states, path, fps)


def total_variation(state: State) -> float:
    """Sum over all grid lines of ``|u_{i+1} - u_i|``, weighted with the widths across the line."""
    grid, total = state.grid, 0.0
    u = np.asarray(state["u"], dtype=float)
    for axis in range(grid.dim):
        line = u
        if grid.periodic[axis]:
            line = np.concatenate([u, np.take(u, [0], axis)], axis)
        jumps = np.abs(np.diff(line, axis=axis)).sum(axis=axis)
        for other in (b for b in range(grid.dim) if b != axis):
            width = grid.widths[other]
            share = (
                0.5 * (width + np.roll(width, 1))
                if grid.periodic[other]
                else 0.5 * (np.append(width, 0.0) + np.append(0.0, width))
            )
            place = other - (other > axis)
            shape = [1] * jumps.ndim
            shape[place] = share.size
            jumps = jumps * share.reshape(shape)
        total += float(jumps.sum())
    return total
