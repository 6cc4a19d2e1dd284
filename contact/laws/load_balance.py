"""Whether contact forces can balance the loads on the free rigid motions of a body."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from contact.condensation.boundary_problem import Array, BoundaryProblem
from contact.errors import Infeasible
from contact.laws.friction import Coulomb, Friction, Tresca


class _Balance(NamedTuple):  # tolerances; displacements relative to max |C|
    limit: float = 1e-6  # relative reduction of friction in the test for loads at its limit
    unseen: float = 1e-10  # largest contact displacement of an undetermined motion
    gain: float = 1e-7  # work along a motion, over the largest load, below which it is rounding
    presses: float = 1e-6  # normal displacement that counts as no pressure, as on rough circles
    driven: float = 1e-4  # work over the largest load that drives the body
    zero: float = 1e-9  # forces and motions: ten times the error that a certificate of 1e-10 allows


BALANCE = _Balance()


def check_held(problem: BoundaryProblem, friction: Friction | None) -> None:
    r"""Raise `gpu.Infeasible` unless admissible forces balance the loads on all free rigid motions.

    A motion a moves the points by ``v = C a``. Forces within the laws, :math:`\mu \ge 0` and
    :math:`|t| \le F \mu` or :math:`|t| \le g`, with :math:`C^T l = s` exist unless (Farkas) some
    motion, the certificate, has

    .. math::
        s^T a > \sum_i g_i |v_{t,i}|, \qquad v_{n,i} + F_i |v_{t,i}| \le 0 .

    A linear program finds it. In 3-D the modulus is bounded from below by components of v_t in some
    directions, to which the direction of each found motion is added (Kelley's cutting planes). A
    motion that displaces no contact point would be undetermined for any loads.
    """
    apart, allowed = without_ties(problem)
    motion = _unresisted(apart, friction)
    if motion is not None:
        raise Infeasible(motion[0], allowed @ motion[1])


def _unresisted(problem: BoundaryProblem, friction: Friction | None) -> tuple[str, Array] | None:
    """Reason and motion a if `check_held` must raise, else None; no points may be bonded."""
    k, loads = problem.s.size, float(np.abs(problem.s).max(initial=0.0))
    if k == 0:
        return None
    touch = problem.can_touch
    rubs = np.zeros(touch.size, dtype=bool)
    if friction is not None:
        rubs = friction.rubs(touch)
    live = (problem.tangent >= 0) & rubs[:, None]
    normal, tangential = problem.C[problem.normal[touch]], problem.C[problem.tangent[live]]
    seen = np.vstack((normal, tangential, np.zeros((k, k))))
    _, singular, V = np.linalg.svd(seen, full_matrices=False)
    if singular[-1] <= BALANCE.unseen * float(np.abs(problem.C).max(initial=1e-300)):
        return "no contact row sees this rigid motion", V[-1]

    # Unknowns: a = a+ - a- with |a|_1 <= 1, which favours few components, and w_i >= |v_t,i|.
    points = np.flatnonzero(live.any(axis=1))
    place = np.full(touch.size, -1)
    place[points] = np.arange(points.size)
    V_t = np.where(live[points][:, :, None], problem.C[problem.tangent[points]], 0.0)
    size = float(np.abs(problem.C).max())
    contact = np.hstack((normal, np.zeros((int(touch.sum()), points.size))))
    price = np.zeros(points.size)
    if isinstance(friction, Coulomb):
        both = np.flatnonzero(place[touch] >= 0)
        at = place[touch][both]
        contact[both, k + at] = friction.coefficient[points[at]]
    elif isinstance(friction, Tresca):
        price = friction.given[points]
    if loads == 0.0:
        return None
    # Relative to the loads: the program's tolerances are absolute.
    gain = np.concatenate((problem.s, -problem.s, -price)) / loads
    total = np.r_[np.ones(2 * k), np.zeros(points.size)][None]
    cuts = [
        np.hstack((sign * V_t.swapaxes(1, 2) @ direction, -np.eye(points.size)))
        for direction in _directions(problem.tangent.shape[1])
        for sign in (1.0, -1.0)
    ]
    for _ in range(30):  # each round of cutting planes reduces the error by four
        of_a, of_w = np.split(np.vstack((*cuts, contact)) / size, [k], axis=1)
        A = np.vstack((np.hstack((of_a, -of_a, of_w)), total))
        found = scipy.optimize.linprog(
            -gain, A_ub=A, b_ub=np.r_[np.zeros(A.shape[0] - 1), 1.0], method="highs"
        )
        # A gain this small may be rounding. The cuts overestimate the gain: if it is not positive,
        # the loads are balanced.
        if found.x is None or gain @ found.x <= BALANCE.gain:
            return None
        motion = found.x[:k] - found.x[k : 2 * k]
        v = V_t @ motion
        length = np.linalg.norm(v, axis=1)
        short = np.maximum(length - found.x[2 * k :], 0.0) / size
        # To first order, exact moduli would reduce the gain by the errors times the multipliers:
        # if by less than a tenth, the gain is accepted.
        worth = np.abs(found.ineqlin.marginals[: len(cuts) * points.size])
        if short @ worth.reshape(len(cuts), points.size).sum(axis=0) <= 0.1 * (gain @ found.x):
            return "no admissible contact forces balance the loads", motion
        b = np.divide(v, length[:, None], out=np.zeros_like(v), where=length[:, None] > 0)
        cuts.append(np.hstack((np.einsum("pi,pik->pk", b, V_t), -np.eye(points.size))))
    return None


def at_the_limit(problem: BoundaryProblem, friction: Friction | None) -> Array | None:
    """A rigid motion that friction reduced by `BALANCE.limit` could not resist, or None. The slip
    then depends on changes of the loads below their accuracy."""
    if friction is None:
        return None
    try:
        check_held(problem, friction.times(1.0 - BALANCE.limit))
    except Infeasible as error:
        return np.asarray(error.certificate)
    return None


def by_friction_alone(problem: BoundaryProblem) -> Array | None:
    """A rigid motion that the loads drive and that presses no contact point, or None. `check_held`
    would allow pressure at any point, even one with a large gap.
    """
    problem, allowed = without_ties(problem)
    k, size = problem.s.size, float(np.abs(problem.C).max(initial=0.0))
    if k == 0 or size == 0.0 or not np.any(problem.s):
        return None
    normal = problem.C[problem.normal[problem.can_touch]] / size
    A = np.vstack((np.hstack((normal, -normal)), np.ones((1, 2 * k))))
    b = np.r_[np.full(len(normal), BALANCE.presses), 1.0]
    s = problem.s / np.abs(problem.s).max()  # the program's tolerances are absolute
    found = scipy.optimize.linprog(-np.r_[s, -s], A_ub=A, b_ub=b, method="highs")
    if found.x is None:
        return None
    motion: Array = found.x[:k] - found.x[k:]
    driven = s @ motion > BALANCE.driven
    return allowed @ motion if driven else None


def undetermined_slip(
    problem: BoundaryProblem, friction: Friction | None, mu: Array, t: Array
) -> Array | None:
    """A motion that a solution leaves undetermined, or None: it keeps loaded points in contact and
    sticking points at rest, and moves all slipping points along their force, or all against it.
    """
    problem, allowed = without_ties(problem)
    k, force = problem.s.size, float(max(mu.max(initial=0.0), np.abs(t).max(initial=0.0)))
    if k == 0 or friction is None or force == 0.0:
        return None
    g, size = friction.bound(mu), np.linalg.norm(t, axis=1)
    live = problem.tangent >= 0
    yields = live.any(axis=1) & (g > BALANCE.zero * force) & (size >= g * (1.0 - BALANCE.zero))
    sticks = live & ((g > BALANCE.zero * force) & ~yields)[:, None]
    loaded = (problem.normal >= 0) & (mu > BALANCE.zero * force)
    V = np.where(live[:, :, None], problem.C[problem.tangent], 0.0)[yields]
    b = t[yields] / size[yields, None]
    along = np.einsum("pi,pik->pk", b, V)
    across = V - b[:, :, None] * along[:, None, :]
    held = np.vstack(
        (
            problem.C[problem.normal[loaded]],
            problem.C[problem.tangent[sticks]],
            across.reshape(-1, k),
            np.zeros((k, k)),
        )
    )
    largest = float(np.abs(problem.C).max())
    _, singular, motions = np.linalg.svd(held, full_matrices=False)
    for motion in motions[singular <= BALANCE.zero * largest]:
        slip = along @ motion
        reach = BALANCE.zero * largest
        if np.any(np.abs(slip) > reach) and (np.all(slip >= -reach) or np.all(slip <= reach)):
            return np.asarray(allowed @ motion)
    return None


def without_ties(problem: BoundaryProblem) -> tuple[BoundaryProblem, Array]:
    """The problem without bonded points, in motions b that do not move these, and `allowed`, (k,
    number of b), of ``a = allowed @ b``.
    """
    k, ties = problem.s.size, problem.ties
    if not ties.any():
        return problem, np.eye(k)
    at = np.concatenate((problem.normal[ties], problem.tangent[ties].ravel()))
    rows = np.vstack((problem.C[at[at >= 0]], np.zeros((k, k))))
    _, singular, V = np.linalg.svd(rows, full_matrices=False)
    allowed = V[singular <= BALANCE.unseen * float(np.abs(problem.C).max(initial=1e-300))].T
    s = allowed.T @ problem.s
    # Drop the rounding of loads that bonded points balance.
    s[np.abs(s) <= BALANCE.zero * float(np.abs(problem.s).max(initial=0.0))] = 0.0
    apart = replace(
        problem,
        C=problem.C @ allowed,
        s=s,
        gap=np.where(ties, np.inf, problem.gap),
        normal=np.where(ties, -1, problem.normal),
        tangent=np.where(ties[:, None], -1, problem.tangent),
        bonded=None,
    )
    return apart, allowed


def _directions(count: int) -> list[Array]:
    """Unit directions over half a turn, each of shape (count,)."""
    if count == 1:
        return [np.ones(1)]
    angles = np.pi * np.arange(16) / 16
    return [np.array([np.cos(angle), np.sin(angle)]) for angle in angles]
