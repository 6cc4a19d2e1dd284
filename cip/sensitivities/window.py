r"""Tangent-linear and adjoint of a run: exact derivatives of its discrete steps.

A step is :math:`z_{n+1} = A(X_n) z_n`, linear in the moments z at given feet X, and the feet depend
on the velocity's parameters p. So

.. math::
    \delta z_{n+1} = A(X_n) \, \delta z_n + \partial_X [A(X_n) z_n] \, X_n' \, \delta p ,

and the adjoint runs through the steps backward with :math:`A^T`, a scatter of the same weights
(Griewank and Walther, Evaluating Derivatives, 2008, chapters 3 and 12, also for the checkpoints).
Where a path begins on a wall, the new moments come from the data there: rows of A are zero, and the
derivatives with respect to p are those of `cip.sensitivities.wall_derivatives`. Sources and decay
are moves of their own before and after a step's stages (`cip.sources.reaction`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from cip.errors import InputError, NotSupported
from cip.formulas.expression import COORDINATES
from cip.sensitivities.blocks import Block, blocks_of, whole_cells
from cip.sensitivities.path_tangent import PathTangent
from cip.sensitivities.wall_derivatives import WallDerivatives
from cip.sources.reaction import HalfStep
from cip.stages.stage import Correction, Stage, StageFeet
from cip.stages.state import State, state_of
from skfem_adini.ground.arguments import integer
from skfem_adini.ground.arrays import host

Array = Any  # arrays of NumPy or CuPy
# Default limit of the bytes of a window's states: with checkpoints another run is needed, a quarter
# of a gradient.
KEPT = 2**30


@dataclass(frozen=True)
class Move:
    """A stage of the step [t, t + dt]."""

    stage: Stage
    t: float
    dt: float

    @property
    def columns(self) -> list[str]:
        """Names of the parameters on which its feet depend."""
        return names_of(self.stage.system.parameters)

    @property
    def wall_columns(self) -> list[str]:
        """Names of the parameters on which the moments from walls depend."""
        return names_of(self.stage.wall_parameters)

    @property
    def reads_state(self) -> bool:
        """Whether derivatives in parameters depend on the moments."""
        return bool(self.columns)


class Window:
    """The derivative of a run's last state in the first one and in the parameters. The adjoint
    recomputes states between checkpoints, `every` moves apart. ``advance(n, state)`` makes move n,
    for a change of the state if a third argument is True; ``feet(n)`` are its feet."""

    _kind: Any = LinearOperator

    def __init__(
        self,
        moves: list[Any],
        start: State,
        advance: Callable[..., State],
        feet: Callable[[int], StageFeet],
        parameters: tuple[str, ...],
        every: int,
        steady: bool,
    ) -> None:
        self.parameters, self.every, self._steady = parameters, every, steady
        self._moves, self._start = moves, start
        self._advance, self._feet = advance, feet
        # Columns of the parameters that occur; others have no influence.
        place = {name: q for q, name in enumerate(parameters)}
        self._columns = [[place[name] for name in move.columns] for move in moves]
        self._wall_columns = [
            [place[name] for name in move.wall_columns] if isinstance(move, Move) else []
            for move in moves
        ]
        self._varies = any(move.reads_state for move in moves)
        self._xp: Any = np
        self._kept: dict[Any, Any] = {}
        self._marks: dict[int, State] = {}
        self._blocks: dict[Stage, list[Block]] = {}
        self._on_paths: dict[Stage, PathTangent] = {}
        self._on_walls: dict[Stage, WallDerivatives] = {}

    def follow(self) -> State:
        """Take the steps, keep the states at the checkpoints, and return the last state."""
        state = self._start
        for n in range(len(self._moves)):
            if self._varies and n % self.every == 0:
                self._marks[n] = state
            state = self._advance(n, state)
        return state

    def operator(self) -> LinearOperator:
        """The derivative as a linear operator; its transpose is the adjoint."""
        size = self._start.data.size
        found = self._linear(self._tangent, self._adjoint, size + len(self.parameters))
        found.feet_on_edges = self.feet_on_edges
        return found

    def state_operator(self) -> LinearOperator:
        """The derivative in the first state alone, without storing states for parameters."""
        held = np.zeros(len(self.parameters))

        def tangent(x: Any) -> Array:
            return self._tangent(self._xp.append(self._starting_point(x), self._xp.asarray(held)))

        def adjoint(x: Any) -> Array:
            return self._adjoint(x, held=True)[: self._start.data.size]

        return self._linear(tangent, adjoint, self._start.data.size)

    def _linear(self, tangent: Any, adjoint: Any, columns: int) -> Any:
        shape = (self._start.data.size, columns)
        return self._kind(shape, tangent, rmatvec=adjoint, dtype=np.float64)

    def _key(self, n: int) -> Any:
        """Moves with the same key have the same feet where the velocity is steady."""
        move = self._moves[n]
        return move.stage.axis, (move.stage.end - move.stage.begin) * move.dt

    def _once(self, n: int, steady: bool, make: Callable[[Stage, StageFeet], Any]) -> Any:
        """The result of `make` for the feet of move n, kept if it is the same for other moves."""
        if not steady:
            return make(self._moves[n].stage, self._feet(n))
        key = make, self._key(n)
        if key not in self._kept:
            self._kept[key] = make(self._moves[n].stage, self._feet(n))
        return self._kept[key]

    def _blocks_of(self, stage: Stage) -> list[Block]:
        if stage not in self._blocks:
            self._blocks[stage] = blocks_of(stage, self._xp)
        return self._blocks[stage]

    def _walls(self, n: int) -> list[Correction]:
        data = self._moves[n].stage.walls.values()
        steady = self._steady and all(formula.exact and formula.steady for formula in data)
        found: list[Correction] = self._once(n, steady, self._new_walls) if data else []
        return found

    def _new_walls(self, stage: Stage, feet: StageFeet) -> list[Correction]:
        if stage not in self._on_walls:
            self._on_walls[stage] = WallDerivatives(stage)
        return self._on_walls[stage].of(feet)

    def _flat(self, data: Any) -> Array:
        """Reshape moments or components of feet to a row each."""
        return self._xp.asarray(data, dtype=float).reshape(-1, self._start.grid.size)

    def _starting_point(self, x: Any) -> Array:
        """The vector that the operator is applied to."""
        if np.ma.is_masked(x):
            raise InputError("x: some values are masked; fill them")
        x = self._xp.ravel(self._xp.asarray(x))
        if x.dtype.kind not in "biuf":
            raise InputError(f"x: expected real values instead of {x.dtype}")
        found: Array = x.astype(float)
        return found

    def _tangent(self, x: Any) -> Array:
        x = self._starting_point(x)
        state, size = self._start, self._start.data.size
        change = state_of(state.grid, state.profile, x[:size].reshape(state.data.shape).copy())
        given = host(x[size:])
        varies = self._varies and given.any()
        known: dict[Any, Array] = {}
        for n in range(len(self._moves)):
            # The scheme is linear in the moments.
            new = self._advance(n, change, True)
            more = self._along(n, state, given, known)
            if more is not None:
                data = new.data + more.reshape(new.data.shape)
                new = state_of(state.grid, state.profile, data, new.t)
            if varies:
                state = self._advance(n, state)
            change = new
        return change.data.ravel()

    def _along(
        self, n: int, state: State, direction: Array, known: dict[Any, Array]
    ) -> Array | None:
        """The change of the moments after move n for a change of all parameters; None for none.
        `known` holds the changes of the feet of a steady velocity."""
        own, on_walls = direction[self._columns[n]], direction[self._wall_columns[n]]
        if not (own.any() or on_walls.any()):
            return None
        move, xp = self._moves[n], self._xp
        found = xp.zeros(state.data.size)
        if isinstance(move, HalfStep):
            return found + move.along(state.data, own).ravel()
        if own.any():
            key = self._key(n)
            if key not in known:
                known[key] = self._foot_changes(n, own)
            found += self._pushed(n, self._flat(state.data), known[key]).ravel()
            if not self._steady:
                known.clear()
        for wall in self._walls(n):
            # Indices are distinct, so the order of additions is fixed.
            xp.add.at(found, xp.asarray(wall.places), xp.asarray(on_walls @ wall.values))
        for stops in self._feet(n).stops:
            found[xp.asarray(stops.values)] = found[xp.asarray(stops.means)]
        return found

    def _foot_changes(self, n: int, direction: Array) -> Array:
        """The changes of the feet of move n along a direction of its parameters."""
        stage = self._moves[n].stage
        if stage not in self._on_paths:
            self._on_paths[stage] = self._new_tangent(stage)
        return self._on_paths[stage].along(self._blocks_of(stage), self._feet(n), direction)

    def _new_tangent(self, stage: Stage) -> PathTangent:
        return PathTangent(stage)

    def _edges(self, stage: Stage, feet: StageFeet) -> list[tuple[Any, Array, Array]]:
        """The feet on edges of cells, where derivatives of the profile may jump. For each direction
        in which parameters move feet: the rows of its displacements, a mask of whole cells, and all
        components with these feet on the other side of their edges."""
        xp, found, components = self._xp, [], self._flat(feet.data)
        for q, axis in enumerate(stage.moving):
            if axis not in varying_axes(stage):
                continue
            rows = [block.components.start + q for block in self._blocks_of(stage)]
            d = components[rows]
            whole = xp.rint(d)
            near = 2.0**-42 * (1.0 + xp.abs(d))  # in cells: feet are on an edge up to rounding
            on_edge = xp.abs(d - whole) <= near
            if bool(on_edge.any()):
                beside = xp.where(d >= whole, whole - 2.0 * near, whole)
                other = components.copy()
                other[rows] = xp.where(on_edge, beside, d)
                found.append((rows, on_edge, other))
        return found

    def feet_on_edges(self) -> int:
        """Number of feet, in all moves, that lie on edges of cells and depend on parameters."""
        moves = [n for n, move in enumerate(self._moves) if isinstance(move, Move)]
        return sum(
            int(on_edge.sum())
            for n in moves
            if self._columns[n]
            for _, on_edge, _ in self._once(n, self._steady, self._edges)
        )

    def _pushed(self, n: int, z: Array, changes: Array) -> Array:
        """The change of the new moments of move n: on edges of cells the mean of both sides."""
        edges, feet = self._once(n, self._steady, self._edges), self._flat(self._feet(n).data)
        if not edges:
            return self._push_forward(n, z, feet, changes)
        here, found = changes.copy(), self._xp.zeros_like(z)
        for rows, on_edge, other in edges:
            there = self._xp.zeros_like(changes)
            there[rows] = 0.5 * on_edge * changes[rows]
            here[rows] -= there[rows]
            found += self._push_forward(n, z, other, there)
        return found + self._push_forward(n, z, feet, here)

    def _pulled(self, n: int, z: Array, weight: Array, feet: Array, g: Array, held: bool) -> Array:
        """The transposed update of move n; `g` is the transpose of what `_pushed` does."""
        moved = self._columns[n] and not held
        edges = self._once(n, self._steady, self._edges) if moved else []
        if not edges:
            return self._pull_back(n, z, weight, feet, g)
        here = self._xp.zeros_like(g)
        found = self._pull_back(n, z, weight, feet, here)
        for rows, on_edge, other in edges:
            there = self._xp.zeros_like(g)
            self._pull_back(n, z, weight, other, there)
            here[rows] += 0.5 * on_edge * (there[rows] - here[rows])
        g += here
        return found

    def _push_forward(self, n: int, z: Array, feet: Array, changes: Array) -> Array:
        """The change of the new moments of move n with its feet, at their components."""
        from cip.sensitivities.node_derivatives import push_forward

        return push_forward(self._blocks_of(self._moves[n].stage), z, feet, changes)

    def _adjoint(self, x: Any, held: bool = False) -> Array:
        """The transpose; zeros for the parameters where they are `held`."""
        xp, shape, varies = self._xp, self._start.data.shape, self._varies and not held
        weight = self._flat(self._starting_point(x)).copy()
        found, segment = np.zeros(len(self.parameters)), list[State]()
        gathered: dict[Any, tuple[int, StageFeet, Array]] = {}
        for n in range(len(self._moves) - 1, -1, -1):
            move, z = self._moves[n], weight
            if varies:
                first = n - n % self.every
                if n == len(self._moves) - 1 or (n + 1) % self.every == 0:
                    segment = self._states(self._marks[first], first, n)
                z = self._flat(segment[n - first].data)
            if isinstance(move, HalfStep):
                back, more = move.pull_back(z.reshape(shape), weight.reshape(shape))
                weight = self._flat(back)
                if not held:
                    found[self._columns[n]] += more
                continue
            stage, feet, columns = move.stage, self._feet(n), self._wall_columns[n]
            for stops in feet.stops:
                values, means = xp.asarray(stops.values), xp.asarray(stops.means)
                xp.add.at(weight.reshape(-1), means, weight.reshape(-1)[values])
                weight.reshape(-1)[values] = 0.0
            if columns and feet.bounded and not held:
                for wall in self._walls(n):
                    own = weight.ravel()[xp.asarray(wall.places)]
                    found[columns] += wall.values @ host(own)
            for correction in stage.corrections(feet):
                if not correction.add:
                    weight.reshape(-1)[xp.asarray(correction.places)] = 0.0
            components = self._flat(feet.data)
            # Moves with the same feet in a steady velocity, whose derivatives are therefore applied
            # once, to the sum over these moves.
            _, _, g = gathered.setdefault(self._key(n), (n, feet, xp.zeros(components.shape)))
            weight = self._pulled(n, z, weight, components, g, held)
            if not (self._steady or held):
                self._spread(gathered, found)
        if not held:
            self._spread(gathered, found)
        return xp.concatenate([weight.ravel(), xp.asarray(found)])

    def _spread(self, gathered: dict[Any, tuple[int, StageFeet, Array]], found: Array) -> None:
        """Convert derivatives in the feet to parameters, add them to `found`, and discard them."""
        for n, where, total in gathered.values():
            if self._columns[n]:
                found[self._columns[n]] += self._gradient(n, where, total)
        gathered.clear()

    def _pull_back(self, n: int, z: Array, weight: Array, feet: Array, g: Array) -> Array:
        """The transposed update of move n; `cip.sensitivities.node_derivatives.pull_back`."""
        from cip.sensitivities.node_derivatives import pull_back

        stage = self._moves[n].stage
        blocks = self._blocks_of(stage)
        pairs: list[Any] = [None] * len(blocks)
        if stage.conservative:
            pairs = self._once(n, self._steady, self._whole_cells)
        return pull_back(blocks, z, weight, feet, g, pairs)

    def _whole_cells(self, stage: Stage, feet: StageFeet) -> list[Any]:
        """For each block of feet the pairs of `whole_cells`."""
        components, axis = self._flat(feet.data), stage.axis or 0
        first = [components[block.components][0] for block in self._blocks_of(stage)]
        return [whole_cells(stage.grid, axis, one) for one in first]

    def _gradient(self, n: int, feet: StageFeet, g: Array) -> Any:
        """The gradient in the parameters of the stage of move n, from derivatives in its feet."""
        from cip.sensitivities.path_adjoint import parameter_gradient

        return parameter_gradient(self._moves[n].stage, feet, g)

    def _states(self, state: State, first: int, last: int) -> list[State]:
        """The states at which the moves first..last begin."""
        found = [state]
        for n in range(first, last):
            found.append(self._advance(n, found[-1]))
        return found


def varying_axes(stage: Stage) -> set[int]:
    """Directions in which the feet of a stage move with the parameters of the velocity."""
    needs = {axis: stage.velocity[axis].expression.variables() for axis in stage.moving}
    own = {axis for axis, names in needs.items() if any(name.startswith("p_") for name in names)}
    return own | {axis for axis in needs if needs[axis] & {COORDINATES[other] for other in own}}


def names_of(variables: Iterable[str]) -> list[str]:
    """The names of parameters, from those of their variables in code."""
    return [name.removeprefix("p_") for name in variables]


def check_differentiable(profile: str, limiter: str | None) -> None:
    """Raise `NotSupported` for a profile or limiter with kinks."""
    if limiter is not None:
        raise NotSupported(f"limiter: {limiter!r} is not differentiable; take limiter=None")
    if profile in ("linear", "piecewise_linear", "smoothed"):
        raise NotSupported(
            f"profile: {profile!r} is not differentiable in the feet; take 'cubic' or 'quintic'"
        )


def checkpoint_distance(steps: int, checkpoints: int | None, state: int) -> int:
    """Steps between checkpoints. By default every state is kept if all of them, of `state` bytes
    each, take at most `KEPT` bytes; otherwise about the square root of the number of steps."""
    if checkpoints is None:
        return 1 if steps * state <= KEPT else max(1, int(np.ceil(np.sqrt(steps))))
    return max(1, -(-steps // integer("checkpoints", checkpoints, 1)))
