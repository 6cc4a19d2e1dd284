"""What other threads compute of a body while the library of a sparse solver works."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.free_motions import free_motions
from contact.condensation.elimination_order import dissected_if_large, elimination_tree


class Beside:
    """Free rigid motions of a body, and for a device its dissection; they begin at once.

    Parameters
    ----------
    body : BasisSolid
    on_device : bool
    """

    def __init__(self, body: Any, on_device: bool) -> None:
        self._pool = ThreadPoolExecutor(2)
        self._motions = self._pool.submit(free_motions, body)
        self._parts = self._pool.submit(dissected_if_large, body) if on_device else None

    def __enter__(self) -> Beside:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown()

    def motions(self) -> NDArray[np.float64]:
        """See `contact.body.free_motions.free_motions`."""
        return self._motions.result()

    def tree(self, kept: NDArray[np.int64]) -> Callable[[], Any]:
        """What waits for the tree of `contact.condensation.elimination_order.elimination_tree`."""
        parts = self._parts
        assert parts is not None
        return self._pool.submit(lambda: elimination_tree(parts.result(), kept)).result
