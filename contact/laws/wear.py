"""Archard's law of wear: the depth that slip under pressure takes off surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.errors import InputError
from skfem_adini.ground.arguments import choice, evaluated

Array = Any


@dataclass(frozen=True)
class Wear:
    r"""Archard's law: depths worn off both sides, :math:`\dot h = k(x, p)\, p\, |\dot s|`.

    p is the compressive pressure and s the slip. In a load history the gap grows by the depths, at
    the pressure at the end of each step and by the slip of the step (backward Euler).

    Parameters
    ----------
    coefficient : float, callable or array
        k of the body, area per force: the wear volume of the whole contact is k F s. A function of
        the places x (dim, m), or of the pressures p (m,), or one value a contact point.
    other : float, callable or array
        k of the other side, body or obstacle, at the same contact points.
    by : {"place", "pressure"}
        What functions are of.

    Raises
    ------
    InputError
        An unknown word. `ContactProblem` and `GridContact` refuse negative coefficients.

    References
    ----------
    J. F. Archard, Contact and rubbing of flat surfaces, J. Appl. Phys. 24 (1953), 981-988.

    Examples
    --------
    A flat foundation dragged by 2 along a block under the force .1 takes k F s off it:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, LoadStepper, Rigid, Wear
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.0)
    >>> body = body.fix("left", "x").fix("right", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, wear=Wear(1e-3))
    >>> stepper = LoadStepper(problem).obstacle(lambda t: Rigid(0.0, displacement=(t, 0.0)))
    >>> last = stepper.run([1.0, 2.0]).results[-1]
    >>> round(float(last.worn_volume.sum()), 12)
    0.0002
    """

    coefficient: Any
    other: Any = 0.0
    by: str = "place"

    def __post_init__(self) -> None:
        choice("by", self.by, ("place", "pressure"))

    def at(self, x: Array) -> Array | tuple[Callable[[Array], Array], ...]:
        """Coefficients of both sides at the places x, (2, m), or functions of the pressure."""
        both = (self.coefficient, self.other)
        if self.by == "place":
            return np.stack([coefficients("wear", k, x) for k in both])
        for k in both:  # raise errors here
            coefficients("wear", k, np.ones(x.shape[1:]), x.shape[1:])
        return both


def coefficients(name: str, value: Any, at: Array, shape: Any = None) -> Array:
    """Values from a number, an array or a function of places (dim, ...), or of pressures if a shape
    is given; `InputError` unless finite, not negative and one for each point."""
    shape = at.shape[1:] if shape is None else shape
    found = evaluated(name, value, at)
    if found.shape not in ((), shape) or not np.all(np.isfinite(found) & (found >= 0)):
        raise InputError(
            f"{name}: expected finite numbers >= 0, one or of shape {shape}, got shape "
            f"{found.shape}"
        )
    return np.broadcast_to(found, shape).copy()
