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
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from skfem_adini.ground.arrays import namespace, to_host


class _Rounding(NamedTuple):  # what residuals are measured against
    cancellation: float = 1e-3  # least part of a sum's terms that may cancel
    product: float = 16 * float(np.finfo(float).eps)  # rounding allowed in x'Px
    plain: float = 1e3  # times that rounding: larger errors are taken as they are
    sharp: float = 1e-13  # residuals below this are not examined more closely
    least: float = 1e-6  # relative to `StandardQP.lengths`: a smaller x is rounding of the forces
    certain: float = 1e-10  # residuals below this are taken as they are
    side: float = 1e-14  # relative to these lengths: smaller sides may be left by a difference


ROUNDING = _Rounding()


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

    def diagonal(self) -> np.ndarray:
        """Its diagonal, on the host."""
        return to_host(self.matrix.diagonal())

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
    near: Array = None  # lengths of x below which only rounding of the sides is left

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
        """The same program with its vectors on the host; matrices of a device stay there. This is
        faster for many short vectors and few products.
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
    def moduli(self) -> tuple[Matrix, Matrix]:
        """``|P|`` and ``|C|``, kept."""
        return abs(self.P), abs(self.C)

    @cached_property
    def bounded(self) -> Array:
        """Which variables are confined on both sides: by bounds, or by a row and other bounds."""
        low, high = self.xp.isfinite(self.lb), self.xp.isfinite(self.ub)
        if isinstance(self.C, Remote) or not self.row_low.size or bool((low & high).all()):
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

    @cached_property
    def holds_at_origin(self) -> bool:
        """Whether x = 0 is feasible."""
        pairs = ((self.row_low, self.row_high), (self.lb, self.ub))
        return all(bool(((low <= 0.0) & (high >= 0.0)).all()) for low, high in pairs)

    def sided(self, y: Array) -> Array:
        """The multipliers that x = 0 can have: those of sides at zero."""
        at_side = ((y > 0) & (self.row_high == 0.0)) | ((y < 0) & (self.row_low == 0.0))
        return self.xp.where(at_side, y, 0.0)

    @cached_property
    def lengths(self) -> Array:
        r"""The size of each x that follows from curvature and linear term, :math:`D_j|Dq|_\infty`
        with :math:`D = \mathrm{diag}(P)^{-1/2}`, or :math:`D_j` times the largest side in these
        units if that is smaller and not rounding; 0 without curvature."""
        xp, diagonal = self.xp, self.P.diagonal()
        D = xp.where(diagonal > 0.0, 1.0 / xp.sqrt(xp.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
        if not self.q.size:
            return D
        size, unit = float((D * xp.abs(self.q)).max()), abs(self.C) @ D
        sides = 0.0
        for units, pair in ((unit, (self.row_low, self.row_high)), (D, (self.lb, self.ub))):
            for side in pair:
                counts = xp.isfinite(side) & (units > 0.0)
                if bool(counts.any()):
                    sides = max(sides, float((xp.abs(side[counts]) / units[counts]).max()))
        return D * (sides if ROUNDING.side * size < sides < size else size)

    @cached_property
    def least_sizes(self) -> tuple[float, float, float, float]:
        """Least sizes of rows, of the objective, of x and of forces that residuals are measured
        against."""
        known = self.near is not None
        near = self.near if known else ROUNDING.least * self.lengths
        forces = abs(self.P) @ near if known else self.xp.zeros_like(near)
        rows = abs(self.C) @ near
        return (
            float(rows.max()) if rows.size else 0.0,
            float((self.xp.abs(self.q) + forces) @ near),
            float(near.max()) if near.size else 0.0,
            float(forces.max()) if near.size else 0.0,
        )

    def rounded_forces(self, x: Array, y: Array) -> float:
        """The least size of forces that residuals are measured against, where terms cancel."""
        terms = self.moduli[0] @ self.xp.abs(x) + self.moduli[1].T @ self.xp.abs(y)
        return ROUNDING.cancellation * float(terms.max()) if terms.size else 0.0

    def gradient(self, x: Array, y: Array) -> Array:
        """``P x + q + C'y``."""
        return self.P @ x + self.q + self.C.T @ y


def one_sided(value: Array, low: Array, high: Array) -> Array:
    """`value`, with zeros where it points to an infinite side."""
    xp = namespace(value)
    value = xp.where((value > 0) & xp.isinf(high), 0.0, value)
    return xp.where((value < 0) & xp.isinf(low), 0.0, value)


def largest(*values: float) -> float:
    """The largest number; not a number where one of them is not, which `max` may lose."""
    return float(np.max(values)) if values else 0.0


