r"""Sources and decay by symmetric splitting: half before the transport of a step, half after it.

A step from t to t + dt is S D T D S: source and decay over the first half, transport, decay and
source over the second (Strang, SIAM J. Numer. Anal. 5, 1968, 506-517). D is exact at each place, S
adds the integral of the source over its half of the step by Gauss's rule of two points. So the
error in time is of order dt^2, and what a source adds is integrated to degree three in time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import COORDINATES, Expression, ordered
from cip.formulas.formula import Formula
from cip.formulas.parameters import parameter
from cip.formulas.source import Source
from cip.formulas.straight_line_code import numpy_function
from cip.grid import Grid, node_name
from cip.profiles.catalogue import Moment, moments
from cip.sources.products import Orders, Products
from cip.stages.state import averaged


class Reaction:
    """What sources and decay do to the moments of a state, each by itself; with derivatives."""

    def __init__(
        self, grid: Grid, profile: str, source: Source | None, decay: Source | None, xp: Any
    ) -> None:
        self.source, self.decay = source, decay
        self._grid, self._xp, self._moments = grid, xp, moments(profile, grid.dim)
        self.source_parameters = tuple(source.parameters) if source is not None else ()
        self.decay_parameters = tuple(decay.parameters) if decay is not None else ()
        self._node: Expression | None = None
        if source is not None:
            self.source_formula = source.on(grid)
            self._node = self.source_formula.expression
            self._sources = NodalMoments(grid, self.source_formula, source.steady, xp)
        self._decay: Decay | None = None
        if decay is not None:
            self.decay_formula = decay.on(grid)
            rate = self.decay_formula.expression
            if rate.op == "constant" and not rate.value >= 0.0:
                raise InputError(
                    f"decay: expected a rate >= 0, got {rate.value:.6g}; what grows belongs into "
                    "source"
                )
            self._decay = Decay(grid, profile, self.decay_formula, decay.steady, xp)
        self._kept: dict[Any, Any] = {}

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters; one name in source and decay is one parameter."""
        return tuple(dict.fromkeys([*self.source_parameters, *self.decay_parameters]))

    def check_times(self, start: float, end: float) -> None:
        """Raise `InputError` if snapshots do not cover the time from `start` to `end`."""
        for one in (self.source, self.decay):
            if one is not None:
                one.check_times(start, end)

    def added(self, data: Any, t: float, length: float) -> Any:
        """The moments after the source has been added from t to t + length."""
        if self._node is None:
            return data
        return data + self._increment(self._node, t, length).astype(data.dtype)

    def added_slope(self, name: str, t: float, length: float) -> Any:
        """The derivative of what the source adds in a parameter, for all moments."""
        assert self._node is not None
        return self._increment(self._node.derivative(parameter(name).value), t, length)

    def decayed(self, data: Any, t: float, length: float, transpose: bool = False) -> Any:
        """The moments after their decay from t to t + length, or the transpose of that map."""
        if self._decay is None:
            return data
        decay = self._decay.transposed if transpose else self._decay.applied
        return decay(data, t, length)

    def decay_slope(self, data: Any, name: str, t: float, length: float) -> Any:
        """The derivative of `decayed` in a parameter, from the decayed moments."""
        assert self._decay is not None
        return self._decay.slope(data, t, length, name)

    def _increment(self, node: Expression, t: float, length: float) -> Any:
        """What a source adds to all moments from t to t + length, in double precision."""
        key, known = (node, length), self._kept
        if self._sources.steady and key in known:
            return known[key]
        found = self._xp.stack(
            [self._sources.integral(node, moment, t, length) for moment in self._moments]
        )
        if self._sources.steady:
            self._check_finite(found)
            # A new dict: other threads may be reading the old one.
            last = list(known)[-2 - len(self.source_parameters) :]
            self._kept = {**{one: known[one] for one in last}, key: found}
        return found

    def _check_finite(self, found: Any) -> None:
        with np.errstate(all="ignore"):
            total = float(found.sum())
        if not np.isfinite(total):
            raise InputError(
                "source: it, or a derivative that the profile needs, is NaN or infinite at a node"
            )


def reaction(grid: Grid, profile: str, source: Any, decay: Any, xp: Any) -> Reaction | None:
    """The reaction of a solver, from its arguments `source` and `decay`; None without them. Raises
    `InputError` for a function that does not fit the grid, or a negative rate.
    """
    if source is None and decay is None:
        return None
    return Reaction(grid, profile, source, decay, xp)


class Decay:
    r"""Exact decay u' = -k u of all moments, its transpose and its derivatives in parameters: u
    times :math:`E = e^{-K}`, :math:`K = \int k \, dt`, with :math:`E_x = -K_x E`, :math:`E_{xy} =
    (K_x K_y - K_{xy}) E`, :math:`E_p = -K_p E`."""

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
        """The derivative of the moments after a time, `data`, in the parameter `name`."""
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
        """The result of `make`, kept for the last length of a step if k does not depend on t."""
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


# The abscissae of Gauss's rule of two points, as fractions of an interval: exact to degree 3.
GAUSS_TIMES = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)


class NodalMoments:
    """Moments of expressions in the functions and numbers of a formula, integrated over a time.
    Formulas are computed in NumPy or CuPy (`xp`), callables and splines in NumPy. `steady`: t does
    not occur."""

    def __init__(self, grid: Grid, formula: Formula, steady: bool, xp: Any) -> None:
        self._grid, self._formula, self._xp = grid, formula, xp
        self.steady = steady or (formula.exact and formula.steady)
        self._steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
        self._made: dict[Any, Callable[..., Any]] = {}

    def integral(
        self, node: Expression, moment: Moment, t: float, length: float, midpoints: bool = False
    ) -> Any:
        """The integral of a moment from t to t + length, shape ``grid.nodes``. With `midpoints` it
        has the value at the midpoint of a cell in place of its mean.
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
