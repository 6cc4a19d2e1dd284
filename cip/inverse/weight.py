r"""The weight of the seminorm, chosen by the data.

Around an estimate the problem is linear: :math:`\|J d + r\|^2 + \alpha \|L d + \rho\|^2`, with r in
units of the noise. Only the part of the misfit that the parameters can change says something about
the weight, and of that only what is seen well: fitting the noise elsewhere takes weights that let
the velocity grow without limit. The discrepancy principle is used there, with the degrees of
freedom that the estimate has taken: :math:`\|Q^T (J d + r)\|^2 = s^2 (n - \mathrm{tr} Q^T A Q)`,
where the n columns of Q span these changes of the data and A maps data to predictions (Morozov,
Soviet Math. Dokl. 7, 1966, 414-417; with these degrees of freedom Hall and Titterington, J. R.
Statist. Soc. B 49, 1987, 184-198).
The L-curve's corner is the point of largest curvature (Hansen, SIAM Review 34, 1992, 561-580).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cip.inverse.identifiability import FAINT, UNCERTAIN

Array = NDArray[np.float64]
# Exponents of ten, around equal traces of both terms: below, the seminorm is lost in rounding;
# above, only its null space is left.
_RANGE = (-13.0, 9.0)
_TRIED = 111  # five in a decade
# Changes of the data below this, beside the data, are rounding.
_ROUNDING = 1e-11


@dataclass(frozen=True)
class Linearised:
    """A linear problem with as many rows as parameters, and the misfit that none explains."""

    J: Array  # (parameters, parameters): triangular, derivatives of the misfit
    L: Array  # likewise, of the seminorm
    Q: Array  # (parameters, n): orthonormal changes of reduced data, seen well
    r: Array  # right-hand side of J
    rho: Array  # right-hand side of L
    rest: float  # square of the misfit that no parameters remove
    count: int  # number of data
    depends: bool  # some data change with a parameter, beyond rounding
    known: bool  # the misfit is in units of the noise

    @classmethod
    def of(
        cls,
        J: Array,
        r: Array,
        L: Array,
        rho: Array,
        size: Array,
        scale: float,
        known: bool,
    ) -> Linearised:
        """From all rows. `size` are changes of the parameters that change the velocity by itself; a
        direction is seen well if such a change is at least two deviations of data of known noise,
        and not negligible beside the best one. `scale` is the rms of the data in the units of r."""
        (one, right, rest), (two, rough, _) = _reduced(J, r), _reduced(L, rho)
        U, s, _ = np.linalg.svd(one * size)
        seen = s > FAINT * s[0]
        if known:
            seen &= s >= 1.0 / UNCERTAIN
        depends = bool(s[0] > _ROUNDING * np.sqrt(len(r)) * scale)
        return cls(one, two, U[:, seen], right, rough, rest, len(r), depends, known)

    @property
    def scale(self) -> float:
        """The weight at which both terms have equal traces."""
        return float(np.sum(self.J**2) / np.sum(self.L**2))

    @property
    def variance(self) -> float:
        """Variance of the misfit that no parameters remove; at least 1 where the noise is known."""
        free = max(self.count - self.J.shape[1], 1)
        found = self.rest / free
        return max(1.0, found) if self.known else found

    def at(self, weight: float) -> tuple[float, float, float]:
        """Squares of misfit (what is seen) and seminorm, and the degrees of freedom taken."""
        stacked = np.vstack([self.J, np.sqrt(weight) * self.L])
        right = -np.concatenate([self.r, np.sqrt(weight) * self.rho])
        # In the order of scale: columns differ by the units of parameters.
        size = np.linalg.norm(stacked, axis=0)
        size[size == 0.0] = 1.0
        U, s, Vt = np.linalg.svd(stacked / size, full_matrices=False)
        kept = s > np.finfo(float).eps * len(stacked) * s[0]
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        d = Vt.T @ (U.T @ right / s) / size
        n = len(self.J)
        return (
            float(np.sum((self.Q.T @ (self.J @ d + self.r)) ** 2)),
            float(np.sum((self.L @ d + self.rho) ** 2)),
            float(np.sum((self.Q.T @ U[:n]) ** 2)),
        )


def _reduced(matrix: Array, right: Array) -> tuple[Array, Array, float]:
    """Triangular factor, transformed right-hand side, and the square of what is left of it."""
    n = matrix.shape[1]
    rows = np.zeros((max(len(right), n + 1), n + 1))
    rows[: len(right), :n], rows[: len(right), n] = matrix, right
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    return R[:n, :n], R[:n, n], float(R[n, n] ** 2)


def by_discrepancy(problem: Linearised) -> float:
    """The largest weight whose misfit the noise explains."""
    weights = problem.scale * np.logspace(*_RANGE[::-1], _TRIED)
    unknowns, variance = problem.Q.shape[1], problem.variance

    def excess(weight: float) -> float:
        misfit, _, taken = problem.at(weight)
        return misfit - variance * (unknowns - taken)

    above = None
    for weight in weights:
        if excess(weight) <= 0.0:
            break
        above = weight
    if above is None or above == weights[-1]:
        return float(weight)
    low, high = weight, above
    while high > 1.02 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
    return float(low)


def by_l_curve(problem: Linearised) -> float:
    """The weight at the corner of the curve of misfit and seminorm, both in logarithms."""
    weights: Array = problem.scale * np.logspace(*_RANGE, _TRIED)
    found: Array = np.array([problem.at(float(weight))[:2] for weight in weights])
    found[:, 0] += problem.rest + float(
        problem.r @ problem.r - np.sum((problem.Q.T @ problem.r) ** 2)
    )
    tiny = np.finfo(float).tiny
    x, y = 0.5 * np.log(found[:, 0] + tiny), 0.5 * np.log(found[:, 1] + tiny)
    dx, dy = np.gradient(x), np.gradient(y)
    turn = dx * np.gradient(dy) - dy * np.gradient(dx)
    speed = np.hypot(dx, dy)
    # Where neither changes the curve stands still and has no curvature.
    moving = speed > 1e-3 * speed.max()
    curvature = np.where(moving, turn / np.where(moving, speed, 1.0) ** 3, -np.inf)
    return float(weights[np.argmax(curvature)])
