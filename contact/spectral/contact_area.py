"""Area and perimeter of the contact on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError


def perimeter(
    touching: NDArray[np.bool_],
    spacing: tuple[float, ...],
    mirrored: tuple[bool, ...] = (False, False),
) -> float:
    """Length of the edges between cells in contact and others; of a profile the number of ends.

    Cells on a side that is not periodic, but mirrored, are halves.
    """
    cell, length = float(np.prod(spacing)), 0.0
    for axis, h in enumerate(spacing):
        share = shares(touching.shape, mirrored)
        if mirrored[axis]:
            edges = np.diff(touching, axis=axis)
            share = np.take(share, [1], axis=axis)
        else:
            edges = touching != np.roll(touching, 1, axis)
        length += float(np.sum(edges * share)) * cell / h
    return length


def shares(shape: tuple[int, ...], mirrored: tuple[bool, ...]) -> NDArray[np.float64]:
    """Area of each point in units of a cell."""
    whole = np.ones(shape)
    for axis in np.flatnonzero(mirrored[: len(shape)]):
        np.moveaxis(whole, axis, 0)[[0, -1]] *= 0.5
    return whole


def corrected_area(
    touching: NDArray[np.bool_],
    spacing: tuple[float, ...],
    mirrored: tuple[bool, ...] = (False, False),
) -> float:
    r"""Contact area from the cells in contact, corrected by their perimeter.

    The area counted is too large by about :math:`(\pi - 1 + \ln 2) / 24` times perimeter times
    spacing, where the perimeter is that of the cells.

    References
    ----------
    V. A. Yastrebov, G. Anciaux and J.-F. Molinari, On the accurate computation of the true
    contact-area in mechanical contact of random rough surfaces, Tribology International 114 (2017)
    161-171.
    """
    if touching.ndim != 2:
        raise InputError("corrected_area: the correction is known for surfaces, not for profiles")
    counted = float((touching * shares(touching.shape, mirrored)).sum() * np.prod(spacing))
    excess = (np.pi - 1 + np.log(2)) / 24 * perimeter(touching, spacing, mirrored)
    return counted - excess * float(np.sqrt(np.prod(spacing)))
