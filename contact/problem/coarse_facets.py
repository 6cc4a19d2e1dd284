"""Warning if the facets of two bodies in contact are of very different lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from contact.errors import warn

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]

_RATIO = 4.0  # of the lengths of facets that face each other in a contact zone
_VARIES = 0.05  # part of the largest pressure: one that varies by less is resolved by any facets


def warn_of_coarse_facets(result: ContactResult, ratio: Array) -> None:
    """Warn if facets in contact face others of less than a quarter of their length.

    The coarser of the two meshes limits the accuracy of the pressure.

    Parameters
    ----------
    result : ContactResult
    ratio : ndarray, shape (m,)
        See `contact.rows.mortar.resolution.facet_ratio`.

    Warns
    -----
    ContactWarning
    """
    p = result.pressure
    loaded = p > 1e-12 * p.max(initial=0.0)
    if not loaded.any() or np.ptp(p) <= _VARIES * p.max():
        return
    worst = float(ratio[loaded].max())
    if worst > _RATIO * (1 + 1e-9):
        warn(
            f"facets in contact are up to {worst:.0f} times as long as those of the other body: "
            "the coarser mesh limits the accuracy of the pressure; refine it there"
        )
