"""Geometry for pictures of bodies: deformed cells, edges, pressures on faces; colours, legends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Basis

from contact.body.basis_solid import BasisSolid
from contact.body.cut_body import CutBody
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.laws.status import Status
from contact.output.drawn import Drawn, DrawnBody, drawn_bodies, drawn_mesh
from contact.output.vtk import body_grid
from skfem_adini import to_pyvista

Array = NDArray[np.float64]
Index = NDArray[np.int64]
COLOURS = {
    Status.OPEN: "#b8b8b8",
    Status.STICK: "#1f6f8b",
    Status.SLIP: "#d1495b",
    Status.BONDED: "#5b4a8a",
    Status.UNDETERMINED: "#d9a441",
}


def triangulated(one: DrawnBody, per_cell: int, nodal: bool) -> tuple[Array, Array, Index]:
    """Places (n, 2), displacements (n, 2) and triangles (k, 3) of a body in 2-D.
    `per_cell` parts an edge, of simplices powers of two; `nodal`: corners of the cells only."""
    body = one.body
    parts = per_cell if body.mesh.t.shape[0] == 4 else 2 ** int(np.ceil(np.log2(per_cell)))
    grid = to_pyvista(body.basis, {"u": one.u}, subdivide=1 if nodal else parts)
    grid = body.clipped(grid) if isinstance(body, CutBody) else grid
    cells = _polygons(grid)
    first = [corners[:3] for corners in cells]
    triangles = first + [corners[[0, 2, 3]] for corners in cells if len(corners) == 4]
    u = np.asarray(grid.point_data["u"])[:, :2]
    return np.asarray(grid.points)[:, :2], u, np.array(triangles)


def deformed_cells(one: DrawnBody, magnification: float) -> tuple[list[Array], Array]:
    """Outline of each deformed cell of a body in 2-D, as the element bends it, and its mean von
    Mises stress."""
    body = one.body
    grid = body_grid(one, subdivide=None if isinstance(body, CutBody) else 1)
    stress = np.asarray(grid.cell_data["von_mises"])
    if isinstance(body, CutBody):
        x = np.asarray(grid.points) + magnification * np.asarray(grid.point_data["displacement"])
        return [x[corners, :2] for corners in _polygons(grid)], stress
    return cell_outlines(one, magnification), stress


def cell_outlines(one: DrawnBody, magnification: float = 1.0) -> list[Array]:
    """Outline of each deformed cell of a body in 2-D on a fitted mesh, as the element bends it."""
    body = one.body
    corners, s = body.mesh.elem.refdom.p, np.arange(4) / 4  # cyclic, and parts of an edge
    around = zip(corners.T, np.roll(corners, -1, axis=1).T, strict=True)
    X = np.hstack([a[:, None] + (b - a)[:, None] * s for a, b in around])
    basis = Basis(body.mesh, body.basis.elem, quadrature=(X, np.ones(X.shape[1])))
    x = np.asarray(basis.global_coordinates()) + magnification * np.asarray(
        basis.interpolate(one.u)
    )
    return list(x.transpose(1, 2, 0))


def deformed_edges(one: DrawnBody, magnification: float, outline: bool) -> list[Array]:
    """Edges of the deformed cells of a body in 2-D, or of its boundary, as the element bends them.
    Each of shape (points, 2)."""
    body = one.body
    mesh = body.mesh
    s = np.linspace(0.0, 1.0, 7)[None]
    facets = mesh.boundary_facets() if outline else np.arange(mesh.nfacets)
    along = facet_basis(mesh, body.basis.elem, facets, quadrature=(s, np.ones(s.shape[1])))
    x = np.asarray(along.global_coordinates()) + magnification * np.asarray(
        along.interpolate(one.u)
    )
    return list(x.transpose(1, 2, 0))


def pressed_faces(result: Drawn, k: int, tied: bool = False) -> tuple[Index, Array]:
    """Facets of body k in 3-D that its contact, or tied, points lie on; mean pressure of each."""
    rows, mesh = result.system.rows, drawn_mesh(result, k)
    own = (rows.ties == tied) & (rows.owner == k if rows.owner.size else True)
    nominal, normals = rows.x_nominal[:, own], rows.normals[:, own]
    values = (result.tie_pressure if tied else result.pressure)[own]
    weights = rows.weights[own]
    facets = mesh.boundary_facets()
    corner = mesh.p[:, mesh.facets[:, facets]]
    middle = corner.mean(axis=1)
    reach = np.linalg.norm(corner - middle[:, None], axis=0).max(axis=0)
    normal = np.cross((corner[:, 1] - corner[:, 0]).T, (corner[:, 2] - corner[:, 0]).T).T
    normal /= np.linalg.norm(normal, axis=0)
    found, pressure = [], []
    for f in range(facets.size):
        off = nominal - middle[:, f : f + 1]
        near = np.linalg.norm(off, axis=0) <= (1 + 1e-6) * reach[f]
        near &= np.abs(normal[:, f] @ off) <= 0.2 * reach[f]
        near &= np.abs(normal[:, f] @ normals) > 0.3
        # Points must surround its middle: a face next to the boundary has points on one side only.
        around = off[:, near].T
        spread = [
            (around @ (corner[:, i, f] - middle[:, f]) > 0).any() for i in range(len(corner[0]))
        ]
        if near.any() and all(spread):
            found.append(f)
            pressure.append(np.average(values[near], weights=weights[near]))
    return facets[found], np.array(pressure)


def _polygons(grid: Any) -> list[Index]:
    """Corners of each cell; those of a cut body have three or four."""
    cells, found = np.asarray(grid.cells), []  # each is its number of corners, then the corners
    while cells.size:
        found.append(cells[1 : 1 + cells[0]])
        cells = cells[1 + cells[0] :]
    return found


def draw_outlines(result: Drawn, ax: Any) -> Any:
    """Outlines and cells of the deformed bodies (2-D) around their contact, and the contact points.
    Displacements are not magnified, which would let touching bodies overlap."""
    from matplotlib.collections import LineCollection

    colours = ("#3d3d3d", "#b0702a", "#4f7942", "#6a5acd")
    for k, one in enumerate(drawn_bodies(result)):
        colour = colours[k % len(colours)]
        cells = LineCollection(deformed_edges(one, 1.0, False), colors=colour, linewidths=0.3)
        outline = LineCollection(deformed_edges(one, 1.0, True), colors=colour, linewidths=1.3)
        cells.set_alpha(0.5)
        outline.set_label(one.body.name or f"body {k}")
        ax.add_collection(cells)
        ax.add_collection(outline)
    x = on_deformed(result)
    mark_points(ax, result, x[0], x[1], 3.5)
    low, high = x.min(axis=1), x.max(axis=1)
    room = 0.3 * float((high - low).max())
    ax.set_xlim(low[0] - room, high[0] + room)
    ax.set_ylim(low[1] - room, high[1] + room)
    ax.set_aspect("equal")
    ax.set_xlabel("x")
    ax.set_ylabel("y")
    return legend_below(ax)


def have_outlines(result: Drawn) -> bool:
    """Whether the result has several bodies in 2-D with fitted meshes, so that outlines exist."""
    bodies = result.system.body.bodies
    whole = all(isinstance(one, BasisSolid) and not isinstance(one, CutBody) for one in bodies)
    return len(bodies) > 1 and bodies[0].dim == 2 and whole


def on_deformed(result: Drawn) -> Array:
    """Nominal places of the contact points on the deformed bodies, shape (2, m)."""
    rows, x = result.system.rows, result.x_nominal.copy()
    for k, one in enumerate(drawn_bodies(result)):
        own = rows.owner == k if rows.owner.size else np.ones(x.shape[1], dtype=bool)
        x[:, own] += one.body.displacement(one.u, x[:, own])
    return x


def axes_of(ax: Any) -> Any:
    """The given axes, or those of a new figure; `InputError` for other objects."""
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    if not hasattr(ax, "fill_between"):
        raise InputError(f"ax: expected axes of matplotlib, got {type(ax).__name__}")
    return ax


def mark_points(ax: Any, result: Drawn, x: Array, y: Array, size: float) -> None:
    """Contact points in the colour of their status."""
    for status, colour in COLOURS.items():
        at = result.status == status
        if at.any():
            ax.plot(x[at], y[at], "o", ms=size, color=colour, label=status.name.lower())


def legend_below(ax: Any, *entries: Any) -> Any:
    """A legend below the axes and their label, whatever their height; the axes."""
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": 5}
    ax.legend(*entries, frameon=False, fontsize=8, borderaxespad=4.5, **below)
    return ax


def scale_colours(ax: Any, parts: list[Any], label: str | None, shrink: float = 0.85) -> Any:
    """One scale of colours, and one bar, of all parts of a picture; the axes."""
    values = np.concatenate([np.asarray(part.get_array()) for part in parts])
    for part in parts:
        part.set_clim(values.min(initial=np.inf), values.max(initial=-np.inf))
    ax.figure.colorbar(parts[-1], ax=ax, shrink=shrink, label=label)
    return ax


def draw_faces(parts: list[tuple[Array, Array]], ax: Any, label: str, **style: Any) -> Any:
    """Faces of bodies in 3-D, corners (n, k, 3) with a value (n,) each, in colours; the axes."""
    from mpl_toolkits.mplot3d import art3d  # type: ignore[import-untyped]

    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure(layout="constrained").add_subplot(projection="3d")
    if not hasattr(ax, "add_collection3d"):
        raise InputError("ax: a body in 3-D is drawn in axes with projection='3d'")
    bodies = []
    for corners, values in parts:
        faces = art3d.Poly3DCollection(list(corners), **style)
        faces.set_array(values)
        bodies.append(ax.add_collection3d(faces))
    corners = np.concatenate([corners.reshape(-1, 3) for corners, _ in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = 0.05 * float((high - low).max())
    for axis, a, b in zip("xyz", low - room, high + room, strict=True):
        getattr(ax, f"set_{axis}lim")(a, b)
    ax.set(xlabel="x", ylabel="y", zlabel="z")
    return scale_colours(ax, bodies, label, 0.7)
