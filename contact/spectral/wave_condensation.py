r"""Layers condensed onto their lower side, wave by wave, without storing inner planes.

A slab of layers is the real symmetric matrix of its lower and upper unknowns (`wave_cells`). Two of
them are joined by elimination of the plane between. All Schur complements use symmetric Gaussian
elimination without pivoting, which is stable since eliminated blocks are stiffnesses of supported
bodies, hence positive definite. Waves are processed in blocks that fit the cache; on a device by a
kernel with one thread per wave (`contact.spectral.wave_kernel`), with matrices in registers.

References
----------
N. J. Higham, Accuracy and Stability of Numerical Algorithms, SIAM 2002, theorem 10.3, for the
elimination; R. W. Hockney, J. ACM 12 (1965), 95-113, for the doubling.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from contact.spectral import wave_kernel
from contact.spectral.wave_cells import Column, functions
from skfem_adini.ground.arrays import cores, namespace

Waves = Any  # array of NumPy or CuPy, shape (n, n, waves), of which the upper triangle counts
_NUMBERS = 1 << 20  # entries in the largest matrices of a block of waves; 64 times as many for CuPy


def condensed(column: Column, phases: Sequence[Any], base: Any = None) -> tuple[Any, Any]:
    """Stiffness and compliance, upper triangles row by row, of the lower side for the outer product
    of phases, on a `base`; the wave 0 is meaningless if the top is free."""
    xp, r = namespace(phases[0]), column.tables.shape[1] // 2
    if xp is not np and r <= wave_kernel.MOST and not column.kinks:
        return wave_kernel.condensed(column, phases, base)
    waves, d = int(np.prod([p.size for p in phases])), column.dim
    stiffness, compliance = (xp.empty((d * (d + 1) // 2, waves)) for _ in range(2))
    size = max(1, _NUMBERS * (1 if xp is np else 64) // (9 * r * r))
    tables = xp.asarray(column.tables)

    def take(first: int) -> None:
        at = slice(first, min(first + size, waves))
        here = phases_of(phases, at)
        whole, upper = _slab(tables, column, here), np.triu_indices(d)
        # The wave 0 is singular if the top is free; the caller replaces it.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            face = _face(column, whole, base, at)
            stiffness[:, at], compliance[:, at] = face[upper], inverse(face)[upper]

    starts = range(0, waves, size)
    if xp is not np or len(starts) == 1:
        for first in starts:
            take(first)
    else:
        with ThreadPoolExecutor(cores()) as pool:
            list(pool.map(take, starts))
    return stiffness, compliance


def joined(lower: Waves, upper: Waves) -> Waves:
    """Join two slabs, one above the other, each of shape (2 r, 2 r, waves)."""
    r, xp = lower.shape[0] // 2, namespace(lower)
    Z = xp.zeros((3 * r, 3 * r, lower.shape[2]), dtype=lower.dtype)
    Z[:r, :r] = lower[r:, r:] + upper[:r, :r]
    Z[:r, r : 2 * r] = lower[:r, r:].transpose(1, 0, 2)
    Z[:r, 2 * r :] = upper[:r, r:]
    Z[r : 2 * r, r : 2 * r] = lower[:r, :r]
    Z[2 * r :, 2 * r :] = upper[r:, r:]
    return eliminated(Z, r)


def released(slab: Waves, own: Any) -> Waves:
    """Eliminate the unshared unknowns `own` of the lower side; their entries become zero."""
    if not len(own):
        return slab
    order = np.array([*own, *np.setdiff1d(np.arange(slab.shape[0]), own)])
    rest, left = order[len(own) :], namespace(slab).zeros_like(slab)
    low, high = np.minimum.outer(order, order), np.maximum.outer(order, order)
    left[np.ix_(rest, rest)] = eliminated(slab[low, high], len(own))
    return left


def eliminated(Z: Waves, count: int) -> Waves:
    """Schur complement after eliminating the first unknowns; overwrites Z (upper triangle)."""
    n = Z.shape[0]
    for k in range(count):
        scaled = Z[k, k + 1 :] / Z[k, k]
        for i in range(k + 1, n):
            Z[i, i:] -= scaled[i - k - 1] * Z[k, i:]
    return Z[count:, count:]


def inverse(matrices: Waves) -> Waves:
    """Upper triangles of the inverses."""
    n, xp = matrices.shape[0], namespace(matrices)
    Z = xp.zeros((2 * n, 2 * n, matrices.shape[2]), dtype=matrices.dtype)
    Z[:n, :n] = matrices
    Z[range(n), range(n, 2 * n)] = 1.0
    return -eliminated(Z, n)


def _slab(tables: Any, column: Column, phases: Sequence[Any]) -> Waves:
    """All layers together."""
    xp, values, whole = namespace(phases[0]), functions(phases), None
    kinks = column.kinks or [np.zeros(0, dtype=int)] * len(column.counts)
    for table, count, kink in zip(tables, column.counts, kinks, strict=True):
        power, own = xp.tensordot(table, values, axes=1), kink
        for bit in range(count.bit_length()):
            power = joined(power, power) if bit else power
            if count >> bit & 1:
                whole = power if whole is None else joined(whole, released(power, own))
                own = kink[:0]  # only the lowest piece meets another layer
    return whole


def _face(column: Column, whole: Waves, base: Any, at: slice) -> Waves:
    """Stiffness of the unknowns that forces act on, shape (dim, dim, waves)."""
    d, inner = column.dim, column.eliminated
    order = np.array([*inner, *range(d)])
    low, high = np.minimum.outer(order, order), np.maximum.outer(order, order)
    Z = whole[low, high]
    if base is not None:
        Z[np.triu_indices(d)] += base[:, at]
    return eliminated(Z, len(inner))


def phases_of(phases: Sequence[Any], at: slice) -> list[Any]:
    """Phases of a range of waves, numbered with the last direction running fastest."""
    xp, sizes = namespace(phases[0]), [p.size for p in phases]
    index = xp.arange(at.start, at.stop)
    return [p[i] for p, i in zip(phases, xp.unravel_index(index, sizes), strict=True)]
