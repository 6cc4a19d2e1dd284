r"""Contact on a curve that cuts the cells of a mesh: hats along the arc as multipliers.

The boundary of a cut domain meets its cells in pieces of any length, so multipliers that belong to
cells would be as many as the trace cannot control, and tiny pieces would have their own. Here the
arc is run through in units of the cells that it crosses and divided evenly, whatever the cuts:
with the hat functions :math:`N_k \ge 0`, :math:`\sum N_k = 1`

.. math::
    u_{n,k} = \frac{1}{w_k} \int N_k \, n \cdot u, \qquad
    d_k = \frac{1}{w_k} \int N_k \, d, \qquad w_k = \int N_k,

and the multipliers :math:`\mu_k \ge 0` are those of the continuous, piecewise linear pressure
:math:`p = \sum_k (\mu_k / w_k) N_k \ge 0`: it has a sign, a uniform one is exact on any mesh, and
friction within :math:`|t_k| \le F \mu_k` keeps :math:`|q| \le F p` everywhere.

How many multipliers the trace controls is measured: the least eigenvalue of the compliance W
relative to that of the same hats on cells a quarter of the size, over shifted disks and slivers.
At a distance of 2, 1.5, 1, 0.75, 0.5 cells it is at least .75, .54, .30, .08, .02 (shear, the
pressure is better off); an exact trace space would give 1. The default is 1.5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.arc_length import Curve, curves
from contact.errors import InputError, numbers
from contact.obstacles.shapes import Gap, evaluate_gap
from contact.rows.discretise import ContactRows
from contact.rows.frames import tangent_frame
from contact.rows.shares import check_weights

if TYPE_CHECKING:
    from contact.body.cut_body import CutBody

Array = NDArray[np.float64]
HAT = "hat"


@dataclass(frozen=True, eq=False)
class CutArc:
    """Part of the curved boundary of a `CutBody`, by its quadrature points.

    Attributes
    ----------
    body : CutBody
    index : ndarray of int, shape (n,)
        Numbers of the quadrature points among all of the boundary, to tell arcs that overlap.
    x, normals : ndarray, shape (2, n)
        Quadrature points and outward unit normals.
    weights : ndarray, shape (n,)
    size : ndarray, shape (n,)
        Extent of the cell along the arc.
    part : ndarray of int, shape (n,)
        Leaf of the level set, or side of the polygon.
    trace : csr_array, shape (n, scalar dofs)
        Values of the scalar functions at the points.
    spacing : float
        Distance of multipliers in cell sizes.
    """

    body: CutBody
    index: NDArray[np.int64]
    x: Array
    normals: Array
    weights: Array
    size: Array
    part: NDArray[np.int64]
    trace: sparse.csr_array
    spacing: float

    @cached_property
    def curves(self) -> list[Curve]:
        """The connected smooth curves that the arc consists of."""
        return curves(self.x, self.normals, self.weights, self.size, self.part)

    def integral(self, density: Array) -> Array:
        """Load vector of all dofs of a traction at the points, shape (2, n)."""
        load = np.zeros(2 * self.trace.shape[1])
        for c in range(2):
            load[c::2] = self.trace.T @ (self.weights * density[c])
        return load

    def rows(
        self, functional: str | None = None, direction: Callable[[Array], Array] | None = None
    ) -> tuple[ContactRows, ArcGap]:
        """Contact rows of the arc and how it reads a gap; see
        `contact.rows.discretise.contact_boundary`.

        Raises
        ------
        InputError
            Another functional than "hat".
        """
        if functional not in (None, HAT):
            raise InputError(f"functional={functional!r}: a cut arc offers {HAT!r} alone")
        hats, x = self._hats()
        mean = sparse.csr_array(hats @ sparse.diags_array(self.weights))
        weights = np.asarray(mean.sum(axis=1), dtype=float)
        check_weights(weights, float(self.weights.sum()), HAT)
        mean = sparse.csr_array(sparse.diags_array(1.0 / weights) @ mean)
        normals = self.normals if direction is None else direction(self.x)
        tangents = tangent_frame(normals)[:, 0]
        middle = normals @ mean.T
        middle /= np.linalg.norm(middle, axis=0)
        count = weights.size
        rows = ContactRows(
            self._directed(mean, normals),
            self._directed(mean, tangents),
            np.full(count, np.inf),
            weights,
            x,
            self.x @ mean.T,
            middle,
            tangent_frame(middle),
            HAT,
        )
        return rows, ArcGap(self.x, self.normals, mean, rows.x_nominal)

    def _directed(self, mean: sparse.csr_array, direction: Array) -> sparse.csr_array:
        """Means of ``direction . u`` as rows of all dofs."""
        parts = [(mean @ sparse.diags_array(direction[c]) @ self.trace).tocoo() for c in range(2)]
        place = (
            np.concatenate([part.row for part in parts]),
            np.concatenate([2 * part.col + c for c, part in enumerate(parts)]),
        )
        shape = mean.shape[0], 2 * self.trace.shape[1]
        data = np.concatenate([part.data for part in parts])
        return sparse.csr_array(sparse.coo_array((data, place), shape=shape))

    def _hats(self) -> tuple[sparse.csr_array, Array]:
        """Values of the hats at the points, shape (m, n), and the places of the knots, (2, m)."""
        rows, columns, values, knots, first = [], [], [], [], 0
        for curve in self.curves:
            pieces = max(int(curve.length / self.spacing + 1e-9), 1)
            count = pieces if curve.closed or curve.length < self.spacing else pieces + 1
            t = curve.s / curve.length * pieces
            low = np.minimum(t.astype(np.int64), pieces - 1)
            for knot, value in ((low, 1 - (t - low)), (low + 1, t - low)):
                rows.append(first + knot % count)
                columns.append(curve.points)
                values.append(value)
            at = np.arange(count) if count > 1 else np.array([0.5])
            period = float(pieces) if curve.closed else None
            knots.append([np.interp(at, t, self.x[c, curve.points], period=period) for c in (0, 1)])
            first += count
        place = np.concatenate(rows), np.concatenate(columns)
        hats = sparse.coo_array((np.concatenate(values), place), shape=(first, self.weights.size))
        return sparse.csr_array(hats), np.hstack(knots)


@dataclass(frozen=True)
class ArcGap:
    """The gap between an arc and an obstacle, under the hats; see `contact.rows.gap_rule.GapRule`.

    Attributes
    ----------
    x, normals : ndarray, shape (2, n)
        Quadrature points and outward normals there.
    mean : csr_array, shape (m, n)
        Means under the hats.
    x_nominal : ndarray, shape (2, m)
    """

    x: Array
    normals: Array
    mean: sparse.csr_array
    x_nominal: Array

    @property
    def order(self) -> NDArray[np.int64]:
        """The multipliers in their order."""
        return np.arange(self.mean.shape[0])

    def __call__(self, obstacle: Gap) -> Array:
        """Gap of every contact point, shape (m,); ``inf`` where there is no obstacle.

        Raises
        ------
        InputError
            NaN, minus infinity or a wrong shape.
        """
        if isinstance(obstacle, np.ndarray | list | tuple):
            given, x = numbers("obstacle", obstacle), self.x_nominal
            if given.shape not in ((), x.shape[1:]):
                raise InputError(
                    f"obstacle: {given.size} gaps given for {x.shape[1]} contact points"
                )
            return evaluate_gap(given, x, x)
        at = evaluate_gap(obstacle, self.x, self.normals)
        open_ = np.isinf(at)
        gap = self.mean @ np.where(open_, 0.0, at)
        return np.where(self.mean @ open_.astype(float) > 0, np.inf, gap)
