"""Normal displacements of a surface grid under normal forces, also on coarser grids."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.transforms import filtered
from skfem_adini.ground.arrays import namespace


@dataclass(frozen=True)
class NormalFilter:
    """The normal entry of a symbol and of its inverse, as products of transforms."""

    compliance: RealSymbol
    stiffness: RealSymbol
    cells: tuple[int, ...]
    lateral: LateralWaves | None = None  # transforms if a direction is not periodic

    def apply_normal(self, forces: Any) -> Any:
        """Normal displacements, shape (nx[, ny]), under normal forces only."""
        if self.lateral is None:
            return filtered(self.compliance, forces[None])[0]
        doubled = self.lateral.doubled(forces)[None]
        return self.lateral.filtered(self.compliance, doubled, forces.ndim)[0]

    def precondition_normal(self, displacements: Any) -> Any:
        """Normal forces, shape (nx[, ny]), that alone cause given normal displacements."""
        if self.lateral is None:
            return filtered(self.stiffness, displacements[None])[0]
        caused = self.lateral.filtered(self.stiffness, displacements[None], displacements.ndim)
        return self.lateral.halved(caused[0])

    @cached_property
    def coarser(self) -> NormalFilter | None:
        """The same body on every other point; None for few points, or an odd number of cells."""
        if min(self.cells) < 64 or any(n % 2 for n in self.cells):
            return None
        cells = tuple(n // 2 for n in self.cells)
        lateral = self.lateral
        if lateral is not None:
            lateral = LateralWaves(cells, lateral.odd, namespace(self.compliance.entries))
        compliance, stiffness = (self._resolved(s) for s in (self.compliance, self.stiffness))
        # A coarse point carries the forces of the points that it replaces.
        share = 2.0 ** -len(cells)
        return NormalFilter(
            RealSymbol(share * compliance, (0,)),
            RealSymbol(stiffness / share, (0,)),
            cells,
            lateral,
        )

    def _resolved(self, symbol: RealSymbol) -> Any:
        """Entries of the waves that every other point resolves."""
        xp, entries = namespace(symbol.entries), symbol.entries
        mirrored = (False,) * len(self.cells) if self.lateral is None else self.lateral.mirrored
        halved = [axis for axis, twice in enumerate(mirrored) if not twice][-1:]
        for axis, n in enumerate(self.cells):
            waves = xp.moveaxis(entries, axis + 1, 0)
            if mirrored[axis]:
                waves = waves[: n // 2 + 1]
            elif axis in halved:
                waves = waves[: n // 4 + 1]
            else:
                waves = xp.concatenate((waves[: n // 4], waves[-(n // 2 - n // 4) :]))
            entries = xp.moveaxis(waves, 0, axis + 1)
        return xp.ascontiguousarray(entries)

    def refined(self, forces: Any) -> Any:
        """Forces on the points of this grid from those on `coarser`, by linear interpolation."""
        xp, coarse = namespace(forces), self.coarser
        if coarse is not None and coarse.lateral is not None:
            forces = coarse.lateral.doubled(forces)
        for axis, n in enumerate(self.cells):
            values = xp.moveaxis(forces, axis, 0)
            mirrored = values.shape[0] == n // 2 + 1
            fine = xp.empty((n + mirrored, *values.shape[1:]))
            fine[::2] = 0.5 * values
            after = values[1:] if mirrored else xp.roll(values, -1, 0)
            fine[1::2] = 0.25 * (values[: n // 2] + after)
            forces = xp.moveaxis(fine, 0, axis)
        forces = xp.ascontiguousarray(forces)
        return forces if self.lateral is None else self.lateral.halved(forces)
