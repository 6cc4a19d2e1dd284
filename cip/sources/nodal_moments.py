"""Moments of functions of space and time on a grid, in NumPy or on a device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cip.formulas.expression import COORDINATES, Expression, ordered
from cip.formulas.formula import Formula
from cip.formulas.straight_line_code import numpy_function
from cip.grid import Grid
from cip.profiles.catalogue import Moment
from cip.stages.state import averaged

# The abscissae of Gauss's rule of two points, as fractions of an interval: exact to degree 3.
GAUSS_TIMES = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)


class NodalMoments:
    """Moments of expressions in a formula, integrated over a time.

    Parameters
    ----------
    grid : Grid
    formula : Formula
        Whose functions and numbers the expressions hold.
    steady : bool
        Whether t does not occur.
    xp : module
        NumPy or CuPy. Formulas are computed there, callables and splines in NumPy.
    """

    def __init__(self, grid: Grid, formula: Formula, steady: bool, xp: Any) -> None:
        self._grid, self._formula, self._xp = grid, formula, xp
        self.steady = steady or (formula.exact and formula.steady)
        self._steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
        self._made: dict[Any, Callable[..., Any]] = {}

    def integral(
        self, node: Expression, moment: Moment, t: float, length: float, midpoints: bool = False
    ) -> Any:
        """The integral of a moment from t to t + length, shape ``grid.nodes``.

        With `midpoints` it has the value at the midpoint of a cell in place of its mean.
        """
        key = node, moment.orders
        if key not in self._made:  # code is made once, not in every step
            self._made[key] = self._evaluator(_derivative(node, moment))
        values = self._made[key]
        more = {"xp": self._xp, **({"points": 1} if midpoints else {})}
        if self.steady:
            return length * averaged(values, self._grid, moment, t, **more)
        first, second = (
            averaged(values, self._grid, moment, t + part * length, **more) for part in GAUSS_TIMES
        )
        return 0.5 * length * (first + second)

    def _evaluator(self, node: Expression) -> Callable[..., Any]:
        functions = self._formula.functions([node], self._steps)
        compute, xp = numpy_function([node], COORDINATES, functions), self._xp
        if xp is np or not any(inner.op == "opaque" for inner in ordered([node])):

            def evaluate(*point: Any) -> Any:
                with np.errstate(all="ignore"):  # what is not finite is reported by the caller
                    return compute(*point)[0]

            return evaluate

        def values(*point: Any) -> Any:
            host = [x if isinstance(x, float | np.ndarray) else x.get() for x in point]
            with np.errstate(all="ignore"):
                return xp.asarray(np.asarray(compute(*host)[0], dtype=float))

        return values


def _derivative(node: Expression, moment: Moment) -> Expression:
    for name, order in zip(COORDINATES, moment.orders, strict=True):
        for _ in range(order):
            node = node.derivative(name)
    return node
