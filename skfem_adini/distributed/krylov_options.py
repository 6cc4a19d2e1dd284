"""Algebraic multigrid as a preconditioner of PETSc's Krylov methods."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OPTIONS: dict[str, dict[str, Any]] = {
    "gamg": {
        "pc_type": "gamg",
        "pc_gamg_threshold": 0.01,
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "jacobi",
    },
    "hypre": {"pc_type": "hypre", "pc_hypre_type": "boomeramg"},
}


def precondition(ksp: Any, matrix: Any, near_null: Array, method: str) -> None:
    """Give a PETSc Krylov method a multigrid ("gamg" or "hypre") of a matrix.
    The near-null space (own unknowns, modes), functions of little energy, is made orthonormal."""
    from petsc4py import PETSc

    v = matrix.createVecRight()
    vectors: list[Any] = []
    for mode in near_null.T:
        v.setArray(np.ascontiguousarray(mode))
        before = v.norm()
        for earlier in vectors:
            v.axpy(-v.dot(earlier), earlier)
        if v.norm() > 1e-8 * before:
            v.normalize()
            vectors.append(v.copy())
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=PETSc.COMM_WORLD))
    prefix = f"skfem_adini_{id(ksp)}_"
    ksp.setOptionsPrefix(prefix)
    options = PETSc.Options()
    for name, value in OPTIONS[method].items():
        options[prefix + name] = value
    ksp.setFromOptions()
    for name in OPTIONS[method]:
        options.delValue(prefix + name)
