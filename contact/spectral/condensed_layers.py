"""The layers above a surface grid: symbols of their lower side, and displacements inside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.slab_symbols import Stack, real_slab
from contact.spectral.wave_cells import Column, cell_table, functions, parities
from contact.spectral.wave_condensation import condensed, phases_of
from skfem_adini.ground.arrays import namespace

Array = NDArray[np.float64]


class CondensedLayers:
    """Layers of equal cells, from the bottom up, with their top fixed or bonded to a half space."""

    def __init__(
        self,
        bodies: Sequence[ElasticBody],
        counts: Sequence[int],
        kinds: NDArray[np.int64],  # by `contact.body.rigid_modes.dof_kinds`
        lengths: Array,  # factors that scale unknowns to displacements
        held: NDArray[np.bool_],  # components that are fixed on the top
        waves: LateralWaves,
        base: RealSymbol | None = None,
        changes: Sequence[bool] = (),  # layers with separate derivatives at their lower side
    ) -> None:
        dim, parity = held.size, parities(kinds, held.size)
        self.kinds, self.lengths, self.held = kinds, lengths, held
        self._waves, self._base = waves, None if base is None else base.entries
        powers = waves.turns + parity
        self.turns = tuple(((powers - powers[0]) % 4).tolist())
        tables = np.array([cell_table(body, lengths, parity) for body in bodies])
        across = (kinds == dim - 1) | ((kinds == -2) & (dim == 2))
        kinks = tuple(np.flatnonzero(across & change) for change in changes)
        kinks = kinks if any(kink.size for kink in kinks) else ()
        self._column, self._first = (
            Column(tables, tuple(counts), free, dim, kinks) for free in (self.loose, self._of_mean)
        )
        self._kept: Stack | None = None

    @property
    def own(self) -> list[int]:
        """Unknowns of a node that the upper layer does not share, over all interfaces."""
        return [int(k) for kink in self._column.kinks for k in kink]

    @property
    def loose(self) -> NDArray[np.intp]:
        """Free node unknowns of the top; a fixed value fixes its lateral derivatives."""
        dim = self.held.size
        component = np.arange(self.kinds.size) % dim
        along = (self.kinds >= -1) & (self.kinds < dim - 1)
        return np.flatnonzero(~(self.held[component] & along))

    @property
    def _of_mean(self) -> NDArray[np.intp]:
        """Top unknowns that are eliminated in the wave 0, where free values are undetermined: the
        body moves as with a fixed top, plus a translation.
        """
        return self.loose[self.kinds[self.loose] != -1]

    def symbols(self) -> tuple[RealSymbol, RealSymbol]:
        """Compliance and stiffness of the lower side; the compliance excludes means measured from
        the top, where these are free or the top is on a half space.
        """
        steps, d = self._waves.steps, self.held.size
        stiffness, compliance = condensed(self._column, steps, self._flat_base())
        mean = condensed(self._first, [np.zeros(1)] * (d - 1))
        for symbol, first in zip((stiffness, compliance), mean, strict=True):
            symbol[:, 0] = namespace(symbol).asarray(first[:, 0])
        low, high = np.triu_indices(d)
        for e in np.flatnonzero((low == high) & ~self.held[low]):
            compliance[e, 0] = 0.0
        shape, turns = self._waves.shape, self.turns[:d]
        return (
            RealSymbol(compliance.reshape(-1, *shape), turns),
            RealSymbol(stiffness.reshape(-1, *shape), turns),
        )

    def plane(self, load: Any, row: int, above: bool = False) -> Any:
        """Waves of the unknowns on a plane, counted from the bottom, of the layer above it or
        below; a free mean is omitted, or measured from that of the lower side.
        """
        xp, d, r = namespace(load), self.held.size, self.kinds.size
        turn = xp.asarray(np.array([1, 1j, -1, -1j])[list(self.turns)])
        turn = turn if load.dtype.kind == "c" else turn.real
        given = xp.moveaxis(load.reshape(d, -1), 0, 1) * xp.conj(turn[:d])
        if self._base is None:
            given[0][xp.asarray(~self.held)] = 0.0
        found = xp.empty((given.shape[0], r), dtype=given.dtype)
        for at, stack in self._stacks():
            lower, upper = self._ends(stack, given[at], at)
            found[at] = stack.at(row, lower, upper, above)
            if self._base is not None and not at.start:
                found[0] -= lower[0]  # all are values: cells on a base are linear
        found *= turn / xp.asarray(self.lengths)
        return xp.moveaxis(found, 1, 0).reshape(r, *load.shape[1:])

    def _ends(self, stack: Stack, load: Any, at: slice) -> tuple[Any, Any]:
        """Unknowns of the lower side and of the top, both of shape (waves, r)."""
        whole, r, xp = stack.whole, self.kinds.size, namespace(load)
        lower, upper = (xp.zeros((load.shape[0], r), dtype=load.dtype) for _ in range(2))
        base, d = self._flat_base(), self.held.size
        for waves, free in self._tops(at):
            n = r + free.size
            matrix = xp.empty((whole.P[waves].shape[0], n, n))
            matrix[:, :r, :r] = whole.P[waves]
            coupling = whole.Q[waves][:, :, xp.asarray(free)]
            matrix[:, :r, r:], matrix[:, r:, :r] = coupling, coupling.transpose(0, 2, 1)
            matrix[:, r:, r:] = whole.R[waves][:, free[:, None], free]
            if base is not None and free.size:
                for e, (i, j) in enumerate(zip(*np.triu_indices(d), strict=True)):
                    part = base[e, at][waves]
                    matrix[:, r + i, r + j] += part
                    if i != j:
                        matrix[:, r + j, r + i] += part
            given = xp.zeros((matrix.shape[0], n, 1), dtype=load.dtype)
            given[:, :d, 0] = load[waves]
            solved = xp.linalg.solve(matrix, given)[..., 0]
            lower[waves] = solved[:, :r]
            upper[waves, xp.asarray(free)] = solved[:, r:]
        return lower, upper

    def _tops(self, at: slice) -> list[tuple[slice, NDArray[np.intp]]]:
        """Blocks of waves with the top unknowns that are free in them."""
        if at.start:
            return [(slice(None), self.loose)]
        return [(slice(0, 1), self._of_mean), (slice(1, None), self.loose)]

    def _stacks(self) -> Iterator[tuple[slice, Stack]]:
        """Slabs inside, for one block of waves at a time; cached if they are few."""
        steps, r = self._waves.steps, self.kinds.size
        waves = int(np.prod(self._waves.shape))
        levels = sum(2 * count.bit_length() for count in self._column.counts)
        # At most 1 GB of slabs is cached, or made for one block of waves.
        size = max(1, int(1e9 / (24 * r * r * levels)))
        if self._kept is not None:
            yield slice(0, waves), self._kept
            return
        for first in range(0, waves, size):
            at = slice(first, min(first + size, waves))
            stack = self._stack(phases_of(steps, at))
            if size >= waves:
                self._kept = stack
            yield at, stack

    def _stack(self, phases: Sequence[Any]) -> Stack:
        values = functions(phases)
        slabs = [real_slab(table, values) for table in self._column.tables]
        return Stack.of(list(zip(slabs, self._column.counts, strict=True)), self._column.kinks)

    def _flat_base(self) -> Any:
        return None if self._base is None else self._base.reshape(self._base.shape[0], -1)
