"""The certificate: all recomputed residuals are below the tolerance; displacements are
plausible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from contact.body.basis_solid import BasisSolid
from contact.body.free_motions import strained_by_rotation
from contact.body.supports import norms
from contact.errors import InputError, NotConverged
from contact.result.contact_system import ContactState


def certify(state: ContactState, tol: float, slack: float) -> dict[str, float]:
    """Recompute all residuals; raise if they exceed tol, or tol + slack for a regularised law."""
    kkt = state.system.kkt(state.u, state.mu, state.t, state.motion)
    refuse_residuals(state, kkt, tol, slack)
    refuse_shared_points(state)
    _refuse_large_displacements(state)
    return kkt


def take_strains(body: Any, chosen: Sequence[int] | None = None) -> bool:
    """Let the (chosen) bodies compute forces from strains; returns whether any body changed."""
    bodies = body.bodies if chosen is None else [body.bodies[k] for k in chosen]
    taken = [one.take_strains() for one in bodies if isinstance(one, BasisSolid)]
    return any(taken)


def strained_bodies(body: Any) -> list[int]:
    """Numbers of the bodies that compute forces from strains on request."""
    solids = [isinstance(one, BasisSolid) and one.takes_strains for one in body.bodies]
    return [k for k, strained in enumerate(solids) if strained]


def _refuse_large_displacements(state: ContactState) -> None:
    """Raise if displacements exceed the size of the body: the linear theory is then invalid."""
    system, body = state.system, state.system.body
    size, reach = body.extent, body.largest_displacement(state.u)
    # Prescribed displacements and the gap that closes before contact are intended.
    nearest = np.abs(system.rows.gap).min(initial=np.inf)
    given = max(
        body.largest_displacement(body.constraint[1]), nearest if np.isfinite(nearest) else 0.0
    )
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
    """Raise `NotConverged`, which names residuals above the tolerance; see `certify`."""
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
        motion = state.system.motion
        if "penetration" in missed and not remedy and motion is not None and np.any(motion.free):
            remedy = (
                "; supports may hold contact points in the way of the obstacle that a force "
                "drives: let them end where the contact begins, or hold fewer components there"
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
    """A remark for error messages if stiffnesses of bodies differ so much that digits are lost."""
    solids = [body for body in bodies if isinstance(body, BasisSolid)]
    # Stiffness of each dof per unit displacement, independent of the dof's unit.
    sizes = [float((b.stiffness.diagonal() / b.lengths[0] ** 2).max()) for b in solids]
    ratio = max(sizes, default=1.0) / min(sizes, default=1.0)
    if ratio < 1e6:  # reactions are accurate enough for a certificate
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


def refuse_shared_points(state: ContactState) -> None:
    """Raise if displacements of points in contact are linearly dependent.
    Only sums of their forces would be determined; pressures would be arbitrary."""
    system = state.system
    body = system.body
    # The path of a block fixes derivatives at its sides, as by ties to mirror images.
    if not any(each._couplings or getattr(each, "path", None) for each in body.bodies):
        return
    rows = system.rows
    u_n, _ = system.relative(state.u, state.motion)
    rounding = 1e-8  # of gaps relative to the largest displacement, and of forces to the bound
    closed = (u_n - rows.gap > -rounding * (body.largest_displacement(state.u) or 1.0)) | (
        state.mu > 0.0
    )
    if not np.any(state.mu[closed] != 0.0):
        return
    chosen = [rows.G[np.flatnonzero(closed)]]
    if system.law is not None:
        held = np.linalg.norm(state.t, axis=1) < (1.0 - rounding) * system.bound(state.mu)
        sticks = np.repeat(closed & held, state.t.shape[1])
        chosen.append(rows.T[np.flatnonzero(sticks)])
    if any(_dependent(body, each) for each in chosen):
        x = rows.x[:, np.flatnonzero(closed)[0]]
        raise InputError(
            f"body: {int(closed.sum())} points are in contact, the first at {x.round(6).tolist()}, "
            "and periodic or tied boundaries make their displacements dependent, so that their "
            "pressures are not determined; let periodic boundaries end where there is no contact, "
            "replace them by supports of symmetry, leave out the path of a LayeredBlock, or do not "
            "tie the contact boundary"
        )


def _dependent(body: Any, rows: sparse.csr_array) -> bool:
    live = np.flatnonzero(body.unconstrained(rows))
    if not live.size:
        return False
    B: Any = body.in_unknowns(rows[live])
    size = norms(sparse.csr_array(B.T))
    B = B @ sparse.diags_array(1.0 / np.where(size > 0.0, size, 1.0))  # independent of units
    B = sparse.diags_array(1.0 / norms(sparse.csr_array(B))) @ B
    try:
        factor = splu(
            sparse.csc_array(B @ B.T),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # an exactly zero pivot
        return True
    pivots: NDArray[np.float64] = np.abs(factor.U.diagonal())
    return bool(pivots.min() < 1e-11)  # rounding, for rows of unit length
