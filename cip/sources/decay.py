r"""Exact decay of moments over a time: u' = -k u at each place, so u is multiplied by E.

With :math:`K = \int k \, dt`, :math:`E = e^{-K}` has the derivatives
:math:`E_x = -K_x E` and :math:`E_{xy} = (K_x K_y - K_{xy}) E`, and with respect to a parameter
:math:`E_p = -K_p E`: that of the decayed field is its product with :math:`-K_p`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import Expression
from cip.formulas.formula import Formula
from cip.formulas.parameters import parameter
from cip.grid import Grid, node_name
from cip.profiles.catalogue import Moment
from cip.sources.nodal_moments import NodalMoments
from cip.sources.products import Orders, Products


class Decay:
    """Decay of all moments of a profile, its transpose, and its derivatives in parameters.

    Parameters
    ----------
    grid : Grid
    profile : str
    formula : Formula
        The rate k, in 1 / time.
    steady : bool
    xp : module
        NumPy or CuPy.
    """

    def __init__(self, grid: Grid, profile: str, formula: Formula, steady: bool, xp: Any) -> None:
        self._grid, self._xp = grid, xp
        self._rate = formula.expression
        self._integrals = NodalMoments(grid, formula, steady, xp)
        self._products = Products(grid, profile, xp)
        self._uniform = self._rate.op == "constant"
        self._kept: dict[Any, Any] = {}

    def applied(self, data: Any, t: float, length: float) -> Any:
        """The moments after a time, shape as `data`."""
        factors = self._factors(t, length)
        return data * factors if self._uniform else self._products.times(data, factors)

    def transposed(self, weight: Any, t: float, length: float) -> Any:
        """The transpose of `applied`."""
        factors = self._factors(t, length)
        return weight * factors if self._uniform else self._products.transposed(weight, factors)

    def slope(self, data: Any, t: float, length: float, name: str) -> Any:
        """The derivative of the moments after a time in a parameter.

        Parameters
        ----------
        data : array
            The moments after that time.
        t, length : float
        name : str
            Of the parameter.
        """
        return -self._products.times(data, self._slopes(t, length, name))

    def _factors(self, t: float, length: float) -> Any:
        """E as its products need it; a number where the rate is one."""
        if self._uniform:
            return float(np.exp(-self._rate.value * length))
        return self._once((length, None), lambda: self._exponentials(t, length))

    def _slopes(self, t: float, length: float, name: str) -> Any:
        """K_p as its products need it."""
        node = self._rate.derivative(parameter(name).value)
        return self._once(
            (length, name),
            lambda: {
                key: self._integral(node, moment, t, length)
                for key, moment in self._products.wanted.items()
            },
        )

    def _once(self, key: tuple[float, str | None], make: Any) -> Any:
        """What `make` finds; kept for the last length of a step where k does not depend on t."""
        if not self._integrals.steady:
            return make()
        known = self._kept
        if key not in known:
            # A new dict: other threads may be reading the old one.
            same = {one: value for one, value in known.items() if one[0] == key[0]}
            known = self._kept = {**same, key: make()}
        return known[key]

    def _integral(self, node: Expression, moment: Moment, t: float, length: float) -> Any:
        return self._integrals.integral(node, moment, t, length, midpoints=True)

    def _exponentials(self, t: float, length: float) -> dict[Orders, Any]:
        found: dict[Orders, Any] = {}
        for key, moment in self._products.wanted.items():  # values come first
            axes = [axis for axis in range(3) for _ in range(moment.orders[axis])]
            if not axes:
                found[key] = self._exponential(moment, t, length)
                continue
            slopes = []
            for axis in axes:
                i, j, k = (int(axis == q) for q in range(3))
                slopes.append(self._integral(self._rate, Moment("", (i, j, k, 0)), t, length))
            if len(axes) == 1:
                factor = -slopes[0]
            else:
                factor = slopes[0] * slopes[1] - self._integral(self._rate, moment, t, length)
            found[key] = factor * next(iter(found.values()))
        return found

    def _exponential(self, moment: Moment, t: float, length: float) -> Any:
        """E at the nodes; raises unless k >= 0 there."""
        exponent = self._integral(self._rate, moment, t, length)
        if not bool((exponent >= 0.0).all()):  # also where it is NaN
            bad = exponent if isinstance(exponent, np.ndarray) else exponent.get()
            node = int(np.flatnonzero(~(bad.ravel() >= 0.0))[0])
            raise InputError(
                f"decay: expected a rate >= 0, got {bad.ravel()[node] / length:.6g} at "
                f"{node_name(self._grid, node)}, t = {t:.6g}; what grows belongs into source"
            )
        return self._xp.exp(-exponent)
