"""Whether a body on many processes is condensed or solved by multigrid."""

from __future__ import annotations

import math
import os

from skfem_adini.distributed import has_petsc

# Unknowns in space from which Newton's steps by multigrid are faster than one factorisation with
# its Schur complement; in the plane the factorisation was faster up to the largest bodies measured.
LARGE_IN_SPACE = 100_000
# Bytes of MUMPS's factors: measured at 396,294 unknowns in the plane and at 107,811 in space, with
# the growth of nested dissection.
_PLANE = 2.5e3 / 18.6  # times n log2 n
_SPACE = 1.8e9 / 107_811 ** (4 / 3)  # times n^(4/3)
_DENSE = 3.0 * 8.0  # the complement, its factor and the compliance, on each process


def factor_memory(unknowns: int, rows: int, dim: int, processes: int) -> float:
    """Estimate the bytes that the condensation needs on all processes together.

    Parameters
    ----------
    unknowns, rows : int
        Of the body, and in contact.
    dim, processes : int
    """
    n = float(max(unknowns, 2))
    sparse = _SPACE * n ** (4 / 3) if dim == 3 else _PLANE * n * math.log2(n)
    return sparse + _DENSE * processes * float(rows) ** 2


def choose_backend(unknowns: int, rows: int, dim: int, processes: int) -> tuple[str, str]:
    """The back end, and why.

    Parameters
    ----------
    unknowns, rows, dim, processes : int
        As for `factor_memory`.
    """
    if processes == 1 and not has_petsc():
        return "mumps", "one process without PETSc takes the sparse solvers of other bodies"
    need, there = factor_memory(unknowns, rows, dim, processes), physical_memory()
    gigabytes = f"the factor would take about {need / 1e9:.1f} of {there / 1e9:.1f} GB"
    if need > 0.5 * there:
        return "krylov", gigabytes
    if dim == 3 and unknowns >= LARGE_IN_SPACE:
        return "krylov", f"{unknowns} unknowns in space are solved faster by multigrid"
    return "mumps", gigabytes


def physical_memory() -> float:
    """Bytes of memory of this machine; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")
