r"""What candidates for sensors tell, in the space of their reports.

With A from independent unknowns to all reports of all candidates and F to what is to be known, all
that a choice of sensors achieves follows from :math:`G = A A^T` and :math:`C = A F^T F A^T`.
Weights w between 0 and 1 on the candidates relax the choice; both criteria are concave in them
(Pukelsheim, Optimal Design of Experiments, 1993, chapters 5 and 9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]
# The relaxation ends when its two bounds agree to this fraction, or after this many steps.
_GAP, _STEPS = 1e-3, 200
# Halvings of the interval in which the best length of a step lies.
_BISECTIONS = 20


@dataclass(frozen=True)
class DesignKernels:
    """The kernels, and which candidate each report belongs to.

    Attributes
    ----------
    G : ndarray, shape (m, m)
    C : ndarray, shape (m, m) or None
        For the criterion "A"; None for "D".
    owner : ndarray of int, shape (m,)
    count : int
        Number of candidates.
    """

    G: Array
    C: Array | None
    owner: NDArray[np.int64]
    count: int

    def after(self, chosen: list[int]) -> DesignKernels:
        """The kernels once the reports of some candidates are known."""
        weights = np.zeros(self.count)
        weights[chosen] = 1.0
        G, C = self._posterior(weights)
        return DesignKernels(G, C, self.owner, self.count)

    def gains(self) -> Array:
        """What each candidate adds by itself."""
        found = np.zeros(self.count)
        for j in range(self.count):
            own = np.flatnonzero(self.owner == j)
            T = np.eye(own.size) + self.G[np.ix_(own, own)]
            if self.C is None:
                found[j] = 0.5 * np.linalg.slogdet(T)[1]
            else:
                found[j] = np.trace(np.linalg.solve(T, self.C[np.ix_(own, own)]))
        return found

    def value(self, weights: Array) -> float:
        """The criterion, 0 without sensors: nats of information, or variance removed."""
        s = np.sqrt(weights[self.owner])
        factor = cho_factor(np.eye(s.size) + s[:, None] * self.G * s)
        if self.C is None:
            return float(np.sum(np.log(np.diag(factor[0]))))
        return float(np.trace(cho_solve(factor, s[:, None] * self.C * s)))

    def slopes(self, weights: Array) -> Array:
        """Its derivative in each weight."""
        G, C = self._posterior(weights)
        each = 0.5 * np.diag(G) if C is None else np.diag(C)
        return np.bincount(self.owner, each, minlength=self.count).astype(float)

    def _posterior(self, weights: Array) -> tuple[Array, Array | None]:
        s = np.sqrt(weights[self.owner])
        factor = cho_factor(np.eye(s.size) + s[:, None] * self.G * s)
        E = np.eye(s.size) - (s[:, None] * cho_solve(factor, s[:, None] * self.G)).T
        return E @ self.G, None if self.C is None else E @ self.C @ E.T


def relaxed_bound(kernels: DesignKernels, allowed: NDArray[Any], budget: int) -> float:
    """No choice of `budget` allowed candidates has a larger value than this.

    Frank and Wolfe's method for the relaxation. At any weights w the tangent plane lies above the
    concave criterion, so its maximum over all choices is a bound, however far w is from optimal.
    """
    weights = np.where(allowed, budget / np.count_nonzero(allowed), 0.0)
    bound = np.inf
    for _ in range(_STEPS):
        value, slopes = kernels.value(weights), kernels.slopes(weights)
        best = np.flatnonzero(allowed)[np.argsort(-slopes[allowed], kind="stable")[:budget]]
        vertex = np.zeros(weights.size)
        vertex[best] = 1.0
        gap = float(slopes @ (vertex - weights))
        bound = min(bound, value + gap)
        if bound - value <= _GAP * abs(bound):
            break
        weights = weights + _length(kernels, weights, vertex - weights) * (vertex - weights)
    return bound


def _length(kernels: DesignKernels, weights: Array, direction: Array) -> float:
    """The step in [0, 1] at which the slope along a direction vanishes, by bisection."""
    low, high = 0.0, 1.0
    if kernels.slopes(weights + direction) @ direction >= 0.0:
        return 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if kernels.slopes(weights + middle * direction) @ direction > 0.0:
            low = middle
        else:
            high = middle
        if high - low < 0.05 * high:  # an exact step gains nothing over a near one
            break
    return low if low > 0.0 else high
