"""The processes of a run: MPI's communicator, or one process alone."""

from __future__ import annotations

import os
import sys
import traceback
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import AdiniError, MissingDependency

INSTALLING = (
    "install PETSc by one of: apt install python3-petsc4py-real python3-slepc4py-real; conda "
    "install -c conda-forge petsc4py slepc4py; or, with PETSC_DIR and SLEPC_DIR set to an "
    "existing PETSc, pip install 'skfem-adini[petsc]'"
)


class Communicator(Protocol):
    """The part of ``mpi4py.MPI.Comm`` that this package uses."""

    @property
    def rank(self) -> int:
        """Number of this process, from 0."""
        ...

    @property
    def size(self) -> int:
        """Number of processes."""
        ...

    def allgather(self, sendobj: Any) -> list[Any]:
        """One object from each process, on all of them."""
        ...

    def alltoall(self, sendobj: list[Any]) -> list[Any]:
        """One object from each process for each other one."""
        ...

    def bcast(self, obj: Any, root: int = 0) -> Any:
        """The object of one process, on all of them."""
        ...

    def gather(self, sendobj: Any, root: int = 0) -> list[Any] | None:
        """One object from each process, on one of them."""
        ...

    def scatter(self, sendobj: Any, root: int = 0) -> Any:
        """One object of a list that one process has, for each."""
        ...


class Alone:
    """The communicator of a single process, which needs no MPI."""

    rank, size = 0, 1

    def allgather(self, sendobj: Any) -> list[Any]:
        """The object in a list."""
        return [sendobj]

    def alltoall(self, sendobj: list[Any]) -> list[Any]:
        """The list itself."""
        return sendobj

    def bcast(self, obj: Any, root: int = 0) -> Any:
        """The object itself."""
        return obj

    def gather(self, sendobj: Any, root: int = 0) -> list[Any] | None:
        """The object in a list."""
        return [sendobj]

    def scatter(self, sendobj: Any, root: int = 0) -> Any:
        """The object of this process."""
        return sendobj[0]


def world() -> Any:
    """Return the communicator of all processes of this run.

    With several processes an uncaught exception ends all of them after its traceback, since the
    others would wait forever.

    Returns
    -------
    mpi4py.MPI.Comm or Alone
        The latter where mpi4py is not installed and no launcher has started the script.

    Raises
    ------
    MissingDependency
        A launcher has started several processes, and mpi4py is not installed.
    AdiniError
        The launcher has started more processes than this MPI library sees: it belongs to another
        one, and each process would solve the whole problem by itself.

    Examples
    --------
    >>> world().size
    1
    """
    # Environment variables in which launchers give the number of processes.
    names = "OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE"
    launched = max(int(os.environ.get(name, "1")) for name in names)
    try:
        from mpi4py import MPI
    except ImportError:
        if launched > 1:
            raise MissingDependency(
                f"a launcher has started {launched} processes, which need mpi4py: pip install "
                "mpi4py"
            ) from None
        return Alone()
    comm = MPI.COMM_WORLD
    if comm.size < launched:
        library = MPI.Get_library_version().split(",")[0].split("\n")[0]
        raise AdiniError(
            f"comm: the launcher has started {launched} processes, but mpi4py's library ({library})"
            f" sees {comm.size}: they belong to different MPI libraries; start the script with the "
            "mpiexec of that library"
        )
    if comm.size > 1 and sys.excepthook is sys.__excepthook__:
        sys.excepthook = _end_all
    return comm


def _end_all(kind: Any, error: Any, trace: Any) -> None:
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    sys.stdout.flush()
    lines = "".join(traceback.format_exception(kind, error, trace))
    sys.stderr.write(f"process {comm.rank} of {comm.size}:\n{lines}")
    sys.stderr.flush()
    comm.Abort(1)


def petsc(comm: Any) -> Any:
    """Return petsc4py's module PETSc, for the processes of a communicator.
    PETSc and mpi4py must be built with the same MPI library."""
    try:
        from petsc4py import PETSc
    except ImportError as error:
        raise MissingDependency(f"petsc4py cannot be imported ({error}); {INSTALLING}") from None
    if PETSc.COMM_WORLD.size < comm.size:
        raise AdiniError(
            f"petsc4py: it sees {PETSc.COMM_WORLD.size} processes and mpi4py {comm.size}: both "
            "must be built with the same MPI library"
        )
    return PETSc


def has_petsc() -> bool:
    """Whether petsc4py can be imported."""
    try:
        petsc(Alone())
    except MissingDependency:
        return False
    return True


def total(comm: Communicator, value: Any) -> NDArray[np.float64]:
    """Sum over the processes in their order: identical bits on all of them."""
    return np.asarray(sum(comm.allgather(np.asarray(value, dtype=np.float64))), dtype=np.float64)


def largest(comm: Communicator, value: float) -> float:
    """Largest number of all processes."""
    return max(comm.allgather(float(value)))


def any_of(comm: Communicator, value: Any) -> bool:
    """Whether a condition holds on any process."""
    return any(comm.allgather(bool(value)))