@dataclass(frozen=True)
class Residuals:
    r"""Relative residuals of an approximate solution of a `StandardQP`; bounds hold exactly.

    `gap` is :math:`|x^TPx + q^Tx + y^Tr + z_\mathrm{box}^Tb|`, with the sides r, b that multipliers
    point to, over the larger of the first two terms, less the rounding
    :math:`16\epsilon|x|^T|P||x|` of confined variables. Where `StandardQP.near` is known, no
    size is less than what it makes. `pairing` does not count as a residual: if multiplier and
    distance both vanish at the solution, it is the square root of their product, which `gap`
    bounds.
    """

    primal: float  # largest violation of a row over the largest of |Cx|, |r|
    dual: float  # largest entry of Px + q + C'y + z_box over its largest term
    gap: float
    complementarity: float = 0.0  # largest product of relative multiplier and distance
    pairing: float = 0.0  # largest min(multiplier, distance): large if the active set is wrong

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
    """Residuals of `x` within its bounds and of multipliers with the right signs. `products` are P
    x and C'y, if they are known already.
    """
    xp, part = p.xp, ROUNDING.cancellation

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
        lambda: largest(part * size_of(p.moduli[1] @ size[0]), p.least_sizes[0]),
    )
    dual = _over(
        size_of(Px + p.q + Cy + z_box),
        size_of(Px, p.q, Cy, z_box),
        lambda: largest(p.rounded_forces(x, y), p.least_sizes[3]),
    )
    row = xp.where(y > 0, p.row_high, xp.where(y < 0, p.row_low, 0.0))
    bound = xp.where(z_box > 0, p.ub, xp.where(z_box < 0, p.lb, 0.0))
    terms = [float(x @ Px), float(p.q @ x), float(y @ row), float(z_box @ bound)]
    error = abs(sum(terms))
    if bool(p.q.any()) and error > ROUNDING.sharp * largest(*(abs(term) for term in terms[:2])):
        most = ROUNDING.product * float(size[0] @ (p.moduli[0] @ size[0]))
        if error < ROUNDING.plain * most and not p.bounded.all():  # else it is that, or nothing
            near = xp.where(p.bounded, size[0], 0.0)
            most = ROUNDING.product * float(near @ (p.moduli[0] @ near))
        error -= min(error, most) if error < ROUNDING.plain * most else 0.0
    gap = _over(
        error,
        largest(*(abs(term) for term in terms[:2])),
        lambda: largest(
            # Without q nothing else has a size where Px = 0, and no x runs away.
            part * float(size[0] @ (xp.abs(Px) if bool(p.q.any()) else p.moduli[0] @ size[0])),
            part * float(xp.abs(p.q) @ size[0]),
            part * float(size[1] @ xp.abs(row)),
            part * float(xp.abs(z_box * bound).sum()),
            p.least_sizes[1],
        ),
    )
    force, length = size_of(Px, p.q, Cy, z_box), size_of(x)
    sizes = largest(length, size_of(Cx)), length
    product, lesser = _pairs(p, y, z_box, Cx, x, force, sizes)
    if largest(product, lesser) > ROUNDING.sharp and length <= p.least_sizes[2]:
        least = p.least_sizes
        sizes = largest(sizes[0], least[0], least[2]), least[2]
        product, lesser = _pairs(p, y, z_box, Cx, x, force, sizes)
    return Residuals(primal, dual, gap, product, lesser)


def _pairs(
    p: StandardQP,
    y: Array,
    z_box: Array,
    Cx: Array,
    x: Array,
    force: float,
    lengths: tuple[float, float],
) -> tuple[float, float]:
    """`complementarity` and `pairing` of `Residuals`: the largest product of a multiplier and the
    distance to its side, and the largest minimum of the two, each relative to its size. `lengths`
    are those of rows and of bounds."""
    xp = p.xp
    product = lesser = 0.0
    for multiplier, value, low, high, length in (
        (y, Cx, p.row_low, p.row_high, lengths[0]),
        (z_box, x, p.lb, p.ub, lengths[1]),
    ):
        if not value.size:
            continue
        side = xp.where(multiplier > 0, high, xp.where(multiplier < 0, low, value))
        near = xp.abs(xp.where(xp.isinf(side), 0.0, value - side)) / (length or 1.0)
        push = xp.abs(multiplier) / (force or 1.0)
        product = largest(product, float((push * near).max()))
        lesser = largest(lesser, float(xp.minimum(push, near).max()))
    return product, lesser


def _over(value: float, size: float, terms: Callable[[], float]) -> float:
    """`value` over the larger of `size` and `terms`, which are computed only if it matters."""
    if not np.isfinite(size):
        return np.nan
    if not value or value <= ROUNDING.sharp * size:
        return value / size if value else 0.0
    size = largest(size, terms())
    if not np.isfinite(size):
        return np.nan
    return float(value / size) if size else np.inf
