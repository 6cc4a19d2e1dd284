"""What a run records: gauges at every step, and snapshots in a folder, from which it can go on.

The folder holds ``run.json``, which says what the run is, and a file of states for each snapshot,
with the gauges since the one before it. Each appears complete or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.grid import Array
from cip.output.sample import points_of, sample
from cip.output.stored import read_words, reading, write_words
from cip.stages.state import State, by_field, states_in
from cip.stages.state_files import read_states, write_states
from skfem_adini.ground.arguments import shown
from skfem_adini.ground.files import remove_unfinished

FORM, HEAD = "run of cip 1", "run.json"


@dataclass(frozen=True, eq=False)
class Gauges:
    """The field at fixed points over all steps of a run.

    Attributes
    ----------
    points : ndarray, shape (dim, ...)
    t : ndarray, shape (steps + 1,)
    values : ndarray, shape (steps + 1, ...), or dict of these by field
    """

    points: Array
    t: Array
    values: Any


class Recorder:
    """Collects gauges at `points` (or None) and, given a `folder`, writes the snapshots; those that
    are there already are `states`. `plan` holds by name what the run depends on, words or numbers,
    which another machine may round otherwise."""

    def __init__(
        self, start: State, points: Any, folder: Any, resume: bool, plan: Mapping[str, Any]
    ) -> None:
        self.points = None if points is None else points_of(points, start.grid.dim)
        self.fields = start.fields
        self.t: list[float] = []
        self.rows: list[Array] = []  # of all fields
        self.states: list[State] = []
        self.extra: list[dict[str, Any]] = []  # arrays in the files of these
        self.beside: Callable[[], dict[str, Any]] = dict  # more of them, for the next file
        self._saved = 0  # rows in files
        self._folder: Path | None = None
        if folder is None:
            if resume:
                raise InputError("resume: pass save=, the folder of the run")
            return
        if self.points is not None:
            plan = {**plan, "gauges": self.points.tolist()}
        self._folder = _opened(folder, resume, plan)
        self.states, self.extra = snapshots_in(self._folder)
        if self.states:
            _check_start(self._folder, self.states[0], start)
            self.t, self.rows = _joined(self.extra)
            self._saved = len(self.t)

    def see(self, state: State) -> None:
        """Record the gauges of a state."""
        points = self.points
        if points is None:
            return
        found = by_field(state.host(), lambda one: sample(one, points))
        self.t.append(state.t)
        self.rows.append(np.stack(list(found.values())) if self.fields else found)

    def keep(self, state: State) -> None:
        """Write a snapshot to the folder."""
        if self._folder is None:
            return
        extra = self.beside()
        if self.points is not None:
            new = slice(self._saved, None)
            extra |= {"t": np.array(self.t[new]), "rows": np.array(self.rows[new])}
            self._saved = len(self.t)
        write_states(_file(self._folder, len(self.states)), [state], extra=extra)
        self.states.append(state)

    def gauges(self) -> Gauges | None:
        """The gauges until now; None if there are none."""
        if self.points is None:
            return None
        return gauges_of(self.points, self.t, self.rows, self.fields)


def gauges_of(points: Array, t: Any, rows: Any, fields: tuple[str, ...]) -> Gauges:
    """Gauges from rows of all fields."""
    rows = np.array(rows)
    values = {name: rows[:, k] for k, name in enumerate(fields)} if fields else rows
    return Gauges(np.asarray(points), np.array(t), values)


def read_run(folder: Path) -> tuple[dict[str, Any], list[State], Gauges | None]:
    """The plan, snapshots and gauges in the folder of a run."""
    with reading(folder / HEAD, "a run"):
        plan = read_words(folder / HEAD, FORM, ["dt", "form", "times"])
    states, extra = snapshots_in(folder)
    if not states:
        raise InputError(f"path: {folder} holds no snapshot yet; run it with resume=True")
    if "gauges" not in plan:
        return plan, states, None
    return plan, states, gauges_of(plan["gauges"], *_joined(extra), states[0].fields)


def snapshots_in(folder: Path) -> tuple[list[State], list[dict[str, Any]]]:
    """The snapshots in the folder of a run, and the arrays beside them."""
    count = len(list(folder.glob("snapshot_*.npz")))
    states, extra = [], []
    for k in range(count):
        path = _file(folder, k)
        if not path.exists():
            raise InputError(f"save: {path} is missing; remove the snapshots after it, and resume")
        try:
            found = read_states(path)
        except InputError as error:
            raise InputError(
                f"{error}; remove it and the snapshots after it, and resume"
            ) from error
        states += states_in(found)
        extra.append(found.extra)
    return states, extra


def _file(folder: Path, k: int) -> Path:
    return folder / f"snapshot_{k:05d}.npz"


def _joined(extra: list[dict[str, Any]]) -> tuple[list[float], list[Array]]:
    """Times and rows of gauges from the files of all snapshots."""
    t = [float(time) for one in extra for time in one.get("t", ())]
    return t, [row for one in extra for row in one.get("rows", ())]


def _opened(name: Any, resume: bool, plan: Mapping[str, Any]) -> Path:
    """The folder of a run, new or with the same plan."""
    try:
        folder = Path(name)
    except TypeError:
        raise InputError(f"save={shown(name)}: expected the name of a folder") from None
    if folder.is_file():
        raise InputError(f"save: {folder} is a file, expected a folder; a Trajectory has save()")
    folder.mkdir(parents=True, exist_ok=True)
    remove_unfinished(folder)
    if not (folder / HEAD).exists():
        if any(folder.iterdir()):
            raise InputError(f"save: {folder} holds other files; take a new folder")
        write_words(folder / HEAD, FORM, plan)
        return folder
    if not resume:
        raise InputError(f"save: {folder} holds a run; pass resume=True to go on with it")
    with reading(folder / HEAD, "a run"):
        known = read_words(folder / HEAD, FORM, ["dt", "form", "times"])
    known.pop("format")
    for key in dict.fromkeys([*plan, *known]):
        if not _same(known.get(key), plan.get(key)):
            raise InputError(
                f"resume: the run in {folder} has another {key}; give what it began with, or "
                "another folder"
            )
    return folder


def _same(one: Any, other: Any) -> bool:
    """Whether two values of a plan are equal, numbers up to rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True))
    return bool(one == other)


def _check_start(folder: Path, known: State, start: State) -> None:
    a, b = known.data, start.host().data
    size = float(np.abs(a).max())
    if known.t != start.t or not np.allclose(a, b, rtol=1e-9, atol=1e-9 * size):
        raise InputError(f"resume: the run in {folder} began with another state")
