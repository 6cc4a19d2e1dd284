"""Rigid motions that the supports of a body leave free."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.cell_finder import CURVED_MESHES
from contact.body.rigid_modes import reduced_echelon
from contact.body.vector_element import DEFAULT_ELEMENT
from contact.errors import Unbounded

Array = NDArray[np.float64]

RIGID = 1e-12  # relative to the largest motion: smaller ones at supports or boundaries are zero


def free_motions(body: Any) -> Array:
    """Rigid motions that no support prevents, as vectors z (nfree, k) of ``u = P z + u0``.
    Translations are separated from rotations where possible."""
    P, modes, of_dof = body.constraint[0], body.rigid, body.lengths[0]
    dofs = body.chosen
    if dofs is None:
        held = of_dof[:, None] * (modes - P @ (body.picked.T @ modes))
    else:
        fixed = np.diff(P.indptr) == 0
        held = of_dof[fixed, None] * modes[fixed]
    size = np.sqrt(np.einsum("i,ki,ki->k", of_dof * of_dof, modes.T, modes.T))
    at_supports = np.vstack([held[held.any(axis=1)], np.zeros((size.size, size.size))])
    _, singular, V = np.linalg.svd(at_supports / size, full_matrices=False)
    plain = reduced_echelon(V[singular < RIGID] / size)
    if not len(plain):
        return np.zeros((P.shape[1], 0))
    free: Array = body.picked.T @ (modes @ plain.T) if dofs is None else modes[dofs] @ plain.T
    return free


def strained_by_rotation(body: Any) -> str:
    """Text for an error message if free rigid motions strain the body; else an empty string.
    An element of lower order than its curved cells does not contain the linear functions."""
    mesh, element = body.mesh, body.element
    if mesh.affine or not isinstance(mesh, CURVED_MESHES) or element.maxdeg >= mesh.elem.maxdeg:
        return ""
    modes = body.constraint[0] @ free_motions(body)
    terms = abs(body.stiffness) @ np.abs(modes)
    if not np.any(np.abs(body.stiffness @ modes) > RIGID * terms.max(initial=0.0)):
        return ""
    better = DEFAULT_ELEMENT[type(mesh).__name__].__name__
    order = "P2" if better.endswith("P2") else "Q2"
    return (
        f"; on curved cells {type(element).__name__} has no rotation without strain, and the body "
        f"is free to rotate: take {order} elements ({better}), straight cells, or hold the body"
    )


def unseen_motion(modes: Array, on_boundary: Array) -> Array | None:
    """A combination of modes, shape (n, k), that is zero on the boundary, or None.
    It moves a piece that is neither supported nor in contact. It is sought before the
    factorisation, which detects zero pivots only up to rounding."""
    size = np.linalg.norm(modes, axis=0)
    if not size.size:
        return None
    wide = len(on_boundary) < size.size  # the last row of V then has no singular value
    _, singular, V = np.linalg.svd(on_boundary / size, full_matrices=wide)
    seen = singular.size == size.size and singular[-1] > RIGID * singular[0]
    return None if seen else modes @ (V[-1] / size)


def not_held(body: Any, name: str, u: Array) -> Unbounded:
    """The error for an unsupported rigid motion u, shape (ndofs,), of a body."""
    f = body.f
    idle = abs(body.dot(f, u)) <= 1e-12 * body.dot(np.abs(f), np.abs(u))
    lack = ", and no load says how far it goes" if idle else " that could balance the loads"
    return Unbounded(
        f"the body is not held: {name} meets no resistance{lack}; fix a displacement that it "
        "moves, or add friction or an obstacle that stops it",
        u / np.abs(u).max(),
    )
