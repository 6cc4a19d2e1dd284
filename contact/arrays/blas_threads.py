"""One BLAS thread for the dense algebra of a contact boundary."""

from __future__ import annotations

import functools
import importlib.util
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Up to here one thread is quicker: measured at 260 and at 1040 boundary unknowns.
_ONE_THREAD = 2000
_lock = threading.Lock()
_inside = 0
_limits: list[Any] = []


@contextmanager
def one_blas_thread(size: int) -> Iterator[None]:
    """Hold OpenBLAS to one thread while matrices of this size are worked on.

    OpenBLAS's threads and those of MKL PARDISO go on spinning after their work and take the cores
    from each other; small matrices gain nothing from threads that could make up for it. Needs
    threadpoolctl, which comes with the extra ``mkl``; without it nothing is limited.

    Parameters
    ----------
    size : int
        Order of the largest dense matrix; from 2000 on the threads are left alone.
    """
    global _inside
    openblas = _openblas() if size < _ONE_THREAD else None
    if openblas is None:
        yield
        return
    with _lock:  # the number of threads belongs to the process: the last one out restores it
        _inside += 1
        if _inside == 1:
            _limits.append(openblas.limit(limits=1))
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _limits.pop().restore_original_limits()


@functools.cache
def _openblas() -> Any:
    """NumPy's and SciPy's OpenBLAS libraries, or None."""
    if importlib.util.find_spec("threadpoolctl") is None:
        return None
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(internal_api="openblas")
