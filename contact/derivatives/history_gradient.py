"""Gradients of a function of a load history, backward through the memory of friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.derivatives.gradient import ContactGradient, vertices_of
from contact.errors import InputError

Array = NDArray[np.float64]


class Backward:
    """Steps taken backward: from the slip of a step, or its displacement, the next one counts."""

    def __init__(self) -> None:
        self._later: dict[str, Array] = {}  # derivatives of later steps by this one, by its name

    def step(
        self, result: Any, before: Any, given: dict[str, Any], problem: Any = None
    ) -> ContactGradient:
        """The gradient of a step, after which comes the one `before`, or None.
        Raises InputError if the step does not follow that one."""
        if before is not None and not _follows(result, before):
            raise InputError(
                "vjp: a step of the history does not follow the one before it, because it was "
                "halved, or steps are missing; take more times, and LoadStepper(halvings=0)"
            )
        given = dict(given)
        for name, more in self._later.items():
            given[name] = more + (0.0 if given.get(name) is None else given[name])
        found: ContactGradient = result.vjp(**given, problem=problem)
        self._later = {} if result.system.slip_from is None else found.memory()
        return found


def _follows(result: Any, before: Any) -> bool:
    start, origin = result.system.slip_from, result.origin
    if origin is not None and origin.slide is not None:
        return bool(np.array_equal(origin.slide.last, before.u))
    if start is None:
        return False
    slip = np.where(before.system.rows.ties[:, None], 0.0, before.slip)
    size = np.abs(slip).max(initial=0.0)
    return start.shape == slip.shape and bool(np.abs(start - slip).max(initial=0.0) <= 1e-7 * size)


@dataclass(frozen=True, eq=False)
class HistoryGradient:
    """Gradients of a function of a load history; what `LoadHistory.vjp` returns.

    Attributes
    ----------
    steps : tuple of ContactGradient
        By the data of each step: its loads, gap, motions, ...

    References
    ----------
    K. Ito and K. Kunisch, Lagrange Multiplier Approach to Variational Problems and Applications,
    SIAM 2008, chapter 8.

    Examples
    --------
    A block that is pressed and dragged; the drag is friction times pressure:

    >>> import numpy as np
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, LoadStepper
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.0)
    >>> problem = ContactProblem(body.fix("top", "xy"), "bottom", 0.0, friction=0.2)
    >>> stepper = LoadStepper(problem).move("top", "y", -0.02, lambda t: 1.0)
    >>> history = stepper.move("top", "x", 0.1).run([0.5, 1.0])
    >>> gradient = history.vjp(resultant=[(0.0, 0.0), (1.0, 0.0)])
    >>> ratio = gradient.friction.sum() / history.resultant[1, 1]
    >>> gradient.friction.shape, bool(-1.5 < ratio < -0.5)
    ((9,), True)
    """

    steps: tuple[ContactGradient, ...]

    def __repr__(self) -> str:
        return f"HistoryGradient({len(self.steps)} steps)"

    def total(self, part: Callable[[ContactGradient], Any]) -> Array:
        """The sum over all steps of a part of their gradients, such as ``lambda g: g[body].E``.

        Parameters
        ----------
        part : callable
            `ContactGradient` to array.

        Returns
        -------
        ndarray
        """
        return np.asarray(sum(part(step) for step in self.steps))

    @property
    def E(self) -> Array:
        """By Young's modulus of the body, in its shape: () or (ncells,)."""
        return self.total(lambda step: step.E)

    @property
    def nu(self) -> Array:
        """By Poisson's ratio of the body, in its shape: () or (ncells,)."""
        return self.total(lambda step: step.nu)

    @property
    def friction(self) -> Array:
        """By `ContactProblem.friction` of every point, shape (m,)."""
        return self.total(lambda step: step.friction)

    @cached_property
    def vertices(self) -> list[Array]:
        """By the places of the nodes of each body, the shapes of ``mesh.doflocs``."""
        return vertices_of(self.steps)

    @property
    def degenerate(self) -> NDArray[np.bool_]:
        """Points that are degenerate in some step, shape (m,)."""
        return np.any([step.degenerate for step in self.steps], axis=0)


def history_gradient(
    results: Sequence[Any], given: dict[str, Any], problem: Any
) -> HistoryGradient:
    """Gradients of a function with derivatives `given`, one a step; see `LoadHistory.vjp`."""
    count = len(results)
    read = {name: value for name, value in given.items() if value is not None}
    for name, value in read.items():
        if len(value) != count:
            raise InputError(f"{name}: expected {count} arrays, one a step, got {len(value)}")
    if not count:
        raise InputError("history: has no finished step")
    steps, backward = list[ContactGradient](), Backward()
    for k in range(count - 1, -1, -1):
        own = {name: value[k] for name, value in read.items()}
        steps.append(backward.step(results[k], results[k - 1] if k else None, own, problem))
    return HistoryGradient(tuple(reversed(steps)))
