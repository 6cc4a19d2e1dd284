r"""A convex quadratic program in the one form that the interior point and the polish work on.

.. math:: \min_x \tfrac12 x^TPx + q^Tx \quad\text{subject to}\quad
          r_l \le Cx \le r_u, \quad l \le x \le u

Equality rows have :math:`r_l = r_u`. With multipliers y of all rows and z_box of the bounds,
positive where an upper side holds and negative where a lower side does, the solution has
:math:`Px + q + C^Ty + z_\mathrm{box} = 0`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from gpu.arrays.namespace import namespace, to_host

Array = Any  # numpy.ndarray or cupy.ndarray
Matrix = Any  # the same, or a SciPy sparse array


def is_sparse(matrix: Any) -> bool:
    """Whether a matrix is stored sparsely."""
    return bool(sparse.issparse(matrix))


class Remote:
    """A device matrix that multiplies vectors of the host."""

    def __init__(self, matrix: Array) -> None:
        self.matrix = matrix

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        return to_host(self.matrix @ namespace(self.matrix).asarray(x))

    def __abs__(self) -> Remote:
        return Remote(abs(self.matrix))

    @property
    def T(self) -> Remote:
        """Its transpose."""
        return Remote(self.matrix.T)


@dataclass(frozen=True)
class StandardQP:
    """Data of the module's formula; P and C are both dense or both sparse."""

    P: Matrix
    q: Array
    C: Matrix
    row_low: Array
    row_high: Array
    lb: Array
    ub: Array

    @property
    def xp(self) -> Any:
        """numpy or cupy."""
        return namespace(self.q)

    @property
    def is_sparse(self) -> bool:
        """Whether P and C are."""
        return is_sparse(self.P)

    def stored_sparsely(self) -> StandardQP:
        """The same program of the host with P and C sparse."""
        if self.is_sparse:
            return self
        return replace(self, P=sparse.csr_array(self.P), C=sparse.csr_array(self.C))

    def on_host(self) -> StandardQP:
        """The same program with its vectors on the host; matrices of a device stay there.

        What is many short vectors and few products takes less time so.
        """
        if self.xp is np:
            return self
        vectors = (self.row_low, self.row_high, self.lb, self.ub)
        C = Remote(self.C)
        return StandardQP(Remote(self.P), to_host(self.q), C, *(to_host(v) for v in vectors))

    @property
    def equality(self) -> Array:
        """Which rows are equalities."""
        return self.row_low == self.row_high

    @cached_property
    def bounded(self) -> Array:
        """Which variables are confined on both sides: by bounds, or by a row and other bounds."""
        low, high = self.xp.isfinite(self.lb), self.xp.isfinite(self.ub)
        if isinstance(self.C, Remote) or not self.row_low.size:
            return low & high
        up, down = ((sign * self.C > 0).astype(float) for sign in (1.0, -1.0))
        held = low, high
        for side, (least, most) in ((self.row_high, held), (self.row_low, held[::-1])):
            # Where all terms of a row but one are held from below, its side holds that one above.
            loose = up @ (~least).astype(float) + down @ (~most).astype(float)
            none, one = (self.xp.isfinite(side) & (loose == count) for count in (0.0, 1.0))
            none, one = none.astype(float), one.astype(float)
            above = (up.T @ none > 0.0) | (~least & (up.T @ one > 0.0))
            below = (down.T @ none > 0.0) | (~most & (down.T @ one > 0.0))
            if side is self.row_low:
                above, below = below, above
            high, low = high | above, low | below
        return low & high

    def gradient(self, x: Array, y: Array) -> Array:
        """``P x + q + C'y``."""
        return self.P @ x + self.q + self.C.T @ y


def one_sided(value: Array, low: Array, high: Array) -> Array:
    """`value` without what points to an infinite side."""
    xp = namespace(value)
    value = xp.where((value > 0) & xp.isinf(high), 0.0, value)
    return xp.where((value < 0) & xp.isinf(low), 0.0, value)


def largest(*values: float) -> float:
    """The largest number; not a number where one of them is not, which `max` may lose."""
    return float(np.max(values)) if values else 0.0


# Sums whose terms cancel are measured against their terms times this, not against themselves.
CANCELLATION = 1e-3
# Of the terms of x'Px, what their sum may be off by.
PRODUCT_ROUNDING = 16 * np.finfo(float).eps
# Residuals below this need no closer look.
SHARP_RESIDUAL = 1e-13


