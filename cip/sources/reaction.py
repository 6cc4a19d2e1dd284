r"""Sources and decay by symmetric splitting: half before the transport of a step, half after it.

A step from t to t + dt is S D T D S: source and decay over the first half, transport, decay and
source over the second (Strang, SIAM J. Numer. Anal. 5, 1968, 506-517). D is exact at each point, S
adds the integral of the source over its half of the step by Gauss's rule of two points. So the
error in time is of order dt^2, and what a source adds is integrated to degree three in time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import comb
from typing import Any

import numpy as np

from cip.characteristics.flow_derivatives import Jet, exponential
from cip.errors import InputError, NotSupported
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    apply,
    derived,
    numpy_function,
    ordered,
    variable,
)
from cip.formulas.formula import Formula, functions_of
from cip.formulas.parameters import parameter
from cip.formulas.source import Source
from cip.formulas.sphere_spline import cell_means, centre_values
from cip.grid import GridLike, node_name, wall_name
from cip.profiles.catalogue import CONSERVATIVE, SPHERE, Moment, carries_slopes, moments
from cip.stages.state import averaged
from cip.stages.walls import MIDDLE, Wall


class Reaction:
    """The separate effects of source and decay on the moments of a state, with derivatives. Raises
    `InputError` for a function that does not fit the grid, or a negative rate."""

    def __init__(
        self,
        grid: GridLike,
        profile: str,
        source: Source | None,
        decay: Source | None,
        xp: Any,
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

    def integral(self, data: Any) -> float:
        """The integral of a field, from its means."""
        means = data[-1][tuple(slice(0, n) for n in self._grid.cells)]
        return float((means * self._xp.asarray(self._grid.volumes)).sum())

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


class Decay:
    r"""Exact decay u' = -k u of all moments, its transpose and its derivatives in parameters: u
    times :math:`E = e^{-K}`, :math:`K = \int k \, dt`, with :math:`E_x = -K_x E`, :math:`E_{xy} =
    (K_x K_y - K_{xy}) E`, :math:`E_p = -K_p E`."""

    def __init__(
        self, grid: GridLike, profile: str, formula: Formula, steady: bool, xp: Any
    ) -> None:
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
        """E in the form that its products need; a number if the rate is one."""
        if self._uniform:
            return float(np.exp(-self._rate.value * length))
        return self._once((length, None), lambda: self._exponentials(t, length))

    def _slopes(self, t: float, length: float, name: str) -> Any:
        """K_p in the form that its products need."""
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
        def exponent(jet: Jet) -> Any:
            return -self._integral(self._rate, Moment("", jet.orders), t, length)

        found: dict[Orders, Any] = {}
        for key, moment in self._products.wanted.items():  # values come first
            if any(moment.orders):
                found[key] = exponential(Jet(3, moment.orders), exponent, found[min(found)])
            else:
                found[key] = self._exponential(moment, t, length)
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


class NodalMoments:
    """Moments of expressions in the functions and numbers of a formula, integrated over a time.
    Formulas are computed in NumPy or CuPy (`xp`), callables and splines in NumPy. `steady`: t does
    not occur."""

    def __init__(self, grid: GridLike, formula: Formula, steady: bool, xp: Any) -> None:
        self._grid, self._formula, self._xp = grid, formula, xp
        self.steady = steady or (formula.exact and formula.steady)
        self._steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
        self._made: dict[Any, Callable[..., Any]] = {}

    def integral(
        self, node: Expression, moment: Moment, t: float, length: float, midpoints: bool = False
    ) -> Any:
        """The integral of a moment from t to t + length, shape ``grid.nodes``. With `midpoints` it
        has the value at the midpoint of a cell in place of its mean."""
        key = node, moment.orders
        if key not in self._made:  # code is made once, not in every step
            self._made[key] = self._evaluator(derived(node, moment.orders))
        values = self._made[key]
        more = {"xp": self._xp, **({"points": 1} if midpoints else {})}
        if self.steady:
            return length * averaged(values, self._grid, moment, t, **more)
        # Gauss's rule of two points: exact to degree 3.
        first, second = (
            averaged(values, self._grid, moment, t + part * length, **more)
            for part in (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)
        )
        return 0.5 * length * (first + second)

    def _evaluator(self, node: Expression) -> Callable[..., Any]:
        functions = self._formula.functions([node], self._steps)
        compute, xp = numpy_function([node], COORDINATES, functions), self._xp
        if xp is np or not any(inner.op == "opaque" for inner in ordered([node])):

            def evaluate(*point: Any) -> Any:
                with np.errstate(all="ignore"):  # the caller reports values that are not finite
                    return compute(*point)[0]

            return evaluate

        def values(*point: Any) -> Any:
            host = [x if isinstance(x, float | np.ndarray) else x.get() for x in point]
            with np.errstate(all="ignore"):
                return xp.asarray(np.asarray(compute(*host)[0], dtype=float))

        return values


class ReactedData(Formula):
    r"""The data g of a wall as the transport takes it in between the halves of the splitting. What
    enters at t* undergoes source and decay from then on, but the splitting applies them only after
    the middle t_m of the step; so the data are advanced by :math:`t_m - t^*`, to
    :math:`g e^{-k (t_m - t^*)} + (t_m - t^*) s`: second order up to the walls."""

    def __init__(self, data: Formula, reaction: Reaction) -> None:
        node, left = data.expression, variable(MIDDLE) - variable("t")
        self._parts = [data]
        if reaction.decay is not None:
            self._parts.append(reaction.decay_formula)
            node = node * apply("exp", -(reaction.decay_formula.expression * left))
        if reaction.source is not None:
            self._parts.append(reaction.source_formula)
            node = node + left * reaction.source_formula.expression
        super().__init__(node, data.dim)

    def functions(self, nodes: Sequence[Expression], steps: Sequence[float]) -> dict[str, Any]:
        """The callables and numbers in `nodes` of data, source and decay, by names in code."""
        return functions_of(self._parts, nodes, steps)


def reacted(
    data: dict[Wall, Formula], reaction: Reaction | None, fixed: bool
) -> dict[Wall, Formula]:
    """The data of all walls in the form that the transport of a step needs. `fixed` ones, of
    `check_split`, are unchanged; raises `NotSupported` if decay would change them."""
    if reaction is None:
        return data
    for (axis, side), formula in data.items() if fixed else ():
        node = formula.expression
        if reaction.decay is not None and not (node.op == "constant" and node.value == 0.0):
            raise NotSupported(
                f"decay: with splitting the data of the wall {wall_name(axis, side)} must be "
                "zero; take 'csl2' or 'csl4', or a direct profile ('adini', 'bicubic')"
            )
    if fixed:
        return data
    return {wall: ReactedData(formula, reaction) for wall, formula in data.items()}


Orders = tuple[int, ...]
Factors = Mapping[Orders, Any]


class Products:
    r"""Moments of a product g u for a known g, shape (moments,) + grid.nodes, with the transpose.
    Derivatives follow by Leibniz's rule, :math:`(g u)_a = \sum_{b \le a} \binom{a}{b} g_{a-b} u_b`;
    means are those of a rule of Simpson's kind with the profile's midpoint value,
    :math:`\bar u = (u_0 + 4 u_{1/2} + u_1) / 6`, or of the rule of degree five with slopes, so that
    (g f) u = g (f u) for means too. `wanted` are the moments of g that they need, by keys: orders
    of derivatives, or for means for each direction whether it is the midpoint; slopes of profiles
    with means have the key (2,)."""

    def __init__(self, grid: GridLike, profile: str, xp: Any) -> None:
        self._grid, self._xp = grid, xp
        self._moments = moments(profile, grid.dim)
        # Of a sphere the degree of the spline of means, whose values at the centres of cells serve.
        self._degree = SPHERE.get(profile, 0) if self._moments[0].averaged else 0
        self.means = profile in CONSERVATIVE or self._degree > 0
        self._slopes = carries_slopes(profile, grid.dim)
        self.wanted: dict[Orders, Moment] = {}
        if not self.means:
            self.wanted = {moment.orders[:3]: moment for moment in self._moments}
            return
        if self._degree:
            self.wanted[(0, 0)] = Moment("", (0, 0, 0, 0))
            return
        for bits in product((0, 1), repeat=grid.dim):
            averaged = tuple(axis for axis, bit in enumerate(bits) if bit)
            self.wanted[bits] = Moment("", (0, 0, 0, 0), averaged)
        if self._slopes:
            self.wanted[(2,)] = Moment("", (1, 0, 0, 0))

    def times(self, data: Any, factors: Factors) -> Any:
        """The moments of g u, of shape (moments,) + grid.nodes, from those of u and those of g."""
        if not self.means:
            return self._leibniz(data, factors)
        points = self.to_points(data)
        if self._slopes:
            points[1] = factors[(0,)] * points[1] + factors[(2,)] * points[0]
            points[0], points[2] = factors[(0,)] * points[0], factors[(1,)] * points[2]
        else:
            self._scale(points, factors)
        return self.to_moments(points).astype(data.dtype)

    def transposed(self, weight: Any, factors: Factors) -> Any:
        """The transpose of `times` for the same factors."""
        if self._slopes:
            return self._with_slopes_transposed(weight, factors)
        if self.means:
            return self._with_means_transposed(weight, factors)
        return self._leibniz(weight, factors, True)

    def _leibniz(self, data: Any, factors: Factors, transpose: bool = False) -> Any:
        place = {orders: q for q, orders in enumerate(self.wanted)}
        new = self._xp.zeros_like(data)
        for above, q in place.items():
            for below in product(*(range(order + 1) for order in above)):
                rest = tuple(a - b for a, b in zip(above, below, strict=True))
                count = np.prod([comb(a, b) for a, b in zip(above, below, strict=True)])
                to, of = (place[below], q) if transpose else (q, place[below])
                new[to] += (float(count) * factors[rest] * data[of]).astype(data.dtype)
        return new

    def to_points(self, data: Any) -> Any:
        """The moments in double precision, means replaced by values in the middle of cells."""
        if self._degree:
            return centre_values(data, self._degree)
        new = data.astype(float)
        if self._slopes:
            new[2] = (30.0 * new[2] - self._ends(new[0], new[1])) / 16.0
        elif self.means:
            for axis, value, mean in self._pairs():
                new[mean] = 1.5 * new[mean] - 0.25 * self._sum_of_ends(new[value], axis)
        return new

    def to_moments(self, points: Any) -> Any:
        """The inverse of `to_points`."""
        if self._degree:
            return cell_means(points, self._degree)
        new = points.copy()
        if self._slopes:
            new[2] = (16.0 * new[2] + self._ends(new[0], new[1])) / 30.0
        elif self.means:
            for axis, value, mean in self._pairs():
                new[mean] = (4.0 * new[mean] + self._sum_of_ends(new[value], axis)) / 6.0
        return new

    def _with_means_transposed(self, weight: Any, factors: Factors) -> Any:
        new = weight.astype(float)
        for axis, value, mean in reversed(self._pairs()):
            new[value] += self._of_cells(new[mean], axis) / 6.0
            new[mean] *= 4.0 / 6.0
        self._scale(new, factors)
        for axis, value, mean in reversed(self._pairs()):
            new[value] -= 0.25 * self._of_cells(new[mean], axis)
            new[mean] *= 1.5
        return new

    def _pairs(self) -> list[tuple[int, int, int]]:
        """For each direction the numbers of the moments of values and of means along it."""
        every = range(2**self._grid.dim)
        return [
            (axis, bits, bits | 1 << axis)
            for axis in range(self._grid.dim)
            for bits in every
            if not bits >> axis & 1
        ]

    def _scale(self, new: Any, factors: Factors) -> None:
        for bits in range(len(new)):
            new[bits] *= factors[tuple(bits >> axis & 1 for axis in range(self._grid.dim))]

    def _with_slopes_transposed(self, weight: Any, factors: Factors) -> Any:
        u, slope, mean = weight.astype(float)
        for_u, for_slope = self._ends_transposed(mean / 30.0)
        u, slope = u + for_u, slope + for_slope
        u, slope = factors[(0,)] * u + factors[(2,)] * slope, factors[(0,)] * slope
        middle = 16.0 / 30.0 * factors[(1,)] * mean
        for_u, for_slope = self._ends_transposed(middle / 16.0)
        return self._xp.stack([u - for_u, slope - for_slope, 30.0 / 16.0 * middle])

    def _ends(self, u: Any, slope: Any) -> Any:
        """Contribution of both ends of each cell to 30 times the mean in the rule with slopes."""
        jump = self._sum_of_ends(slope, 0) - 2.0 * self._in_cells(slope)  # of the slope over it
        return 7.0 * self._sum_of_ends(u, 0) - self._half * jump

    def _ends_transposed(self, weight: Any) -> tuple[Any, Any]:
        jump = self._half * weight
        return 7.0 * self._of_cells(weight, 0), 2.0 * self._in_cells(jump) - self._of_cells(jump, 0)

    @property
    def _half(self) -> Any:
        (widths,), (nodes,) = self._grid.widths, self._grid.nodes
        return 0.5 * self._xp.asarray(np.append(widths, widths[-1])[:nodes])

    def _in_cells(self, values: Any, axis: int = 0) -> Any:
        """The values, set to 0 at nodes where no cell begins."""
        found = values.copy()
        if not self._grid.periodic[axis]:
            self._xp.moveaxis(found, axis, 0)[-1] = 0.0
        return found

    def _sum_of_ends(self, values: Any, axis: int) -> Any:
        """Sum of the values at both ends of each cell; 0 where no cell begins."""
        return self._in_cells(values + self._xp.roll(values, -1, axis), axis)

    def _of_cells(self, weight: Any, axis: int) -> Any:
        """The transpose of `_sum_of_ends`."""
        inside = self._in_cells(weight, axis)
        return inside + self._xp.roll(inside, 1, axis)


@dataclass(frozen=True)
class HalfStep:
    """A half of a reaction's step, with decay D and what the source adds, S: before the transport
    z -> D (z + S), after it z -> D z + S. In parameters S has the derivative S_p, D z has -K_p D z.
    """

    reaction: Any  # a Reaction, or what is called like one
    t: float  # time at which it begins
    length: float  # duration
    after: bool  # whether it follows the transport
    sea: Any = None  # mask of the moments that are not on land; None: of all

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the parameters of the source and of the decay."""
        return self.reaction.parameters

    @property
    def reads_state(self) -> bool:
        """Whether derivatives in the parameters depend on the moments."""
        return bool(self.reaction.decay_parameters)

    def applied(self, data: Any, tally: Any = None) -> Any:
        """The moments after this half; `tally` counts what it adds and what decays."""
        end = self._decayed(data)
        if self.after:
            end = self._masked(self.reaction.added(end, self.t, self.length))
        if tally is not None and isinstance(self.reaction, Reaction):
            added = self._masked(self.reaction.added(0.0 * data, self.t, self.length))
            total = self.reaction.integral(added)
            tally.react(total, total - self.reaction.integral(end - data))
        return end

    def linear(self, change: Any) -> Any:
        """The change of the moments after it for one before it."""
        return self._masked(self.reaction.decayed(change, self.t, self.length))

    def along(self, data: Any, direction: Any) -> Any:
        """The change of the moments after it for a change of the parameters, in the order of
        `columns`. `data` are the moments before it."""
        reaction, added, total = self.reaction, 0.0, 0.0
        end = self._decayed(data) if self.reads_state else None
        for name, size in zip(self.columns, map(float, direction), strict=True):
            if size and name in reaction.source_parameters:
                added = added + size * reaction.added_slope(name, self.t, self.length)
            if size and name in reaction.decay_parameters:
                total = total + size * reaction.decay_slope(end, name, self.t, self.length)
        if self.after or isinstance(added, float):
            return self._masked(total + added)
        return self._masked(total) + self.linear(added)

    def pull_back(self, data: Any, weight: Any) -> tuple[Any, list[float]]:
        """The weight of the moments before it, `data`, and the derivatives of weight . (moments
        after it) in the parameters."""
        reaction, found, weight = self.reaction, [], self._masked(weight)
        end = self._decayed(data) if self.reads_state else None
        before = reaction.decayed(weight, self.t, self.length, transpose=True)
        entering = weight if self.after else before
        for name in self.columns:
            total = 0.0
            if name in reaction.source_parameters:
                slope = reaction.added_slope(name, self.t, self.length)
                total += float((entering * slope).sum())
            if name in reaction.decay_parameters:
                slope = reaction.decay_slope(end, name, self.t, self.length)
                total += float((weight * slope).sum())
            found.append(total)
        return before, found

    def _decayed(self, data: Any) -> Any:
        """The moments after the decay; before the transport the source acts first."""
        if not self.after:
            data = self.reaction.added(data, self.t, self.length)
        return self.linear(data)

    def _masked(self, data: Any) -> Any:
        return data if self.sea is None else data * self.sea


def halves(
    reactions: Sequence[Any], t: float, dt: float, sea: Any = None
) -> tuple[list[HalfStep], list[HalfStep]]:
    """The half steps before and after the transport of the step [t, t + dt], in mirror order."""
    half = 0.5 * dt
    before = [HalfStep(one, t, half, False, sea) for one in reactions]
    return before, [HalfStep(one, t + half, half, True, sea) for one in reversed(reactions)]
