r"""Whether a frictional contact problem has other solutions: a proof, or a search.

Given friction (Tresca) has one solution. Coulomb's law has one for small friction; for large
friction discrete problems have several, all of them valid (Klarbring 1990). There are two ways to
examine a discrete problem:

*Proof.* With the compliance W of the contact points, in the scale of `BoundaryProblem`, let two
solutions differ by the forces :math:`\delta = (\delta_\mu, \delta_t)`. The laws of contact and
friction give :math:`\delta^T W \delta \le \sum_i F_i |\delta_{\mu, i}| |(W \delta)_{t, i}|`, and so
:math:`\delta = 0` for

.. math::
    \max_i F_i < F^* = \bigl(\lambda_{\max}(E_n W^{-1} E_n^T)\,
                 \lambda_{\max}(E_t W E_t^T)\bigr)^{-1/2},

E_n and E_t picking the normal and the tangential rows. :math:`F^*` falls like :math:`\sqrt h` (so
does the best bound known, Hild 2002). Above it, nothing is known until a second solution is found.

*Search.* The problem is solved again from starts far apart; every solution found is certified.

References
----------
A. Klarbring, Examples of non-uniqueness and non-existence of solutions to quasistatic contact
problems with friction, Ingenieur-Archiv 60 (1990). P. Hild, On finite element uniqueness studies
for Coulomb's frictional contact model, Int. J. Appl. Math. Comput. Sci. 12 (2002).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem
from contact.errors import InputError, NotConverged, Unbounded
from contact.laws.options import Options
from contact.problem.contact_problem import ContactProblem
from contact.problem.solve_system import solve_system
from contact.result.contact_result import ContactResult
from skfem_adini.ground.arguments import integer

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Uniqueness:
    """The result of `uniqueness`: a proof, or other solutions.

    Attributes
    ----------
    proven : bool
        No other solution exists.
    coefficient : float
        F*: below it Coulomb's law has one solution, for any loads and gap. ``inf`` for given or no
        friction; 0 if unknown, as for a body supported by contact alone and for driven obstacles.
    others : tuple of ContactResult
        Certified solutions that differ from the one given and from each other.

    Examples
    --------
    Friction below F* leaves one solution:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> from contact import uniqueness
    >>> problem.friction = 0.01
    >>> found = uniqueness(problem, problem.solve(), starts=1)
    >>> found.others, found.proven == bool(found.coefficient > 0.01)
    ((), True)
    """

    proven: bool
    coefficient: float
    others: tuple[ContactResult, ...]

    def __str__(self) -> str:
        if self.proven and np.isinf(self.coefficient):
            return "unique: no friction depends on the pressure"
        if self.proven:
            return f"unique: proven for friction below {self.coefficient:.3g}"
        found = f"{len(self.others)} other solutions found" if self.others else "no other one found"
        return f"uniqueness is proven below friction {self.coefficient:.3g} only; {found}"


def uniqueness(
    problem: ContactProblem, result: ContactResult, *, starts: int = 20, seed: int = 0
) -> Uniqueness:
    """Prove that a result is the only solution, or look for others.

    Parameters
    ----------
    problem : ContactProblem
    result : ContactResult
        Of this problem, or a step of its load history.
    starts : int
        Solves from random forces besides those from rest and from full stick.
    seed : int

    Returns
    -------
    Uniqueness

    Raises
    ------
    InputError
        Not a problem and a result of it; `starts` or `seed` is not a whole number.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=2.0, nu=0.3).fix("left", "xy")
    >>> problem = ContactProblem(body.load("top", (0.0, -0.1)), "bottom", 0.0, friction=0.05)
    >>> uniqueness(problem, problem.solve()).proven
    True
    """
    if not isinstance(problem, ContactProblem):
        raise InputError(f"problem: expected a ContactProblem, got {type(problem).__name__}")
    if not isinstance(result, ContactResult):
        raise InputError(f"result: expected a ContactResult, got {type(result).__name__}")
    if result.mu.shape != problem.rows.gap.shape:
        raise InputError(
            f"result: has {result.mu.size} contact points, the problem {problem.rows.gap.size}"
        )
    if not result.system.body.has_stiffness_of(problem.body):
        raise InputError(
            "result: its body has another material or mesh than the problem's; solve the problem "
            "as it is now"
        )
    for name, count in (("starts", starts), ("seed", seed)):
        integer(name, count, 0)
    system = result.system
    if system.surface is not None:
        raise InputError("result: uniqueness is known without adhesion, hardness and wear")
    condensed = problem.condense().under(system.body)
    boundary = condensed.boundary_problem(
        system.load, system.rows.gap, system.slip_from, system.motion
    )
    if system.law != "coulomb":
        return Uniqueness(True, np.inf, ())
    least = unique_below(boundary)
    if float(np.max(system.friction)) < least:
        return Uniqueness(True, least, ())
    options = Options.checked(system.law, system.body.dim, "newton", None, None, None)
    found = [result]
    for mu, t in _starts(boundary, np.random.default_rng(seed), starts):
        scale = condensed.point_scale
        start = replace(result, mu=mu / scale, t=t / scale[:, None])
        with suppress(NotConverged, Unbounded):
            other = solve_system(system, condensed, options, start)
            if all(_apart(other, one) for one in found):
                found.append(other)
    return Uniqueness(False, least, tuple(found[1:]))


def unique_below(problem: BoundaryProblem) -> float:
    """The bound F* of the module docstring; 0 if rigid motions are free."""
    if problem.s.size:
        return 0.0
    W, ties = problem.W, problem.ties
    normal = problem.normal[problem.can_touch & ~ties]
    tangent = problem.tangent[(problem.tangent >= 0) & ~ties[:, None]]
    tangent = tangent[W.diagonal()[tangent] > 0]
    if normal.size == 0 or tangent.size == 0:
        return np.inf
    if ties.any():  # compliance of a body fixed at its bonded points
        at = np.concatenate((problem.normal[ties], problem.tangent[ties].ravel()))
        at = at[at >= 0]
        at = at[W.diagonal()[at] > 0]
        W = W - W[:, at] @ np.linalg.solve(W[np.ix_(at, at)], W[at])
    compliance_t = W[np.ix_(tangent, tangent)]
    coupling = W[np.ix_(normal, tangent)]
    # The normal block of the inverse is the inverse of the Schur complement.
    rest = W[np.ix_(normal, normal)] - coupling @ np.linalg.solve(compliance_t, coupling.T)
    ratio = np.linalg.eigvalsh(rest)[0] / np.linalg.eigvalsh(compliance_t)[-1]
    return float(np.sqrt(max(ratio, 0.0)))


def _starts(
    problem: BoundaryProblem, rng: np.random.Generator, count: int
) -> Iterator[tuple[Array, Array]]:
    """Starting forces (mu, t) in the problem's scale: zero, full stick, and random ones."""
    yield problem.zeros()
    pushed = problem.v0.copy()
    live = problem.can_touch
    pushed[problem.normal[live]] -= problem.gap[live]
    stuck = np.linalg.lstsq(problem.W, pushed, rcond=None)[0]
    mu, t = problem.zeros()
    mu[live] = np.maximum(stuck[problem.normal[live]], 0.0)
    t[problem.tangent >= 0] = stuck[problem.tangent[problem.tangent >= 0]]
    yield mu, t
    size = float(np.abs(pushed).max())
    # Random forces of .1 to 100 times that size, on seven tenths of the points.
    for _ in range(count):
        reach = size * 10 ** rng.uniform(-1, 2)
        yield (
            np.where(live, reach * rng.random(live.size) * (rng.random(live.size) < 0.7), 0.0),
            reach * rng.normal(size=problem.tangent.shape) * (problem.tangent >= 0),
        )


def _apart(one: ContactResult, other: ContactResult) -> bool:
    """Whether displacements or contact forces differ by more than rounding."""
    body, forces = one.system.body, [r.contact_forces + r.tie_forces for r in (one, other)]
    length = max(
        *(body.largest_displacement(result.u) for result in (one, other)),
        *(body.local_displacement(force) for force in forces),
    )
    distinct = 1e-6  # relative distance of certified solutions that differ
    size = max(
        body.local_displacement(force) for force in forces
    )  # as displacements: dofs have different units
    return bool(
        body.largest_displacement(one.u - other.u) > distinct * length
        or body.local_displacement(forces[0] - forces[1]) > distinct * size
    )
