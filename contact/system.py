"""The discrete contact problem: what a solver is given and what a result is proved against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body import ElasticBody
from contact.boundary import Friction, project
from contact.errors import InputError
from contact.rows import ContactRows, live_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactSystem:
    """Equilibrium ``S u + G^T mu + T^T t = f`` and the laws at the contact points.

    Attributes
    ----------
    body : ElasticBody
    rows : ContactRows
        Its ``gap`` is the one in force.
    load : ndarray, shape (ndofs,)
    law : {"coulomb", "tresca", None}
    friction : ndarray, shape (m,)
        Coulomb: the coefficient F. Tresca: the bound g as a force, i.e. traction times weight.
    slip_from : ndarray, shape (m, dim - 1), optional
        Tangential displacement of the last converged step of a load history: friction opposes
        the slip since then. None: at rest in the reference state.
    """

    body: ElasticBody
    rows: ContactRows
    load: Array
    law: str | None
    friction: Array
    slip_from: Array | None = None

    def slip_increment(self, u: Array) -> Array:
        """Tangential displacement since the last step, that of the friction law, (m, dim - 1)."""
        u_t = (self.rows.T @ u).reshape(self.rows.gap.size, -1)
        return u_t if self.slip_from is None else u_t - self.slip_from

    def bound(self, mu: Array) -> Array:
        """Friction bound g of every point for the normal forces mu, shape (m,)."""
        return Friction(self.friction, self.law == "coulomb").bound(mu)

    def scaled_friction(self, scale: Array) -> Friction | None:
        """The friction law with forces multiplied by the scale of each point; None without."""
        if self.law is None:
            return None
        coulomb = self.law == "coulomb"
        return Friction(self.friction if coulomb else self.friction * scale, coulomb)

    def kkt(self, u: Array, mu: Array, t: Array) -> dict[str, float]:
        """Relative residuals of every law, computed from the problem and (u, mu, t) alone.

        Returns
        -------
        dict
            ``equilibrium``: largest unbalanced force at a free dof over the largest force that
            cancels there; ``support``: violation of the prescribed displacements;
            ``penetration``, ``sign``, ``complementarity``: the contact law; ``cone``, ``slip``:
            |t| <= g, and t = P_g(t + c u_t) with the slip increment u_t. Lengths are relative to
            the largest displacement, forces to the largest contact force.
        """
        rows = self.rows
        T, u0 = self.body.constraint
        S = self.body.stiffness
        force = S @ u + rows.G.T @ mu + rows.T.T @ t.ravel() - self.load
        terms = self.body.absolute_stiffness @ np.abs(u) + np.abs(self.load)
        _, lengths = self.body.lengths
        length = float(np.abs(u).max(initial=0.0)) or 1.0
        size = max(float(np.abs(mu).max(initial=0.0)), float(np.abs(t).max(initial=0.0))) or 1.0
        reachable = np.isfinite(rows.gap)
        through = np.where(reachable, rows.G @ u - np.where(reachable, rows.gap, 0.0), -np.inf)
        u_t = self.slip_increment(u)
        g = self.bound(mu)
        live = live_rows(rows.T, self.body).reshape(t.shape)
        returned = t - project(t + size / length * u_t, g)
        prescribed = u - u0
        prescribed = prescribed - T @ (T.T @ prescribed)
        result = {
            "equilibrium": _ratio(T.T @ force / lengths, abs(T.T @ terms) / lengths),
            "support": _largest(prescribed) / length,
            "penetration": _largest(np.maximum(through, 0.0)) / length,
            "sign": _largest(np.maximum(-mu, 0.0)) / size,
            "complementarity": _largest(np.minimum(np.abs(mu) / size, np.abs(through) / length)),
            "cone": _largest(np.maximum(np.linalg.norm(t, axis=1) - g, 0.0)) / size,
            "slip": _largest(returned[live]) / size,
        }
        if any(np.isnan(value) for value in result.values()):
            raise InputError("kkt: the state (u, mu, t) holds NaN")
        return result

    def energy(self, u: Array) -> float:
        """Potential energy ``u^T S u / 2 - f^T u``, without friction."""
        return float(0.5 * u @ (self.body.stiffness @ u) - self.load @ u)


def _largest(x: Any) -> float:
    return float(np.abs(x).max(initial=0.0))


def _ratio(error: Any, size: Any) -> float:
    """Largest component of error over the largest component of size."""
    return _largest(error) / (_largest(size) or 1.0)
