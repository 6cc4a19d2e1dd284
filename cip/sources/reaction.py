r"""Sources and decay by symmetric splitting: half before the transport of a step, half after it.

A step from t to t + dt is S D T D S: source and decay over the first half, transport, decay and
source over the second (Strang, SIAM J. Numer. Anal. 5, 1968, 506-517). D is exact at each place, S
adds the integral of the source over its half of the step by Gauss's rule of two points. So the
error in time is of order dt^2, and what a source adds is integrated to degree three in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cip.errors import InputError, NotSupported
from cip.formulas.expression import Expression
from cip.formulas.parameters import parameter
from cip.grid import Grid
from cip.profiles.catalogue import moments
from cip.sources.decay import Decay
from cip.sources.nodal_moments import NodalMoments
from cip.sources.source import Source


class Reaction:
    """What sources and decay do to the moments of a state, and its derivatives.

    Parameters
    ----------
    grid : Grid
    profile : str
    source, decay : Source or None
    xp : module
        NumPy or CuPy, of the moments.
    """

    def __init__(
        self, grid: Grid, profile: str, source: Source | None, decay: Source | None, xp: Any
    ) -> None:
        self.source, self.decay = source, decay
        self._grid, self._xp, self._moments = grid, xp, moments(profile, grid.dim)
        self.parameters = tuple(source.parameters) if source is not None else ()
        self._node: Expression | None = None
        if source is not None:
            self.source_formula = source.on(grid)
            self._node = self.source_formula.expression
            self._sources = NodalMoments(grid, self.source_formula, source.steady, xp)
        self._decay: Decay | None = None
        if decay is not None:
            if decay.parameters:
                raise NotSupported("decay: its parameters have no derivatives; write numbers")
            self.decay_formula = decay.on(grid)
            rate = self.decay_formula.expression
            if rate.op == "constant" and not rate.value >= 0.0:
                raise InputError(
                    f"decay: expected a rate >= 0, got {rate.value:.6g}; what grows belongs into "
                    "source"
                )
            self._decay = Decay(grid, profile, self.decay_formula, decay.steady, xp)
        self._kept: dict[Any, Any] = {}

    def check_times(self, start: float, end: float) -> None:
        """Raise `InputError` if snapshots do not cover the time from `start` to `end`."""
        for one in (self.source, self.decay):
            if one is not None:
                one.check_times(start, end)

    def before(self, data: Any, t: float, dt: float) -> Any:
        """The moments after the first half of the step [t, t + dt], to be transported."""
        half = 0.5 * dt
        if self._node is not None:
            data = data + self._increment(self._node, t, half).astype(data.dtype)
        return data if self._decay is None else self._decay.applied(data, t, half)

    def after(self, data: Any, t: float, dt: float) -> Any:
        """The moments at the end of the step [t, t + dt], from those transported."""
        half = 0.5 * dt
        if self._decay is not None:
            data = self._decay.applied(data, t + half, half)
        if self._node is not None:
            data = data + self._increment(self._node, t + half, half).astype(data.dtype)
        return data

    def change_before(self, data: Any, t: float, dt: float, direction: Any) -> Any:
        """The derivative of `before` along a change of the moments and of the parameters."""
        half = 0.5 * dt
        data = self._moved(data, t, half, direction)
        return data if self._decay is None else self._decay.applied(data, t, half)

    def change_after(self, data: Any, t: float, dt: float, direction: Any) -> Any:
        """The derivative of `after`."""
        half = 0.5 * dt
        if self._decay is not None:
            data = self._decay.applied(data, t + half, half)
        return self._moved(data, t + half, half, direction)

    def weight_before(self, weight: Any, t: float, dt: float, gradient: Any) -> Any:
        """The transpose of `change_before`; the parameters' part is added to `gradient`."""
        half = 0.5 * dt
        if self._decay is not None:
            weight = self._decay.transposed(weight, t, half)
        self._gather(weight, t, half, gradient)
        return weight

    def weight_after(self, weight: Any, t: float, dt: float, gradient: Any) -> Any:
        """The transpose of `change_after`; the parameters' part is added to `gradient`."""
        half = 0.5 * dt
        self._gather(weight, t + half, half, gradient)
        return weight if self._decay is None else self._decay.transposed(weight, t + half, half)

    def _moved(self, data: Any, t: float, length: float, direction: Sequence[float]) -> Any:
        for name, size in zip(self.parameters, direction, strict=True):
            if size:
                data = data + float(size) * self._increment(self._slope(name), t, length)
        return data

    def _gather(self, weight: Any, t: float, length: float, gradient: Any) -> None:
        for q, name in enumerate(self.parameters):
            gradient[q] += float((weight * self._increment(self._slope(name), t, length)).sum())

    def _slope(self, name: str) -> Expression:
        assert self._node is not None
        return self._node.derivative(parameter(name).value)

    def _increment(self, node: Expression, t: float, length: float) -> Any:
        """What a source adds to all moments from t to t + length, in double precision."""
        key = (node, length)
        if self._sources.steady and key in self._kept:
            return self._kept[key]
        found = self._xp.stack(
            [self._sources.integral(node, moment, t, length) for moment in self._moments]
        )
        if self._sources.steady:
            self._check_finite(found)
            while len(self._kept) > 2 + len(self.parameters):
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = found
        return found

    def _check_finite(self, found: Any) -> None:
        with np.errstate(all="ignore"):
            total = float(found.sum())
        if not np.isfinite(total):
            raise InputError(
                "source: it, or a derivative that the profile needs, is NaN or infinite at a node"
            )


def reaction(grid: Grid, profile: str, source: Any, decay: Any, xp: Any) -> Reaction | None:
    """The reaction of a solver, from its arguments `source` and `decay`; None without them.

    Parameters
    ----------
    grid : Grid
    profile : str
    source, decay : Source or None
    xp : module

    Raises
    ------
    InputError
        A function that does not fit the grid, a negative rate.
    NotSupported
        A rate of decay with parameters.
    """
    if source is None and decay is None:
        return None
    return Reaction(grid, profile, source, decay, xp)
