"""A load history on disk: a folder of steps that are checked to belong to one run.

It contains ``history.json``, ``problem.npz`` and ``step_00001.npz``, ... for finished steps. Each
of several processes adds ``step_00001_0.npz``, ... with displacement, load and prescribed
displacement at its dofs, which are identified by a cell of the whole mesh and their number in it;
the first process then writes the step itself, with all data on the contact boundary.

Files are written atomically, so that an interruption or a full disk costs the current step only.
``history.json`` is created by one process, even if several start in the folder, and has a random
name of the run and the checksum of the problem; each step has the name of the run, its number and
time, and the checksum of the step before. Files of other runs or positions are refused.
"""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from secrets import token_hex
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from contact.body.distributed_body import DistributedBody
from contact.errors import ContactError, InputError
from contact.result.contact_result import ContactResult
from contact.result.stored_result import OWN, problem_arrays, rebuild, rows_arrays, state_arrays
from skfem_adini.ground.archives import checksum, is_damaged, read_arrays, words, write_arrays
from skfem_adini.ground.files import complete_file, remove_unfinished, try_lock

if TYPE_CHECKING:
    from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]
Found = TypeVar("Found")
_SPREAD = ("load", "u0", "u")  # distributed vectors; all other arrays are equal on all processes
_FORMAT = 2  # of history.json
logger = logging.getLogger(__name__)


