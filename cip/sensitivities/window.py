r"""Tangent-linear and adjoint of a run: exact derivatives of its discrete steps.

A step is :math:`z_{n+1} = A(X_n) z_n`, linear in the moments z at given feet X, and the feet depend
on the velocity's parameters p. So

.. math::
    \delta z_{n+1} = A(X_n) \, \delta z_n + \partial_X [A(X_n) z_n] \, X_n' \, \delta p ,

and the adjoint runs through the steps backward with :math:`A^T`, a scatter of the same weights
(Griewank and Walther, Evaluating Derivatives, 2008, chapters 3 and 12, also for the checkpoints).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from cip.errors import InputError, NotSupported
from cip.profiles.catalogue import PLANE
from cip.profiles.locate_nodes import cells_of
from cip.sensitivities.foot_derivatives import foot_derivatives
from cip.sensitivities.profile_derivatives import CORNERS, profile_derivatives, rows
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Step:
    """The derivatives of one step at its feet.

    Attributes
    ----------
    corners : ndarray of int, shape (2^dim, nodes)
        The nodes at the corners of the cell of each foot.
    weights : ndarray, shape (moments, moments, 2^dim, nodes)
        Derivative of the new moment in the old one at a corner.
    cell : ndarray, shape (2 dim, nodes)
        The place of each foot in its cell, then the widths of the cell.
    feet : ndarray, shape (components - dim, nodes)
        Components of the feet after the displacements.
    by_parameter : ndarray, shape (parameters, components, nodes)
        Derivatives of the components; of displacements in the unit of the place in the cell.
    """

    profile: str
    advect: bool
    corners: np.ndarray[Any, np.dtype[np.int64]]
    weights: Array
    cell: Array
    feet: Array
    by_parameter: Array

    def forward(self, z: Array) -> Array:
        """A z, the new moments; shape (moments, nodes)."""
        return np.asarray(np.einsum("qren,ren->qn", self.weights, z[:, self.corners]))

    def backward(self, weight: Array) -> Array:
        """A^T applied: every node scatters to the corners of its cell."""
        parts = np.einsum("qren,qn->ren", self.weights, weight)
        size = weight.shape[1]
        return np.array(
            [np.bincount(self.corners.ravel(), part.ravel(), minlength=size) for part in parts]
        )

    def parameters(self, z: Array) -> Array:
        """Derivatives of the new moments in the parameters, shape (parameters, moments, nodes)."""
        found = profile_derivatives(self.profile, self.advect)
        moments = z[:, self.corners].reshape(-1, z.shape[1])
        values = found.slopes(*self.cell, *self.feet, *moments)
        slopes = rows(values, (len(z), self.by_parameter.shape[1]), z.shape[1])
        return np.asarray(np.einsum("qcn,pcn->pqn", slopes, self.by_parameter))


def step_derivatives(stage: Stage, feet: StageFeet) -> Step:
    """The derivatives of a step from the feet that the step itself uses.

    Raises
    ------
    NotSupported
        A path begins on a wall.
    """
    if feet.bounded:
        raise NotSupported(
            "boundary: characteristics enter through a wall; derivatives of their data are not "
            "implemented. Take a periodic grid, or one that the flow only leaves"
        )
    grid, size = stage.grid, stage.grid.size
    components = np.asarray(feet.data).reshape(-1, size)
    found = [cells_of(grid, axis, components[axis]) for axis in range(grid.dim)]
    widths = [grid.widths[axis][cells[0]] for axis, cells in enumerate(found)]
    cell = np.stack([*(cells[2] for cells in found), *widths])
    corners = np.stack(
        [
            np.ravel_multi_index([found[axis][side] for axis, side in enumerate(sides)], grid.nodes)
            for sides in CORNERS[grid.dim]
        ]
    )
    profile, rest = profile_derivatives(stage.profile, stage.advect), components[grid.dim :]
    shape = (profile.moments, profile.moments, len(corners))
    weights = rows(profile.weights(*cell, *rest), shape, size)
    by_parameter = np.empty((0, len(components), size))
    if stage.system.parameters:
        by_parameter = foot_derivatives(stage, feet)
        by_parameter[:, : grid.dim] /= np.stack(widths)
    return Step(stage.profile, stage.advect, corners, weights, cell, rest, by_parameter)


class Window:
    """The derivative of the last state of a run in the first one and in the velocity's parameters.

    The adjoint recomputes the states between checkpoints.

    Parameters
    ----------
    stage : Stage
    plan : sequence of (t, dt)
        The steps.
    start : State
    advance : callable
        The state after a step, ``advance(state, dt)``.
    feet : callable
        ``feet(t, dt)``, those that the step uses.
    parameters : sequence of str
        In the order of the columns.
    every : int
        Steps from one checkpoint to the next.
    steady : bool
        Whether steps of one length have the same feet.
    """

    def __init__(
        self,
        stage: Stage,
        plan: list[tuple[float, float]],
        start: State,
        advance: Callable[[State, float], State],
        feet: Callable[[float, float], StageFeet],
        parameters: tuple[str, ...],
        every: int,
        steady: bool,
    ) -> None:
        self.parameters, self.every, self._steady = parameters, every, steady
        self._stage, self._plan, self._start = stage, plan, start
        self._advance, self._feet = advance, feet
        names = [name.removeprefix("p_") for name in stage.system.parameters]
        # Columns of the parameters that occur: others have no influence.
        self._columns = [parameters.index(name) for name in names]
        self._kept: dict[float, Step] = {}

    def operator(self) -> LinearOperator:
        """The derivative as a linear operator; its transpose is the adjoint."""
        self._step(*self._plan[0])  # raises here, not when the operator is applied
        size = self._start.data.size
        shape = (size, size + len(self.parameters))
        return LinearOperator(shape, self._tangent, rmatvec=self._adjoint, dtype=np.float64)

    def _step(self, t: float, dt: float) -> Step:
        if not self._steady:
            return step_derivatives(self._stage, self._feet(t, dt))
        if dt not in self._kept:
            self._kept[dt] = step_derivatives(self._stage, self._feet(t, dt))
        return self._kept[dt]

    def _flat(self, state: State) -> Array:
        return np.asarray(state.data, dtype=float).reshape(len(state.data), -1)

    def _tangent(self, x: Any) -> Array:
        x = np.ravel(x)
        state, size = self._start, self._start.data.size
        change = x[:size].reshape(len(state.data), -1)
        given = x[size:][self._columns]
        for t, dt in self._plan:
            step = self._step(t, dt)
            new = step.forward(change)
            if given.any():
                new += np.einsum("pqn,p->qn", step.parameters(self._flat(state)), given)
                state = self._after(state, t, dt)
            change = new
        return change.ravel()

    def _adjoint(self, x: Any) -> Array:
        weight = np.ravel(x).reshape(len(self._start.data), -1)
        found = np.zeros(len(self.parameters))
        marks = self._marks() if self._columns else {}
        segment: list[State] = []
        for n in range(len(self._plan) - 1, -1, -1):
            t, dt = self._plan[n]
            step = self._step(t, dt)
            if self._columns:
                first = n - n % self.every
                if n == len(self._plan) - 1 or (n + 1) % self.every == 0:
                    segment = self._states(marks[first], first, n)
                change = step.parameters(self._flat(segment[n - first]))
                found[self._columns] += np.einsum("pqn,qn->p", change, weight)
            weight = step.backward(weight)
        return np.concatenate([weight.ravel(), found])

    def _after(self, state: State, t: float, dt: float) -> State:
        """The state after the step at t; its time is that of the plan."""
        return self._advance(State(state.grid, state.profile, state.data, t), dt)

    def _marks(self) -> dict[int, State]:
        """States at the checkpoints, by the number of the step that begins there."""
        found, state = {}, self._start
        for n, (t, dt) in enumerate(self._plan):
            if n % self.every == 0:
                found[n] = state
            state = self._after(state, t, dt)
        return found

    def _states(self, state: State, first: int, last: int) -> list[State]:
        """The states at which the steps first..last begin."""
        found = [state]
        for n in range(first, last):
            found.append(self._after(found[-1], *self._plan[n]))
        return found


def check_differentiable(profile: str, limiter: str | None, dim: int, backend: str) -> None:
    """Raise unless the scheme has derivatives that this package knows.

    Raises
    ------
    NotSupported
        A profile or limiter with kinks, a splitting, or a device.
    """
    if limiter is not None:
        raise NotSupported(f"limiter: {limiter!r} is not differentiable; take limiter=None")
    if profile in ("linear", "piecewise_linear", "smoothed"):
        raise NotSupported(
            f"profile: {profile!r} is not differentiable in the feet; take 'cubic' or 'quintic'"
        )
    if profile not in (("cubic", "quintic") if dim == 1 else PLANE):
        raise NotSupported(
            f"profile: derivatives of {profile!r} in {dim} dimensions are not implemented; they "
            "are for 'cubic' and 'quintic' on lines, 'adini' and 'bicubic' in planes"
        )
    if backend != "cpu":
        raise NotSupported("backend: derivatives are implemented for backend='cpu'")


def checkpoint_distance(steps: int, checkpoints: int | None) -> int:
    """Steps between checkpoints, by default about the square root of their number.

    Raises
    ------
    InputError
        A number of checkpoints that is not a positive integer.
    """
    if checkpoints is None:
        return max(1, int(np.ceil(np.sqrt(steps))))
    if isinstance(checkpoints, bool) or not isinstance(checkpoints, int | np.integer):
        raise InputError(f"checkpoints: expected a positive number, got {checkpoints!r}")
    if checkpoints < 1:
        raise InputError(f"checkpoints: expected a positive number, got {checkpoints!r}")
    return max(1, -(-steps // int(checkpoints)))
