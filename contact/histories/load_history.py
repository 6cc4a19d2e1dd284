"""The finished steps of a load history, in memory, on disk and as an animation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.derivatives.history_gradient import HistoryGradient, history_gradient
from contact.errors import InputError
from contact.histories.history_folder import HistoryFolder
from contact.histories.step_history import StepHistory, as_path
from skfem_adini.ground.arguments import numbers

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]


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


@dataclass(frozen=True, eq=False, repr=False)
class LoadHistory(StepHistory["ContactResult"]):
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

    damage: InputError | None = None

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