class HistoryFolder:
    """The folder of a run, in which the first of the processes `comm`, if any, writes.
    `fingerprint`: checksum of problem, loads and motions; `damage`: the error of `finished`."""

    def __init__(self, path: Path, about: dict[str, Any], comm: Any = None) -> None:
        self.path, self.times, self.comm = path, np.array(about["times"], dtype=float), comm
        self.fingerprint, self._run = str(about["fingerprint"]), str(about["run"])
        self._problem = self._before = str(about["problem"])
        self.damage: InputError | None = None
        self._rows_of_problem: Any = None

    @classmethod
    def created(
        cls, path: Path, times: Array, system: ContactSystem, fingerprint: str
    ) -> HistoryFolder:
        """Create the folder; `InputError` if it is not empty, or another process creates it."""
        comm = system.body.comm if isinstance(system.body, DistributedBody) else None

        def about() -> dict[str, Any]:
            entry = {
                "format": _FORMAT,
                "run": token_hex(16),
                "times": times.tolist(),
                "fingerprint": fingerprint,
                "problem": checksum(problem_arrays(system)),
            }
            try:
                path.mkdir(parents=True, exist_ok=True)
                if any(path.iterdir()):
                    raise FileExistsError(path)
                with complete_file(path / "history.json", exclusive=True) as file:
                    file.write(json.dumps(entry | {"checksum": _digest(entry)}).encode())
            except (FileExistsError, NotADirectoryError) as error:
                raise InputError(
                    f"path: {path} is not empty; resume it, or choose a new folder"
                ) from error
            return entry

        return cls(path, _on_first(comm, about), comm)

    @classmethod
    def opened(cls, path: Path, body: Any = None) -> HistoryFolder:
        """Open a folder on all processes of the body; `InputError` if it has no history."""

        def about() -> dict[str, Any]:
            try:
                entry: dict[str, Any] = json.loads((path / "history.json").read_text())
                if entry["format"] == 1:
                    raise ValueError(
                        "format 1, of version 0.1.0, whose files do not show which run they are "
                        "of; run it again in a new folder"
                    )
                if entry["format"] != _FORMAT:
                    raise ValueError(f"format {entry['format']}, not {_FORMAT}")
                if entry.pop("checksum") != _digest(entry):
                    raise ValueError("history.json was changed since it was written")
                cls(path, entry)
            except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
                raise InputError(f"path: {path} holds no load history ({error})") from error
            return entry

        comm = body.comm if isinstance(body, DistributedBody) else None
        return cls(path, _on_first(comm, about), comm)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder against other processes, or raise; the lock ends with this process."""
        descriptor = _on_first(self.comm, self._lock)
        try:
            yield
        finally:
            if self.comm is None or self.comm.rank == 0:
                os.close(descriptor)

    def _lock(self) -> int:
        name = self.path / "history.json"
        try:
            descriptor = os.open(name, os.O_RDWR)
        except PermissionError:
            descriptor = os.open(name, os.O_RDONLY)
        if try_lock(descriptor) is False:
            os.close(descriptor)
            raise InputError(f"path: another process is writing the history in {self.path}")
        return descriptor

    def write(
        self, k: int, result: ContactResult, more: Mapping[str, Array] = MappingProxyType({})
    ) -> None:
        """Write step k, counted from zero, in order, with more arrays; parts of processes first."""
        arrays, rows = state_arrays(result) | dict(more), result.system.rows
        if self.comm is not None:
            self._write_part(k, result.system.body, arrays)
        elif rows.T is not self._rows_of_problem:  # finite sliding
            arrays |= rows_arrays(result.system.body, rows) | {OWN: np.array(True)}
        self._before = _on_first(self.comm, lambda: self._write_step(k, arrays))

    def _write_step(self, k: int, arrays: dict[str, Any]) -> str:
        """Write the final file of step k, with its position in the run; return its checksum."""
        place = {"run": self._run, "number": k + 1, "time": float(self.times[k])}
        place |= {"before": self._before}
        arrays = arrays | {"place": words(place)}
        try:
            write_arrays(self._step(k), arrays, compress=False, exclusive=True)
        except FileExistsError as error:
            raise InputError(
                f"path: {self._step(k)} appeared while this run was solving it; another process "
                "writes there"
            ) from error
        return checksum(arrays)

    def _write_part(self, k: int, body: DistributedBody, arrays: dict[str, Any]) -> None:
        """Move the vectors of this process from `arrays` to a file of its own."""
        vectors = {name: body.counted(arrays.pop(name)) for name in _SPREAD}
        arrays["processes"] = np.array(self.comm.size)
        failure = ""
        try:
            write_arrays(self._part(k, self.comm.rank), body.places() | vectors, compress=False)
        except OSError as error:
            failure = f"{type(error).__name__}: {error}"
        for rank, each in enumerate(self.comm.allgather(failure)):
            if each:
                raise OSError(f"process {rank} could not write its part of step {k + 1}: {each}")

    def finished(self, system: ContactSystem | None = None) -> Iterator[ContactResult]:
        """The results of `steps`."""
        return (result for result, _ in self.steps(system))

    def steps(
        self, system: ContactSystem | None = None
    ) -> Iterator[tuple[ContactResult, dict[str, Any]]]:
        """The steps before the first one that is missing or cannot be read, which is logged.
        `InputError` if one belongs elsewhere; steps share the body and rows of a given system."""
        last = max(self._steps(), default=0)
        if last == 0:
            return
        shared = self._shared() if system is None else problem_arrays(system)
        for k in range(self.times.size):
            path = self._step(k)
            try:
                arrays, found = self._read(path, k, system)
                state = rebuild(path, shared | arrays, found is not None, system)
            except InputError as error:
                if path.is_file() and not is_damaged(error):
                    raise
                if last > k:
                    self.damage = error
                    logger.warning("%s; the history ends before it", error)
                return
            self._before, system = str(found), state.system
            result = ContactResult(**vars(state))
            result.keep_facts_of_many()
            yield result, arrays

    def _read(self, path: Path, k: int, system: ContactSystem | None) -> tuple[Any, Any]:
        """The arrays of step k, with the vectors of this process, and their checksum."""
        arrays, found = read_arrays(path)
        self._check_place(path, k, arrays)
        if self.comm is not None and system is not None:
            processes = range(int(arrays["processes"]))
            parts = (read_arrays(self._part(k, rank))[0] for rank in processes)
            arrays |= system.body.from_places(parts, _SPREAD)
        return arrays, found

    def prepare(self, count: int, system: ContactSystem) -> None:
        """Write the problem; rename step files after the first `count`, or unreadable ones."""
        self._rows_of_problem = system.rows.T
        _on_first(self.comm, lambda: self._prepare(count, system))

    def _prepare(self, count: int, system: ContactSystem) -> None:
        remove_unfinished(self.path)
        for number in self._steps():
            if number > count:
                _set_aside(self._step(number - 1))
        problem = self.path / "problem.npz"
        if problem.exists():
            try:
                self._shared()
            except InputError as error:
                if not is_damaged(error):
                    raise
                _set_aside(problem)
        if not problem.exists():
            write_arrays(problem, problem_arrays(system))

    def _shared(self) -> dict[str, Any]:
        arrays, found = read_arrays(self.path / "problem.npz")
        if found != self._problem:
            raise InputError(f"path: {self.path / 'problem.npz'} is not the problem of this run")
        return arrays

    def _check_place(self, path: Path, k: int, arrays: dict[str, Any]) -> None:
        try:
            place = json.loads(str(arrays["place"]))
            run, number, time, before = (place[n] for n in ("run", "number", "time", "before"))
        except (KeyError, ValueError, TypeError) as error:
            raise InputError(f"result file {path} is no step of a load history") from error
        for name, found, expected in (
            ("run", run, self._run),
            ("number", number, k + 1),
            ("time", time, float(self.times[k])),
            ("step before", before, self._before),
        ):
            if found != expected:
                raise InputError(
                    f"result file {path} is not this run's step {k + 1}: its {name} is {found}, "
                    f"not {expected}; move it away, and resume"
                )

    def _steps(self) -> list[int]:
        """Numbers of the steps that have a file."""
        found = (re.fullmatch(r"step_(\d{5,})\.npz", path.name) for path in self.path.iterdir())
        return sorted(int(match[1]) for match in found if match)

    def _step(self, k: int) -> Path:
        return self.path / f"step_{k + 1:05d}.npz"

    def _part(self, k: int, rank: int) -> Path:
        return self.path / f"step_{k + 1:05d}_{rank}.npz"


def _on_first(comm: Any, task: Callable[[], Found]) -> Found:
    """Run `task` on the first process; all processes get its result or error."""
    if comm is None:
        return task()
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
    entry: Found = comm.bcast(found)
    return entry


def _set_aside(path: Path) -> None:
    other = path.with_name(f"aside_{token_hex(4)}_{path.name}")
    path.rename(other)
    logger.warning("%s is set aside as %s", path, other.name)


def _digest(about: dict[str, Any]) -> str:
    return sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()


def fingerprint(system: ContactSystem, vectors: Sequence[Array]) -> str:
    """SHA-256 of a problem together with its loads and motions that vary in time."""
    arrays = problem_arrays(system) | {"law": np.array(str(system.law))}
    if isinstance(system.body, DistributedBody):  # its vectors depend on the number of processes
        vectors = []
    else:
        arrays |= {"load": system.load, "u0": system.body.constraint[1]}
    arrays |= {"friction": system.friction, "gap": system.rows.gap}
    arrays |= {f"motion/{name}": value for name, value in _of_rigid(system).items()}
    return checksum(arrays | {f"vector/{i}": vector for i, vector in enumerate(vectors)})


def same_conditions(now: ContactSystem, then: ContactSystem, same_rows: bool = True) -> bool:
    """Whether two steps have the same loads, supports, obstacles and, if `same_rows`, gaps."""
    pairs = [(now.load, then.load), (now.body.constraint[1], then.body.constraint[1])]
    if same_rows:
        pairs += [(now.rows.gap, then.rows.gap), (now.friction, then.friction)]
    one, other = _of_rigid(now), _of_rigid(then)
    if set(one) != set(other) or now.law != then.law:
        return False
    pairs += [(one[name], other[name]) for name in one]
    return all(same_values(a, b) for a, b in pairs)


def _of_rigid(system: ContactSystem) -> dict[str, Array]:
    """Arrays of the motions of `Rigid` obstacles, without the paths of shapes."""
    motion = system.motion
    if motion is None or not motion.prescribed.size:
        return {}
    return {name: value for name, value in vars(motion).items() if name != "travel"}


def same_values(a: Array, b: Array) -> bool:
    """Equal up to rounding of functions of time."""
    if a.shape != b.shape:
        return False
    finite = np.isfinite(b)
    size = np.abs(b[finite]).max(initial=0.0)
    return np.array_equal(a[~finite], b[~finite], equal_nan=True) and bool(
        np.all(np.abs(a[finite] - b[finite]) <= 1e-9 * size)
    )
