"""Pictures of contact results; every function takes ``ax=None`` and returns the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.cut_body import CutBody
from contact.errors import InputError, numbers
from contact.facet_basis import facet_basis
from contact.laws.status import Status
from contact.output.contact_runs import arc_length
from contact.output.drawn import Drawn
from contact.output.vtk import body_grid
from skfem_adini import to_pyvista

Array = NDArray[np.float64]

_COLOURS = {
    Status.OPEN: "#b8b8b8",
    Status.STICK: "#1f6f8b",
    Status.SLIP: "#d1495b",
    Status.BONDED: "#5b4a8a",
}


def plot_tractions(
    result: Drawn, ax: Any = None, abscissa: Array | None = None, xlabel: str | None = None
) -> Any:
    """Contact pressure and shear along the boundary, coloured by open, stick and slip.

    In 3-D the pressure on the faces in contact, see `plot_pressure`.

    Parameters
    ----------
    result : ContactResult
    ax : matplotlib Axes, optional
    abscissa : ndarray, shape (m,), optional
        What to plot against; default the arc length, see `contact.output.contact_runs.arc_length`.
    xlabel : str, optional

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        Not axes; in 3-D an abscissa, or axes without a third dimension.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xy"), "bottom", -0.01, friction=0.3).solve()
    >>> ax = plot_tractions(result)
    >>> len(ax.lines) > 0
    True
    """
    if result.x.shape[0] != 2:
        if abscissa is not None:
            raise InputError("abscissa: tractions along a line need a body in 2-D")
        return plot_pressure(result, ax)
    ax = _axes(ax)
    s, run = arc_length(result)
    if abscissa is not None:
        s = numbers("abscissa", abscissa)
        if s.shape != run.shape:
            raise InputError(f"abscissa: expected {run.size} numbers, got shape {s.shape}")
    g = result.system.bound(result.mu) / result.system.rows.weights
    for k in range(run.max() + 1):
        here = run == k
        ax.plot(s[here], result.pressure[here], color="0.25", lw=1.2, zorder=2)
        if result.system.law is not None:
            first = k == 0
            label = "shear on the body" if first else None
            ax.plot(s[here], result.shear[here, 0], color="0.25", lw=1.0, ls="--", label=label)
            label = "friction bound" if first else None
            ax.fill_between(s[here], -g[here], g[here], color="0.92", zorder=0, label=label)
    ax.axhline(0.0, color="0.7", lw=0.8, zorder=1)
    for status, colour in _COLOURS.items():
        at = result.status == status
        if at.any():
            ax.plot(s[at], result.pressure[at], "o", ms=4, color=colour, label=status.name.lower())
    ax.set_xlabel(xlabel or "arc length along the contact boundary")
    ax.set_ylabel("contact traction")
    ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=5)
    return ax


def plot_pressure(result: Drawn, ax: Any = None) -> Any:
    """Contact pressure on the faces of a body in 3-D, on each the mean of its contact points.

    Parameters
    ----------
    result : ContactResult
    ax : matplotlib Axes3D, optional

    Returns
    -------
    matplotlib Axes3D

    Raises
    ------
    InputError
        Axes without a third dimension.

    Examples
    --------
    >>> from skfem import MeshHex
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshHex().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xyz"), "bottom", -0.01).solve()
    >>> plot_pressure(result).name
    '3d'
    """
    from matplotlib import cm
    from mpl_toolkits.mplot3d import art3d  # type: ignore[import-untyped]

    mesh = result.system.body.trace.mesh
    facets, pressure = face_pressure(result)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure(layout="constrained").add_subplot(projection="3d")
    if not hasattr(ax, "add_collection3d"):
        raise InputError("ax: a body in 3-D is drawn in axes with projection='3d'")
    corners = mesh.p[:, mesh.facets[:, facets]].transpose(2, 1, 0)
    faces = art3d.Poly3DCollection(list(corners), cmap=cm.viridis, lw=0.2, ec="0.5")
    faces.set_array(pressure)
    ax.add_collection3d(faces)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    room = 0.05 * float((high - low).max())
    for axis, a, b in zip("xyz", low - room, high + room, strict=True):
        getattr(ax, f"set_{axis}lim")(a, b)
    ax.figure.colorbar(faces, ax=ax, shrink=0.7, label="contact pressure")
    return ax


def face_pressure(result: Drawn) -> tuple[NDArray[np.int64], Array]:
    """Facets of a body in 3-D that its contact points lie on, and the mean pressure of each.

    Parameters
    ----------
    result : ContactResult
        Of a body in 3-D.

    Returns
    -------
    facets : ndarray, shape (k,)
        Facet numbers of the mesh.
    pressure : ndarray, shape (k,)
        Force per area, the unit of E.

    Examples
    --------
    >>> from skfem import MeshHex
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshHex().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xyz"), "bottom", -0.01).solve()
    >>> facets, pressure = face_pressure(result)
    >>> facets.size, bool((pressure > 0).all())
    (4, True)
    """
    mesh, rows = result.system.body.trace.mesh, result.system.rows
    facets = mesh.boundary_facets()
    corner = mesh.p[:, mesh.facets[:, facets]]
    middle = corner.mean(axis=1)
    reach = np.linalg.norm(corner - middle[:, None], axis=0).max(axis=0)
    normal = np.cross((corner[:, 1] - corner[:, 0]).T, (corner[:, 2] - corner[:, 0]).T).T
    normal /= np.linalg.norm(normal, axis=0)
    found, pressure = [], []
    for f in range(facets.size):
        off = rows.x_nominal - middle[:, f : f + 1]
        near = np.linalg.norm(off, axis=0) <= (1 + 1e-6) * reach[f]
        near &= np.abs(normal[:, f] @ off) <= 0.2 * reach[f]
        near &= np.abs(normal[:, f] @ rows.normals) > 0.3
        # All around its middle: a face beside the boundary has points on one side only.
        around = off[:, near].T
        spread = [
            (around @ (corner[:, i, f] - middle[:, f]) > 0).any() for i in range(len(corner[0]))
        ]
        if near.any() and all(spread):
            found.append(f)
            pressure.append(np.average(result.pressure[near], weights=rows.weights[near]))
    return facets[found], np.array(pressure)


def plot_field(
    result: Drawn,
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
        Draw the values at the mesh vertices only, linearly interpolated.
    label : str, optional

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        A body in 3-D, or not axes.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xy"), "bottom", -0.01, friction=0.3).solve()
    >>> ax = plot_field(result, 1, magnification=10.0, label="vertical displacement")
    >>> ax.get_aspect()
    1.0
    """
    body = result.system.body
    if body.dim != 2:
        raise InputError("plot: fields are drawn for bodies in 2-D; use to_pyvista in 3-D")
    ax = _axes(ax)
    grid = to_pyvista(
        body.basis, {"u": result.u}, subdivide=1 if nodal else _subdivision(body, per_cell)
    )
    grid = body.clipped(grid) if isinstance(body, CutBody) else grid
    points, u = np.asarray(grid.points)[:, :2], np.asarray(grid.point_data["u"])[:, :2]
    triangles = _triangles(grid)
    where = points + magnification * u
    colours = ax.tripcolor(where[:, 0], where[:, 1], triangles, u[:, component], shading="gouraud")
    ax.figure.colorbar(colours, ax=ax, shrink=0.85, label=label)
    draw_edges(result, ax, magnification)
    ax.set_aspect("equal")
    return ax


