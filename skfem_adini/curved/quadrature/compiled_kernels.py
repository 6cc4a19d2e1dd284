"""The compiled kernels of cut boxes, which replace the plain functions on first use."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

from skfem_adini.jit import compiled

# Several threads may request the kernels at once; the lock lets one of them replace the functions.
_lock = threading.Lock()


@lru_cache
def compiled_cut_boxes() -> Callable[..., Any]:
    """Return `graph_boxes.cut_boxes`, compiled by numba, with all that it calls.

    The compiled functions replace the plain ones in their modules, callees first, so that calls
    find them.
    """
    from skfem_adini.curved.quadrature import bernstein_kernels, graph_boxes, graph_rules

    with _lock:
        for module in (bernstein_kernels, graph_rules, graph_boxes):
            for name in module.KERNELS:
                kernel = getattr(module, name)
                if isinstance(kernel, FunctionType):
                    wrapped = name == "cut_boxes"
                    kernel = compiled(kernel, no_cpython_wrapper=not wrapped, no_cfunc_wrapper=True)
                    setattr(module, name, kernel)
    return graph_boxes.cut_boxes
