"""Which body has the contact points of a pair, and which one is opposite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.layers.layered_block import LayeredBlock
from contact.body.rigid_modes import rigid_field
from contact.output.drawn import Drawn, DrawnBody

Index = NDArray[np.int64]
_ROUNDING = 1e-12  # relative: normal displacement of a pair under a common translation


@dataclass(frozen=True)
class Side:
    """The body on whose boundary contact points lie."""

    body: Any
    G: sparse.csr_array  # rows of the normal displacement, columns of this body, shape (n, ndofs)

    @property
    def trace(self) -> Any:
        """Its part with a Basis that determines the boundary."""
        return self.body.trace


def side(result: Drawn, points: Index) -> Side:
    """The side of points of one contact boundary, which carries the multipliers."""
    rows, body = result.system.rows, result.system.body
    k = int(rows.owner[points[0]]) if rows.owner.size else 0
    return Side(body.bodies[k], rows.G[points][:, body.slices[k]])


def pair_name(result: Drawn, k: int) -> str:
    """Contact boundary k as texts, pictures and blocks call it: "contact 0", or "tie 0"."""
    return f"{'tie' if result.system.rows.ties[result.part == k].all() else 'contact'} {k}"


def is_elastic(result: Drawn, points: Index) -> bool:
    """Whether a body, not a rigid obstacle, is opposite to points of one contact boundary.
    A translation of all bodies together then changes no gap."""
    rows, bodies = result.system.rows, result.system.body
    if not rows.owner.size:
        return False
    k = int(rows.owner[points[0]])
    elsewhere = np.ones(rows.G.shape[1], dtype=bool)
    elsewhere[bodies.slices[k]] = False
    if abs(rows.G[points][:, elsewhere]).sum() > 0:
        return True
    own, axes = side(result, points), rows.axes[points]
    trace = own.trace
    moved = own.G[:, : trace.f.size] @ rigid_field(trace, np.zeros(trace.dim))[:, : trace.dim]
    return bool(np.abs(moved).max() <= _ROUNDING * np.abs(axes).max())


def drawn_bodies(result: DrawnBody) -> list[Any]:
    """The part of a result in each of its bodies; the result itself if there is one only."""
    system = getattr(result, "system", None)
    if system is None or len(system.body.bodies) == 1:
        return [meshed(result)]
    several: Any = result
    return [meshed(several[k]) for k in range(len(system.body.bodies))]


def meshed(one: Any) -> Any:
    """The part of a result in one body; in a `LayeredBlock` with the mesh that this stands for."""
    return one.on_mesh if isinstance(one.body, LayeredBlock) else one
