"""Pictures of contact results; every function takes ``ax=None`` and returns the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.status import Status
from contact.output.contact_runs import arc_length, contact_runs
from contact.output.drawn import Drawn, DrawnBody, drawn_bodies, drawn_mesh, pair_name
from contact.output.pictures import (
    COLOURS,
    axes_of,
    deformed_cells,
    deformed_edges,
    draw_faces,
    legend_below,
    mark_points,
    pressed_faces,
    scale_colours,
    triangulated,
)
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]


def plot_tractions(
    result: Drawn, ax: Any = None, abscissa: Array | None = None, xlabel: str | None = None
) -> Any:
    """Contact pressure and shear along the boundary, coloured by open, stick and slip.

    Tractions of ties have lines of their own. In 3-D the pressure on the faces in contact, see
    `plot_pressure`.

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
    ax = axes_of(ax)
    runs = contact_runs(result)
    s, run = arc_length(result, runs)
    if abscissa is not None:
        s = numbers("abscissa", abscissa)
        if s.shape != run.shape:
            raise InputError(f"abscissa: expected {run.size} numbers, got shape {s.shape}")
    ties = result.system.rows.ties
    g = result.system.bound(result.mu) / result.system.rows.weights
    whose = "shear on the body" if len(result.system.body.bodies) == 1 else "shear"
    line: dict[str, Any] = {"color": COLOURS[Status.BONDED], "lw": 1.0}
    for one in runs:
        points = one.points
        here, tied = points[~ties[points]], points[ties[points]]
        ax.plot(s[here], result.pressure[here], color="0.25", lw=1.2, zorder=2)
        if result.system.law is not None and here.size:
            ax.plot(s[here], result.shear[here, 0], color="0.25", lw=1.0, ls="--", label=whose)
            bound = {"color": "0.92", "zorder": 0, "label": "friction bound"}
            ax.fill_between(s[here], -g[here], g[here], **bound)
        if tied.size:
            ax.plot(s[tied], result.tie_pressure[tied], label="tie, normal", **line)
            ax.plot(s[tied], result.tie_shear[tied, 0], ls="--", label="tie, shear", **line)
    ax.axhline(0.0, color="0.7", lw=0.8, zorder=1)
    normal = result.pressure + result.tie_pressure
    mark_points(ax, result, s, normal, 4)
    if abscissa is None:
        _name_parts(ax, result, s)
    ax.set_xlabel(xlabel or "arc length along the contact boundary")
    ax.set_ylabel("contact traction")
    handles, names = ax.get_legend_handles_labels()
    once = dict(zip(names, handles, strict=True))  # once for several runs
    return legend_below(ax, once.values(), once.keys())


def plot_pressure(result: Drawn, ax: Any = None) -> Any:
    """Contact pressure on the faces of bodies in 3-D, on each the mean of its contact points.

    Where two bodies meet it is drawn once, on the one that carries the contact points. Ties are
    drawn where there is no contact at all.

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
    tied = bool(result.system.rows.ties.all())
    drawn = [_faces(result, k, tied) for k in _owners(result, tied)]
    label = "pressure of the tie" if tied else "contact pressure"
    return draw_faces(drawn, ax, label, cmap="viridis", lw=0.2, ec="0.5")


def face_pressure(result: Drawn, body: Any = None) -> tuple[NDArray[np.int64], Array]:
    """Facets of a body in 3-D that its contact points lie on, and the mean pressure of each.

    Parameters
    ----------
    result : ContactResult
        In 3-D.
    body : Solid, int or str, optional
        Which one, if several have contact points.

    Returns
    -------
    facets : ndarray, shape (k,)
        Facet numbers of its mesh.
    pressure : ndarray, shape (k,)
        Force per area, the unit of E.

    Raises
    ------
    InputError
        Contact points lie on several bodies, and none is chosen; or the body has none.

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
    owners = _owners(result, False)
    if body is None and len(owners) > 1:
        raise InputError(f"body: bodies {owners} have contact points; say which one is meant")
    k = owners[0] if body is None else result.system.body.number_of(body)
    if k not in owners:
        raise InputError(f"body: body {k} has no contact points; its pair has them on the other")
    return pressed_faces(result, k)