def plot_cells(
    result: Drawn, ax: Any = None, *, magnification: float = 1.0, label: str | None = None
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

    Raises
    ------
    InputError
        A body in 3-D, or not axes.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xy"), "bottom", -0.01, friction=0.3).solve()
    >>> plot_cells(result, magnification=10.0).get_aspect()
    1.0
    """
    from matplotlib.collections import PolyCollection

    body = result.system.body
    if body.dim != 2:
        raise InputError("plot: cells are drawn for bodies in 2-D; use to_pyvista in 3-D")
    ax = _axes(ax)
    grid = body_grid(result, subdivide=None if isinstance(body, CutBody) else 1)
    where = np.asarray(grid.points) + magnification * np.asarray(grid.point_data["displacement"])
    outlines = [where[corners, :2] for corners in _polygons(grid)]
    cells = PolyCollection(outlines, array=grid.cell_data["von_mises"], lw=0.3)
    cells.set_edgecolor("face")
    ax.add_collection(cells)
    ax.figure.colorbar(cells, ax=ax, shrink=0.85, label=label)
    ax.autoscale_view()
    ax.set_aspect("equal")
    return ax


def draw_edges(result: Drawn, ax: Any, magnification: float = 1.0, outline: bool = False) -> Any:
    """Cell edges of the deformed body, or its outline alone, as the element bends them (2-D).

    Parameters
    ----------
    result : ContactResult
        Of a body in 2-D.
    ax : matplotlib Axes
    magnification : float
        Of the deformation; 0 draws the body as it was.
    outline : bool
        Draw the boundary of the body only.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> result = ContactProblem(body.fix("top", "xy"), "bottom", -0.01, friction=0.3).solve()
    >>> import matplotlib.pyplot as plt
    >>> ax = draw_edges(result, plt.figure().add_subplot(), outline=True)
    >>> len(ax.collections)
    1
    """
    from matplotlib.collections import LineCollection

    body = result.system.body
    mesh = body.mesh
    s = np.linspace(0.0, 1.0, 7)[None]
    facets = mesh.boundary_facets() if outline else np.arange(mesh.nfacets)
    along = facet_basis(mesh, body.basis.elem, facets, quadrature=(s, np.ones(s.shape[1])))
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


def _polygons(grid: Any) -> list[NDArray[np.int64]]:
    """Corners of each cell; those of a cut body have three or four."""
    cells, found = np.asarray(grid.cells), []  # each as its number of corners, then these
    while cells.size:
        found.append(cells[1 : 1 + cells[0]])
        cells = cells[1 + cells[0] :]
    return found


def _triangles(grid: Any) -> NDArray[np.int64]:
    cells = _polygons(grid)
    first = [corners[:3] for corners in cells]
    return np.array(first + [corners[[0, 2, 3]] for corners in cells if len(corners) == 4])


def _axes(ax: Any) -> Any:
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    if not hasattr(ax, "fill_between"):
        raise InputError(f"ax: expected axes of matplotlib, got {type(ax).__name__}")
    return ax
