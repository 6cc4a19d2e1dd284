"""The certificate of a result, computed on the host in pairs of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.paired_rows import rows_times
from contact.arrays.pairs import Pairs
from contact.checks.paired_bodies import PairedBody, largest, paired_body
from contact.errors import InputError
from contact.laws.newton import LIMITS
from contact.laws.options import checked_tolerance, default_tolerance
from contact.result.certify import refuse_residuals
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactState, beside_travel


def recheck(result: ContactResult, tol: float | None = None) -> dict[str, float]:
    r"""Compute the certificate of a result anew, on the host and in twice the working precision.

    The residuals have the names and scales of ``result.kkt``, for comparison. They are computed by
    independent code: all sums that cancel are formed in pairs of float64, of about 32 digits
    (`contact.arrays.pairs`). They are the residuals of the stored numbers u, mu and t, while those
    of ``result.kkt`` include the rounding of their own sums.

    ==================  ============================================================================
    equilibrium         ``S u + G^T mu + T^T t - f`` at the free unknowns; S is the matrix of the
                        body, in slender cells the strains, in a `LayeredBlock` its cells
    balance             loads, reactions and contact forces of each body, added up
    support             ``u - u0`` where displacements are prescribed
    penetration, ...    the laws of contact and friction, of ties and of driven obstacles, from
                        ``G u - d``, ``T u`` and the forces
    ==================  ============================================================================

    Parameters
    ----------
    result : ContactResult
        Of any body with a mesh, of several, or of a `LayeredBlock`; also one from a file, or of a
        step of a load history.
    tol : float, optional
        Tolerance of the residuals, which are relative; default: that of the solve.

    Returns
    -------
    dict
        The residuals, see `ContactResult.kkt`.

    Raises
    ------
    NotConverged
        A residual exceeds the tolerance; the message names it.
    InputError
        Not a ContactResult, one of a `DistributedBody`, NaN, or a tolerance outside (0, 1).

    Notes
    -----
    The curves of compliant surfaces, and the scales that residuals are divided by, are evaluated in
    float64. A `GridResult` holds no displacements: its own certificate transforms them anew.

    References
    ----------
    T. J. Dekker, Numer. Math. 18 (1971), 224-242. T. Ogita, S. M. Rump and S. Oishi, Accurate sum
    and dot product, SIAM J. Sci. Comput. 26 (2005), 1955-1988.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, recheck
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> result = ContactProblem(body, "bottom", 0.0, friction=0.3).solve()
    >>> again = recheck(result)
    >>> again.keys() == result.kkt.keys(), max(again.values()) < 1e-12
    (True, True)
    """
    if not isinstance(result, ContactResult):
        raise InputError(f"result: expected a ContactResult, got {type(result).__name__}")
    if tol is None:
        tol = default_tolerance(result.method) if result.tol is None else result.tol
    else:
        tol = checked_tolerance(tol)
    bodies = [paired_body(body) for body in result.system.body.bodies]
    kkt = PairedResiduals(result, bodies).all()
    if any(np.isnan(value) for value in kkt.values()):
        raise InputError("result: the state (u, mu, t) holds NaN")
    refuse_residuals(result, kkt, tol, result.slack)
    return kkt


Array = NDArray[np.float64]


class PairedResiduals:
    """Residuals of a state and its bodies in pairs, and the scales that they are divided by."""

    def __init__(self, state: ContactState, bodies: list[PairedBody]) -> None:
        self.system = state.system
        self.u, self.mu, self.t, self.w = state.u, state.mu, state.t, state.motion
        rows = self.system.rows
        self.rows, self.free = rows, ~rows.ties
        contact = rows_times(rows.G.T, self.mu) + rows_times(rows.T.T, self.t.ravel())
        load, moduli = self.system.load, self.system.moduli
        terms = np.abs(load) if moduli is None else moduli
        self.parts = [
            _BodyForces(body, self.u[own], contact[own], load[own], terms[own])
            for body, own in zip(bodies, self.system.body.slices, strict=True)
        ]
        give = max(part.body.host.local_displacement(part.contact.rounded) for part in self.parts)
        self.length = max(*(part.reach for part in self.parts), give) or 1.0
        self.unbalanced, self.cancelling = max(
            (part.equilibrium() for part in self.parts), key=lambda pair: pair[0] / (pair[1] or 1.0)
        )
        self.noise = LIMITS.noise * self.cancelling
        self.size = max(largest(self.mu), largest(self.t), self.noise) or 1.0

    def all(self) -> dict[str, float]:
        """The residuals, as `ContactSystem.kkt` names them."""
        u_n, u_t = self._relative()
        ties, gap = self.rows.ties, self.rows.gap
        touchable = np.isfinite(gap)
        off = (u_n - np.where(touchable, gap, 0.0)).rounded
        through = np.where(touchable & self.free, off, -np.inf)
        kkt = {
            "equilibrium": self.unbalanced / (self.cancelling or 1.0),
            "balance": max(part.balance() for part in self.parts),
            "support": max(part.body.support_error(part.u) for part in self.parts) / self.length,
            **self._contact(through),
            **self._friction(u_t),
        }
        if ties.any():
            opened = max(largest(off[ties]), largest(u_t.rounded[ties]))
            kkt["tie"] = opened / self.length
        motion = self.system.motion
        if motion is not None and np.any(motion.free):
            kkt["obstacle"] = self._on_obstacles(motion)
        return kkt

    def _relative(self) -> tuple[Pairs, Pairs]:
        """Displacement relative to obstacles; the tangential one since the last step."""
        rows, motion = self.rows, self.system.motion
        u_n = rows_times(rows.G, self.u)
        u_t = rows_times(rows.T, self.u)
        if motion is not None and self.w is not None:
            known = np.nan_to_num(self.w)
            u_n = u_n - rows_times(motion.normal, known)
            u_t = u_t - rows_times(motion.tangent, known)
        u_t = u_t.reshape(*self.t.shape)
        if motion is not None and motion.travel is not None:
            u_t = u_t - motion.travel
        return u_n, u_t if self.system.slip_from is None else u_t - self.system.slip_from

    def _contact(self, through: Array) -> dict[str, float]:
        """Residuals of the contact law; on compliant surfaces the deviation of forces from the
        curve."""
        mu, size, length, free = self.mu, self.size, self.length, self.free
        force = np.maximum(np.abs(mu) - self.noise, 0.0) / size
        found = {
            "penetration": largest(np.maximum(through, 0.0)) / length,
            "sign": _beyond(-mu[free], self.noise) / size,
            "complementarity": largest(np.minimum(force, np.abs(through) / length)[free]),
        }
        if self.system.lawful:
            slip = np.linalg.norm(self._relative()[1].rounded, axis=1)
            found |= self.system.off_the_curve(mu, through, slip, size, length)
            if self.system.surface is not None and self.system.surface.adhesion is not None:
                del found["sign"]
        return found

    def _friction(self, u_t: Pairs) -> dict[str, float]:
        """The friction law: |t| <= g, and t the projection of ``t + c u_t`` onto that."""
        system, free, t = self.system, self.free, Pairs.of(self.t)
        coulomb = system.law == "coulomb"
        given = Pairs.of(system.friction)
        g = given * np.maximum(self.mu, 0.0) if coulomb else given
        q = t + u_t * (self.size / self.length)
        length = (q * q).sum(axis=1).sqrt()
        beyond = length.rounded > g.rounded
        factor = g / Pairs.where(beyond, length, 1.0)
        slipped = q * factor.reshape(-1, 1)
        returned = (t - Pairs.where(beyond[:, None], slipped, q)).rounded
        over = ((t * t).sum(axis=1).sqrt() - g).rounded
        return {
            "cone": _beyond(over[free], self.noise) / self.size,
            "slip": _beyond(np.abs(returned[free]), self.noise) / self.size,
        }

    def _on_obstacles(self, motion: Any) -> float:
        """Forces on the free motions of obstacles, relative to all contact forces and arms."""
        normal, tangent, force = motion.normal, motion.tangent, np.nan_to_num(motion.force)
        left = rows_times(normal.T, self.mu) + rows_times(tangent.T, self.t.ravel()) + force
        arms = np.maximum(
            np.abs(normal).max(axis=0, initial=0.0), np.abs(tangent).max(axis=0, initial=0.0)
        )
        size = arms * (np.abs(self.mu).sum() + np.abs(self.t).sum()) + np.abs(force)
        return largest((left.rounded / np.where(size > 0, size, 1.0))[motion.free])


class _BodyForces:
    """Forces on one of the bodies; `terms` are the sums of moduli that the load consists of."""

    def __init__(
        self, body: PairedBody, u: Array, contact: Pairs, load: Array, terms: Array
    ) -> None:
        self.body, self.u, self.contact, self.load, self.terms = body, u, contact, load, terms
        self.reach = float(body.host.largest_displacement(u))
        self.left = body.internal(u) + contact - load  # reactions, and the residual at free dofs

    def equilibrium(self) -> tuple[float, float]:
        """Largest residual force, and the largest sum of moduli of the forces there."""
        forces = self.contact.rounded, self.load, self.terms
        size = self.body.host.equilibrium(self.u, *forces)[1]
        return self.body.unbalanced(self.left), size

    def balance(self) -> float:
        """The sum of all forces relative to that of their moduli."""
        body, load = self.body, self.load
        reactions = body.at_supports(self.left)
        loads = body.total(Pairs.of(self.terms)).rounded
        given = loads + body.total(abs(self.contact)).rounded
        if not np.any(given):  # only support reactions, which balance each other
            return 0.0
        size = largest(given + body.total(abs(reactions)).rounded)
        left = largest(body.total(reactions - self.contact + load).rounded) / size
        return beside_travel(left, loads, body.host, self.u)


def _beyond(x: Array, bound: float) -> float:
    return float((x - bound).max(initial=0.0))
