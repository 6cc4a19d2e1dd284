"""Transforms of arrays of NumPy or CuPy, and products of symbols."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from skfem_adini.ground.arrays import cores, namespace


def fft_of(xp: Any) -> Any:
    """The module of transforms, with SciPy's names, for arrays of this module."""
    if xp is np:
        return scipy.fft
    import cupyx.scipy.fft

    return cupyx.scipy.fft


def filtered(symbol: Any, values: Any) -> Any:
    """The product of a symbol and the real transform of values, (dim, nx[, ny])."""
    xp, axes = namespace(values), tuple(range(1, values.ndim))
    fft = fft_of(xp)
    # Threads of one transform; small ones do not profit from them.
    threads = {"workers": cores()} if xp is np and values.size >= 1 << 17 else {}
    products = symbol.times(fft.rfftn(values, axes=axes, **threads))
    return fft.irfftn(products, s=values.shape[1:], axes=axes, overwrite_x=True, **threads)
