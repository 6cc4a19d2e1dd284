"""One BLAS thread for the dense algebra of a contact boundary."""

from __future__ import annotations

import functools
import importlib.util
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()
_inside = 0
_limits: list[Any] = []


@contextmanager
def one_blas_thread(size: int) -> Iterator[None]:
    """Limit OpenBLAS to one thread in this context, unless matrices have order 2000 or more.
    Threads of OpenBLAS and MKL PARDISO busy-wait and take the cores from each other. Without
    threadpoolctl (extra ``mkl``) nothing is limited."""
    global _inside
    # For smaller matrices one thread is faster, as measured at 260 and 1040.
    openblas = _openblas() if size < 2000 else None
    if openblas is None:
        yield
        return
    with _lock:  # the limit applies to the whole process: the last context to exit removes it
        _inside += 1
        if _inside == 1:
            _take_control()
            _limits.append(openblas.limit(limits=1))
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _take_control()
                _limits.pop().restore_original_limits()


@functools.cache
def _openblas() -> Any:
    """NumPy's and SciPy's OpenBLAS libraries, or None."""
    if importlib.util.find_spec("threadpoolctl") is None:
        return None
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(internal_api="openblas")


def _take_control() -> None:
    """Let this thread set the limit: since threadpoolctl 3.8 only the first one may."""
    import threadpoolctl

    clear = getattr(threadpoolctl.OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
