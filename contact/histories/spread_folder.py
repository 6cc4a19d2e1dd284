"""The load history of a body on many processes on disk, readable by another number of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from contact.body.distributed_body import DistributedBody
from contact.errors import ContactError
from contact.histories.history_folder import HistoryFolder
from contact.output.archive import read_arrays, write_arrays
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem
from contact.result.stored_result import state_arrays

Array = NDArray[np.float64]
T = TypeVar("T")
_SPREAD = ("load", "u0", "u")  # vectors of the body; everything else is the same on all processes


class SpreadFolder(HistoryFolder):
    """A `HistoryFolder` whose steps have a file from each process beside their index.

    ``step_00001_0.npz``, ... hold the displacement, the load and the prescribed displacement at
    the dofs of each process, which are named by a cell of the whole mesh and their place in it;
    then the first process writes ``step_00001.npz`` with all that is on the contact boundary. A
    step counts as finished once that file is there.

    Attributes
    ----------
    comm : Communicator
    """

    comm: Any

    @classmethod
    def created(
        cls, path: Path, times: Array, system: ContactSystem, fingerprint: str
    ) -> HistoryFolder:
        """Create the folder; `InputError` if it is not empty, or another process creates it."""
        comm = _body(system).comm
        make = super().created
        found = _on_first(comm, lambda: vars(make(path, times, system, fingerprint)))
        return cls._as_told(comm, found)

    @classmethod
    def reopened(cls, path: Path, comm: Any) -> HistoryFolder:
        """Open an existing folder on all processes; `InputError` if it holds no history."""
        opened = super().opened
        return cls._as_told(comm, _on_first(comm, lambda: vars(opened(path))))

    @classmethod
    def _as_told(cls, comm: Any, attributes: dict[str, Any]) -> HistoryFolder:
        folder = cls.__new__(cls)
        vars(folder).update(attributes, comm=comm)
        return folder

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder by the first process against others."""
        lock = super().locked()
        _on_first(self.comm, lock.__enter__)
        try:
            yield
        finally:
            if self.comm.rank == 0:
                lock.__exit__(None, None, None)

    def prepare(self, count: int, system: ContactSystem) -> None:
        """Prepare the folder for the steps after the first `count`, and write the problem."""
        prepare = super().prepare
        _on_first(self.comm, lambda: prepare(count, system))

    def write(self, k: int, result: ContactResult) -> None:
        """Write step k: the parts of all processes, then its index."""
        body = _body(result.system)
        own = {name: vector for name, vector in state_arrays(result).items() if name in _SPREAD}
        arrays = body.places() | {name: body.counted(vector) for name, vector in own.items()}
        failure = ""
        try:
            write_arrays(self._part(k, self.comm.rank), arrays, compress=False)
        except OSError as error:
            failure = f"{type(error).__name__}: {error}"
        for rank, each in enumerate(self.comm.allgather(failure)):
            if each:
                raise OSError(f"process {rank} could not write its part of step {k + 1}: {each}")
        write = super().write
        _on_first(self.comm, lambda: write(k, result))
        self._before = self.comm.bcast(self._before)

    def _arrays_of(self, result: ContactResult) -> dict[str, Any]:
        """What the index of a step holds."""
        whole = {n: a for n, a in state_arrays(result).items() if n not in _SPREAD}
        return whole | {"processes": np.array(self.comm.size)}

    def _read(self, path: Path, k: int, system: ContactSystem | None) -> tuple[Any, Any]:
        """The arrays of a step, with its vectors on the dofs of the present processes."""
        assert system is not None
        arrays, found = super()._read(path, k, system)
        body = _body(system)
        parts = (read_arrays(self._part(k, rank))[0] for rank in range(int(arrays["processes"])))
        return arrays | body.from_places(parts, _SPREAD), found

    def _part(self, k: int, rank: int) -> Path:
        return self.path / f"step_{k + 1:05d}_{rank}.npz"


def _body(system: ContactSystem) -> DistributedBody:
    body = system.body
    assert isinstance(body, DistributedBody)
    return body


def _on_first(comm: Any, task: Callable[[], T]) -> T:
    """Do it on the first process; all get what it returns, or the error that it raises."""
    found: Any = None
    failure: Exception | None = None
    if comm.rank == 0:
        try:
            found = task()
        except (ContactError, OSError) as error:
            failure = error
    failure = comm.bcast(failure)
    if failure is not None:
        raise failure
    told: T = comm.bcast(found)
    return told
