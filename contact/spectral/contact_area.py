"""Area and perimeter of the contact on a periodic grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError


def perimeter(touching: NDArray[np.bool_], spacing: tuple[float, ...]) -> float:
    """Length of the edges between cells in contact and others; of a profile the number of ends."""
    cell = float(np.prod(spacing))
    edges = (
        np.count_nonzero(touching != np.roll(touching, 1, axis)) * cell / h
        for axis, h in enumerate(spacing)
    )
    return float(sum(edges))


def corrected_area(touching: NDArray[np.bool_], spacing: tuple[float, ...]) -> float:
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
    counted = float(np.count_nonzero(touching) * np.prod(spacing))
    excess = (np.pi - 1 + np.log(2)) / 24 * perimeter(touching, spacing)
    return counted - excess * float(np.sqrt(np.prod(spacing)))
