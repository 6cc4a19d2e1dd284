"""Sensors at points in space and time: their reports, and their predicted values in a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import block_array, csr_array
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from cip.errors import InputError
from cip.formulas.dataset import seconds
from cip.formulas.snapshots import increasing
from cip.grid import AXES, Array, Grid, check_grid
from cip.output.sample import sample_rows
from cip.output.stored import read_words, reading, write_words
from cip.output.trajectory import Trajectory
from cip.stages.state import State, one_field
from cip.stages.state_dataset import xarray_module
from skfem_adini.ground.arguments import integer, masked_array, real_array, real_number


@dataclass(frozen=True, eq=False)
class Reports:
    """The reports of sensors as linear maps of states on one grid; missing reports are left out."""

    times: Array  # shape (k,)
    values: tuple[Array, ...]  # for each time those that arrived, shape (m,)
    deviations: tuple[Array, ...]  # for each time their standard deviations
    operators: tuple[csr_array, ...]  # for each time (m, N), applied to state.data.ravel()


class Sensors:
    """Point sensors of the field, all read at the same times, with noise and dropouts.

    Parameters
    ----------
    points : array_like
        Places, shape (dim, m); in one dimension shape (m,) is accepted too.
    times : array_like
        Increasing times of the reports, shape (k,).
    values : array_like, optional
        Reports, shape (k, m); NaN or masked where none arrived. Default: all 0, for sensors that
        are only planned.
    deviations : array_like
        Standard deviation of the noise, positive, broadcast to (k, m), in the unit of the field.

    Attributes
    ----------
    points, times, values, deviations : ndarray, shapes (dim, m), (k,), (k, m) and (k, m)

    Raises
    ------
    InputError
        Shapes that do not belong together, times that do not increase, deviations that are not
        positive.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Sensors, Solver
    >>> solver = Solver(Grid((0, 1), 32, periodic=True), 1.0)
    >>> sensors = Sensors([0.21, 0.64], [0.1, 0.2], [[0.5, -0.9], [np.nan, -0.4]], 0.05)
    >>> start = solver.state("sin(2*pi*x1)")
    >>> run = solver.run(start, 0.2, dt=0.05, snapshots=sensors.times)
    >>> sensors.sample(run).round(2).tolist()
    [[0.64, -0.25], [0.06, 0.37]]
    >>> sensors.residuals(run).round(1).tolist()  # in deviations
    [[-2.7, -13.0], [nan, -15.4]]
    """

    def __init__(
        self,
        points: ArrayLike,
        times: ArrayLike,
        values: ArrayLike | None = None,
        deviations: ArrayLike = 1.0,
    ) -> None:
        place = real_array("points", points).astype(float)
        place = place[None] if place.ndim == 1 else place
        if place.ndim != 2 or place.shape[0] not in (1, 2, 3) or not place.size:
            raise InputError(
                f"points: expected shape (dim, m) with dim = 1, 2 or 3, got {np.shape(points)}"
            )
        if not np.isfinite(place).all():
            raise InputError("points: expected finite coordinates")
        self.points, self.times = place, increasing(times)
        shape = (self.times.size, place.shape[1])
        self.values = checked_values(values, shape)
        self.deviations = checked_deviations(deviations, shape)

    def __repr__(self) -> str:
        dim, count = self.points.shape
        missing = int(np.isnan(self.values).sum())
        return (
            f"Sensors({count} points in {dim} dimensions, {self.times.size} times from "
            f"{self.times[0]:.6g} to {self.times[-1]:.6g}, {missing} of {self.values.size} "
            "reports missing)"
        )

    @property
    def reported(self) -> NDArray[np.bool_]:
        """Which reports arrived, shape (k, m)."""
        return ~np.isnan(self.values)

    def rows(self, grid: Grid, profile: str) -> csr_array:
        """Rows that map a state to the values at all sensors, by the profile between nodes.

        Parameters
        ----------
        grid : Grid
        profile : str

        Returns
        -------
        scipy.sparse.csr_array
            Shape (m, N), applied to all moments, ``state.data.ravel()``.

        Raises
        ------
        InputError
            Sensors outside the grid.
        NotSupported
            A profile that is not linear in its moments.
        """
        self._require(grid)
        return sample_rows(grid, profile, self.points)

    def reports(self, grid: Grid, profile: str) -> Reports:
        """The reports that arrived, with their rows, for `identify_velocity` and `four_d_var`.

        Parameters
        ----------
        grid, profile
            As for `rows`.

        Returns
        -------
        Reports
            With ``times``, ``values``, ``deviations`` and ``operators``, an entry for each time.
        """
        rows, there = self.rows(grid, profile), self.reported
        return Reports(
            self.times,
            tuple(value[kept] for value, kept in zip(self.values, there, strict=True)),
            tuple(one[kept] for one, kept in zip(self.deviations, there, strict=True)),
            tuple(csr_array(rows[np.flatnonzero(kept)]) for kept in there),
        )

    def operator(self, grid: Grid, profile: str) -> LinearOperator:
        """The observation operator of all reports that arrived, and its transpose.

        Parameters
        ----------
        grid, profile
            As for `rows`.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator
            Shape (reports, k N): from the moments of the states at all times, one state after the
            other, to the reports, in the order of ``values[reported]``.
        """
        blocks = self.reports(grid, profile).operators
        count = len(blocks)
        layout = [[blocks[i] if i == j else None for j in range(count)] for i in range(count)]
        return aslinearoperator(csr_array(block_array(layout)))

    def states(self, run: Trajectory) -> tuple[State, ...]:
        """The snapshots of a run at the times of the sensors.

        Parameters
        ----------
        run : Trajectory
            Made with ``snapshots=sensors.times``.

        Returns
        -------
        tuple of State

        Raises
        ------
        InputError
            The run has no snapshot at one of the times.
        """
        if not isinstance(run, Trajectory):
            raise InputError(f"run: expected what solver.run returned, got {type(run).__name__}")
        known = run.times
        near = np.abs(known[:, None] - self.times).argmin(axis=0)
        apart = np.abs(known[near] - self.times) > 1e-9 * max(np.ptp(known), abs(run.dt))
        if apart.any():
            raise InputError(
                f"run: it has no snapshot at t = {self.times[apart][0]:.6g}; run the solver with "
                "snapshots=sensors.times, to their last"
            )
        return tuple(run[int(q)] for q in near)

    def sample(self, run: Trajectory) -> Array:
        """What the sensors would have read in a run, without noise.

        Parameters
        ----------
        run : Trajectory
            Made with ``snapshots=sensors.times``.

        Returns
        -------
        ndarray
            Shape (k, m), also where no report arrived.
        """
        seen = replace(run, states=self.states(run))
        self._require(seen[0].grid)
        one_field(seen[0], "run: readings")
        return np.stack([seen.sample(self.points, place) for place in range(len(seen))])

    def residuals(self, run: Trajectory) -> Array:
        """Reports minus the values of a run, in units of the deviations.

        Parameters
        ----------
        run : Trajectory
            Made with ``snapshots=sensors.times``.

        Returns
        -------
        ndarray
            Shape (k, m), NaN where no report arrived.
        """
        return np.asarray((self.values - self.sample(run)) / self.deviations)

    def with_values(self, values: ArrayLike) -> Sensors:
        """The same sensors with other reports.

        Parameters
        ----------
        values : array_like
            Shape (k, m).

        Returns
        -------
        Sensors
        """
        return Sensors(self.points, self.times, values, self.deviations)

    def perturbed(self, seed: int, dropouts: float = 0.0) -> Sensors:
        """The same sensors with noise of their deviations, and some reports lost at random.

        Parameters
        ----------
        seed : int
        dropouts : float
            Probability that a report is lost, in [0, 1).

        Returns
        -------
        Sensors

        Raises
        ------
        InputError
            A probability outside [0, 1), a seed that is no whole number.
        """
        share = real_number("dropouts", dropouts)
        if not 0.0 <= share < 1.0:
            raise InputError(f"dropouts: expected a probability in [0, 1), got {dropouts!r}")
        rng = np.random.default_rng(integer("seed", seed, 0))
        values = self.values + self.deviations * rng.standard_normal(self.values.shape)
        values[rng.random(values.shape) < share] = np.nan
        return self.with_values(values)

    def at(self, chosen: ArrayLike) -> Sensors:
        """A subset of the sensors.

        Parameters
        ----------
        chosen : array_like of int or bool
            Numbers of the points, or a mask.

        Returns
        -------
        Sensors

        Raises
        ------
        InputError
            No point is chosen, or one that does not exist.
        """
        places = real_array("chosen", chosen)
        if not places.size:
            raise InputError("chosen: expected at least one point, got none")
        try:
            kept = np.atleast_1d(np.arange(self.points.shape[1])[places])
        except IndexError as error:
            raise InputError(f"chosen: expected numbers of points or a mask: {error}") from None
        if kept.ndim != 1 or not kept.size:
            raise InputError(f"chosen: expected at least one point, got {chosen!r}")
        return Sensors(
            self.points[:, kept], self.times, self.values[:, kept], self.deviations[:, kept]
        )

    def save(self, path: str | Path) -> None:
        """Write a file of JSON, which `load` reads without loss; it appears when it is complete.

        Parameters
        ----------
        path : path

        Raises
        ------
        OSError
            No space left, or no permission to write.
        """
        values = self.values.astype(object)
        values[np.isnan(self.values)] = None  # null: no report arrived
        write_words(path, _FORMAT, {n: getattr(self, n) for n in _STORED} | {"values": values})

    @classmethod
    def load(cls, path: str | Path) -> Sensors:
        """The sensors of a file.

        Parameters
        ----------
        path : path
            Written by `save`.

        Returns
        -------
        Sensors

        Raises
        ------
        InputError
            A file that `save` did not write.
        """
        with reading(path, "sensors"):
            told = read_words(path, _FORMAT, _STORED)
            values = [[np.nan if v is None else v for v in row] for row in told["values"]]
        return cls(told["points"], told["times"], values, told["deviations"])

    def to_xarray(self) -> Any:
        """An xarray.Dataset with ``value`` and ``deviation`` over ``t`` and ``sensor``.

        The coordinates x, y, z of the points lie along ``sensor``.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingDependency
            xarray is not installed.
        """
        xarray, dims = xarray_module(), ["t", "sensor"]
        places = {name: ("sensor", x) for name, x in zip(AXES, self.points, strict=False)}
        data = {"value": (dims, self.values), "deviation": (dims, self.deviations)}
        return xarray.Dataset(data, {"t": self.times, **places})

    @classmethod
    def from_xarray(cls, dataset: Any, since: Any = None) -> Sensors:
        """Sensors from a Dataset with variables and coordinates named as by `to_xarray`.

        Parameters
        ----------
        dataset : xarray.Dataset
            Dimensions ``t`` and ``sensor`` in any order; ``deviation`` may lack one or both. Dates
            and timedelta64 become seconds.
        since : datetime64, datetime or str, optional
            The date of time 0; default the first in ``t``. That of winds is the first of theirs.

        Returns
        -------
        Sensors

        Raises
        ------
        InputError
            A variable or coordinate is missing, or of other dimensions or type; `since` is no date.
        """
        try:
            points = [dataset[name].values for name in AXES if name in dataset.coords]
            value, deviation = dataset["value"].transpose("t", "sensor"), dataset["deviation"]
            spread = (deviation + 0.0 * value.fillna(0.0)).transpose("t", "sensor").values
            times = dataset["t"].values
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            raise InputError(
                "dataset: expected variables value and deviation over t and sensor, and "
                f"coordinates x, y, z along sensor: {error}"
            ) from error
        return cls(points, seconds(times, "dataset: 't'", since), value.values, spread)

    def _require(self, grid: Grid) -> None:
        check_grid(grid)
        if grid.dim != self.points.shape[0]:
            raise InputError(
                f"grid: it has {grid.dim} dimensions, the sensors' points {self.points.shape[0]}"
            )


def checked_values(values: ArrayLike | None, shape: tuple[int, int]) -> Array:
    """Checked reports, NaN where none arrived; zeros if none are given."""
    if values is None:
        return np.zeros(shape)
    given, hidden = masked_array("values", values)
    found = given.astype(float)
    if hidden is not None:
        found[hidden] = np.nan
    if found.shape != shape:
        raise InputError(
            f"values: expected one for each of {shape[0]} times and {shape[1]} points, shape "
            f"{shape}, got {found.shape}"
        )
    if np.isinf(found).any():
        raise InputError("values: infinity among them; NaN means that no report arrived")
    return found


def checked_deviations(deviations: ArrayLike, shape: tuple[int, int]) -> Array:
    """Checked positive deviations of this shape."""
    given = real_array("deviations", deviations).astype(float)
    try:
        found = np.broadcast_to(given, shape).copy()
    except ValueError:
        raise InputError(
            f"deviations: expected shape {shape} or one that broadcasts to it, got {given.shape}"
        ) from None
    if not (np.isfinite(found).all() and np.all(found > 0.0)):
        raise InputError(f"deviations: expected positive standard deviations, got {deviations!r}")
    return found


_FORMAT = "cip sensors 1"
_STORED = ("points", "times", "values", "deviations")
