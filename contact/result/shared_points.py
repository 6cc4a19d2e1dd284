"""Contact points that share their unknowns, and whose forces are therefore not determined."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from contact.body.supports import norms
from contact.errors import InputError
from contact.result.contact_state import ContactState

_TOUCHES = 1e-8  # of the largest displacement: gaps below this are closed
_DEPENDENT = 1e-11  # pivots of the Gram matrix of rows of unit length below this are rounding


def refuse_shared_points(state: ContactState) -> None:
    """Raise if points in contact have forces that equilibrium and the contact law leave open.

    Periodic and tied boundaries can make displacements at contact points linearly dependent, and so
    do derivatives that vanish at the sides of a block that equals its mirror image. Where the
    points touch the obstacle, only certain sums of their forces are then determined, and a pressure
    at one of them would be arbitrary.

    Raises
    ------
    InputError
        Displacements at points in contact depend on each other linearly.
    """
    system = state.system
    body = system.body
    # The path of a block holds derivatives at its sides, as if they were tied to mirror images.
    if not any(each._couplings or getattr(each, "path", None) for each in body.bodies):
        return
    rows = system.rows
    u_n, _ = system.relative(state.u, state.motion)
    closed = (u_n - rows.gap > -_TOUCHES * (body.reach(state.u) or 1.0)) | (state.mu > 0.0)
    if not np.any(state.mu[closed] != 0.0):
        return
    chosen = [rows.G[np.flatnonzero(closed)]]
    if system.law is not None:
        held = np.linalg.norm(state.t, axis=1) < (1.0 - _TOUCHES) * system.bound(state.mu)
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
    live = np.flatnonzero(body.live(rows))
    if not live.size:
        return False
    B: Any = body.in_unknowns(rows[live])
    size = norms(sparse.csr_array(B.T))
    B = B @ sparse.diags_array(1.0 / np.where(size > 0.0, size, 1.0))  # whatever their units
    B = sparse.diags_array(1.0 / norms(sparse.csr_array(B))) @ B
    try:
        factor = splu(
            sparse.csc_array(B @ B.T),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # a pivot that is exactly zero
        return True
    pivots: NDArray[np.float64] = np.abs(factor.U.diagonal())
    return bool(pivots.min() < _DEPENDENT)
