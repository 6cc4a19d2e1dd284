"""One line of the history of a solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Iteration:
    """One line of a solver's history.

    Attributes
    ----------
    step : int
    phase : str
        Which part of the method made the step.
    active, stick, slip : int
        Number of points in contact; and, of the points with a positive friction bound, how many
        stick and how many slip.
    residual : float
        Relative residual after the step; NaN where it is not computed.
    energy : float
        Potential energy plus the friction functional, up to a constant; NaN except for
        ``fixed_point`` with given friction.
    change : float
        Relative change of the displacement of the contact points; NaN except for ``fixed_point``.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> last = problem.solve().history[-1]
    >>> last.active, last.residual < 1e-10
    (9, True)
    """

    step: int
    phase: str
    active: int
    stick: int
    slip: int
    residual: float
    energy: float = np.nan
    change: float = np.nan

    def __str__(self) -> str:
        residual = "" if np.isnan(self.residual) else f"   residual {self.residual:.1e}"
        zones = f", stick {self.stick:4d}, slip {self.slip:4d}" if self.stick or self.slip else ""
        return f"{self.phase:>12} {self.step:3d}   active {self.active:4d}{zones}{residual}"


Report = Callable[[Iteration], None]
