"""Run by mpiexec: one process fails in the way that the first argument names."""

import os
import signal
import sys

import numpy as np
import skfem
from skfem.models.poisson import laplace

from skfem_adini.distributed import DistributedBasis, DistributedSolver, save_pvtu, world

comm = world()
space = DistributedBasis(skfem.MeshQuad().refined(3).with_defaults(), skfem.ElementQuad1())
last = comm.rank == comm.size - 1
if sys.argv[1] == "raises" and last:
    raise RuntimeError("this process has had enough")
if sys.argv[1] == "is killed" and last:
    os.kill(os.getpid(), signal.SIGKILL)
if sys.argv[1] == "cannot write" and last:
    space.basis.mesh = None
if sys.argv[1] == "is singular":
    DistributedSolver(space.assemble(laplace), solver="mumps").solve(np.ones(space.basis.N))
save_pvtu(sys.argv[2], space, np.ones(space.basis.N))
comm.allgather(None)
print("all went well")
