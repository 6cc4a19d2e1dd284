"""The operator of the iteration in `eigs`, and the map from its eigenvalues to those wanted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from gpu.eigenvalues.operator import Matrix, factorized
from gpu.errors import InputError

# Rounding error of the inverse relative to its least wanted eigenvalue: above this value the order
# of its eigenvalues is not reliable.
DROWNED = 1e-6
# The shift must be this many times nearer to sigma than the farthest wanted eigenvalue, or this
# many times farther away; otherwise eigenvalues nearest to the shift need not be nearest to sigma.
APART = 1e3
# Logarithms to base 2, of moduli that count as different, and of the largest unit.
UNEVEN, MOST_UNEVEN = 1e-6, 400.0
# Parts without connection for which units are sought.
MOST_PARTS = 100


def shifts(matrix: Matrix, mass: Matrix | None, sigma: Any) -> Iterator[Any]:
    """Sigma, then shifts close to it, in case it is an eigenvalue."""
    yield sigma
    if sigma is not None:
        yield from (sigma * (1.0 + step) for step in (1e-9, 1e-7) if sigma)
        size = (matrix.norm or 1.0) / (1.0 if mass is None else mass.norm or 1.0)
        yield from (sigma + step * size for step in (1e-9, 1e-8, 1e-7))


@dataclass(frozen=True)
class EigenProblem:
    """The operator of the iteration: A, M^-1 A or (A - shift M)^-1 M."""

    apply: Callable[[Any], Any]
    dtype: Any
    values: Callable[[np.ndarray], np.ndarray]  # maps its eigenvalues to those of the pencil
    matrix: Any = None  # its entries, if it is A and they are stored

    @classmethod
    def of(cls, matrix: Matrix, mass: Matrix | None, shift: Any) -> EigenProblem | None:
        """The operator for this shift, with its factors; None if ``A - shift M`` is singular.
        Raises `InputError` if M is singular or if a matrix to be factored is given as an operator.
        """
        real = matrix.real and (mass is None or mass.real) and np.isrealobj(shift)
        dtype = np.dtype(float if real else complex)
        unit = matrix.unit
        if shift is None and mass is None:
            if unit == 1.0:
                return cls(matrix.apply, dtype, lambda theta: theta, matrix.explicit)
            return cls(lambda x: matrix.apply(x * unit), dtype, lambda theta: theta / unit)
        if mass is not None and mass.explicit is None:
            raise InputError("M: an operator cannot be factored; pass its entries")
        if shift is None:
            assert mass is not None
            # Real factors drop the imaginary part of right-hand sides, or refuse it.
            entries = mass.explicit if mass.dtype == dtype else mass.explicit.astype(dtype)
            solve = factorized(entries, matrix.xp)
            if solve is None:
                raise InputError("M is singular: give sigma, so that A - sigma M is factored")
            by_mass = solve
            return cls(lambda x: by_mass(matrix.apply(x * unit)), dtype, lambda t: t / unit)
        if matrix.explicit is None:
            raise InputError(
                "sigma: A is an operator and cannot be factored; pass eigs an operator of "
                "(A - sigma)^-1 and take sigma + 1 / w"
            )
        solve = factorized(_shifted(matrix, mass, shift * unit, unit), matrix.xp)
        if solve is None:
            return None
        if mass is None:
            return cls(solve, dtype, lambda theta: shift + 1.0 / (theta * unit))
        weigh, inverse = mass.apply, solve
        return cls(lambda x: inverse(weigh(x)), dtype, lambda theta: shift + 1.0 / (theta * unit))


def even_units(matrix: Matrix) -> Any:
    """Units d, powers of two, with :math:`|a_{ij}| d_j / d_i = |a_{ji}| d_i / d_j` up to a factor
    of two, or None if none exist or they change nothing. They make a matrix of convection and
    diffusion on a line or grid nearly normal."""
    A = matrix.explicit
    if A is None or matrix.xp is not np or matrix.n < 2:
        return None
    A = abs(sparse.csr_array(A))
    A.eliminate_zeros()
    twin = sparse.csr_array(A.T)
    A.sort_indices()
    twin.sort_indices()
    if not np.array_equal(A.indptr, twin.indptr) or not np.array_equal(A.indices, twin.indices):
        return None
    half = sparse.csr_array((0.5 * np.log2(A.data / twin.data), A.indices, A.indptr), A.shape)
    if not np.abs(half.data).max(initial=0.0) > UNEVEN:
        return None
    log = np.zeros(matrix.n)
    count, label = csgraph.connected_components(A, directed=False)
    for first in np.unique(label, return_index=True)[1] if count <= MOST_PARTS else ():
        order, before = csgraph.breadth_first_order(A, first)
        step = half[order[1:], before[order[1:]]]
        for i, j, change in zip(order[1:].tolist(), before[order[1:]].tolist(), step, strict=True):
            log[i] = log[j] + change
        log[order] -= (log[order].max() + log[order].min()) / 2.0
    rows = np.repeat(np.arange(matrix.n), np.diff(A.indptr))
    wrong = np.abs(log[rows] - log[A.indices] - half.data).max()
    if not wrong <= UNEVEN or not 1.0 <= np.abs(log).max() <= MOST_UNEVEN:
        return None
    return np.exp2(np.round(log))


def told_apart(theta: np.ndarray, rounding: float, away: np.ndarray, moved: float) -> bool:
    """Whether the largest eigenvalues `theta` of an inverse are surely those nearest to sigma.
    `rounding` is the error of the inverse, `away` the distances of the pencil's eigenvalues from
    sigma, `moved` that of the shift."""
    reach = float(away.max())
    return bool(
        rounding <= DROWNED * np.abs(theta).min()
        and not (moved and moved < APART * reach < APART**2 * moved)
    )


def _shifted(matrix: Matrix, mass: Matrix | None, sigma: Any, unit: float) -> Any:
    """``unit A - sigma M``, sparse only if both are."""
    A, xp = matrix.explicit * unit, matrix.xp
    if hasattr(A, "tocsr"):
        if xp is np:
            from scipy import sparse
        else:
            from cupyx.scipy import sparse  # type: ignore[no-redef]
        B = sparse.identity(matrix.n, format="csr") if mass is None else mass.explicit
        if not hasattr(B, "tocsr"):
            return A.toarray() - sigma * B
        return A - sigma * B
    if mass is not None and hasattr(mass.explicit, "tocsr"):
        return A - sigma * mass.explicit.toarray()
    if mass is not None:
        return A - sigma * mass.explicit
    shifted = A.astype(np.result_type(A.dtype, type(sigma)))
    places = xp.arange(matrix.n)
    shifted[places, places] -= sigma
    return shifted