@dataclass(frozen=True)
class Residuals:
    r"""Relative residuals of an approximate solution of a `StandardQP`.

    Attributes
    ----------
    primal : float
        Largest violation of a row over the largest of :math:`|Cx|, |r|` in the rows where either
        side counts; bounds hold exactly.
    dual : float
        Largest entry of :math:`Px + q + C^Ty + z_\mathrm{box}` over the largest of its four terms.
    gap : float
        :math:`|x^TPx + q^Tx + y^Tr + z_\mathrm{box}^Tb|`, with the sides r of rows and b of bounds
        that the multipliers point to, over the larger of the first two terms: large multipliers
        that cancel excuse no error in the objective. What exceeds the rounding
        :math:`16\epsilon|x|^T|P||x|` of the first term counts, |x| of the variables
        that are confined on both sides.
    complementarity : float
        Largest product of a multiplier and the distance to its side, the one over the largest
        term of `dual`, the other over the largest entry of x, or of x and Cx for rows.
    pairing : float
        Largest value of min(multiplier, distance to its side), in the same units: large where
        the active set is a wrong one. It does not count as a residual: where multiplier and
        distance both vanish at the solution, it is as large as the square root of their product,
        which `gap` bounds already.
    """

    primal: float
    dual: float
    gap: float
    complementarity: float = 0.0
    pairing: float = 0.0

    @property
    def worst(self) -> float:
        """The largest residual; infinite where one is not a number."""
        values = (self.primal, self.dual, self.gap, self.complementarity)
        return max(values) if all(np.isfinite(values)) else np.inf

    @property
    def sharp(self) -> float:
        """The same with `pairing`: small only where the active set is the right one."""
        return max(self.worst, self.pairing)


@np.errstate(all="ignore")  # what overflows is not a number, or infinite, in the end
def residuals(
    p: StandardQP, x: Array, y: Array, z_box: Array, products: tuple[Array, Array] | None = None
) -> Residuals:
    """Residuals of `x` within its bounds and of multipliers with the right signs.

    `products` are P x and C'y, where they are known already.
    """
    xp = p.xp

    def size_of(*arrays: Array) -> float:
        return largest(*(float(xp.abs(a).max()) if a.size else 0.0 for a in arrays))

    Px, Cy = products or (p.P @ x, p.C.T @ y)
    Cx = p.C @ x
    size = xp.abs(x), xp.abs(y)
    outside = xp.maximum(p.row_low - Cx, Cx - p.row_high)
    near = xp.clip(Cx, p.row_low, p.row_high)
    primal = _over(
        largest(float(outside.max()) if outside.size else 0.0, 0.0),
        size_of(Cx, near),
        lambda: size_of(abs(p.C) @ size[0]),
    )
    dual = _over(
        size_of(Px + p.q + Cy + z_box),
        size_of(Px, p.q, Cy, z_box),
        lambda: size_of(abs(p.P) @ size[0] + abs(p.C).T @ size[1]),
    )
    row = xp.where(y > 0, p.row_high, xp.where(y < 0, p.row_low, 0.0))
    bound = xp.where(z_box > 0, p.ub, xp.where(z_box < 0, p.lb, 0.0))
    parts = [float(x @ Px), float(p.q @ x), float(y @ row), float(z_box @ bound)]
    error = abs(sum(parts))
    if bool(p.q.any()) and error > SHARP_RESIDUAL * largest(*(abs(part) for part in parts[:2])):
        near = xp.where(p.bounded, size[0], 0.0)
        error -= min(error, PRODUCT_ROUNDING * float(near @ (abs(p.P) @ near)))
    gap = _over(
        error,
        largest(*(abs(part) for part in parts[:2])),
        lambda: largest(
            # Without q nothing else has a size where Px = 0, and no x runs away.
            float(size[0] @ (xp.abs(Px) if bool(p.q.any()) else abs(p.P) @ size[0])),
            float(xp.abs(p.q) @ size[0]),
            float(size[1] @ xp.abs(row)),
            float(xp.abs(z_box * bound).sum()),
        ),
    )
    force, length = size_of(Px, p.q, Cy, z_box), size_of(x)
    pairs = (
        _pairs(y, Cx, p.row_low, p.row_high, force, largest(length, size_of(Cx))),
        _pairs(z_box, x, p.lb, p.ub, force, length),
    )
    product, lesser = (largest(*(pair[i] for pair in pairs)) for i in (0, 1))
    return Residuals(primal, dual, gap, product, lesser)


def _pairs(
    multiplier: Array, value: Array, low: Array, high: Array, force: float, length: float
) -> tuple[float, float]:
    """Of multipliers and distances to their sides, each over its size: see `Residuals`.

    The largest product (`complementarity`), and the largest value of min(multiplier, distance)
    (`pairing`).
    """
    if not value.size:
        return 0.0, 0.0
    xp = namespace(value)
    side = xp.where(multiplier > 0, high, xp.where(multiplier < 0, low, value))
    near = xp.abs(xp.where(xp.isinf(side), 0.0, value - side)) / (length or 1.0)
    push = xp.abs(multiplier) / (force or 1.0)
    return float((push * near).max()), float(xp.minimum(push, near).max())


def _over(value: float, size: float, terms: Callable[[], float]) -> float:
    """`value` over `size`, or over `terms`, the size of what cancels, computed where it matters."""
    if not np.isfinite(size):
        return np.nan
    if not value or value <= SHARP_RESIDUAL * size:
        return value / size if value else 0.0
    size = largest(size, CANCELLATION * terms())
    if not np.isfinite(size):
        return np.nan
    return value / size if size else np.inf
