"""The steps of bodies with inertia: energies and forces of all, fields of those that are kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.histories.history_folder import HistoryFolder
from contact.histories.load_history import LoadHistory
from contact.histories.step_history import as_path
from contact.output.pictures import axes_of
from contact.result.contact_fields import as_html, as_text

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]
COLUMNS = ("kinetic", "elastic", "potential", "work", "friction", "damping", "impact", "residual")
STORED = ("u", "v", "motion", "gap", "varied", "table", "dt")  # beside the result


@dataclass(frozen=True, eq=False, repr=False)
class DynamicStep:
    """A step of bodies with inertia: displacement and velocity at its end, forces during it.

    Attributes
    ----------
    number : int
        Number of the step, from one.
    time : float
        At its end.
    u, v : ndarray, shape (ndofs,)
        Displacement and velocity at its end; at contact nodes without mass the mean velocity of
        the step.
    result : ContactResult
        In the middle of the step, with its certificate. Forces, pressure and stress are those
        during the step; its loads include inertia and damping.
    seconds : float
        Time that it took.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, DynamicStepper, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> problem = ContactProblem(body, "bottom", 0.0)
    >>> step = DynamicStepper(problem, density=1.0, dt=0.1, velocity=(0.0, -0.1)).step()
    >>> step.number, step.time, bool(step.result.pressure.max() > 0)
    (1, 0.1, True)
    """

    number: int
    time: float
    u: Array
    v: Array
    result: ContactResult
    seconds: float = 0.0

    def __repr__(self) -> str:
        return f"DynamicStep({self})"

    def __str__(self) -> str:
        counted = np.bincount(self.result.status, minlength=3)
        return (
            f"step {self.number:5d}   t = {self.time:<9.4g} contact force "
            f"{self.result.contact_force:.4e}   open {counted[0]:4d}, stick {counted[1]:4d}, "
            f"slip {counted[2]:4d}   {len(self.result.history):2d} iterations, {self.seconds:.3f} s"
        )


@dataclass(frozen=True, eq=False)
class DynamicHistory:
    """Energies and contact forces of all steps, and the steps whose fields are kept.

    ``history[-1]`` is the last `DynamicStep` that is kept, ``for step in history`` runs through
    them. Arrays over all steps begin with the initial state, in which forces and what happens
    during a step are zero.

    Attributes
    ----------
    dt : float
        Length of a step.
    times : ndarray, shape (n + 1,)
        The initial time and the ends of the steps. Forces of a step are those in its middle.
    table : ndarray, shape (n + 1, 8 + dim)
        Columns: those of `kinetic` to `residual`, then `force`.
    steps : tuple of DynamicStep
    damage : InputError or None
        For a history read from a folder: why it ends before the last file.

    Examples
    --------
    A block thrown at a wall; the ledger of energy closes in every step:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, DynamicStepper, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(3).with_defaults(), E=1.0, nu=0.0)
    >>> problem = ContactProblem(body, "bottom", 0.0)
    >>> history = DynamicStepper(problem, density=1.0, dt=0.1, velocity=(0.0, -0.1)).run(25)
    >>> bool(abs(history.residual).max() < 1e-10 * history.total[0])
    True
    """

    dt: float
    times: Array
    table: Array
    steps: tuple[DynamicStep, ...] = ()
    damage: InputError | None = field(default=None)

    def __repr__(self) -> str:
        return (
            f"DynamicHistory({self.times.size - 1} steps from t = {self.times[0]:.6g} to "
            f"{self.times[-1]:.6g}; {len(self.steps)} kept)"
        )

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[DynamicStep]:
        return iter(self.steps)

    def __getitem__(self, place: int) -> DynamicStep:
        """One of the steps that are kept."""
        return self.steps[place]

    def _column(self, name: str) -> Array:
        return np.asarray(self.table[:, COLUMNS.index(name)])

    @property
    def kinetic(self) -> Array:
        """Kinetic energy at `times`."""
        return self._column("kinetic")

    @property
    def elastic(self) -> Array:
        """Elastic energy at `times`."""
        return self._column("elastic")

    @property
    def potential(self) -> Array:
        """Potential energy of the loads that do not vary, zero without displacement."""
        return self._column("potential")

    @property
    def total(self) -> Array:
        """Kinetic, elastic and potential energy."""
        return np.asarray(self.table[:, :3].sum(axis=1))

    @property
    def work(self) -> Array:
        """Work in each step of loads that vary and of moving supports and obstacles."""
        return self._column("work")

    @property
    def friction(self) -> Array:
        """Energy that friction dissipates in each step."""
        return self._column("friction")

    @property
    def damping(self) -> Array:
        """Energy that damping dissipates in each step."""
        return self._column("damping")

    @property
    def impact(self) -> Array:
        """Energy lost in each step where points close that were open at its start."""
        return self._column("impact")

    @property
    def residual(self) -> Array:
        """What is missing in the balance of each step: rounding, which is certified."""
        return self._column("residual")

    @property
    def force(self) -> Array:
        """Force of the obstacle on the body during each step, shape (n + 1, dim).

        Between bodies as `ContactResult.resultant`.
        """
        return np.asarray(self.table[:, len(COLUMNS) :])

    @property
    def _facts(self) -> dict[str, str]:
        first, last = self.total[0], self.total[-1]
        lost = ", ".join(
            f"{name} {self._column(name).sum():.6g}" for name in ("friction", "damping", "impact")
        )
        size = max(float(np.abs(self.table[:, :3]).sum(axis=1).max()), np.finfo(float).tiny)
        k = int(np.argmax(np.linalg.norm(self.force, axis=1)))
        return {
            "steps": f"{self.times.size - 1} of {self.dt:.6g}, to t = {self.times[-1]:.6g}",
            "energy": f"{first:.6g} at first, {last:.6g} at last; work {self.work.sum():.6g}",
            "lost": lost,
            "largest force": f"{np.linalg.norm(self.force[k]):.6g}, before t = {self.times[k]:.6g}",
            "ledger": f"closes to {np.abs(self.residual).max() / size:.1e} of the energy",
        }

    def summary(self) -> str:
        """Steps, energies, losses and the largest force, in six lines.

        Returns
        -------
        str
        """
        return as_text(self._facts, type(self).__name__)

    def _repr_html_(self) -> str:
        return as_html(self._facts, type(self).__name__)

    def plot(self, ax: Any = None) -> Any:
        """Energies over time, and the size of the contact force on an axis of its own.

        Parameters
        ----------
        ax : matplotlib Axes, optional

        Returns
        -------
        matplotlib Axes
            Of the energies.

        Raises
        ------
        InputError
            Not axes.
        """
        ax = axes_of(ax)
        lost = np.cumsum(self.friction + self.damping + self.impact)
        for name, values, colour in (
            ("kinetic", self.kinetic, "#1f6f8b"),
            ("elastic", self.elastic, "#d9a441"),
            ("potential", self.potential, "#5b4a8a"),
            ("dissipated", lost, "#d1495b"),
            ("work", np.cumsum(self.work), "#6b8e23"),
        ):
            if np.any(values):
                ax.plot(self.times, values, color=colour, lw=1.3, label=name)
        ax.plot(self.times, self.total, color="0.2", lw=1.0, ls="--", label="total")
        ax.set(xlabel="time", ylabel="energy")
        beside = ax.twinx()
        size = np.linalg.norm(self.force[1:], axis=1)
        beside.fill_between(self.times[1:] - 0.5 * self.dt, size, color="0.5", alpha=0.25, lw=0)
        beside.set_ylabel("contact force (grey)")
        beside.set_ylim(bottom=0.0)
        ax.set_zorder(beside.get_zorder() + 1)
        ax.patch.set_visible(False)
        ax.legend(fontsize=8)
        return ax

    def to_pvd(self, path: str | Path, subdivide: int | None = None) -> Path:
        """Write the kept steps as series that ParaView animates, see `LoadHistory.to_pvd`.

        Each file is the state in the middle of a step, to which forces and stresses belong.

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
            Another suffix, or no step is kept.
        MissingDependency
            pyvista is not installed.
        """
        times = np.array([step.time - 0.5 * self.dt for step in self.steps])
        results = tuple(step.result for step in self.steps)
        return LoadHistory(times, results).to_pvd(path, subdivide)

    @classmethod
    def load(cls, path: str | Path) -> DynamicHistory:
        """Read the finished steps of a folder that `DynamicStepper.run` wrote, complete or not.

        Every step that was kept is certified again. A step that cannot be read ends the history
        before it; `damage` has the reason.

        Parameters
        ----------
        path : str or Path
            The folder that was given to `DynamicStepper.run`.

        Returns
        -------
        DynamicHistory

        Raises
        ------
        InputError
            The folder holds no dynamic history; a step belongs to another run or was changed.
        """
        folder = HistoryFolder.opened(as_path(path))
        steps = tuple(stored_steps(folder, None))
        if not steps:
            raise InputError(f"path: {path} holds no finished step of a dynamic history")
        first, dt = steps[0][0], float(steps[0][1]["dt"])
        table = np.concatenate([arrays["table"] for _, arrays in steps])
        times = first.time + dt * (np.arange(float(len(table))) - first.number)
        return cls(dt, times, table, tuple(step for step, _ in steps), folder.damage)


def arrays_of(values: Sequence[Any]) -> dict[str, Array]:
    """What a file holds beside the result of a step, by name."""
    return {f"dynamic/{name}": value for name, value in zip(STORED, values, strict=True)}


def stored_steps(
    folder: HistoryFolder, system: Any
) -> Iterator[tuple[DynamicStep, dict[str, Array]]]:
    """Steps of a folder with their arrays; the table of the first begins with the initial state."""
    number = -1  # of the last row
    for k, (result, arrays) in enumerate(folder.steps(system)):
        own = {name: arrays.get(f"dynamic/{name}", np.zeros(())) for name in STORED}
        width = len(COLUMNS) + result.system.body.dim
        shapes = own["u"].shape == own["v"].shape == result.u.shape
        if not (shapes and own["table"].shape[1:] == (width,) and _are_finite(own)):
            raise InputError(
                f"path: {folder.path} holds a load history without inertia, or a changed one; read "
                "it by LoadHistory.load"
            )
        number += len(own["table"])
        yield DynamicStep(number, float(folder.times[k]), own["u"], own["v"], result), own


def _are_finite(arrays: dict[str, Array]) -> bool:
    return all(bool(np.all(np.isfinite(a))) for name, a in arrays.items() if name != "gap")
