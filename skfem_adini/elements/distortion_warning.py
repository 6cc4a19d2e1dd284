"""The log message about cells on which Adini's elements lose order."""

from __future__ import annotations

import logging
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Relative to the longest side: noise of coordinates in files is far below.
NEGLIGIBLE_TWIST = 1e-3

_logger = logging.getLogger(__name__)
# The meshes that were spoken of, by their addresses.
_spoken_of: weakref.WeakValueDictionary[int, Any] = weakref.WeakValueDictionary()


def log_twist(twist: float, cells: Any, mapping: Any, X: NDArray[np.float64]) -> None:
    """Log, once for a mesh, that the twist of its cells over their sides is not negligible.

    Parameters
    ----------
    twist
        The largest relative twist; above 1e-3 a message of level WARNING is logged.
    cells
        Geometry of the cells, with the names in the message.
    mapping, X
        Those of the basis. Points with an axis of cells belong to facets or probes, for which
        nothing is logged.
    """
    mesh = getattr(mapping.mesh, "part_of", mapping.mesh)
    if twist <= NEGLIGIBLE_TWIST or X.ndim > 2 or _spoken_of.get(id(mesh)) is mesh:
        return
    _spoken_of[id(mesh)] = mesh
    _logger.warning(
        "the cells are not %ss (twist t = %.2g of the longest side). The error gains terms of size "
        "t^2 h^2 and t h^3: if t stays constant under refinement, the orders fall from 4 to 2 in "
        "L2 and from 3 to 1 in H1; if t falls like h, as in uniform refinement of a coarse %s "
        "mesh, orders 4 and 3 are kept",
        cells.affine_name,
        twist,
        cells.general_name,
    )
