"""The same contact problem, solved by an independent QP solver and compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from contact.checks.frozen_problem import FrozenProblem
from contact.checks.surface_slacks import SurfaceSlacks
from contact.errors import InputError
from contact.laws.pressure_overclosure import Exponential
from contact.problem.contact_problem import ContactProblem
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CrossCheck:
    """Differences between the result and an independent solver's solution.

    Attributes
    ----------
    solver : str
    size : int
        Unknowns of the QP solved by the independent solver, the peer.
    displacement : float
        Largest difference of u over the largest displacement; NaN if the peer found no solution.
    multipliers : float
        Largest difference of a contact force over the largest contact force.
    objective : float
        Difference of the energies over the larger modulus.
    seconds : float
        Time of the peer.
    residual : float
        Largest residual of the peer's solution, by `ContactSystem.kkt`, with the frozen friction
        bound.
    ours : float
        Largest residual of the result.
    effect : float
        Displacement that the difference of the contact forces would cause, dof by dof, relative to
        that of the forces; 0 if the difference has no effect on dofs, NaN if unknown.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> from contact import cross_check
    >>> check = cross_check(problem, problem.solve())
    >>> check.solver, check.displacement < 1e-6
    ('osqp', True)
    """

    solver: str
    size: int
    displacement: float
    multipliers: float
    objective: float
    seconds: float
    residual: float
    ours: float
    effect: float = float("nan")

    @property
    def verdict(self) -> str:
        """The conclusion from the numbers.

        ===============================  =========================================================
        agrees                           both answers differ by 1e-6 at most
        agrees, forces not unique        both are solutions with one displacement; their contact
                                         forces differ by some that act on nothing, because rows
                                         are dependent, as where three bodies meet
        the peer did not converge        its residual is larger than that: no conclusion
        disagrees                        it satisfies the laws, by another solution
        ===============================  =========================================================
        """
        agrees = 1e-6  # relative difference of solutions, and residual of a solver
        if max(self.displacement, self.multipliers) <= agrees:
            return "agrees"
        if not self.residual <= agrees:
            return "the peer did not converge"
        if max(self.displacement, self.effect) <= agrees:
            return "agrees, forces not unique"
        return "disagrees"

    def __str__(self) -> str:
        return (
            f"{self.solver:>9} on {self.size} unknowns {self.verdict}: "
            f"displacement {self.displacement:.1e}, multipliers {self.multipliers:.1e}, "
            f"objective {self.objective:.1e}; residual of the peer {self.residual:.1e}, "
            f"ours {self.ours:.1e} ({self.seconds:.2f} s)"
        )


def cross_check(
    problem: ContactProblem,
    result: ContactResult,
    solver: str = "osqp",
    *,
    condensed: bool | None = None,
) -> CrossCheck:
    r"""Solve the problem again with another package and compare.

    The peer, the other solver, gets with free unknowns z and one slack s per friction row

    .. math::
        \min_{z, s} \tfrac12 z^T S z - f^T z + g^T s \quad
        \text{s.t.} \quad G z \le d, \; -s \le T z \le s ,

    in variables and rows of unit size (`contact.checks.frozen_problem`), so that units of length
    and force have no effect. A Coulomb problem is checked at its solution: with the bound frozen at
    g = F mu it is the given-friction problem that the solution must also solve. In 3-D the friction
    terms are cones, :math:`s_i \ge |T_i z|`, and the peer is Clarabel. Bonded points are equations;
    a compliant surface with a table adds one slack for each straight piece of it.

    Parameters
    ----------
    problem : ContactProblem
    result : ContactResult
    solver : str
        A solver of qpsolvers: "osqp" (polished), "proxqp", "piqp", "clarabel", ...
    condensed : bool, optional
        True for the dense problem on the contact boundary, False for the full sparse one, on which
        other solvers are slower and less accurate. Default: the dense one up to 2000 unknowns.

    Returns
    -------
    CrossCheck
        Its ``verdict`` says whether the peer agrees, disagrees, or has not converged itself.

    Raises
    ------
    InputError
        Friction in three dimensions with a solver other than Clarabel, a solver that qpsolvers does
        not have, a result of another problem, or one with the exponential law of compliant
        surfaces.
    MissingDependency
        The solver is not installed.

    Examples
    --------
    OSQP finds the same contact forces:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> check = cross_check(problem, problem.solve(), "osqp")
    >>> check.multipliers < 1e-6, check.residual < 1e-6
    (True, True)
    """
    _check(problem, result, solver)
    system, body = result.system, result.system.body
    boundary = problem.condense().under(body) if condensed is not False else None
    # Use the dense problem, which the peer solves to 1e-8, for small boundaries.
    if condensed is None and boundary is not None and boundary.unknowns > 2000:
        boundary = None
    asked = FrozenProblem.of(result, boundary, _has_cones(result))
    answer = asked.solved_by(solver)
    u, mu, t = np.full(result.u.size, np.nan), answer.mu, answer.t
    if answer.z is not None and boundary is not None:
        u = boundary.expand(system.load, answer.z)
    elif answer.z is not None:
        P, u0 = body.constraint
        u = P @ answer.z + u0
    bound, surfaces = system.bound(result.mu), SurfaceSlacks.of(system)
    t = _with_prescribed(result, bound, u, t)
    free, usable = ~system.rows.ties, np.isfinite(system.rows.gap)

    def energy(u: Array) -> float:
        slip = np.linalg.norm(system.slip_increment(system.relative(u, result.motion)[1]), axis=1)
        closed = system.relative(u, result.motion)[0] - np.where(usable, system.rows.gap, 0.0)
        return system.energy(u) + float(bound[free] @ slip[free]) + surfaces.energy(closed)

    ours, theirs = energy(result.u), energy(u)
    force = max(np.abs(result.mu).max(initial=0.0), np.abs(result.t).max(initial=0.0)) or 1.0
    difference = max(np.abs(mu - result.mu).max(initial=0.0), np.abs(t - result.t).max(initial=0.0))
    return CrossCheck(
        solver=solver,
        size=asked.size,
        displacement=body.largest_displacement(u - result.u)
        / (body.largest_displacement(result.u) or 1.0),
        multipliers=float(difference / force),
        objective=abs(ours - theirs) / max(abs(ours), abs(theirs), np.finfo(float).tiny),
        seconds=answer.seconds,
        residual=_residual(system, bound, u, mu, t, result.motion),
        ours=max(result.kkt.values()),
        effect=_effect(result, mu, t),
    )


def _check(problem: ContactProblem, result: ContactResult, solver: str) -> None:
    """Raise an `InputError` unless the solver is suitable and the result belongs to the problem."""
    for name, given, kind in (
        ("problem", problem, ContactProblem),
        ("result", result, ContactResult),
    ):
        if not isinstance(given, kind):
            raise InputError(f"{name}: expected a {kind.__name__}, got {type(given).__name__}")
    if any(isinstance(law, Exponential) for law in result.system.overclosure):
        raise InputError(
            "result: it has compliant surfaces with an exponential law, which is no quadratic "
            "program; a table of pressures and overclosures is one"
        )
    if result.system.surface is not None:
        raise InputError(
            "result: adhesion, hardness and wear are no part of the quadratic program; recheck has "
            "a second certificate"
        )
    if _has_cones(result) and solver != "clarabel":
        raise InputError(
            "cross_check: friction in 3-D is a cone problem, not a QP; use solver='clarabel'"
        )
    if result.u.size != problem.body.f.size or result.mu.size != problem.rows.gap.size:
        raise InputError(
            f"result: has {result.u.size} unknowns and {result.mu.size} contact points, the "
            f"problem {problem.body.f.size} and {problem.rows.gap.size}"
        )


def _has_cones(result: ContactResult) -> bool:
    return result.system.body.dim == 3 and result.system.law is not None


def _with_prescribed(result: ContactResult, bound: Array, u: Array, t: Array) -> Array:
    """The peer's t, completed by the friction law where the whole slip is prescribed.
    Where only free obstacles move a point along its tangents, t is that of the result."""
    system = result.system
    asked = replace(system, law=None if system.law is None else "tresca", friction=bound)
    dead = (
        ~system.body.unconstrained(system.rows.T).reshape(t.shape).any(axis=1) & ~system.rows.ties
    )
    t = np.where((dead & ~system.held)[:, None], result.t, t)
    return asked.with_held_points(u, result.mu, t, result.motion) if np.isfinite(u).all() else t


def _effect(result: ContactResult, mu: Array, t: Array) -> float:
    """See `CrossCheck.effect`; forces on fixed dofs have none."""
    rows, body = result.system.rows, result.system.body
    P = body.constraint[0]

    def give(mu: Array, t: Array) -> float:
        forces = rows.G.T @ mu + rows.T.T @ t.ravel()
        return float(body.local_displacement(P @ (P.T @ forces)))

    size = give(result.mu, result.t)
    return give(mu - result.mu, t - result.t) / size if size > 0 else float("nan")


def _residual(
    system: ContactSystem, bound: Array, u: Array, mu: Array, t: Array, motion: Array | None
) -> float:
    """Largest residual of the peer's solution of the frozen problem."""
    if not all(np.all(np.isfinite(part)) for part in (u, mu, t)):
        return float("nan")
    law = None if system.law is None else "tresca"
    asked = replace(system, law=law, friction=bound)
    # Obstacles are fixed at the result's positions: their force balance is not a condition.
    kkt = asked.kkt(u, mu, t, motion)
    return max(value for name, value in kkt.items() if name not in ("obstacle", "balance"))
