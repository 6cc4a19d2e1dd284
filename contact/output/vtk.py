"""Results as VTK data: the body, and the contact boundary."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from contact.body.cut_body import CutBody
from contact.errors import InputError, MissingDependency, numbers
from contact.output.contact_runs import Run, contact_runs
from contact.output.drawn import Drawn, DrawnBody
from skfem_adini import to_pyvista, von_mises


def body_grid(result: DrawnBody, subdivide: int | None = None) -> Any:
    """Body as a pyvista.UnstructuredGrid with the displacement and the mean stress of each cell.

    Parameters
    ----------
    result : ContactResult or BodyResult
    subdivide : int, optional
        Number of linear sub-cells along each edge, instead of exact high-order cells. A `CutBody`
        always has sub-cells, 4 by default, clipped to the part inside.

    Returns
    -------
    pyvista.UnstructuredGrid
        Point data ``displacement``, ``nodal_stress`` (nine components), ``nodal_von_mises``; cell
        data ``von_mises`` and ``stress`` (xx, yy, zz, xy, ...).
    """
    given = None if subdivide is None else numbers("subdivide", subdivide)
    if given is not None and (given.shape != () or not 1 <= given < np.inf or given % 1):
        raise InputError(f"subdivide={subdivide!r}: expected a whole number from 1")
    body, cell, nodal = result.body, result.cell_stress(), result.nodal_stress()
    pairs = [(0, 0), (1, 1), (0, 1)] if body.dim == 2 else [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2)]
    pairs += [] if body.dim == 2 else [(0, 2)]
    dx = body.basis.dx
    cell_data = {"von_mises": np.sum(result.von_mises() * dx, axis=1) / dx.sum(axis=1)}
    cell_data |= {f"stress_{'xyz'[i]}{'xyz'[j]}": cell[i, j] for i, j in pairs}
    cut = isinstance(body, CutBody)
    grid = to_pyvista(
        body.basis,
        {"displacement": result.u},
        subdivide=4 if cut and subdivide is None else subdivide,
        point_data={"nodal_stress": nodal, "nodal_von_mises": von_mises(nodal)},
        cell_data=cell_data,
    )
    return body.clipped(grid) if cut else grid


def boundary_grid(result: Drawn) -> Any:
    """Contact points as pyvista.PolyData: a polyline in 2-D, a point cloud in 3-D.

    There is one polyline for each run of connected facets, closed where the facets are.

    Returns
    -------
    pyvista.PolyData
        Point data ``pressure``, ``shear`` and ``slip`` (vectors), ``gap``, ``status``,
        ``normal``.
    """
    return next(boundary_grids([result]))


def boundary_grids(results: Iterable[Drawn]) -> Iterator[Any]:
    """The grids of several results; points that are the same are joined only once."""
    places, runs = np.zeros(0), []
    for result in results:
        if result.x.shape[0] == 2 and not np.array_equal(places, result.x_nominal):
            places, runs = result.x_nominal, contact_runs(result)
        yield _points(result, runs)


def _points(result: Drawn, runs: list[Run]) -> Any:
    try:
        import pyvista
    except ImportError as error:  # pragma: no cover - a core dependency
        raise MissingDependency("VTK export needs pyvista: pip install 'pyvista>=0.47'") from error
    for name, forces in (("mu", result.mu), ("t", result.t)):
        if not np.all(np.isfinite(forces)):
            raise InputError(f"{name}: the result holds NaN or infinity, which cannot be written")
    rows = result.system.rows
    dim, m = rows.x.shape
    points = np.zeros((m, 3))
    points[:, :dim] = rows.x.T
    cloud = pyvista.PolyData(points)
    if dim == 2:
        around = [np.r_[run.points, run.points[: run.closed]] for run in runs]
        cells = [np.r_[run.size, run] for run in around if run.size > 1]
        cloud = pyvista.PolyData(points, lines=np.concatenate(cells)) if cells else cloud
    cloud.point_data["pressure"] = result.pressure
    cloud.point_data["shear"] = _vectors(np.einsum("mj,djm->md", result.shear, rows.tangents))
    cloud.point_data["slip"] = _vectors(np.einsum("mj,djm->md", result.slip, rows.tangents))
    cloud.point_data["normal"] = _vectors(rows.normals.T)
    cloud.point_data["gap"] = np.where(np.isfinite(result.gap), result.gap, np.nan)
    cloud.point_data["status"] = result.status
    return cloud


def _vectors(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    padded = np.zeros((values.shape[0], 3))
    padded[:, : values.shape[1]] = values
    return padded
