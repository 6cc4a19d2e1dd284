"""Pictures of contact results; every function takes ``ax=None`` and returns the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

if TYPE_CHECKING:
    from contact.result import ContactResult

Array = NDArray[np.float64]

STICK, SLIP, OPEN = "#1f6f8b", "#d1495b", "#b8b8b8"


def arc_length(result: ContactResult) -> Array:
    """Place of each contact point along the boundary, measured from the first, shape (m,)."""
    steps = np.linalg.norm(np.diff(result.x, axis=1), axis=0)
    return np.concatenate(([0.0], np.cumsum(steps)))


def plot_tractions(
    result: ContactResult, ax: Any = None, abscissa: Array | None = None, xlabel: str | None = None
) -> Any:
    """Contact pressure and shear along the boundary, coloured by open, stick and slip (2-D).

    Parameters
    ----------
    result : ContactResult
    ax : matplotlib Axes, optional
    abscissa : ndarray, shape (m,), optional
        What to plot against; default the arc length.
    xlabel : str, optional

    Returns
    -------
    matplotlib Axes
    """
    from contact.result import Status

    if result.x.shape[0] != 2:
        raise InputError("plot: tractions along a line need a body in 2-D; use boundary_to_pyvista")
    ax = _axes(ax)
    s = arc_length(result) if abscissa is None else abscissa
    ax.plot(s, result.pressure, color="0.25", lw=1.2, zorder=2)
    ax.axhline(0.0, color="0.7", lw=0.8, zorder=1)
    for status, colour in ((Status.OPEN, OPEN), (Status.STICK, STICK), (Status.SLIP, SLIP)):
        at = result.status == status
        if at.any():
            ax.plot(s[at], result.pressure[at], "o", ms=4, color=colour, label=status.name.lower())
    if result.system.law is not None:
        ax.plot(s, result.shear[:, 0], color="0.25", lw=1.0, ls="--", label="shear on the body")
        g = result.system.bound(result.mu) / result.system.rows.weights
        ax.fill_between(s, -g, g, color="0.92", zorder=0, label="friction bound")
    ax.set_xlabel(xlabel or "arc length along the contact boundary")
    ax.set_ylabel("contact traction")
    ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=5)
    return ax


def plot_field(
    result: ContactResult,
    component: int,
    ax: Any = None,
    *,
    per_cell: int = 5,
    magnification: float = 1.0,
    nodal: bool = False,
    label: str | None = None,
) -> Any:
    """One displacement component on the deformed body, resolved inside the cells (2-D).

    Parameters
    ----------
    result : ContactResult
    component : int
    ax : matplotlib Axes, optional
    per_cell : int
        Sub-cells along a cell edge on which the element's own interpolation is drawn.
    magnification : float
        Of the deformation.
    nodal : bool
        Draw the values at the mesh vertices, linear in between, as coarse as the mesh.
    label : str, optional

    Returns
    -------
    matplotlib Axes
    """
    from skfem_adini import to_pyvista

    body = result.system.body
    if body.dim != 2:
        raise InputError("plot: fields are drawn for bodies in 2-D; use to_pyvista in 3-D")
    ax = _axes(ax)
    grid = to_pyvista(
        body.basis, {"u": result.u}, subdivide=1 if nodal else _subdivision(body, per_cell)
    )
    points, u = np.asarray(grid.points)[:, :2], np.asarray(grid.point_data["u"])[:, :2]
    triangles = _triangles(grid)
    where = points + magnification * u
    colours = ax.tripcolor(where[:, 0], where[:, 1], triangles, u[:, component], shading="gouraud")
    ax.figure.colorbar(colours, ax=ax, shrink=0.85, label=label)
    draw_edges(result, ax, magnification)
    ax.set_aspect("equal")
    return ax


def plot_cells(
    result: ContactResult, ax: Any = None, *, magnification: float = 1.0, label: str | None = None
) -> Any:
    """Mean von Mises stress of each cell on the deformed body (2-D).

    Parameters
    ----------
    result : ContactResult
    ax : matplotlib Axes, optional
    magnification : float
        Of the deformation.
    label : str, optional

    Returns
    -------
    matplotlib Axes
    """
    from matplotlib.collections import PolyCollection

    body = result.system.body
    if body.dim != 2:
        raise InputError("plot: cells are drawn for bodies in 2-D; use to_pyvista in 3-D")
    ax = _axes(ax)
    grid = result.to_pyvista(subdivide=1)
    where = np.asarray(grid.points) + magnification * np.asarray(grid.point_data["displacement"])
    corners = np.asarray(grid.cells).reshape(grid.n_cells, -1)[:, 1:]
    cells = PolyCollection(where[corners][:, :, :2], array=grid.cell_data["von_mises"], lw=0.3)
    cells.set_edgecolor("face")
    ax.add_collection(cells)
    ax.figure.colorbar(cells, ax=ax, shrink=0.85, label=label)
    ax.autoscale_view()
    ax.set_aspect("equal")
    return ax


def draw_edges(
    result: ContactResult, ax: Any, magnification: float = 1.0, outline: bool = False
) -> Any:
    """Cell edges of the deformed body, or its outline alone, as the element bends them (2-D)."""
    from matplotlib.collections import LineCollection
    from skfem import FacetBasis

    body = result.system.body
    mesh = body.mesh
    s = np.linspace(0.0, 1.0, 7)[None]
    facets = mesh.boundary_facets() if outline else np.arange(mesh.nfacets)
    along = FacetBasis(mesh, body.basis.elem, facets=facets, quadrature=(s, np.ones(s.shape[1])))
    x = np.asarray(along.global_coordinates()) + magnification * np.asarray(
        along.interpolate(result.u)
    )
    ax.add_collection(
        LineCollection(
            list(x.transpose(1, 2, 0)),
            colors="k",
            linewidths=0.9 if outline else 0.25,
            alpha=1.0 if outline else 0.6,
        )
    )
    ax.autoscale_view()
    return ax


def _subdivision(body: Any, per_cell: int) -> int:
    """Simplices are cut into powers of two."""
    return per_cell if body.mesh.t.shape[0] == 4 else 2 ** int(np.ceil(np.log2(per_cell)))


def _triangles(grid: Any) -> NDArray[np.int64]:
    cells = np.asarray(grid.cells).reshape(grid.n_cells, -1)[:, 1:]
    if cells.shape[1] == 3:
        return cells
    return np.vstack((cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]))


def _axes(ax: Any) -> Any:
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    return ax
