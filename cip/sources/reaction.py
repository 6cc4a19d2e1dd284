r"""Sources and decay by symmetric splitting: half before the transport of a step, half after it.

A step from t to t + dt is S D T D S: source and decay over the first half, transport, decay and
source over the second (Strang, SIAM J. Numer. Anal. 5, 1968, 506-517). D is exact at each place, S
adds the integral of the source over its half of the step by Gauss's rule of two points. So the
error in time is of order dt^2, and what a source adds is integrated to degree three in time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import Expression
from cip.formulas.parameters import parameter
from cip.formulas.source import Source
from cip.grid import Grid
from cip.profiles.catalogue import moments
from cip.sources.decay import Decay
from cip.sources.nodal_moments import NodalMoments


class Reaction:
    """What sources and decay do to the moments of a state, each by itself; with derivatives.

    Parameters
    ----------
    grid : Grid
    profile : str
    source, decay : Source or None
    xp : module
        NumPy or CuPy, of the moments.

    Attributes
    ----------
    source_parameters, decay_parameters : tuple of str
    """

    def __init__(
        self, grid: Grid, profile: str, source: Source | None, decay: Source | None, xp: Any
    ) -> None:
        self.source, self.decay = source, decay
        self._grid, self._xp, self._moments = grid, xp, moments(profile, grid.dim)
        self.source_parameters = tuple(source.parameters) if source is not None else ()
        self.decay_parameters = tuple(decay.parameters) if decay is not None else ()
        self._node: Expression | None = None
        if source is not None:
            self.source_formula = source.on(grid)
            self._node = self.source_formula.expression
            self._sources = NodalMoments(grid, self.source_formula, source.steady, xp)
        self._decay: Decay | None = None
        if decay is not None:
            self.decay_formula = decay.on(grid)
            rate = self.decay_formula.expression
            if rate.op == "constant" and not rate.value >= 0.0:
                raise InputError(
                    f"decay: expected a rate >= 0, got {rate.value:.6g}; what grows belongs into "
                    "source"
                )
            self._decay = Decay(grid, profile, self.decay_formula, decay.steady, xp)
        self._kept: dict[Any, Any] = {}

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters; one name in source and decay is one parameter."""
        return tuple(dict.fromkeys([*self.source_parameters, *self.decay_parameters]))

    def check_times(self, start: float, end: float) -> None:
        """Raise `InputError` if snapshots do not cover the time from `start` to `end`."""
        for one in (self.source, self.decay):
            if one is not None:
                one.check_times(start, end)

    def added(self, data: Any, t: float, length: float) -> Any:
        """The moments with what the source adds from t to t + length."""
        if self._node is None:
            return data
        return data + self._increment(self._node, t, length).astype(data.dtype)

    def added_slope(self, name: str, t: float, length: float) -> Any:
        """The derivative of what the source adds in a parameter, for all moments."""
        assert self._node is not None
        return self._increment(self._node.derivative(parameter(name).value), t, length)

    def decayed(self, data: Any, t: float, length: float, transpose: bool = False) -> Any:
        """The moments after their decay from t to t + length, or the transpose of that map."""
        if self._decay is None:
            return data
        decay = self._decay.transposed if transpose else self._decay.applied
        return decay(data, t, length)

    def decay_slope(self, data: Any, name: str, t: float, length: float) -> Any:
        """The derivative of `decayed` in a parameter, from what it has led to."""
        assert self._decay is not None
        return self._decay.slope(data, t, length, name)

    def _increment(self, node: Expression, t: float, length: float) -> Any:
        """What a source adds to all moments from t to t + length, in double precision."""
        key, known = (node, length), self._kept
        if self._sources.steady and key in known:
            return known[key]
        found = self._xp.stack(
            [self._sources.integral(node, moment, t, length) for moment in self._moments]
        )
        if self._sources.steady:
            self._check_finite(found)
            # A new dict: other threads may be reading the old one.
            last = list(known)[-2 - len(self.source_parameters) :]
            self._kept = {**{one: known[one] for one in last}, key: found}
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
    """
    if source is None and decay is None:
        return None
    return Reaction(grid, profile, source, decay, xp)
