"""Results as VTK data: the body, and the contact boundary."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from contact.body.cut_body import CutBody
from contact.errors import InputError
from contact.output.contact_runs import Run, contact_runs
from contact.output.drawn import (
    Drawn,
    DrawnBody,
    drawn_bodies,
    is_elastic,
    meshed,
    pair_name,
)
from skfem_adini import to_pyvista, von_mises
from skfem_adini.ground.arguments import numbers
from skfem_adini.ground.errors import optional


def body_grid(result: DrawnBody, subdivide: int | None = None) -> Any:
    """Body as a pyvista.UnstructuredGrid: displacement, nodal stresses, mean stress of each cell.
    `subdivide`: linear sub-cells along an edge instead of exact high-order cells; a `CutBody`
    always has them, 4 by default, clipped to the part inside."""
    given = None if subdivide is None else numbers("subdivide", subdivide)
    if given is not None and (given.shape != () or not 1 <= given < np.inf or given % 1):
        raise InputError(f"subdivide={subdivide!r}: expected a whole number from 1")
    result = meshed(result)
    body = result.body
    cell_data, point_data = _stresses(result) if getattr(result, "knows_stress", True) else ({}, {})
    cut = isinstance(body, CutBody)
    grid = to_pyvista(
        body.basis,
        {"displacement": result.u},
        subdivide=4 if cut and subdivide is None else subdivide,
        point_data=point_data,
        cell_data=cell_data,
    )
    return result.on_grid(body.clipped(grid) if cut else grid)


def _stresses(result: DrawnBody) -> tuple[dict[str, Any], dict[str, Any]]:
    """Mean stresses of the cells and stresses at the vertices, by name."""
    body, cell, nodal = result.body, result.cell_stress(), result.nodal_stress()
    pairs = [(0, 0), (1, 1), (0, 1)] if body.dim == 2 else [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2)]
    pairs += [] if body.dim == 2 else [(0, 2)]
    dx = body.measure
    cell_data = {"von_mises": np.sum(result.von_mises() * dx, axis=1) / dx.sum(axis=1)}
    cell_data |= {f"stress_{'xyz'[i]}{'xyz'[j]}": cell[i, j] for i, j in pairs}
    if body.is_ring:
        cell_data["stress_hoop"] = cell[2, 2]
    return cell_data, {"nodal_stress": nodal, "nodal_von_mises": von_mises(nodal)}


def boundary_grid(result: Drawn) -> Any:
    """Contact points as pyvista.PolyData with their fields: polylines in 2-D, a cloud in 3-D.
    There is one polyline for each run of connected facets, closed if the run is."""
    return next(boundary_grids([result]))


def boundary_grids(results: Iterable[Drawn]) -> Iterator[Any]:
    """The grids of several results; equal points are connected only once."""
    for result, runs in _joined(results):
        yield _grid(result.system.rows.x, runs, _fields(result))


def block_sets(results: Iterable[Any], subdivide: int | None = None) -> Iterator[Any]:
    """Bodies and contact surfaces of several results, a pyvista.MultiBlock each.
    Blocks: bodies by name, "contact 0" or "tie 0" as `boundary_grid`, and "contact 0 opposite": the
    points moved by the gap onto the other body, with its normals and tractions."""
    pyvista = optional("pyvista", "VTK export needs pyvista: pip install 'pyvista>=0.47'")
    for result, runs in _joined(results):
        blocks = pyvista.MultiBlock()
        for k, one in enumerate(drawn_bodies(result)):
            blocks.append(body_grid(one, subdivide), one.body.name or f"body {k}")
        fields = _fields(result)
        for k in range(int(result.part.max()) + 1):
            chosen = np.flatnonzero(result.part == k)
            number = np.full(result.part.size, -1)
            number[chosen] = np.arange(chosen.size)
            own = [
                replace(run, points=number[run.points]) for run in runs if k == _part(result, run)
            ]
            x, here = result.system.rows.x[:, chosen], {n: v[chosen] for n, v in fields.items()}
            blocks.append(_grid(x, own, here), pair_name(result, k))
            if is_elastic(result, chosen):
                n, gap = result.system.rows.normals[:, chosen], result.system.rows.gap[chosen]
                for name in {"shear", "slip", "normal", "tie_shear"} & here.keys():
                    here[name] = -here[name]
                blocks.append(_grid(x + n * gap, own, here), f"{pair_name(result, k)} opposite")
        yield blocks


def _part(result: Drawn, run: Run) -> int:
    return int(result.part[run.points[0]])


def _joined(results: Iterable[Drawn]) -> Iterator[tuple[Drawn, list[Run]]]:
    """Results with the runs of their points, recomputed only if points differ."""
    places, runs = np.zeros(0), []
    for result in results:
        if result.x.shape[0] == 2 and not np.array_equal(places, result.x_nominal):
            places, runs = result.x_nominal, contact_runs(result)
        yield result, runs


def _fields(result: Drawn) -> dict[str, Any]:
    """Fields at the contact points, by name."""
    for name, forces in (("mu", result.mu), ("t", result.t)):
        if not np.all(np.isfinite(forces)):
            raise InputError(f"{name}: the result holds NaN or infinity, which cannot be written")
    rows = result.system.rows

    def in_space(along: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return _vectors(np.einsum("mj,djm->md", along, rows.tangents))

    ties = {"tie_pressure": result.tie_pressure, "tie_shear": in_space(result.tie_shear)}
    lost: dict[str, Any] = {}
    if getattr(result.system, "surface", None) is not None:
        lost = {name: np.asarray(getattr(result, name)).T for name in ("indentation", "worn")}
    return {
        "pressure": result.pressure,
        "shear": in_space(result.shear),
        **(ties if rows.ties.any() else {}),
        "slip": in_space(result.slip),
        "normal": _vectors(rows.normals.T),
        "gap": np.where(np.isfinite(result.gap), result.gap, np.nan),
        "status": result.status,
        **lost,
    }


def _grid(x: np.ndarray[Any, Any], runs: list[Run], fields: dict[str, Any]) -> Any:
    """Points x of shape (dim, m), joined along runs, with point data."""
    pyvista = optional("pyvista", "VTK export needs pyvista: pip install 'pyvista>=0.47'")
    points = _vectors(x.T)
    cloud = pyvista.PolyData(points)
    if len(x) == 2:
        around = [np.r_[run.points, run.points[: run.closed]] for run in runs]
        cells = [np.r_[run.size, run] for run in around if run.size > 1]
        cloud = pyvista.PolyData(points, lines=np.concatenate(cells)) if cells else cloud
    for name, values in fields.items():
        cloud.point_data[name] = values
    return cloud


def _vectors(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    padded = np.zeros((values.shape[0], 3))
    padded[:, : values.shape[1]] = values
    return padded
