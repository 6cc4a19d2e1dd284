"""The operator that `eigs` iterates with, and the way back from its eigenvalues."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpu.eigen_operator import Matrix, factorized
from gpu.errors import InputError


@dataclass(frozen=True)
class EigenProblem:
    """A or the inverse that is iterated with.

    Attributes
    ----------
    apply : callable x -> product, or None
    dtype : numpy dtype
    values : callable
        From its eigenvalues to those that are wanted.
    matrix : array or None
        Its entries, where they are those of A.
    """

    apply: Callable[[Any], Any] | None
    dtype: Any
    values: Callable[[np.ndarray], np.ndarray]
    matrix: Any = None

    @classmethod
    def of(cls, matrix: Matrix, mass: Matrix | None, sigma: Any, fallback: bool) -> EigenProblem:
        """Factor what has to be; without `apply` where that fails and there is a fallback.

        Raises
        ------
        InputError
            M or A - sigma M is singular, or has no entries.
        """
        real = matrix.real and (mass is None or mass.real) and np.isrealobj(sigma)
        dtype = np.dtype(float if real else complex)
        unit = matrix.unit
        if sigma is None and mass is None:
            if unit == 1.0:
                return cls(matrix.apply, dtype, lambda theta: theta, matrix.explicit)
            return cls(lambda x: matrix.apply(x * unit), dtype, lambda theta: theta / unit)
        if mass is not None and mass.explicit is None:
            raise InputError("M: an operator cannot be factored; pass its entries")
        xp = matrix.xp
        if sigma is None:
            assert mass is not None
            solve = factorized(mass.explicit, xp)
            if solve is None:
                raise InputError("M is singular: give sigma, so that A - sigma M is factored")
            by_mass = solve
            return cls(lambda x: by_mass(matrix.apply(x * unit)), dtype, lambda t: t / unit)
        if matrix.explicit is None:
            raise InputError(
                "sigma: A is an operator and cannot be factored; pass eigs an operator of "
                "(A - sigma)^-1 and take sigma + 1 / w"
            )
        shift, solve = sigma, None
        for attempt in range(3):
            # Where sigma is an eigenvalue the shift moves off it by round-off of half precision.
            solve = factorized(_shifted(matrix, mass, shift * unit, unit), xp)
            if solve is not None:
                break
            step = 1e-9 * 10**attempt * (matrix.norm or 1.0)
            shift = sigma + step / (1.0 if mass is None else mass.norm or 1.0)
        if solve is None and fallback:
            return cls(None, dtype, lambda theta: theta)
        if solve is None:
            raise InputError(
                f"A - sigma M cannot be factored for sigma={sigma} and three values beside it: "
                "take another sigma"
            )
        if mass is None:
            return cls(solve, dtype, lambda theta: shift + 1.0 / (theta * unit))
        weigh, inverse = mass.apply, solve
        return cls(lambda x: inverse(weigh(x)), dtype, lambda theta: shift + 1.0 / (theta * unit))


def _shifted(matrix: Matrix, mass: Matrix | None, sigma: Any, unit: float) -> Any:
    """``unit A - sigma M``, shaped like A."""
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
