"""The budget of an integral: what is inside, came in, left, was added and decayed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from cip.grid import Array, Grid, GridLike, wall_name


@dataclass(frozen=True)
class Budget:
    """Where the integral of a field went, from the start of a run to each snapshot.

    `Trajectory.budget` returns it. What enters and leaves again by the same wall within a sweep is
    counted in neither.

    Attributes
    ----------
    t, mass : ndarray
        Times of the snapshots, and `State.mass` then.
    inflow, outflow : dict
        What came in and left by each wall ("x-", ..), an array with an entry for each snapshot.
    added, decayed : ndarray
        What the source added, and what decayed.
    replaced : ndarray
        Changes by states that a callback returned.
    reacted : ndarray
        What reactions with other fields produced, negative for what they consumed.

    Examples
    --------
    >>> from cip import Grid, Solver
    >>> grid = Grid((0, 1), 20)
    >>> solver = Solver(grid, 1.0, form="advection", profile="csl2", boundary={"x-": 2.0})
    >>> budget = solver.run(solver.state(0.0), 0.5, dt=0.05).budget
    >>> print(f"{budget.inflow['x-'][-1]:.4f} {budget.outflow['x+'][-1]:.4f}")
    1.0000 0.0000
    >>> bool(abs(budget.residual).max() < 1e-14)
    True
    """

    t: Array
    mass: Array
    inflow: dict[str, Array]
    outflow: dict[str, Array]
    added: Array
    decayed: Array
    replaced: Array
    reacted: Array

    def __repr__(self) -> str:
        ways = self.inflow.values(), self.outflow.values()
        came, left = (sum(float(amounts[-1]) for amounts in way) for way in ways)
        return (
            f"Budget(mass {self.mass[0]:.6g} to {self.mass[-1]:.6g}, inflow {came:.6g}, outflow "
            f"{left:.6g}, added {self.added[-1]:.6g}, decayed {self.decayed[-1]:.6g})"
        )

    @property
    def residual(self) -> Array:
        """What is unaccounted for at each snapshot: rounding."""
        passed = sum(self.outflow.values()) - sum(self.inflow.values())
        found: Array = self.mass - self.mass[0] + passed - self.added + self.decayed
        return found - self.replaced - self.reacted


class Tally:
    """Sums of what passed the walls, was added, decayed and replaced, with compensation."""

    def __init__(self, grid: GridLike) -> None:
        walls = isinstance(grid, Grid)  # a sphere has none
        self._axes = [axis for axis in range(grid.dim) if walls and not grid.periodic[axis]]
        keys = list(product(self._axes, (0, 1), ("in", "out")))
        self._keys: list[Any] = [*keys, "added", "decayed", "replaced", "reacted"]
        self._sums = dict.fromkeys(self._keys, (0.0, 0.0))
        self._step: list[tuple[Any, float]] = []
        self._rows: list[list[float]] = []

    def enter(self, amounts: dict[tuple[int, int], float]) -> None:
        """Count what came in through walls."""
        self._step += [((*wall, "in"), amount) for wall, amount in amounts.items()]

    def leave(self, axis: int, amounts: Any) -> None:
        """Count what left by both walls of a direction, at the ends of all lines."""
        for side, place in ((0, 0), (1, -1)):
            index = (slice(None),) * axis + (place,)
            self._step.append(((axis, side, "out"), float(amounts[index].sum())))

    def react(self, added: float, decayed: float) -> None:
        """Count what a source added and what decayed."""
        self._step += [("added", added), ("decayed", decayed)]

    def change(self, kind: str, amount: float) -> None:
        """Count the change by a callback ("replaced") or by reactions with fields ("reacted")."""
        self._step.append((kind, amount))

    def commit(self) -> None:
        """Add what was counted since the last call, after a finished step."""
        for key, amount in self._step:
            total, rest = self._sums[key]
            new = total + amount
            # The rounding error of the sum (Neumaier, ZAMM 54, 1974, 39-51).
            larger, smaller = (total, amount) if abs(total) >= abs(amount) else (amount, total)
            self._sums[key] = new, rest + ((larger - new) + smaller)
        self._step = []

    @property
    def sums(self) -> Array:
        """All sums with their rounding errors, to go on with in another process."""
        return np.array([self._sums[key] for key in self._keys])

    def restore(self, rows: list[Array]) -> None:
        """Go on from the `sums` at each of the snapshots until now."""
        self._rows = [[float(a + b) for a, b in row] for row in rows]
        self._sums = {
            k: (float(a), float(b)) for k, (a, b) in zip(self._keys, rows[-1], strict=True)
        }

    def budget(self, t: Array, mass: Array) -> Budget:
        """The budget at the snapshots, the last of which is now."""
        while len(self._rows) < t.size:
            self._rows.append([sum(self._sums[key]) for key in self._keys])
        found = dict(zip(self._keys, np.array(self._rows).T, strict=True))
        ways: dict[str, dict[str, Array]] = {"in": {}, "out": {}}
        for axis, side, way in product(self._axes, (0, 1), ways):
            ways[way][wall_name(axis, side)] = found[axis, side, way]
        rest = found["added"], found["decayed"], found["replaced"], found["reacted"]
        return Budget(t, mass, ways["in"], ways["out"], *rest)


def masses(state: Any) -> list[float]:
    """The integrals of all fields of a state."""
    return list(state.mass.values()) if state.fields else [state.mass]


def budget_of(tallies: Sequence[Tally], states: Sequence[Any]) -> Any:
    """The budget of snapshots, the last of which is now; of several fields a dict."""
    if not tallies:
        return None
    t, mass = np.array([one.t for one in states]), np.array([masses(one) for one in states])
    found = [tally.budget(t, mass[:, k]) for k, tally in enumerate(tallies)]
    return dict(zip(states[0].fields, found, strict=True)) if states[0].fields else found[0]
