"""Cholesky factor of the boundary's stiffness, rigid motions held by springs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from contact.arrays.dense_arrays import HostArrays
from contact.condensation.boundary_problem import Array
from contact.condensation.strain_factor import STRAIN_UNKNOWNS
from contact.errors import InputError

# Multiples of the mean stiffness added to the diagonal, tried in turn: rounding may make that of a
# thin body indefinite. Shifted solutions only start `contact.problem.stiffness_form`.
SHIFTS = (0.0, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9)
# Least over largest pivot below which bending is so soft that compression loses digits.
THIN = 1e-6


def held_factor(arrays: HostArrays, stiffness: Callable[[], Any], N: Array) -> tuple[Any, bool]:
    """Factor of ``S_b + rho N N^T``, and whether bending is far softer than compression.
    `stiffness` returns a new copy of S_b (nb, nb); N (nb, k) are the free rigid motions. Raises
    InputError where the matrix is indefinite by more than rounding."""
    on_device = arrays.put(N)
    for shift in SHIFTS:
        S = stiffness()
        mean = S.diagonal().mean()
        S = S + mean * (on_device @ on_device.T) if N.shape[1] else S
        if shift:
            i = arrays.xp.arange(S.shape[0])
            S[i, i] += shift * mean
        with suppress(np.linalg.LinAlgError):
            L = arrays.cholesky(S)
            pivots = arrays.get(L.diagonal()) ** 2
            return L, bool(pivots.size and pivots.min() < THIN * pivots.max())
    raise InputError(
        "stiffness: the condensed stiffness is not positive definite; the material or the mesh is "
        "not admissible, or cells are too slender for its digits: make them squarer, or fewer (up "
        f"to {STRAIN_UNKNOWNS} unknowns the strains are factored instead, with twice the digits)"
    )
