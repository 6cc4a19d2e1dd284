"""The finished steps of a load history, in memory, on disk and as an animation."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError, numbers
from contact.export import body_grid, boundary_grid
from contact.storage import problem_arrays, read_arrays, read_step, state_arrays, write_arrays
from skfem_adini.complete_file import complete_file
from skfem_adini.vtk_files import write_series

if TYPE_CHECKING:
    from contact.result import ContactResult
    from contact.system import ContactSystem

Array = NDArray[np.float64]
_FORMAT = 1
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LoadStep:
    """What a progress callback is told of a finished step.

    Attributes
    ----------
    number, count : int
        This step, from one, and how many the run has.
    time : float
    result : ContactResult
    seconds : float
    """

    number: int
    count: int
    time: float
    result: ContactResult
    seconds: float

    def __str__(self) -> str:
        free, stick, slip = np.bincount(self.result.status, minlength=3)[:3]
        return (
            f"step {self.number:4d}/{self.count}   t = {self.time:<9.4g} contact force "
            f"{self.result.contact_force:.4e}   open {free:4d}, stick {stick:4d}, slip {slip:4d}   "
            f"{len(self.result.history):2d} iterations, {self.seconds:.2f} s"
        )


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """The finished steps of a load history.

    Attributes
    ----------
    times : ndarray, shape (n,)
    results : tuple of ContactResult
        One a step, each with its own certificate.
    """

    times: Array = field(default_factory=lambda: np.zeros(0))
    results: tuple[ContactResult, ...] = ()

    def __len__(self) -> int:
        return len(self.results)

    def extended(self, time: float, result: ContactResult) -> LoadHistory:
        """The history with one more step."""
        return LoadHistory(np.append(self.times, time), (*self.results, result))

    @property
    def resultant(self) -> Array:
        """Force of the obstacle on the body in each step, shape (n, dim)."""
        return np.array([result.resultant for result in self.results])

    def to_pvd(self, path: str | Path, subdivide: int | None = None) -> Path:
        """Write the body, and beside it the contact boundary, as series that ParaView animates.

        ``name.pvd`` lists ``name_0000.vtu``, ...; ``name_boundary.pvd`` lists the contact points,
        ``name_boundary_0000.vtp``, .... In Python ``pyvista.get_reader("name.pvd")`` reads them.

        Parameters
        ----------
        path : str or Path
            Ends in .pvd.
        subdivide : int, optional
            As for `ContactResult.to_pyvista`.

        Returns
        -------
        Path
            The collection of the body.
        """
        path = Path(path)
        if path.suffix != ".pvd":
            raise InputError(f"path: expected a name ending in .pvd, got {path.name!r}")
        if not self.results:
            raise InputError("history: has no finished step to write")
        times = self.times.tolist()
        write_series(
            path.with_name(f"{path.stem}_boundary.pvd"),
            ((t, boundary_grid(r)) for t, r in zip(times, self.results, strict=True)),
        )
        return write_series(
            path, ((t, body_grid(r, subdivide)) for t, r in zip(times, self.results, strict=True))
        )

    @classmethod
    def load(cls, path: str | Path) -> LoadHistory:
        """Read the finished steps of a folder that `LoadStepper.run` wrote, complete or not.

        Raises
        ------
        InputError
            No history lies there.
        """
        folder = HistoryFolder.opened(Path(path))
        results = tuple(folder.finished())
        return cls(folder.times[: len(results)], results)


@dataclass(frozen=True)
class HistoryFolder:
    """A folder with ``history.json``, ``problem.npz`` and one ``step_00001.npz`` a finished step.

    Every file appears under its name only once it is complete, so that an interruption or a full
    disk costs the step at hand and none before.

    Attributes
    ----------
    path : Path
    times : ndarray, shape (n,)
        Of all steps that the run was asked for.
    fingerprint : str
        Of the problem.
    """

    path: Path
    times: Array
    fingerprint: str

    @classmethod
    def created(cls, path: Path, times: Array, fingerprint: str) -> HistoryFolder:
        """Make the folder; `InputError` when it holds anything."""
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise InputError(f"path: {path} is not empty; resume it, or choose a new folder")
        about = {"format": _FORMAT, "times": times.tolist(), "fingerprint": fingerprint}
        with complete_file(path / "history.json") as file:
            file.write(json.dumps(about).encode())
        return cls(path, times, fingerprint)

    @classmethod
    def opened(cls, path: Path) -> HistoryFolder:
        """Find an existing folder; `InputError` when it is none."""
        try:
            about = json.loads((path / "history.json").read_text())
            if about["format"] != _FORMAT:
                raise ValueError(f"format {about['format']}, not {_FORMAT}")
            return cls(path, np.array(about["times"], dtype=float), str(about["fingerprint"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"path: {path} holds no load history ({error})") from error

    def write(self, k: int, result: ContactResult) -> None:
        """Write step k, counted from zero; the first brings the problem along."""
        problem = self.path / "problem.npz"
        if not problem.exists():
            write_arrays(problem, problem_arrays(result.system))
        write_arrays(self._step(k), state_arrays(result), compress=False)

    def finished(self, system: ContactSystem | None = None) -> Iterator[ContactResult]:
        """The steps up to the first that is missing or damaged.

        Parameters
        ----------
        system : ContactSystem, optional
            Of the problem at hand: the results then share its body and rows.
        """
        if not self._step(0).is_file():
            return
        shared = read_arrays(self.path / "problem.npz")
        for k in range(self.times.size):
            try:
                result = read_step(self._step(k), shared, system)
            except InputError as error:
                if self._step(k).is_file():
                    logger.warning("%s; the history ends before it", error)
                return
            system = result.system
            yield result

    def _step(self, k: int) -> Path:
        return self.path / f"step_{k + 1:05d}.npz"


def fingerprint(system: ContactSystem, vectors: Sequence[Array]) -> str:
    """SHA-256 of what makes two problems the same."""
    digest = hashlib.sha256(repr(system.law).encode())
    body, rows = system.body, system.rows
    for matrix in (body.stiffness, body.constraint[0], rows.G, rows.T):
        for part in (matrix.data, matrix.indices, matrix.indptr):
            digest.update(np.ascontiguousarray(part).tobytes())
    moved = () if system.motion is None else tuple(vars(system.motion).values())
    given = (system.load, system.friction, rows.weights, rows.gap, *moved, *vectors)
    for array in (body.constraint[1], *given):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def checked_times(times: ArrayLike, done: Array) -> Array:
    """Times of further steps; `InputError` unless they increase from the last of those done."""
    schedule = numbers("times", times)
    if schedule.ndim != 1 or schedule.size == 0 or not np.all(np.isfinite(schedule)):
        raise InputError(f"times: expected finite numbers of shape (n,), got {schedule.shape}")
    if np.any(np.diff(np.concatenate((done[-1:], schedule))) <= 0):
        raise InputError("times: must increase, from the last finished step on")
    return schedule
