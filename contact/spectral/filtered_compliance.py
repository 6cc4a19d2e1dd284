"""Compliance of a surface grid that is diagonal in Fourier space: products by transforms."""

from __future__ import annotations

from typing import Any

from contact.errors import InputError
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.normal_filter import NormalFilter
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.transforms import filtered
from skfem_adini.ground.arrays import namespace


class FilteredCompliance:
    """Displacements under forces on a grid, by a symbol for each wave of a real transform;
    `normal_filter` has only the normal component, also on coarser grids."""

    normal_filter: NormalFilter
    shape: tuple[int, ...]
    _compliance: RealSymbol
    _stiffness: RealSymbol
    _lateral: LateralWaves | None = None

    def _take_symbols(
        self,
        compliance: RealSymbol,
        stiffness: RealSymbol,
        normal: int,
        lateral: LateralWaves | None = None,
    ) -> None:
        """Keep the symbols of all components, and those of the component `normal` alone."""
        own = compliance[normal, normal]
        # A free mean is treated as the softest wave.
        held = namespace(own).where(own > 0, own, own.max())
        self._compliance, self._stiffness, self._lateral = compliance, stiffness, lateral
        self.normal_filter = NormalFilter(
            RealSymbol(own[None], (0,)), RealSymbol(1.0 / held[None], (0,)),
            self.shape if lateral is None else lateral.cells, lateral,
        )  # fmt: skip

    def apply(self, forces: Any) -> Any:
        """Displacements of the points under forces on them.

        Parameters
        ----------
        forces : array, shape (dim, nx[, ny])
            The mean is ignored in components with a free mean.

        Returns
        -------
        array, shape (dim, nx[, ny])

        Raises
        ------
        InputError
            Not real numbers, or of another shape.
        """
        expected = (len(self.shape) + 1, *self.shape)
        real = getattr(getattr(forces, "dtype", None), "kind", "") in ("i", "u", "f")
        if not real or forces.shape != expected:
            raise InputError(f"forces: expected an array of real numbers of shape {expected}")
        if self._lateral is None:
            return filtered(self._compliance, forces)
        return self._lateral.filtered(self._compliance, self._lateral.doubled(forces))

    def precondition(self, displacements: Any) -> Any:
        """Forces that cause given displacements, both (dim, nx[, ny]); approximate for free
        means."""
        if self._lateral is None:
            return filtered(self._stiffness, displacements)
        return self._lateral.halved(self._lateral.filtered(self._stiffness, displacements))

    def apply_normal(self, forces: Any) -> Any:
        """Normal displacements under normal forces only, both (nx[, ny])."""
        return self.normal_filter.apply_normal(forces)

    def precondition_normal(self, displacements: Any) -> Any:
        """Normal forces that, acting alone, cause given normal displacements, both (nx[, ny])."""
        return self.normal_filter.precondition_normal(displacements)
