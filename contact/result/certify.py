"""The certificate: all recomputed residuals are below the tolerance, displacements plausible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import skfem

from contact.body.basis_solid import BasisSolid
from contact.body.free_motions import strained_by_rotation
from contact.errors import InputError, NotConverged
from contact.result.contact_state import ContactState
from contact.result.shared_points import refuse_shared_points

_UNEVEN = 1e6  # ratio of stiffnesses from which reactions lose the digits that a certificate needs


def certify(state: ContactState, tol: float, slack: float) -> dict[str, float]:
    """Recompute every residual, and raise unless all are below the tolerance.

    Parameters
    ----------
    state : ContactState
    tol : float
    slack : float
        Additional tolerance of the friction law, for a method that regularises it.

    Returns
    -------
    dict
        The residuals, see `ContactSystem.kkt`.

    Raises
    ------
    NotConverged
        A residual exceeds its tolerance.
    InputError
        Points in contact share their unknowns, see `refuse_shared_points`; displacements exceed the
        size of the body.
    """
    kkt = state.system.kkt(state.u, state.mu, state.t, state.motion)
    refuse_residuals(state, kkt, tol, slack)
    refuse_shared_points(state)
    _refuse_large_displacements(state)
    return kkt


def take_strains(body: Any, chosen: Sequence[int] | None = None) -> bool:
    """Whether some body, or one of those chosen, computes forces from strains only from now on."""
    bodies = body.bodies if chosen is None else [body.bodies[k] for k in chosen]
    taken = [one.take_strains() for one in bodies if isinstance(one, BasisSolid)]
    return any(taken)


def strained_bodies(body: Any) -> list[int]:
    """Numbers of the bodies that were told to compute forces from strains."""
    solids = [isinstance(one, BasisSolid) and one.takes_strains for one in body.bodies]
    return [k for k, strained in enumerate(solids) if strained]


def _refuse_large_displacements(state: ContactState) -> None:
    """Raise if displacements exceed the size of the body: the linear theory is then invalid.

    What supports and obstacles prescribe, and the gap that must close before anything touches, is
    intended: twice the largest of these is allowed besides.
    """
    system, body = state.system, state.system.body
    size, reach = body.extent, body.reach(state.u)
    nearest = np.abs(system.rows.gap).min(initial=np.inf)
    given = max(body.reach(body.constraint[1]), nearest if np.isfinite(nearest) else 0.0)
    if system.motion is not None and state.motion is not None:
        known = np.where(system.motion.free, 0.0, np.nan_to_num(state.motion))
        given = max(given, *(np.abs(w).max(initial=0.0) for w in system.motion.displacement(known)))
    if reach > size + 2.0 * given:
        raise InputError(
            f"displacements reach {reach:.3g}, {reach / size:.3g} times the size of the body, in a "
            "theory of small ones; check the units of E and of the loads, the place of the "
            "obstacle, and what holds the body"
        )


def refuse_residuals(state: ContactState, kkt: dict[str, float], tol: float, slack: float) -> None:
    """Raise unless all residuals of a state are below the tolerance.

    Parameters
    ----------
    state : ContactState
    kkt : dict
        The residuals, see `ContactSystem.kkt`.
    tol : float
    slack : float
        Additional tolerance of the friction law.

    Raises
    ------
    NotConverged
        A residual exceeds its tolerance; the message names it.
    """
    limits = dict.fromkeys(("cone", "slip"), tol + slack)
    missed = {name: value for name, value in kkt.items() if not value <= limits.get(name, tol)}
    if missed:
        found = ", ".join(f"{name} {value:.1e}" for name, value in missed.items())
        bodies = state.system.body.bodies
        remedy = next(filter(None, (strained_by_rotation(body.trace) for body in bodies)), "")
        if "balance" in missed and not remedy:
            remedy = _uneven(bodies)
        if "balance" in missed and not remedy:
            remedy = (
                "; the displacements hold too few digits for the reactions of cells as slender as "
                "these: make them squarer, or let tol be larger"
            )
        if any(isinstance(body.trace.element, skfem.ElementQuadBFS) for body in bodies):
            remedy = (
                "; take skfem_adini's ElementQuadBFS, scikit-fem's own loses digits in small cells"
            )
        raise NotConverged(
            f"the solution fails its certificate at tolerance {tol:.1e}: {found}{remedy}",
            state.history,
        )


def _uneven(bodies: Sequence[Any]) -> str:
    """A remark on bodies whose stiffnesses differ so much that digits are lost."""
    solids = [body for body in bodies if isinstance(body, BasisSolid)]
    # Of each dof for a unit displacement, whatever the unit of the dof.
    sizes = [float((b.stiffness.diagonal() / b.lengths[0] ** 2).max()) for b in solids]
    ratio = max(sizes, default=1.0) / min(sizes, default=1.0)
    if ratio < _UNEVEN:
        return ""
    return (
        f"; the stiffest body is {ratio:.0e} times as stiff as the softest one, so that it moves "
        "as a rigid one: its displacements hold too few digits for its reactions; use a rigid "
        "obstacle in its place, fix more of it, or let tol be larger"
    )


def as_lines(kkt: dict[str, float]) -> str:
    """One line for each residual."""
    lines = [f"{name:>16}  {value:.1e}" for name, value in kkt.items()]
    return "\n".join(["certificate: relative residuals, recomputed from the problem", *lines])
