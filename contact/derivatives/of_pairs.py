"""Derivatives of the rows of two bodies that slide on each other, by coloured differences.

Those of Newton's method leave out that ends of segments move, which errs by 1e-4 of a gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError, NotConverged
from contact.rows.mortar.mortar_rows import MortarRows
from contact.rows.tool_rows import RowsInMotion

Array = NDArray[np.float64]
Csr = sparse.csr_array
_STEP = 1e-7  # of the extent: differences of displacements


def of_pairs(slide: Any, change: RowsInMotion, result: Any) -> tuple[RowsInMotion, Csr]:
    """The derivatives `change` of all rows at a result, those between bodies replaced; and those
    of the points' areas, (m, ndofs).
    Raises NotConverged where rows jump, InputError where laws depend on areas that move."""
    here, u, (m, slips) = slide.here, result.u, result.t.shape
    own = np.zeros(m, dtype=bool)
    for found, points in zip(here.projected, here.points, strict=True):
        own[points] = isinstance(found, MortarRows)
    if not own.any():
        return change, Csr(change.normal.shape)
    if result.system.law == "tresca" or result.system.lawful:
        raise InputError(
            "vjp: bodies that slide on each other have derivatives with Coulomb's friction or none "
            "on hard surfaces: given bounds and layers count per area, which changes as they slide"
        )
    of_slips = np.repeat(own, slips)
    mu, t = result.mu * own, result.t * own[:, None]

    def terms(place: Array) -> Array:
        rows = here.displaced(place).rows
        if rows.gap.size != m:
            raise NotConverged("vjp: other contact points appear as bodies slide; no derivative")
        gaps, slip = rows.G @ place - rows.gap, rows.T @ (place - slide.last)
        force = rows.G.T @ mu + rows.T.T @ t.ravel()
        return np.concatenate((rows.weights * own, gaps * own, slip * of_slips, force))

    rows = here.rows
    each = sparse.kron(sparse.eye_array(m), np.ones((1, slips)))
    T = Csr(each @ (abs(rows.T) + abs(change.tangential)))
    near = boolean(sparse.diags_array(own * 1.0) @ (abs(rows.G) + abs(change.normal) + T))
    near = boolean(near @ (near.T @ near))  # neighbours of those that share a point
    together = boolean(near.T @ near)
    pattern = Csr(sparse.vstack([near, near, boolean(each.T @ near), together], format="csr"))
    step = _STEP * result.solid.extent

    def difference(moves: Array) -> Array:
        return terms(u + moves) - terms(u - moves)

    colour = coloured(pattern)
    found = rates(difference, pattern, colour, np.full(u.size, step))
    moves = step * np.random.default_rng(0).uniform(-1.0, 1.0, u.size) * (colour >= 0)
    change_of, expected = difference(moves), 2.0 * (found @ moves)
    if not np.abs(change_of - expected).max() <= 1e-3 * np.abs(change_of).max():
        raise NotConverged(
            "vjp: rows of sliding bodies jump at this place, as where a node passes another; take "
            "other steps"
        )
    of_areas, found = Csr(found[:m]), Csr(found[m:])
    normal = Csr(found[:m] - sparse.diags_array(own * 1.0) @ rows.G)
    along = Csr(found[m : m + m * slips] - sparse.diags_array(of_slips * 1.0) @ rows.T)
    kept, held = sparse.diags_array(~own * 1.0), sparse.diags_array(~of_slips * 1.0)
    others = result.mu * ~own, result.t * ~own[:, None]
    of_tools = here.in_motion(u, slide.last, *others, slide.opposites)
    moved = replace(
        change,
        normal=Csr(kept @ change.normal + normal),
        tangential=Csr(held @ change.tangential + along),
        force=Csr(of_tools.force + found[m + m * slips :]),
    )
    return moved, of_areas


def rates(
    difference: Callable[[Array], Array], pattern: Csr, colour: NDArray[np.int64], steps: Array
) -> Csr:
    """Derivatives of terms, entries of `pattern` (terms, unknowns), by central differences.
    `difference` is that of the terms by moves of unknowns ahead and back; those of a colour, which
    share no term, move at once, by `steps`; zero steps give zero."""
    row, moved = pattern.tocoo().row, colour[pattern.indices]
    step, data = steps[pattern.indices], np.zeros(pattern.nnz)
    for k in range(colour.max(initial=-1) + 1):
        own = (moved == k) & (step > 0)
        data[own] = difference(np.where(colour == k, steps, 0.0))[row[own]] / (2.0 * step[own])
    return Csr((data, pattern.indices, pattern.indptr), shape=pattern.shape)


def coloured(pattern: Csr) -> NDArray[np.int64]:
    """Colour of each unknown that some term depends on, -1 for others; greedy."""
    conflicts = sparse.csr_array(pattern.T @ pattern)
    colour = np.full(pattern.shape[1], -1)
    for node in np.flatnonzero(np.diff(conflicts.indptr)):
        taken = colour[conflicts.indices[conflicts.indptr[node] : conflicts.indptr[node + 1]]]
        colour[node] = np.setdiff1d(np.arange(taken.size + 1), taken)[0]
    return colour


def boolean(matrix: Any) -> sparse.csr_array:
    """Ones at the entries of a matrix."""
    matrix = sparse.csr_array(matrix)
    matrix.data = np.ones(matrix.nnz)
    return matrix
