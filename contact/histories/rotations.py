r"""Rotations of bodies of small strain, and what they are allowed to be.

Small strains are linear in the displacement: a body that turns by the angle :math:`\theta` without
strain is given one of :math:`\cos\theta - 1`, and a motion without small strain stretches it by
:math:`1 / \cos\theta - 1`. Finite sliding allows the bodies any path along each other, and no more
rotation than makes this strain negligible beside those of the problem.

The rotation is the one that takes the places X closest to the places x = X + u. It does not see
slopes that strains cause, those of an indented surface, say, which cancel over the boundary.

References
----------
P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, section 3.1; W. Kabsch, Acta
Cryst. A 32 (1976), 922-923, for the closest rotation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.rows.interfaces import Interfaces
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.mortar.solid_interface import SolidInterface
from contact.rows.outline import Outline

Array = NDArray[np.float64]


def refuse_large_rotations(interfaces: Interfaces, u: Array, largest: float) -> None:
    """Raise if a body or one of its contact boundaries turns by more than a small angle.

    Parameters
    ----------
    interfaces : Interfaces
    u : ndarray, shape (ndofs,)
        Displacement of all dofs of all bodies.
    largest : float
        Angle in radians.

    Raises
    ------
    InputError
        It names the body and the angle.
    """
    bodies = interfaces.bodies
    for side in interfaces.sides:
        if not isinstance(side, Interface | SolidInterface):
            continue
        for outline in (side.first, side.second):
            k = bodies.number_of_trace(outline.body)
            for what, angle in _angles(outline, u[bodies.slices[k]]):
                if angle > largest:
                    raise InputError(
                        f"sliding: {what}{bodies.called(k)} turns by {np.degrees(angle):.3g} "
                        "degrees, which small strains mistake for a strain of "
                        f"{1.0 - np.cos(angle):.2g}; they allow rotations of up to "
                        f"{np.degrees(largest):.3g} degrees, see largest_rotation"
                    )


def _angles(outline: Outline, u: Array) -> list[tuple[str, float]]:
    """Rotations in radians of a contact boundary and of its whole body."""
    body, corners = outline.body, outline.corners
    X, moved = body.mesh.p, _of_vertices(body, u)
    edges = X[:, corners] - X[:, corners].mean(axis=2, keepdims=True)
    area = np.linalg.norm(edges, axis=0).mean(axis=1) ** (body.dim - 1)
    weight = np.bincount(
        corners.ravel(), np.repeat(area, corners.shape[1]), minlength=X.shape[1]
    ).astype(np.float64)
    used = np.unique(body.mesh.t)
    return [
        ("the contact boundary of ", rotation(X, moved, weight)),
        ("", rotation(X[:, used], moved[:, used], np.ones(used.size))),
    ]


def _of_vertices(body: Any, u: Array) -> Array:
    """Displacement of the vertices of a mesh, shape (dim, nvertices)."""
    value = body.scalar_dofs.nodal_dofs[0]
    return np.array([u[body.dim * value + c] for c in range(body.dim)])


def rotation(X: Array, u: Array, weight: Array) -> float:
    """Angle in radians of the rotation that takes places X closest to X + u.

    Parameters
    ----------
    X, u : ndarray, shape (dim, n)
    weight : ndarray, shape (n,)
        Of the squares of the distances.

    Examples
    --------
    >>> X = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    >>> u = 0.1 * np.array([-X[1], X[0]])  # a rotation of small displacements
    >>> round(float(np.tan(rotation(X, u, np.ones(3)))), 12)
    0.1
    """
    x = X + u
    here, there = (v - (v @ weight / weight.sum())[:, None] for v in (X, x))
    U, _, V = np.linalg.svd((there * weight) @ here.T)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    R = U @ V
    if len(R) == 2:
        return float(abs(np.arctan2(R[1, 0] - R[0, 1], np.trace(R))))
    turn = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(turn, np.trace(R) - 1.0))
