"""Subdivision of cells until level sets are polynomials, or their sign is settled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

from skfem_adini.curved.quadrature.level_set import TruthTable
from skfem_adini.errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class _Limits(NamedTuple):  # degrees of the interpolants, and limits of the division
    coarse: int = 4  # degree of the interpolant that settles the sign in most boxes
    fine: int = 8  # degree in the others
    error: float = 3e-12  # relative to the variation of phi in a box
    rounding: float = 32 * np.finfo(float).eps  # relative error of phi: some thirty operations
    safety: float = 4.0  # factor on the estimated error before a sign counts as settled
    zero: float = 1e-13  # relative to phi in a cell: smaller is 0, for boundaries on grid lines
    halvings: int = 24  # levels of division: the side is then 6e-8 of the cell's
    boxes: int = 50_000  # unresolved at most, plus two a cell: 32 MB a leaf, 81 coefficients a box
    leaves: int = 6  # maximal zero lines in a box, with 2^6 truth values; other boxes are divided


LIMITS = _Limits()


@dataclass(frozen=True)
class OpenBoxes:
    """Boxes in which the same number of leaves (smooth level sets of a composition) may change
    sign."""

    cell: Indices  # the cell of each box, shape (n,)
    lower: Array  # lower corners, shape (2, n)
    size: Array  # sides, shape (2, n)
    leaves: Indices  # numbers of the relevant leaves, shape (n, leaves)
    coefficients: Array  # Bernstein coefficients of these, shape (n, leaves, 9, 9)
    tolerances: Array  # absolute value below which phi counts as zero, shape (n, leaves)
    tables: NDArray[np.uint8]  # inside or not, by the leaves a point is in, (n, 2^leaves)


@dataclass(frozen=True)
class AccurateBoxes:
    """The boxes into which cells were divided, without those outside."""

    count_in_cell: Indices  # number of boxes of each cell, those outside included
    inside: tuple[Indices, Array, Array]  # cells, lower corners and sides of boxes inside
    groups: list[OpenBoxes]  # the other boxes, by the number of relevant leaves


def accurate_boxes(table: TruthTable, lower: Array, size: Array) -> AccurateBoxes:
    """Divide cells, given by lower corners and sides (2, cells).
    Too many unresolved boxes at one level mean that the level set is not smooth along its zero
    line."""
    cell = np.arange(lower.shape[1])
    count = np.zeros(len(cell), dtype=np.int64)
    inside: list[tuple[Indices, Array, Array]] = []
    found: dict[int, list[OpenBoxes]] = {}
    most = LIMITS.boxes + 2 * len(cell)
    zeros = np.zeros(len(table.leaves))
    for level in range(LIMITS.halvings + 1):
        boxes = _Screened(table, cell, lower, size, zeros)
        divide = np.zeros(len(cell), dtype=bool)
        for pattern, members in boxes.patterns():
            matter, reduced = _reduce(table, pattern)
            crowded = len(matter) > LIMITS.leaves
            if crowded and level == LIMITS.halvings:
                raise InputError(f"level_set: {len(matter)} zero lines meet in one point")
            if level < LIMITS.halvings:
                rough = members[crowded | ~boxes.accurate[matter][:, members].all(axis=0)]
                divide[rough] = True
                members = np.setdiff1d(members, rough, assume_unique=True)
            if members.size == 0:
                continue
            if matter:
                found.setdefault(len(matter), []).append(boxes.open(members, matter, reduced))
            elif reduced[0]:
                inside.append((cell[members], lower[:, members], size[:, members]))
        np.add.at(count, cell[~divide], 1)
        rest = np.flatnonzero(divide)
        if rest.size == 0:
            break
        if rest.size > most:
            raise InputError(
                f"level_set: not smooth along its zero line: {rest.size} boxes of side "
                f"{size.min():.2g} are not resolved; compose smooth functions with "
                "LevelSet(f) & LevelSet(g) instead of minima, signs or absolute values"
            )
        half = size[:, rest] / 2
        shift = np.array([[0, 1, 0, 1], [0, 0, 1, 1]], dtype=float)
        lower = (lower[:, rest, None] + half[:, :, None] * shift[:, None]).reshape(2, -1)
        size, cell = np.repeat(half, 4, axis=1), np.repeat(cell[rest], 4)
    inside.append((np.zeros(0, dtype=np.int64), np.zeros((2, 0)), np.zeros((2, 0))))
    cells, corners, sides = zip(*inside, strict=True)
    return AccurateBoxes(
        count,
        (np.concatenate(cells), np.concatenate(corners, axis=1), np.concatenate(sides, axis=1)),
        [_joined(found[key]) for key in sorted(found)],
    )


class _Screened:
    """Interpolants of all leaves on boxes; the state is 1 inside a leaf, 0 outside, else 2."""

    def __init__(
        self, table: TruthTable, cell: Indices, lower: Array, size: Array, zeros: Array
    ) -> None:
        K, count, m = len(table.leaves), len(cell), LIMITS.fine + 1
        self.cell, self.lower, self.size = cell, lower, size
        self.state = np.full((K, count), 2)
        self.accurate = np.zeros((K, count), dtype=bool)
        self.place = np.full((K, count), -1)
        self.polynomials: list[Array] = []
        self.tolerance = zeros
        # Rounding of coordinates of size |x| changes a function by eps |x| |gradient|.
        offset = (np.abs(lower) + size).max(axis=0) / size.min(axis=0)
        for k, leaf in enumerate(table.leaves):
            left, polynomials = np.arange(count), np.zeros((0, m, m))
            for degree in (LIMITS.coarse, LIMITS.fine):

                def values(x: Array, boxes: Indices = left, leaf: object = leaf) -> Array:
                    return table.signs[k] * leaf.evaluate(x, cell[boxes])  # type: ignore[attr-defined]  # noqa: B023

                polynomials, error = interpolate(values, lower[:, left], size[:, left], degree)
                low, high = polynomials.min(axis=(1, 2)), polynomials.max(axis=(1, 2))
                if degree == LIMITS.fine and zeros[k] == 0 and left.size:
                    # The same for all boxes, so that neighbours agree which zeros lie on a side.
                    zeros[k] = LIMITS.zero * np.median(np.maximum(np.abs(low), np.abs(high)))
                zero = zeros[k]
                self.state[k, left[high + LIMITS.safety * error < -zero]] = 1
                self.state[k, left[low - LIMITS.safety * error > zero]] = 0
                if degree == LIMITS.fine:
                    allowed = (LIMITS.error + LIMITS.rounding * offset[left]) * (high - low)
                    self.accurate[k, left] = error <= allowed + LIMITS.rounding * np.abs(high)
                    self.place[k, left] = np.arange(len(left))
                else:
                    left = left[self.state[k, left] == 2]
            self.polynomials.append(polynomials)

    def patterns(self) -> list[tuple[Indices, Indices]]:
        """Return the states that occur, and the boxes of each."""
        states, owner = np.unique(self.state, axis=1, return_inverse=True)
        return [(states[:, i], np.flatnonzero(owner == i)) for i in range(states.shape[1])]

    def open(self, members: Indices, leaves: list[int], reduced: NDArray[np.uint8]) -> OpenBoxes:
        """Return some of the boxes with the polynomials of the relevant leaves."""
        chosen = [self.polynomials[k][self.place[k, members]] for k in leaves]
        return OpenBoxes(
            self.cell[members],
            self.lower[:, members],
            self.size[:, members],
            np.tile(leaves, (len(members), 1)),
            np.stack(chosen, axis=1),
            np.tile(self.tolerance[leaves], (len(members), 1)),
            np.tile(reduced, (len(members), 1)),
        )


def _reduce(table: TruthTable, state: Indices) -> tuple[list[int], NDArray[np.uint8]]:
    """Return the open leaves that are relevant, and the truth table in terms of these."""
    K = len(state)
    cube = table.table.reshape((2,) * K)  # the last axis is leaf 0
    known = tuple(slice(None) if s == 2 else int(s) for s in state[::-1])
    cube = np.asarray(cube[known])
    leaves = [k for k in reversed(range(K)) if state[k] == 2]
    for k in list(leaves):
        axis = leaves.index(k)
        off, on = np.take(cube, 0, axis), np.take(cube, 1, axis)
        if (off == on).all():
            cube = off
            leaves.remove(k)
    return leaves[::-1], np.ascontiguousarray(cube).reshape(-1)


def _joined(groups: list[OpenBoxes]) -> OpenBoxes:
    def along(name: str, axis: int) -> Array:
        return np.concatenate([getattr(group, name) for group in groups], axis=axis)

    return OpenBoxes(
        along("cell", 0).astype(np.int64),
        along("lower", 1),
        along("size", 1),
        along("leaves", 0).astype(np.int64),
        along("coefficients", 0),
        along("tolerances", 0),
        along("tables", 0).astype(np.uint8),
    )


def lobatto(degree: int) -> Array:
    """Return the Chebyshev-Lobatto points on [0, 1], ascending, shape (degree + 1,)."""
    return (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2


def bernstein(degree: int, t: Array) -> Array:
    r"""Return :math:`\binom{p}{j} t^j (1-t)^{p-j}`, shape (points, degree + 1)."""
    j = np.arange(degree + 1)
    return comb(degree, j) * t[:, None] ** j * (1 - t[:, None]) ** (degree - j)


@lru_cache
def _matrices(degree: int) -> tuple[Array, Array, Array, Array]:
    """Return nodes, matrix from values to coefficients, check points, Bernstein values there."""
    nodes = lobatto(degree)
    to_coefficients: Array = np.asarray(np.linalg.inv(bernstein(degree, nodes)), dtype=float)
    # Between the nodes: around the middle, where the interpolant of a kink is worst, and near the
    # ends.
    checks: Array = np.array([0.03, 0.19, 0.43, 0.61, 0.86, 0.98])
    return nodes, to_coefficients, checks, bernstein(degree, checks)


def interpolate(
    function: Callable[[Array], Array], lower: Array, size: Array, degree: int
) -> tuple[Array, Array]:
    r"""Interpolate by :math:`\sum_{ij} c_{ij} B_i(X) B_j(Y)` at Chebyshev-Lobatto points of boxes.
    Return c, (boxes, degree + 1, degree + 1), which bounds the values, and the largest error at
    36 other points, (boxes,) (Saye, J. Comput. Phys. 448 (2022), 110720, section 2)."""
    nodes, to_coefficients, checks, at_checks = _matrices(degree)
    m, k = degree + 1, len(checks)
    ticks = np.concatenate([nodes, checks])
    X, Y = np.meshgrid(nodes, nodes, indexing="ij")
    Xc, Yc = np.meshgrid(checks, checks, indexing="ij")
    unit = np.array([np.append(X, Xc), np.append(Y, Yc)])
    assert ticks.size == m + k
    values = function(lower[:, :, None] + size[:, :, None] * unit[:, None])
    data, seen = values[:, : m * m].reshape(-1, m, m), values[:, m * m :].reshape(-1, k, k)
    coefficients = to_coefficients @ data @ to_coefficients.T
    # The corners are nodes: keep their values to the last bit, so that neighbours agree.
    for i in (0, -1):
        for j in (0, -1):
            coefficients[:, i, j] = data[:, i, j]
    difference = at_checks @ coefficients @ at_checks.T - seen
    return coefficients, np.abs(difference).max(axis=(1, 2), initial=0.0)
