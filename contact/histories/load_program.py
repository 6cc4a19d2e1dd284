"""Loads, supports and obstacles that vary in time in a load history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.elastic_body import ElasticBody
from contact.errors import InputError
from contact.histories.history_folder import HistoryFolder, fingerprint
from contact.histories.step_history import as_path
from contact.obstacles.shapes import ObstacleLike
from contact.portable import Portable
from skfem_adini.ground.arguments import numbers

if TYPE_CHECKING:
    from contact.body.elastic_body import Field
    from contact.body.solid import Solid
    from contact.problem.contact_problem import ContactProblem
    from contact.rows.pairs import Pair

Array = NDArray[np.float64]
Boundary = str | Sequence[str] | ArrayLike


class LoadProgram(Portable):
    """Loads, motions of supports and an obstacle that vary, added to those of a problem."""

    _SAME = "mesh, material, contact rows, gap, friction, loads or supports"
    _FUNCTIONS = ("_loads", "_calls", "_heats", "_motions", "_obstacle")

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        self._loads: list[tuple[Array, Factor]] = []
        # Body, method and arguments of tractions and motions, for derivatives by vertices.
        self._calls: list[tuple[int, str, tuple[Any, ...], Factor]] = []
        self._heats: list[tuple[int, Array, Factor]] = []
        self._motions: list[tuple[Array, Factor]] = []
        self._obstacle: list[tuple[int | None, Callable[[float], ObstacleLike], Any]] = []

    def load(
        self,
        boundary: Boundary,
        traction: Field,
        factor: Factor | None = None,
        *,
        body: Solid | str | int | None = None,
    ) -> Self:
        """Add the traction ``factor(t) * traction`` on a boundary; see `ElasticBody.load`.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        traction : array of shape (dim,) or callable x -> array of shape (dim, ...)
        factor : callable t -> float, optional
            Default: t itself.
        body : Solid, str or int, optional
            Which one, if the problem has several.
        """
        k = self._number(body)
        return self._load_by(self._unloaded(k).load(boundary, traction), factor, k)

    def body_force(
        self,
        force: Field,
        factor: Factor | None = None,
        *,
        body: Solid | str | int | None = None,
    ) -> Self:
        """Add the volume force ``factor(t) * force``; see `ElasticBody.body_force`.

        Parameters
        ----------
        force : array of shape (dim,) or callable x -> array of shape (dim, ...)
            Force per volume.
        factor : callable t -> float, optional
            Default: t itself.
        body : Solid, str or int, optional
            Which one, if the problem has several.
        """
        k = self._number(body)
        return self._load_by(self._unloaded(k).body_force(force), factor, k)

    def _load_by(self, loaded: Any, factor: Factor | None, k: int) -> Self:
        """Add the load of a body that has no other one."""
        self.load_vector(loaded.f, factor, body=k)
        calls = [(k, name, given, checked_factor(factor)) for name, given, _ in loaded._applied]
        self._calls += calls
        return self

    def heat(
        self,
        temperature: Any,
        expansion: ArrayLike,
        factor: Factor | None = None,
        *,
        body: Solid | str | int | None = None,
    ) -> Self:
        """Add the change of temperature ``factor(t) * temperature``; see `ElasticBody.heat`.

        Parameters
        ----------
        temperature, expansion
            As for `ElasticBody.heat`.
        factor : callable t -> float, optional
            Default: t itself.
        body : Solid, str or int, optional
            Which one, if the problem has several.

        Raises
        ------
        InputError
            A body without thermal strains, such as a `LayeredBlock`.
        """
        k = self._number(body)
        cold = self._unloaded(k)
        if not isinstance(cold, ElasticBody):
            raise InputError(f"heat: a {type(cold).__name__} takes no thermal strains")
        cold.thermal = None
        cold.heat(temperature, expansion)
        self.load_vector(cold.f, factor, body=k)
        self._heats.append((k, np.asarray(cold.thermal), checked_factor(factor)))
        return self

    def load_vector(
        self,
        vector: ArrayLike,
        factor: Factor | None = None,
        *,
        body: Solid | str | int | None = None,
    ) -> Self:
        """Add the load ``factor(t) * vector``, such as the ``f`` of another body on the same mesh.

        Parameters
        ----------
        vector : array of shape (ndofs,)
            Force, or the conjugate of a derivative dof.
        factor : callable t -> float, optional
            Default: t itself.
        body : Solid, str or int, optional
            Which one, if the problem has several.

        Raises
        ------
        InputError
            Not one finite number a dof.
        """
        values, k = numbers("vector", vector), self._number(body)
        size = self.problem.body.bodies[k].f.size
        if values.shape != (size,) or not np.all(np.isfinite(values)):
            raise InputError(f"vector: expected {size} finite numbers, got shape {values.shape}")
        self._loads.append((self._of_all(k, values), checked_factor(factor)))
        return self

    def _number(self, body: Solid | str | int | None) -> int:
        """Number of the given body of the problem."""
        together = self.problem.body
        if body is None and len(together.bodies) > 1:
            raise InputError("body: there are several; say which, as in load(..., body=upper)")
        return 0 if body is None else int(together.number_of(body))

    def _unloaded(self, k: int) -> Any:
        body = copy(self.problem.body.bodies[k])
        body.f = np.zeros_like(body.f)
        return body

    def _of_all(self, k: int, values: Array) -> Array:
        """Extend values on the dofs of one body by zeros to all bodies."""
        own = self.problem.body.slices[k]
        everything = np.zeros(self.problem.body.slices[-1].stop)
        everything[own] = values
        return everything

    def move(
        self,
        boundary: Boundary,
        components: str | int | Sequence[int] | None = None,
        value: Field = 1.0,
        factor: Factor | None = None,
        *,
        body: Solid | str | int | None = None,
    ) -> Self:
        """Move supports: ``factor(t) * value`` is added to the prescribed displacement.

        Parameters
        ----------
        boundary, components, value
            As for `ElasticBody.fix`. The body must have been fixed on this very boundary in these
            components.
        factor : callable t -> float, optional
            Default: t itself.
        body : Solid, str or int, optional
            Which one, if the problem has several.

        Raises
        ------
        InputError
            There is no such support, or the motion contradicts another support.
        """
        k = self._number(body)
        moved = self.problem.body.bodies[k].support_motion(boundary, components, value)
        moved_by = self._of_all(k, moved)
        self._motions.append((moved_by, checked_factor(factor)))
        given = boundary, components, value
        self._calls.append((k, "support_motion", given, checked_factor(factor)))
        return self

    def obstacle(
        self,
        of_time: Callable[[float], ObstacleLike],
        *,
        motion: Callable[[float], Any] | float | None = None,
        pair: Pair | int | None = None,
    ) -> Self:
        """Let the obstacle vary: an obstacle as for `ContactProblem`, as a function of time.

        Friction acts on the slip along the obstacle, so its motion must be known. An unchanged
        shape determines it from step to step: a `Moved` any motion; a Plane, Cone or Rough the
        translation of its point and the smallest rotation of its direction; a Cylinder and a Sphere
        the motion without spin; a SurfaceMesh the motion of its points. The first step counts from
        the obstacle of the problem. A plain number moves along the normal. If the gap changes
        otherwise and friction is not zero, `motion` is required.

        Parameters
        ----------
        of_time : callable t -> obstacle, number, array or callable
            E.g. ``lambda t: Moved(tool, (0.3 * t, -0.02))``, or a `Rigid` whose motion or force
            depends on t: a small motion, or any with ``sliding="finite"``. Without it a
            `ClosestPoint` must keep its directions, those of the problem's own; within a `Rigid` it
            may move.
        motion : callable t -> sequence of float, or 0, optional
            Displacement of the obstacle's contact points since the state of rest, without that of a
            `Rigid`, if its shape does not determine it. 0, constant or returned: motion along the
            normal only. For several boundaries a list, with None to derive it from the shape.
        pair : Pair or int, optional
            Which one, or its number, in a problem given as pairs: its rigid obstacle varies.

        Raises
        ------
        InputError
            Not a function; no pair of the problem, or one of two elastic bodies.
        """
        if not callable(of_time):
            raise InputError(f"obstacle: expected a function of time, got {of_time!r}")
        is_zero = isinstance(motion, int | float) and motion == 0
        if not (motion is None or callable(motion) or is_zero):
            raise InputError(f"motion={motion!r}: expected a function of time, or 0")
        which = self._rigid_pair(pair)
        self._obstacle = [entry for entry in self._obstacle if entry[0] != which]
        self._obstacle.append((which, of_time, motion))
        return self

    def _rigid_pair(self, pair: Any) -> int | None:
        """The number of a pair whose obstacle is rigid; None in a problem without pairs."""
        pairs = self.problem.pairs
        if not pairs and pair is None:
            return None
        number = pair if isinstance(pair, int) and not isinstance(pair, bool) else None
        if number is None:
            number = next((k for k, one in enumerate(pairs) if one is pair), None)
        rigid = [k for k, one in enumerate(pairs) if not one.two_bodies]
        if number not in rigid:
            known = ", ".join(f"pair={k}" for k in rigid) or "none has a rigid obstacle"
            raise InputError(
                f"pair={pair!r}: expected a Pair of the problem whose obstacle is rigid, or its "
                f"number ({known}); elastic bodies are moved by their supports, `move`"
            )
        return number

    def _obstacle_at(self, t: float) -> Any:
        """The obstacle at a time (NaN: state of rest), or a list with the opposite side of each
        pair."""
        found = self.problem.opposite
        for which, way, _ in [] if np.isnan(t) else self._obstacle:
            if which is None:
                return way(t)
            found[which] = way(t)
        return found

    def _said_between(self, begin: float, end: float) -> Any:
        """Given displacements of obstacles between two times; begin is NaN in the state of rest."""
        said = {which: _change(motion, begin, end) for which, _, motion in self._obstacle}
        if not self.problem.pairs:
            return said.get(None)
        return [said.get(k) for k in range(len(self.problem.pairs))]

    def _moving(self, begin: float, end: float) -> dict[str, Any]:
        """The obstacle, that of the last step, and the given displacement in between; begin is NaN
        in the state of rest."""
        if not self._obstacle:
            return {}
        return {
            "obstacle": self._obstacle_at(end),
            "since": self._obstacle_at(begin),
            "said": self._said_between(begin, end),
        }

    def _body_at(self, t: float) -> Any:
        base = self.problem.body
        f, u0 = base.f, base.constraint[1]
        for vector, factor in self._loads:
            f = f + value_at(factor, t) * vector
        for vector, factor in self._motions:
            u0 = u0 + value_at(factor, t) * vector
        now = base.under(f, u0)
        for part, rest in zip(now.bodies, base.bodies, strict=True):
            part._applied = rest._applied
        for k, name, given, factor in self._calls:
            now.bodies[k]._applied += ((name, given, value_at(factor, t)),)
        for k, strain, factor in self._heats:
            part = now.bodies[k]
            before = 0.0 if part.thermal is None else part.thermal
            part.thermal = before + value_at(factor, t) * strain
        return now

    def _opened(self, path: str | Path) -> HistoryFolder:
        """The folder of a run of this very problem; else `InputError`."""
        folder = HistoryFolder.opened(as_path(path), self.problem.body)
        if folder.fingerprint != self._fingerprint():
            raise self._another(path)
        return folder

    def _another(self, path: str | Path) -> InputError:
        return InputError(
            f"path: {path} holds the history of another problem (other {self._SAME}); build the "
            "stepper as it was"
        )

    def _fingerprint(self) -> str:
        return fingerprint(self.problem.system, self._vectors())

    def _vectors(self) -> list[Array]:
        """The loads and motions that vary."""
        vectors = [vector for vector, _ in (*self._loads, *self._motions)]
        return vectors + [strain for _, strain, _ in self._heats]


def _change(motion: Any, begin: float, end: float) -> Any:
    """Change of a displacement that is a function of time; of a list entry by entry."""
    if motion is None or not callable(motion):
        return motion
    now, before = motion(end), 0.0 if np.isnan(begin) else motion(begin)
    several = isinstance(now, list | tuple) and any(v is None or np.ndim(v) for v in now)
    if not several:
        return _difference(now, before)
    were = before if isinstance(before, list | tuple) else [before] * len(now)
    if len(were) != len(now):
        raise InputError(f"motion: {len(now)} at t={end}, {len(were)} at t={begin}")
    return [_difference(one, was) for one, was in zip(now, were, strict=True)]


def _difference(now: Any, before: Any) -> Any:
    return (
        None
        if now is None or before is None
        else numbers("motion", now) - numbers("motion", before)
    )


Factor = Callable[[float], float]


def checked_factor(factor: Factor | None) -> Factor:
    """The factor, by default time itself; `InputError` unless it can be called."""
    if factor is None:
        return _time_itself
    if not callable(factor):
        raise InputError(f"factor={factor!r}: expected a function of time")
    return factor


def value_at(factor: Factor, t: float) -> float:
    """The factor at a time; `InputError` unless it is a finite number."""
    value = numbers("factor", factor(t))
    if value.shape != () or not np.isfinite(value):
        raise InputError(f"factor: returned {value!r} at t = {t}; expected a finite number")
    return float(value)


def _time_itself(t: float) -> float:
    return t
