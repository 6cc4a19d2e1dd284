"""Compliance of a surface grid whose waves do not know each other: products by transforms."""

from __future__ import annotations

from typing import Any

from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.transforms import filtered, namespace


class FilteredCompliance:
    """Displacements under forces on a grid, by a symbol of each wave of a real transform.

    `_lateral` are the waves where a direction is not periodic.
    """

    _compliance: RealSymbol
    _stiffness: RealSymbol
    _normal_compliance: RealSymbol
    _normal_stiffness: RealSymbol
    _lateral: LateralWaves | None = None

    def _take_symbols(self, compliance: RealSymbol, stiffness: RealSymbol, normal: int) -> None:
        """Keep the symbols of all components, and those of the component `normal` alone."""
        own = compliance[normal, normal]
        # A mean that nothing holds is treated as the softest wave.
        held = namespace(own).where(own > 0, own, own.max())
        self._compliance, self._stiffness = compliance, stiffness
        self._normal_compliance = RealSymbol(own[None], (0,))
        self._normal_stiffness = RealSymbol(1.0 / held[None], (0,))

    def apply(self, forces: Any) -> Any:
        """Displacements of the points that forces on them cause.

        Parameters
        ----------
        forces : array, shape (dim, nx[, ny])
            The mean is left out in components that nothing holds.

        Returns
        -------
        array, shape (dim, nx[, ny])
        """
        return self._moved(self._compliance, forces, 0)

    def precondition(self, displacements: Any) -> Any:
        """Forces that cause given displacements, or nearly so in means that nothing holds.

        Parameters
        ----------
        displacements : array, shape (dim, nx[, ny])

        Returns
        -------
        array, shape (dim, nx[, ny])
        """
        return self._loaded(self._stiffness, displacements, 0)

    def apply_normal(self, forces: Any) -> Any:
        """Normal displacements under normal forces alone.

        Parameters
        ----------
        forces : array, shape (nx[, ny])

        Returns
        -------
        array, shape (nx[, ny])
        """
        return self._moved(self._normal_compliance, forces[None], forces.ndim)[0]

    def precondition_normal(self, displacements: Any) -> Any:
        """Normal forces alone that cause given normal displacements.

        Parameters
        ----------
        displacements : array, shape (nx[, ny])

        Returns
        -------
        array, shape (nx[, ny])
        """
        return self._loaded(self._normal_stiffness, displacements[None], displacements.ndim)[0]

    def _moved(self, symbol: RealSymbol, forces: Any, first: int) -> Any:
        """Displacements of the components from `first` on under forces on them."""
        if self._lateral is None:
            return filtered(symbol, forces)
        return self._lateral.filtered(symbol, self._lateral.doubled(forces), first)

    def _loaded(self, symbol: RealSymbol, displacements: Any, first: int) -> Any:
        if self._lateral is None:
            return filtered(symbol, displacements)
        return self._lateral.halved(self._lateral.filtered(symbol, displacements, first))
