"""Results of a run: snapshots, diagnostics, samples, and export to other tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from cip.errors import InputError, NotSupported
from cip.grid import Array, Sphere, in_space, shares
from cip.output.recorder import HEAD, Gauges, gauges_of, read_run
from cip.output.sample import sample, sample_sea
from cip.profiles.catalogue import moments
from cip.stages.state import State, by_field, states_in, values_of
from cip.stages.state_dataset import dated, state_dataset
from cip.stages.state_files import SUFFIXES, read_states, write_states
from skfem_adini.ground.vtk_files import write_series


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
    gauges : Gauges or None
        ``points``, ``t`` of every step, and ``values`` of shape (steps + 1, ...), of several fields
        a dict of these, where the run had gauges.

    Notes
    -----
    Of several fields, `diagnostics` and `sample` give a dict by field, and ``run["dust"]`` is the
    trajectory of one of them.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    >>> run = solver.run(solver.state(lambda x: np.sin(2 * np.pi * x)), 0.5, dt=0.05, snapshots=2)
    >>> run.times.tolist(), run.final["u"].shape
    ([0.0, 0.25, 0.5], (20,))
    >>> run = solver.run(solver.state({"smoke": "x1", "dust": 1.0}), 0.5, dt=0.05, gauges=[0.3])
    >>> run.gauges.values["dust"].shape, sorted(run.diagnostics)
    ((11, 1), ['dust', 'smoke'])
    """

    states: tuple[State, ...]
    solver: Scheme
    dt: float
    interrupted: bool = False
    gauges: Gauges | None = None
    _budget: Any = None

    def __repr__(self) -> str:
        first, last = self.states[0], self.states[-1]
        left = ", interrupted" if self.interrupted else ""
        return (
            f"Trajectory({len(self)} snapshots of {first.profile!r} on {first.grid} from t = "
            f"{first.t:.6g} to {last.t:.6g}, dt = {self.dt:.6g}{left})"
        )

    def __len__(self) -> int:
        return len(self.states)

    @overload
    def __getitem__(self, place: int) -> State: ...

    @overload
    def __getitem__(self, place: str) -> Trajectory: ...

    def __getitem__(self, place: int | str) -> State | Trajectory:
        if not isinstance(place, str):
            return self.states[place]
        states, gauges = tuple(state.field(place) for state in self.states), self.gauges
        if gauges is not None:
            gauges = replace(gauges, values=gauges.values[place])
        budget = None if self._budget is None else self._budget[place]
        return replace(self, states=states, gauges=gauges, _budget=budget)

    @property
    def final(self) -> State:
        """The last snapshot."""
        return self.states[-1]

    @property
    def times(self) -> Array:
        """Times of the snapshots."""
        return np.array([state.t for state in self.states])

    @property
    def diagnostics(self) -> Any:
        """Mass, total variation, extrema and norms of every snapshot: `Diagnostics`, of several
        fields a dict of these."""
        if self.final.fields:
            return {name: self[name].diagnostics for name in self.final.fields}
        rows = []
        for state in self.states:
            u = np.asarray(values_of(state), dtype=float)
            w = state.grid.weights
            norms = np.sum(w * np.abs(u)), np.sqrt(np.sum(w * u**2))
            rows.append((state.t, state.mass, total_variation(state), u.min(), u.max(), *norms))
        return Diagnostics(*np.array(rows, dtype=float).T)

    @property
    def budget(self) -> Any:
        """What came in and left by each wall, was added and decayed, up to each snapshot: `Budget`,
        of several fields a dict of these.

        Raises
        ------
        NotSupported
            A profile that does not keep the integral, or a run that was loaded from a file.
        """
        if self._budget is None:
            raise NotSupported(
                "budget: it is kept for 'csl2' and 'csl4' with form='advection', by a run or one "
                f"that is resumed in its folder; this one is of {self.states[0].profile!r}"
            )
        return self._budget

    def sample(self, points: ArrayLike, place: int = -1) -> Any:
        """The field of one snapshot between the nodes, by its profile.

        Parameters
        ----------
        points : array_like
            Coordinates, shape (dim, ...); in one dimension shape (...) is accepted too; on a sphere
            longitudes and latitudes in radians.
        place : int
            Index of the snapshot, default the last.

        Returns
        -------
        ndarray, or dict of these by field
            Shape (...). See `cip.output.sample.sample` for the profile used with a splitting; on a
            sphere quintic splines.

        Raises
        ------
        InputError
            Points of another shape, or outside the grid.

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
            return by_field(
                self.states[place], lambda one: sample_sea(one, points, self.solver.land)
            )
        return by_field(self.states[place], lambda one: sample(one, points))

    def to_xarray(self, start: Any = None, units: Mapping[str, str] | None = None) -> Any:
        """An xarray.Dataset: each moment over t and the coordinates, diagnostics over t.

        In a direction over which a moment is averaged its coordinate is the midpoint of the cell,
        named ``x_cell``, ``y_cell`` or ``z_cell``. Attributes follow the CF conventions.

        Parameters
        ----------
        start : str or datetime, optional
            The date of t = 0; then t holds dates, counted in ``units["t"]``. Default: that of the
            winds of `Velocity.from_xarray`, in seconds.
        units : dict, optional
            Units by the names of coordinates and fields, ``{"t": "h", "x": "m", "u": "kg m-3"}``;
            of t with dates s (default), min, h or d. Those of coordinates default to the winds'.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingDependency
            xarray is not installed.
        """
        winds = getattr(self.solver, "velocity", None)
        if start is None:
            start = getattr(winds, "_start", None)
        if isinstance(units, Mapping | None):
            units = {**getattr(winds, "_units", {}), **(units or {})}
        found, of = state_dataset(self.states, start, units), self.diagnostics
        for field, one in (of if self.final.fields else {"": of}).items():
            for name in ("mass", "total_variation", "minimum", "maximum", "l1", "l2"):
                found[f"{field}_{name}".lstrip("_")] = (["t"], getattr(one, name))
        return found.assign_attrs(form=self.solver.form, dt=self.dt)

    def to_pyvista(self, place: int | None = -1) -> Any:
        """One snapshot as a pyvista grid, a periodic direction closed by its first nodes again.

        Means over whole cells become cell data. Means over some of the directions become point
        data at the node where the averaged interval begins, NaN at nodes where none begins. A
        sphere is the globe, a quadrilateral for each cell.

        Parameters
        ----------
        place : int or None
            Index of the snapshot, the last by default; None for all.

        Returns
        -------
        pyvista.RectilinearGrid (of a sphere StructuredGrid), or MultiBlock of all snapshots,
        named by their times
        """
        import pyvista

        if place is None:
            return pyvista.MultiBlock(
                {f"t = {s.t!r}": self.to_pyvista(k) for k, s in enumerate(self.states)}
            )
        state = self.states[place]
        grid = state.grid
        if globe := isinstance(grid, Sphere):
            lon, lat = grid.edges
            mesh = pyvista.StructuredGrid(*(grid.radius * in_space(lon[:, None], lat))[..., None])
        else:
            lines = [*grid.edges, *([np.zeros(1)] * (3 - grid.dim))]
            mesh = pyvista.RectilinearGrid(*lines)
        carried = moments(state.profile, grid.dim) * max(1, len(state.fields))
        for name, moment in zip(state.names, carried, strict=True):
            values = np.asarray(state[name])
            if globe or len(moment.averaged) == grid.dim:
                mesh.cell_data[name] = values.ravel(order="F")
                continue
            for axis, periodic in enumerate(grid.periodic):
                if periodic:
                    values = np.concatenate([values, np.take(values, [0], axis)], axis)
                elif axis in moment.averaged:
                    none = np.full_like(np.take(values, [0], axis), np.nan)
                    values = np.concatenate([values, none], axis)
            mesh.point_data[name] = values.ravel(order="F")
        mesh.field_data["t"] = [state.t]
        return mesh

    def save(self, path: str | Path) -> list[Path]:
        """Write the run without loss, for `load`, or as a series for pyvista and ParaView.

        Parameters
        ----------
        path : path
            Ends in ``.npz``, ``.nc`` or ``.zarr``, as for `State.save`; or in ``.pvd``: then the
            snapshots are written beside it as ``.vtr``.

        Returns
        -------
        list of Path
            The files written, the series first.

        Raises
        ------
        OSError
            No space left, or no permission to write; snapshots of a series before it remain.
        InputError
            A name with another ending.
        MissingDependency
            xarray or zarr is not installed.
        """
        try:
            series = Path(path)
        except TypeError:
            raise InputError(f"path={path!r}: expected the name of a series") from None
        if series.suffix in SUFFIXES:
            more = {"form": self.solver.form, "dt": self.dt, "interrupted": self.interrupted}
            extra = {}
            if self.gauges is not None:
                values = self.gauges.values
                rows = np.stack(list(values.values()), 1) if self.final.fields else values
                extra = {"points": self.gauges.points, "t": self.gauges.t, "rows": rows}
            return [write_states(series, self.states, more, extra)]
        if series.suffix != ".pvd":
            known = ", ".join([".pvd", *SUFFIXES])
            raise InputError(f"path: expected a name that ends in {known}, got {series.name!r}")
        series.parent.mkdir(parents=True, exist_ok=True)
        return write_series(series, ((s.t, self.to_pyvista(k)) for k, s in enumerate(self.states)))

    @classmethod
    def load(cls, path: str | Path, solver: Any = None) -> Trajectory:
        """Read a file of `save`, or the folder of ``Solver.run(save=)``.

        Parameters
        ----------
        path : path
        solver : Solver, optional
            That of the run, for derivatives; a file does not hold it.

        Returns
        -------
        Trajectory

        Raises
        ------
        InputError
            A file that is damaged or of another kind, or of a run that this solver did not make.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from cip import Grid, Solver, Trajectory
        >>> solver = Solver(Grid((0, 1), 16, periodic=True), 1.0)
        >>> with TemporaryDirectory() as folder:
        ...     run = solver.run(solver.state(1.0), 0.5, dt=0.1, snapshots=5, save=folder)
        ...     again = Trajectory.load(folder, solver)
        >>> again.times.tolist() == run.times.tolist(), again.solver is solver
        (True, True)
        """
        if isinstance(path, str | Path) and (Path(path) / HEAD).exists():
            about, states, gauges = read_run(Path(path))
        else:
            stored = read_states(path)
            states, about, gauges = states_in(stored), stored.about["more"], None
            if "form" not in about:
                raise InputError(f"path: {path} holds a state; State.load reads it")
            if extra := stored.extra:
                rows = (extra["points"], extra["t"], extra["rows"])
                gauges = gauges_of(*rows, states[0].fields)
        if solver is not None:
            solver._accept(states[-1])
            if solver.form != about["form"]:
                raise InputError(
                    f"solver: its form is {solver.form!r}, of the run {about['form']!r}"
                )
        ended = "times" not in about or len(states) == 1 + len(about["times"])
        interrupted = bool(about.get("interrupted", not ended))
        scheme = solver if solver is not None else SimpleNamespace(form=about["form"])
        return cls(tuple(states), scheme, about["dt"], interrupted, gauges)

    def plot(self, ax: Any = None, places: Sequence[int] | None = None) -> Any:
        """Draw snapshots: curves in one dimension, a map of the last one in two.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Of several fields a sequence of one for each.
        places : sequence of int, optional
            Indices of the snapshots to draw.

        Returns
        -------
        matplotlib Axes, or list of these
        """
        from cip.output.plot import plot_states

        return plot_states(self.states, ax, places, when=self._when())

    def _when(self) -> Callable[[float], str]:
        """Times as titles show them: dates, where the winds have some."""
        return dated(getattr(getattr(self.solver, "velocity", None), "_start", None))

    def animate(self, path: str | Path | None = None, fps: float | None = None) -> Any:
        """An animation of the snapshots, a panel for each field, written to `path` if given.

        Titles have dates where the winds have them (`Velocity.from_xarray`).

        Parameters
        ----------
        path : str or Path, optional
            Ends in ``.gif``, or in ``.mp4`` where ffmpeg is installed.
        fps : float, optional
            Frames per second; by default as many as last for five seconds, at most 20.

        Returns
        -------
        matplotlib.animation.FuncAnimation

        Raises
        ------
        MissingDependency
            ``.mp4`` without ffmpeg.
        """
        from cip.output.plot import animate_states

        return animate_states(self.states, path, fps, self._when())


def total_variation(state: State) -> float:
    """Sum over all grid lines of ``|u_{i+1} - u_i|``, weighted with the widths across the line."""
    grid, total = state.grid, 0.0
    u = np.asarray(values_of(state), dtype=float)
    for axis in range(grid.dim):
        periodic = grid.periodic[axis]
        line = np.concatenate([u, np.take(u, [0], axis)], axis) if periodic else u
        jumps = np.abs(np.diff(line, axis=axis))
        if isinstance(grid, Sphere):  # lengths of the sides of cells that a jump crosses
            side = np.cos(grid.edges[1][1:-1]) * grid.widths[0][0] if axis else grid.widths[1]
            total += float((grid.radius * side * jumps).sum())
            continue
        jumps = jumps.sum(axis=axis)
        for other in (b for b in range(grid.dim) if b != axis):
            shape = [1] * jumps.ndim
            shape[other - (other > axis)] = -1
            jumps = jumps * shares(grid, other).reshape(shape)
        total += float(jumps.sum())
    return total
