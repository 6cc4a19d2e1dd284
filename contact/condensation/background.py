"""Work in a host thread while a sparse solver factors a body."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.free_motions import free_motions
from contact.condensation.elimination_order import dissected_if_large, elimination_tree


class BackgroundWork:
    """Nested dissection of a body for a device, started at once, then its free rigid motions.
    The solver waits only for the dissection."""

    def __init__(self, body: Any, on_device: bool) -> None:
        self._pool, self._body = ThreadPoolExecutor(1), body
        self._parts = self._pool.submit(dissected_if_large, body) if on_device else None
        self._later: Future[NDArray[np.float64]] | None = None
        if not on_device:
            self._begin_motions()

    def __enter__(self) -> BackgroundWork:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown()

    def motions(self) -> NDArray[np.float64]:
        """See `contact.body.free_motions.free_motions`."""
        return self._begin_motions().result()

    def tree(self, kept: NDArray[np.int64]) -> Callable[[], Any]:
        """A function that waits for `elimination_tree` in the other thread and returns its tree."""
        parts = self._parts
        assert parts is not None
        tree = self._pool.submit(lambda: elimination_tree(parts.result(), kept))
        self._begin_motions()
        return tree.result

    def _begin_motions(self) -> Future[NDArray[np.float64]]:
        self._later = self._later or self._pool.submit(_motions, self._body)
        return self._later


def _motions(body: Any) -> NDArray[np.float64]:
    """The free motions, after the host data for vectors on the device."""
    _ = body.lengths, body.are_values, body.picked
    return free_motions(body)
