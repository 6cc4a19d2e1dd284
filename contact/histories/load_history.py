"""The finished steps of a load history, in memory, on disk and as an animation."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.derivatives.history_gradient import HistoryGradient, history_gradient
from contact.errors import InputError
from contact.histories.history_folder import HistoryFolder
from contact.output.tables import steps_frame
from contact.output.vtk import block_sets, body_grid, boundary_grids
from contact.result.contact_result import as_html, facts
from skfem_adini.ground.arguments import numbers
from skfem_adini.ground.vtk_files import write_series

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LoadStep:
    """A finished step, as a progress callback receives it.

    `LoadStepper.run` hands it to `callback` after each step.

    Attributes
    ----------
    number, count : int
        Number of this step, from one, and number of steps of the run.
    time : float
    result : ContactResult
    seconds : float

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, LoadStepper
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> stepper = LoadStepper(ContactProblem(body.fix("top", "xy"), "bottom", 0.0, friction=0.3))
    >>> _ = stepper.move("top", "y", -0.01)
    >>> _ = stepper.run([1.0, 2.0], callback=lambda step: print(step.number, step.count, step.time))
    1 2 1.0
    2 2 2.0
    """

    number: int
    count: int
    time: float
    result: ContactResult
    seconds: float

    def __str__(self) -> str:
        free, stick, slip, _, held = np.bincount(self.result.status, minlength=5)
        more = f", undetermined {held:4d}" if held else ""
        return (
            f"step {self.number:4d}/{self.count}   t = {self.time:<9.4g} contact force "
            f"{self.result.contact_force:.4e}   open {free:4d}, stick {stick:4d}, "
            f"slip {slip:4d}{more}   {len(self.result.history):2d} iterations, {self.seconds:.2f} s"
        )


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """The finished steps of a load history: a sequence of results, and their times.

    ``history[0]`` is the result of the first step, ``history[1:3]`` a part of the history, and
    ``for result in history`` runs through the steps.

    Attributes
    ----------
    times : ndarray, shape (n,)
    results : tuple of ContactResult
        One a step, each with its own certificate.
    damage : InputError or None
        For a history read from a folder: why it ends before the last file.

    Examples
    --------
    A block that is pressed .01, then .02 into its foundation:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, LoadStepper
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> stepper = LoadStepper(ContactProblem(body.fix("top", "xy"), "bottom", 0.0, friction=0.3))
    >>> _ = stepper.move("top", "y", -0.01)
    >>> history = stepper.run([1.0, 2.0])
    >>> print(history.times, history.resultant[:, 1] > 0)
    [1. 2.] [ True  True]
    """

    times: Array = field(default_factory=lambda: np.zeros(0))
    results: tuple[ContactResult, ...] = ()
    damage: InputError | None = None

    def __repr__(self) -> str:
        if not len(self):
            return "LoadHistory(no step)"
        return (
            f"LoadHistory({len(self)} steps from t = {self.times[0]:.6g} to {self.times[-1]:.6g}; "
            f"the last: {self.results[-1]!r})"
        )

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[ContactResult]:
        return iter(self.results)

    @overload
    def __getitem__(self, place: int) -> ContactResult: ...

    @overload
    def __getitem__(self, place: slice) -> LoadHistory: ...

    def __getitem__(self, place: int | slice) -> ContactResult | LoadHistory:
        """The result of one step, counted from zero, or a part of the history."""
        if isinstance(place, slice):
            return LoadHistory(self.times[place], self.results[place])
        return self.results[place]

    def extended(self, time: float, result: ContactResult) -> LoadHistory:
        """The history with one more step.

        Parameters
        ----------
        time : float
        result : ContactResult

        Returns
        -------
        LoadHistory
            A new object.
        """
        return LoadHistory(np.append(self.times, time), (*self.results, result))

    @property
    def resultant(self) -> Array:
        """Force of the obstacle on the body in each step, shape (n, dim)."""
        return np.array([result.resultant for result in self.results])

    def _repr_html_(self) -> str:
        if not len(self):
            return "<p>LoadHistory(no step)</p>"
        span = f"{len(self)} steps from t = {self.times[0]:.6g} to {self.times[-1]:.6g}"
        return as_html({"history": span, **facts(self.results[-1])}, "LoadHistory, its last step")

    def to_frame(self) -> Any:
        """The steps as a table: time, forces, numbers of points by status, largest residual.

        Returns
        -------
        pandas.DataFrame
            One row a step. `ContactResult.to_frame` has the points of one.

        Raises
        ------
        MissingDependency
            pandas is not installed.
        """
        return steps_frame(self)

    def vjp(
        self,
        *,
        u: ArrayLike | None = None,
        pressure: ArrayLike | None = None,
        shear: ArrayLike | None = None,
        slip: ArrayLike | None = None,
        contact_forces: ArrayLike | None = None,
        resultant: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        problem: Any = None,
    ) -> HistoryGradient:
        """Gradients of a function of all steps, backward through the memory of friction.

        The function is given by its derivatives by the parts of the results, as for
        `ContactResult.vjp`, with one more axis in front: the step. Each step costs one transposed
        substitution. `LoadStepper.vjp` keeps fewer states.

        Parameters
        ----------
        u, contact_forces : array, shape (n, ndofs), optional
        pressure : array, shape (n, m), optional
        shear, slip : array, shape (n, m, dim - 1), optional
        resultant : array, shape (n, dim), optional
        motion : array, shape (n, k), optional
        problem : ContactProblem, optional
            As for `ContactResult.vjp`.

        Returns
        -------
        HistoryGradient

        Raises
        ------
        InputError
            Arrays of another shape; a step that was halved, whose first part is not in the history;
            results that `ContactResult.vjp` refuses.
        NotConverged
            As for `ContactResult.vjp`.

        Warns
        -----
        ContactWarning
            Points touch without force, or stick at the bound of friction.
        """
        given = {
            "u": u, "pressure": pressure, "shear": shear, "slip": slip, "motion": motion,
            "contact_forces": contact_forces, "resultant": resultant,
        }  # fmt: skip
        return history_gradient(self.results, given, problem)

    def to_pvd(self, path: str | Path, subdivide: int | None = None) -> Path:
        """Write the body, and beside it the contact boundary, as series that ParaView animates.

        ``name.pvd`` lists ``name_0000.vtu``, ...; ``name_boundary.pvd`` lists the contact points,
        ``name_boundary_0000.vtp``, .... In Python ``pyvista.get_reader("name.pvd")`` reads them.
        Of several bodies ``name.pvd`` lists ``name_0000.vtm``, ..., each with the blocks of
        `ContactResult.to_pyvista`.

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

        Raises
        ------
        InputError
            Another suffix, or a history without a step.
        MissingDependency
            pyvista is not installed.
        """
        path = as_path(path)
        if path.suffix != ".pvd":
            raise InputError(f"path: expected a name ending in .pvd, got {path.name!r}")
        if not self.results:
            raise InputError("history: has no finished step to write")
        times = self.times.tolist()
        write_series(
            path.with_name(f"{path.stem}_boundary.pvd"),
            zip(times, boundary_grids(self.results), strict=True),
        )
        several = len(self.results[0].solid.bodies) > 1
        steps = (
            block_sets(self.results, subdivide)
            if several
            else (body_grid(r, subdivide) for r in self.results)
        )
        return write_series(path, zip(times, steps, strict=True))[0]

    @classmethod
    def load(cls, path: str | Path) -> LoadHistory:
        """Read the finished steps of a folder that `LoadStepper.run` wrote, complete or not.

        Every step is certified again, as by `ContactResult.load`, and checked to belong to this
        run. A step that cannot be read ends the history before it; this is logged as a warning, and
        `damage` has the reason. `LoadStepper.resume` solves the step again.

        Parameters
        ----------
        path : str or Path
            The folder that was given to `LoadStepper.run`.

        Returns
        -------
        LoadHistory

        Raises
        ------
        InputError
            The folder holds no history; a step belongs to another run or was changed; the problem
            is damaged.
        """
        folder = HistoryFolder.opened(as_path(path))
        results = tuple(folder.finished())
        return cls(folder.times[: len(results)], results, folder.damage)


def checked_times(times: ArrayLike, done: Array) -> Array:
    """Times of further steps; `InputError` unless they increase from the last finished step."""
    schedule = numbers("times", times)
    if schedule.ndim != 1 or schedule.size == 0 or not np.all(np.isfinite(schedule)):
        raise InputError(f"times: expected finite numbers of shape (n,), got {schedule.shape}")
    if np.any(np.diff(np.concatenate((done[-1:], schedule))) <= 0):
        raise InputError("times: must increase, from the last finished step on")
    return schedule


def reporter(progress: bool, callback: Callable[[Any], None] | None) -> Callable[[Any], None]:
    """What a run does with a finished step: log it, print it, hand it to the callback."""
    if callback is not None and not callable(callback):
        raise InputError(f"callback={callback!r}: expected a function of a finished step")

    def report(step: Any) -> None:
        logger.info("%s", step)
        if progress:
            print(step, flush=True)
        if callback is not None:
            callback(step)

    return report


def as_path(path: str | Path) -> Path:
    """The path, or an `InputError` if it is not one."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"path={path!r}: expected the name of a file or folder") from None