def plot_field(
    result: DrawnBody,
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
    result : ContactResult or BodyResult
        Of several bodies all are drawn, in one scale of colours; ``result[body]`` alone.
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
    bodies, ax = _in_plane(result, "fields"), axes_of(ax)
    drawn = [triangulated(one, per_cell, nodal) for one in bodies]
    parts = []
    for points, u, triangles in drawn:
        x, y = (points + magnification * u).T
        parts.append(ax.tripcolor(x, y, triangles, u[:, component], shading="gouraud"))
    scale_colours(ax, parts, label)
    draw_edges(result, ax, magnification)
    ax.set_aspect("equal")
    return ax


def plot_cells(
    result: DrawnBody, ax: Any = None, *, magnification: float = 1.0, label: str | None = None
) -> Any:
    """Mean von Mises stress of each cell on the deformed body (2-D).

    Parameters
    ----------
    result : ContactResult or BodyResult
        Of several bodies all are drawn, in one scale of colours; ``result[body]`` alone.
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

    bodies, ax = _in_plane(result, "cells"), axes_of(ax)
    drawn = [deformed_cells(one, magnification) for one in bodies]
    parts = [PolyCollection(outlines, array=of_cells, lw=0.3) for outlines, of_cells in drawn]
    for cells in parts:
        cells.set_edgecolor("face")
        ax.add_collection(cells)
    scale_colours(ax, parts, label)
    ax.autoscale_view()
    ax.set_aspect("equal")
    return ax


def draw_edges(
    result: DrawnBody, ax: Any, magnification: float = 1.0, outline: bool = False
) -> Any:
    """Cell edges of the deformed body, or its outline alone, as the element bends them (2-D).

    Parameters
    ----------
    result : ContactResult or BodyResult
        Of several bodies all are drawn, in one scale of colours; ``result[body]`` alone.
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

    bodies = drawn_bodies(result)
    ax.add_collection(
        LineCollection(
            [edge for one in bodies for edge in deformed_edges(one, magnification, outline)],
            colors="k",
            linewidths=0.9 if outline else 0.25,
            alpha=1.0 if outline else 0.6,
        )
    )
    ax.autoscale_view()
    return ax


def _in_plane(result: DrawnBody, what: str) -> list[Any]:
    """The parts of a result in its bodies, in 2-D."""
    bodies = drawn_bodies(result)
    if bodies[0].body.dim != 2:
        raise InputError(f"plot: {what} are drawn for bodies in 2-D; use to_pyvista in 3-D")
    return bodies


def _name_parts(ax: Any, result: Drawn, s: Array) -> None:
    """Label the pairs of several bodies above the axes, separated by lines."""
    count = int(result.part.max()) + 1
    if count == 1 or len(result.system.body.bodies) == 1:
        return
    for k in range(count):
        own = s[result.part == k]
        over = ax.get_xaxis_transform()
        name = pair_name(result, k)
        ax.text(own.mean(), 1.01, name, transform=over, ha="center", va="bottom", size=8)
        if k:
            left = s[result.part == k - 1].max()
            ax.axvline(0.5 * (left + own.min()), color="0.8", lw=0.8, ls=":", zorder=0)


def _owners(result: Drawn, tied: bool) -> list[int]:
    """Numbers of the bodies that have contact points, or tied points."""
    rows = result.system.rows
    owner = rows.owner if rows.owner.size else np.zeros(rows.gap.size, dtype=np.int64)
    return np.unique(owner[rows.ties == tied]).tolist()


def _faces(result: Drawn, k: int, tied: bool) -> tuple[Array, Array]:
    """Corners (n, corners, 3) and pressures (n,) of the faces of body k in contact."""
    mesh = drawn_mesh(result, k)
    facets, pressure = pressed_faces(result, k, tied)
    return mesh.p[:, mesh.facets[:, facets]].transpose(2, 1, 0), pressure
