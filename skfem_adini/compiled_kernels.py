"""Compilation of kernels at their first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any


@lru_cache
def compiled_cut_boxes() -> Callable[..., Any]:
    """Return `cut_boxes.cut_boxes`, compiled by numba, with all that it calls.

    The compiled functions replace the plain ones in their modules, callees first, so that calls
    find them. numba keeps the code in ``__pycache__``, keyed by the caller's source alone: after a
    change of one of these modules touch the others.
    """
    import numba

    from . import bernstein_kernels, cut_boxes, cut_kernels

    for module in (bernstein_kernels, cut_kernels, cut_boxes):
        for name in module.KERNELS:
            entry = name == "cut_boxes"
            compile_ = numba.njit(
                cache=True, no_cpython_wrapper=not entry, no_cfunc_wrapper=True, nogil=True
            )
            setattr(module, name, compile_(getattr(module, name)))
    return cut_boxes.cut_boxes
