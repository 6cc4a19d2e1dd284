r"""Heat through contact: traces of the temperature on both sides of every contact boundary.

With the positive functions :math:`N_k` of the contact points, which sum to one, and the jump
:math:`[T]` of the temperature, point k transmits

.. math:: Q_k = h_k \int N_k [T], \qquad h_k = h(p_k, g_k),

from the first side to the other one, and what leaves one enters the other exactly. On meshes that
do not match the integrals are those of the mortar segments (S. Hueeber and B. I. Wohlmuth, Comput.
Methods Appl. Mech. Engrg. 198 (2009), 1338-1350).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.discretise import point_functions
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.mortar_rows import Interface
from contact.thermal.conduction import Conduction, field_at, trace_of

Array = NDArray[np.float64]
Csr = sparse.csr_array


@dataclass(frozen=True)
class Film:
    """The contact of all boundaries, at integration points; m contact points."""

    first: Csr  # trace of the temperature of the side with the contact points, shape (n, ndofs)
    other: Csr  # trace on the opposite side, zero opposite a rigid obstacle, shape (n, ndofs)
    N: Csr  # functions of the contact points, shape (n, m)
    w: Array  # lengths or areas of the integration points, shape (n,)
    outside: Array  # temperature of rigid obstacles, else 0, shape (n,)

    @property
    def weights(self) -> Array:
        """Length or area of each contact point, shape (m,)."""
        return np.asarray(self.N.T @ self.w)

    def matrix(self, h: Array) -> Csr:
        """Matrix of the heat that leaves by the contact under conductances h (m,)."""
        jump = self.first - self.other
        return Csr(jump.T @ sparse.diags_array(self.w * (self.N @ h)) @ jump)

    def load(self, h: Array) -> Array:
        """Heat from rigid obstacles whose temperature is given, shape (ndofs,)."""
        return np.asarray((self.first - self.other).T @ (self.w * (self.N @ h) * self.outside))

    def jump(self, T: Array) -> Array:
        """``int N_k [T]``, from the first side to the other one, shape (m,)."""
        return np.asarray(self.N.T @ (self.w * ((self.first - self.other) @ T - self.outside)))

    def rubbed(self, power: Array, share: Array) -> Array:
        """Heat of friction into both sides, (ndofs,), by power and share of the first side."""
        sides = ((self.first, share), (self.other, 1.0 - share))
        per_area = power / self.weights
        return sum(
            (side.T @ (self.w * (self.N @ (per_area * part))) for side, part in sides),
            start=np.zeros(self.first.shape[1]),
        )


def film_of(problem: Any, bodies: Sequence[Conduction], temperatures: list[Any]) -> Film:
    """The film of a problem; `temperatures` of the obstacles by boundary, None insulates."""
    ends = np.cumsum([0, *(one.basis.N for one in bodies)])

    def placed(trace: Csr, body: Any) -> Csr:
        k = next(k for k, one in enumerate(bodies) if one.body is body)
        before, after = int(ends[k]), int(ends[-1] - ends[k + 1])
        rows = trace.shape[0]
        return Csr(sparse.hstack([Csr((rows, before)), trace, Csr((rows, after))]))

    parts = []
    sides = problem.boundaries.sides if problem.pairs else problem.boundaries.alone
    for side, outside in zip(sides, temperatures, strict=True):
        if isinstance(side, Interface):
            found = side.rows()
            q = found.quadrature
            outlines = (side.first, q.facet, q.X), (side.second, q.other, q.Y)
            first, other = (placed(facet_trace(o, f, X), o.body) for o, f, X in outlines)
            parts.append((first, other, found.N, q.w, np.zeros(q.w.size)))
            continue
        (rule,), body = side.rules, side.body
        basis, N = point_functions(rule)
        x = np.asarray(basis.global_coordinates())
        there = field_at("obstacle_temperature", 0.0 if outside is None else outside, x)
        first = placed(trace_of(basis), body)
        w = (np.asarray(basis.dx) * body.depth(x)).ravel()
        parts.append((first, Csr(first.shape), N, w, there.ravel()))
    first, other, N, w, there = zip(*parts, strict=True)
    return Film(
        Csr(sparse.vstack(first)),
        Csr(sparse.vstack(other)),
        Csr(sparse.block_diag(N)),
        np.concatenate(w),
        np.concatenate(there),
    )
