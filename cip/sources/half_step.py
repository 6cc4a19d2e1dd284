r"""What acts before or after the transport of a step, with its derivatives.

With the decay D and what the source adds, S, the half before is :math:`z \mapsto D (z + S)`, that
after :math:`z \mapsto D z + S`. Both are linear in z. In parameters of the source S has the
derivative :math:`S_p`; in those of the decay :math:`D z` has :math:`-K_p D z`
(`cip.sources.reaction`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cip.sources.reaction import Reaction


@dataclass(frozen=True)
class HalfStep:
    """A half of a reaction's step."""

    reaction: Reaction
    t: float  # start of its time
    length: float  # duration
    after: bool  # whether it stands after the transport

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the parameters of the source and of the decay."""
        return self.reaction.parameters

    @property
    def reads_state(self) -> bool:
        """Whether derivatives in the parameters depend on the moments."""
        return bool(self.reaction.decay_parameters)

    def applied(self, data: Any) -> Any:
        """The moments after this half."""
        end = self._decayed(data)
        return self.reaction.added(end, self.t, self.length) if self.after else end

    def linear(self, change: Any) -> Any:
        """The change of the moments after it for one before it."""
        return self.reaction.decayed(change, self.t, self.length)

    def along(self, data: Any, direction: Any) -> Any:
        """The change of the moments after it for a change of the parameters, in the order of
        `columns`. `data` are the moments before it.
        """
        reaction, added, total = self.reaction, 0.0, 0.0
        end = self._decayed(data) if self.reads_state else None
        for name, size in zip(self.columns, map(float, direction), strict=True):
            if size and name in reaction.source_parameters:
                added = added + size * reaction.added_slope(name, self.t, self.length)
            if size and name in reaction.decay_parameters:
                total = total + size * reaction.decay_slope(end, name, self.t, self.length)
        if self.after or isinstance(added, float):
            return total + added
        return total + self.linear(added)

    def pull_back(self, data: Any, weight: Any) -> tuple[Any, list[float]]:
        """The weight of the moments before it, `data`, and the derivatives of weight . (moments
        after it) in the parameters.
        """
        reaction, found = self.reaction, []
        end = self._decayed(data) if self.reads_state else None
        before = reaction.decayed(weight, self.t, self.length, transpose=True)
        entering = weight if self.after else before
        for name in self.columns:
            total = 0.0
            if name in reaction.source_parameters:
                slope = reaction.added_slope(name, self.t, self.length)
                total += float((entering * slope).sum())
            if name in reaction.decay_parameters:
                slope = reaction.decay_slope(end, name, self.t, self.length)
                total += float((weight * slope).sum())
            found.append(total)
        return before, found

    def _decayed(self, data: Any) -> Any:
        """The moments after the decay; before the transport the source acts first."""
        if not self.after:
            data = self.reaction.added(data, self.t, self.length)
        return self.linear(data)


def halves(reaction: Reaction, t: float, dt: float) -> tuple[HalfStep, HalfStep]:
    """What stands before and after the transport of the step [t, t + dt]."""
    half = 0.5 * dt
    return HalfStep(reaction, t, half, False), HalfStep(reaction, t + half, half, True)
