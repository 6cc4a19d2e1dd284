r"""A challenge: a search, outside the space found so far, for eigenvalues that were missed.

Let U be the locked rows and B the compression of A to their orthogonal complement. Arnoldi steps
from a random unit vector r orthogonal to U give norms :math:`\beta_j` with :math:`|p(B) r| =
\prod_j \beta_j`, p the monic polynomial whose roots are the Ritz values, including those dropped by
restarts. An eigenvalue :math:`\mu` of B with left unit eigenvector y has :math:`|y^* p(B) r| =
|p(\mu)|\,|y^* r|`, whence

.. math::
    |y^* r| \le \prod_j \beta_j \,/\, |p(\mu)| .

Once the right-hand side is below :math:`t / \sqrt n` wherever an eigenvalue would be wanted, a
missed one requires :math:`|y^* r| \le t / \sqrt n`, which for a random r has the probability
:math:`\sqrt{2 / \pi}\,t`, however far from normal A is. As :math:`|p|` grows outwards from its
roots, it suffices to look at the edge of the wanted part of the plane.

The best Ritz value of the search is called the newcomer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.schur.order import Edge
from gpu.eigenvalues.schur.ordered_schur import Rank, ordered_schur, whole

# The newcomer counts as ranking below the wanted if its residual is below this times the gap
# between its rank and that of the least wanted.
INSIDE = 0.03
THICK = 0.5  # fraction of the vectors of the search that is kept at a restart
FIRST = 3  # products before the first test: few are enough if the wanted are well separated
# Numbers t: an eigenvalue is missed with a probability of at most .8 t. The second is enough if the
# newcomer ranks below the wanted as well.
SURE, LIKELY = 0.01, 0.1


def unbeaten(
    basis: Arnoldi,
    locked: int,
    worst: float,
    rank: Rank,
    edge: Edge | None,
    *,
    tol: float,
    floor: float,
    restarts: int,
    patience: float,
    meanwhile: Callable[[], Any] | None = None,
) -> tuple[bool, int]:
    """Whether no eigenvalue outside the `locked` rows ranks above `worst`; number of restarts.

    If a better one is found, row `locked` (and for a pair the next) spans its space; rows beyond
    are overwritten. A newcomer that has converged (residual below `tol` times its modulus, or
    `floor`) and ranks below the wanted is locked, and the search begins again. After `patience`
    products the search ends if the newcomer ranks below the wanted.
    """
    first, room, n = locked, basis.size - locked, basis.V.shape[1]
    basis.start(locked)
    S = np.zeros((room, room), dtype=basis.V.dtype)
    kept, goal, made = 0, min(FIRST, room), 0
    begun = searched = basis.matvecs  # products before the search, and before this random vector
    # Log of the product of the betas; Ritz values dropped; products and residual at the last test.
    betas, dropped, past = 0.0, np.zeros(0, dtype=complex), (0, 1.0)
    enough, likely = (0.5 * np.log(n) - np.log(chance) for chance in (SURE, LIKELY))
    rounding = 1e-9 * abs(worst) + floor
    while True:
        aside = meanwhile if basis.matvecs == begun else None
        steps = basis.sweep(locked + kept, locked + goal, aside)
        if not steps.finite:
            raise FloatingPointError(f"A v is not finite after {basis.matvecs} products")
        ended = steps.ended
        size = goal if ended is None else kept + ended + 1
        steps.project(S, kept, size, locked)
        beta = 0.0 if ended is not None else float(steps.betas[-1])
        leading = int(THICK * room) + 1 if size == room else 1
        T, Q, values = ordered_schur(S[:size, :size], rank, leading)
        best, products = whole(T, 1), basis.matvecs - searched
        residual = beta * float(np.linalg.norm(Q[size - 1, :best]))
        distance = worst - float(rank(values[:1])[0])
        evidence = np.inf if distance >= -rounding else 0.0
        if ended is None:
            betas += float(np.log(steps.betas).sum())
            roots = np.concatenate((values, dropped))
            evidence = _evidence(worst, roots, edge) - betas if distance > 0 else 0.0
        converged = residual <= max(tol * float(np.abs(values[0])), floor)
        inside = residual < INSIDE * distance or (converged and distance >= -rounding)
        tired = basis.matvecs - begun >= patience
        copy = converged and distance <= 1e-6 * abs(worst) and patience < np.inf
        if evidence >= enough or (inside and (evidence >= likely or tired or copy)):
            return True, made
        beaten = not inside and (converged or residual < -INSIDE * distance)
        if beaten or made >= restarts:
            basis.rotate(Q[:, :best], size, locked)
            basis.V[first : first + best] = basis.V[locked : locked + best]
            return False, made
        if inside and converged and evidence <= 0.0 and 2 * (room - best) > basis.size - first:
            # Converged below the wanted, without evidence on the rest: lock it and begin again.
            basis.rotate(Q[:, :best], size, locked)
            locked, room = locked + best, room - best
            basis.start(locked)
            S[:] = 0.0
            kept, goal, made, searched = 0, min(FIRST, room), made + 1, basis.matvecs
            betas, dropped, past = 0.0, np.zeros(0, dtype=complex), (0, 1.0)
            continue
        need = _products_left(products, evidence, enough, past, residual, INSIDE * distance)
        past = (products, residual)
        if size < room:
            S[size, size - 1] = beta
            kept, goal = size, min(room, size + need)
            continue
        keep = whole(T, min(int(THICK * room), room - 2))
        basis.rotate(Q[:, :keep], size, locked)
        dropped = np.concatenate((dropped, values[keep:]))
        S[:] = 0.0
        S[:keep, :keep], S[keep, :keep] = T[:keep, :keep], beta * Q[size - 1, :keep]
        kept, made, goal = keep, made + 1, min(keep + need, room)


def _evidence(worst: float, roots: np.ndarray, edge: Edge | None) -> float:
    r"""Logarithm of the least \|p\| on the edge of the wanted part of the plane."""
    if edge is None:
        return np.inf
    apart = np.abs(edge(worst, roots)[:, None] - roots)
    with np.errstate(divide="ignore"):
        return float(np.log(apart).sum(axis=1).min())


def _products_left(
    products: int,
    evidence: float,
    enough: float,
    past: tuple[int, float],
    residual: float,
    target: float,
) -> int:
    """Estimated products until the search ends, by evidence or by residual, at the rates so far."""
    needs: list[Any] = []
    if evidence > 0:
        needs.append((enough - evidence) * products / evidence)
    if past[0] and past[1] > residual > target > 0:
        rate = np.log(past[1] / residual) / (products - past[0])
        needs.append(np.log(residual / target) / rate)
    return max(3, int(np.ceil(min(min(needs, default=np.inf), 1e9))))
