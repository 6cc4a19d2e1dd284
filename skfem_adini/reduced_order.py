"""The warning about cells on which Adini's elements lose order."""

from __future__ import annotations

import warnings

from .errors import ReducedOrderWarning

NEGLIGIBLE_TWIST = 1e-3


def warn_of_twist(twist: float, affine_name: str, cell_name: str) -> None:
    """Warn when the largest twist, over the longest side of its cell, is not negligible.

    Warns
    -----
    ReducedOrderWarning
        The twist is above 1e-3.
    """
    if twist > NEGLIGIBLE_TWIST:
        warnings.warn(
            f"the cells are not {affine_name}s (twist t = {twist:.2g} of the longest side). "
            f"The error gains terms of size t^2 h^2 and t h^3: if t stays constant under "
            f"refinement, the orders fall from 4 to 2 in L2 and from 3 to 1 in H1; if t falls "
            f"like h, as in uniform refinement of a coarse {cell_name} mesh, orders 4 and "
            f"3 are kept",
            ReducedOrderWarning,
            stacklevel=5,
        )
