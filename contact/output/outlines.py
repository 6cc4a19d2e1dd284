"""Several deformed bodies in the plane, near the places where they touch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.basis_solid import BasisSolid
from contact.body.cut_body import CutBody
from contact.output.drawn import Drawn
from contact.output.pictures import COLOURS, deformed_edges
from contact.output.sides import drawn_bodies

Array = NDArray[np.float64]
BODIES = ("#3d3d3d", "#b0702a", "#4f7942", "#6a5acd")
_ROOM = 0.3  # margin around the contact points, relative to their extent


def draw_outlines(result: Drawn, ax: Any) -> Any:
    """Outlines and cells of the deformed bodies (2-D) around their contact, and the contact points.
    Displacements are not magnified, which would let touching bodies overlap."""
    from matplotlib.collections import LineCollection

    for k, one in enumerate(drawn_bodies(result)):
        colour = BODIES[k % len(BODIES)]
        cells = LineCollection(deformed_edges(one, 1.0, False), colors=colour, linewidths=0.3)
        outline = LineCollection(deformed_edges(one, 1.0, True), colors=colour, linewidths=1.3)
        cells.set_alpha(0.5)
        outline.set_label(one.body.name or f"body {k}")
        ax.add_collection(cells)
        ax.add_collection(outline)
    x = on_deformed(result)
    for status, colour in COLOURS.items():
        at = result.status == status
        if at.any():
            ax.plot(x[0, at], x[1, at], "o", ms=3.5, color=colour, label=status.name.lower())
    low, high = x.min(axis=1), x.max(axis=1)
    room = _ROOM * float((high - low).max())
    ax.set_xlim(low[0] - room, high[0] + room)
    ax.set_ylim(low[1] - room, high[1] + room)
    ax.set_aspect("equal")
    ax.set_xlabel("x")
    ax.set_ylabel("y")
    ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=5)
    return ax


def have_outlines(result: Drawn) -> bool:
    """Whether these are several bodies in 2-D whose mesh ends where they do, which can be drawn."""
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
