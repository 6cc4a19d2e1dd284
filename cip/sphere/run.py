"""Results of a run on a sphere: what `Trajectory` has, with areas, great circles and a globe."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cip.errors import InputError
from cip.output.trajectory import Diagnostics, Trajectory
from cip.sphere.paths import in_space
from cip.sphere.splines import PAD, value_spline
from cip.stages.state import State, by_field, values_of
from skfem_adini.ground.arguments import real_array

Array = NDArray[np.float64]


class SphereTrajectory(Trajectory):
    """Snapshots of a run on a sphere.

    `SphereSolver.run` returns it. Times, fields, `save`, `load`, `to_xarray` (longitude and
    latitude in degrees), `plot` and `animate` (maps) are those of `Trajectory`.

    Attributes
    ----------
    states : tuple of State
        The start first.
    solver : SphereSolver
        The solver that made the run.
    dt : float
        Length of the full steps.
    interrupted : bool
        Whether the run was stopped before its end.
    gauges : None

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Sphere, SphereSolver
    >>> solver = SphereSolver(Sphere(32, 16), lambda lon, lat: (np.cos(lat), 0 * lon))
    >>> run = solver.run(solver.state(lambda lon, lat: np.sin(lat)), 1.0, dt=0.25, snapshots=2)
    >>> run.times.tolist(), print(f"{run.sample([0.1, np.pi / 2]):.4f}")
    1.0000
    ([0.0, 0.5, 1.0], None)
    """

    @property
    def diagnostics(self) -> Any:
        """Mass, total variation, extrema and norms of every snapshot: `Diagnostics`, of several
        fields a dict of these."""
        if self.final.fields:
            return {name: self[name].diagnostics for name in self.final.fields}
        rows, sphere = [], self.final.grid
        w, (dlon, dlat) = sphere.weights, (width[0] for width in sphere.widths)
        for state in self.states:
            u = values_of(state)
            across = np.abs(u - np.roll(u, 1, axis=0)).sum() * dlat
            along = (np.abs(np.diff(u, axis=1)) * np.cos(sphere.edges[1][1:-1])).sum() * dlon
            variation = sphere.radius * (across + along)
            norms = np.sum(w * np.abs(u)), np.sqrt(np.sum(w * u**2))
            rows.append((state.t, state.mass, variation, u.min(), u.max(), *norms))
        return Diagnostics(*np.array(rows, dtype=float).T)

    def sample(self, points: ArrayLike, place: int = -1) -> Any:
        """The field of one snapshot between the centres of cells, by quintic splines.

        Parameters
        ----------
        points : array_like
            Longitudes and latitudes in radians, shape (2, ...).
        place : int
            Index of the snapshot, default the last.

        Returns
        -------
        ndarray, or dict of these by field
            Shape (...).

        Raises
        ------
        InputError
            Points of another shape, or latitudes beyond the poles.
        """
        at = real_array("points", points).astype(float)
        if at.ndim == 0 or at.shape[0] != 2 or not np.isfinite(at).all():
            raise InputError(f"points: expected finite (lon, lat), got shape {at.shape}")
        if np.abs(at[1]).max(initial=0.0) > 0.5 * np.pi:
            raise InputError("points: latitudes are from -pi/2 to pi/2, in radians")
        return by_field(self.states[place], lambda one: _sampled(one, at))

    def to_pyvista(self, place: int | None = -1) -> Any:
        """One snapshot on the globe, a quadrilateral for each cell.

        Parameters
        ----------
        place : int or None
            Index of the snapshot, the last by default; None for all.

        Returns
        -------
        pyvista.StructuredGrid, or MultiBlock of all snapshots, named by their times
        """
        import pyvista

        if place is None:
            return pyvista.MultiBlock(
                {f"t = {s.t!r}": self.to_pyvista(k) for k, s in enumerate(self.states)}
            )
        state = self.states[place]
        lon, lat = state.grid.edges
        corners = state.grid.radius * in_space(lon[:, None], lat)
        mesh = pyvista.StructuredGrid(*corners[..., None])
        for name in state.names:
            mesh.cell_data[name] = state[name].ravel(order="F")
        mesh.field_data["t"] = [state.t]
        return mesh


def _sampled(state: State, points: Array) -> Array:
    """A field at points (2, ...)."""
    from cip.sphere.kernels import interpolate
    from cip.sphere.remap import Remap

    values = values_of(state)
    if "u" not in state.names:
        values = Remap(state.grid, 4).values(values)
    found = np.empty((1, points[0].size))
    coefs = value_spline(values[None], 5)
    interpolate(in_space(*points).reshape(3, -1), coefs, 5, PAD, found)
    return found.reshape(points[0].shape)
