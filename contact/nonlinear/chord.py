r"""Iterations with the factored tangent of an earlier iterate, where these cost less.

Newton's method reduces a residual r to C r^2, the tangent of an iterate with the residual r_j one
of a later iterate to q r with about q = 2 C r_j; then q is observed. Until the tolerance that
takes

.. math:: n_q = \log(tol / r) / \log q

iterations, instead of n of Newton's, each of which costs as much as `Tangent.price` of the others.

C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, chapter 5."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.ground.arrays import on_device

Array = NDArray[np.float64]


class _Work(NamedTuple):
    """Seconds on one core, of which only the ratios matter: fitted to 8,000 to 33,000 unknowns."""

    entry: float = 6e-8  # for an entry of the tangent: its assembly and scaling
    fill: float = 1.25e-8  # for an entry of the factors
    product: float = 2.5e-11  # for an entry of the factors and one of their mean column
    unknown: float = 7.5e-7  # for all else in an iteration, which both kinds need
    overhead: float = 6e-3
    least: float = 1e-2  # of a tangent and its factors that are worth keeping


WORK = _Work()


class Tangent(NamedTuple):
    """A tangent with its factors, see `contact.nonlinear.free_unknowns`."""

    K: Any  # on all dofs
    unit: Array  # scales of the free unknowns
    factor: Any  # a `BoundaryFactor`

    @property
    def price(self) -> float:
        """Work of an iteration that forms and factors this tangent over that of one without; zero
        where both are small, or on a device, which is fast at both."""
        if on_device(self.K.data):
            return 0.0
        n, fill = self.unit.size, self.factor.fill
        own = WORK.entry * self.K.nnz + (WORK.fill + WORK.product * fill / n) * fill
        return 1.0 + own / (WORK.overhead + WORK.unknown * n) if own > WORK.least else 0.0


class Chord:
    """Chooses the tangent of each iteration, None where it is to be that of the iterate."""

    def __init__(self) -> None:
        self._kept: tuple[Tangent, Array] | None = None  # at the end of the last step
        self._curvature = 1.0  # C

    def first(self, u: Array) -> Tangent | None:
        """For a step from u: the last one, if the last step ended there."""
        kept, self._kept = self._kept, None
        return kept[0] if kept is not None and np.array_equal(kept[1], u) else None

    def next(
        self, tangent: Tangent, newton: bool, before: float, size: float, tol: float
    ) -> Tangent | None:
        """After an iteration, Newton's or not, from the residual `before` to `size`."""
        ratio = size / before if before > 0 else np.inf
        if newton:
            self._curvature = ratio / before if before > 0 else np.inf
        contraction = 2.0 * ratio if newton else ratio
        if not contraction < 0.5:
            return None
        many, left = 0, size
        while left > tol:
            left *= min(self._curvature * left, 0.5)
            many += 1
        linear = np.ceil(np.log(tol / size) / np.log(contraction))
        return tangent if linear < many * tangent.price else None

    def end(self, tangent: Tangent, u: Array) -> None:
        """Keep the tangent for a step that begins at u."""
        self._kept = (tangent, u) if tangent.price > 0.0 else None
