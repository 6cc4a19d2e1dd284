"""Finite element spaces, systems and eigenvalues on many processes, by MPI, PETSc and SLEPc.

In: a mesh and an element, on processes that a launcher started.
Out: `DistributedBasis`, its matrices and vectors, and their solutions by PETSc.
Start: `distributed_basis`: which process has which dof; then `distributed_matrix` and
`distributed_solver`. `communicator` also serves a single process without MPI.
"""

from skfem_adini.distributed.altered_system import Alteration, AlteredSystem
from skfem_adini.distributed.communicator import has_petsc, largest, total, world
from skfem_adini.distributed.distributed_basis import DistributedBasis
from skfem_adini.distributed.distributed_matrix import DistributedMatrix
from skfem_adini.distributed.distributed_solver import DistributedSolver
from skfem_adini.distributed.eigenpairs import lowest_eigenpairs
from skfem_adini.distributed.mumps_schur import MumpsSchur
from skfem_adini.distributed.partition import partition
from skfem_adini.distributed.pieces import TensorGrid
from skfem_adini.distributed.save_pvtu import save_pvtu, write_pieces
from skfem_adini.distributed.smooth_modes import smooth_modes

__all__ = [
    "Alteration",
    "AlteredSystem",
    "DistributedBasis",
    "DistributedMatrix",
    "DistributedSolver",
    "MumpsSchur",
    "TensorGrid",
    "has_petsc",
    "largest",
    "lowest_eigenpairs",
    "partition",
    "save_pvtu",
    "smooth_modes",
    "total",
    "world",
    "write_pieces",
]
