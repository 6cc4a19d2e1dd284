r"""Equations of the characteristics and of their derivatives, by total differentiation.

With the backward flow :math:`X' = -c(X, t - \tau)`, :math:`X(0) = x`, every derivative
:math:`\partial_x^i \partial_y^j X` obeys the equation that the total derivative of :math:`-c(X)`
gives, for instance :math:`J' = -c'(X) J` and :math:`K' = -c'(X) K - c''(X) J^2` for
:math:`J = X_x`, :math:`K = X_{xx}`. Nothing is divided by c, so zeros of c need no special case.
For direct transport in two dimensions X, Y and their Jacobian have the 6 equations (3.10) of King's
dissertation (2012); with the logarithm of its determinant and the gradient of this they are the 9
equations (3.18).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cip.formulas.expression import (
    COORDINATES,
    Expression,
    Orders,
    apply,
    constant,
    numpy_function,
    raised,
    variable,
)
from cip.formulas.parameters import parameters_in

ZERO: Orders = (0, 0, 0, 0)


@dataclass(frozen=True)
class Jet:
    """A partial derivative of a component of the foot (0, 1, 2) or of log det(dX/dx) (3)."""

    component: int
    orders: Orders  # in x1, x2, x3 and t; the last one is 0

    @property
    def name(self) -> str:
        """Name of its variable in formulas."""
        return f"j{self.component}_{''.join(map(str, self.orders[:3]))}"

    @classmethod
    def named(cls, name: str) -> Jet:
        """The jet that a variable represents."""
        i, j, k = (int(digit) for digit in name[3:6])
        return cls(int(name[1]), (i, j, k, 0))

    def along(self, *axes: int) -> Jet:
        """This derivative, differentiated in each of the given directions."""
        orders = self.orders
        for axis in axes:
            orders = raised(orders, axis)
        return Jet(self.component, orders)


LOG_DETERMINANT = Jet(3, ZERO)


def foot(component: int, *axes: int) -> Jet:
    """The derivative of a component of the foot in the given directions."""
    return Jet(component, ZERO).along(*axes)


def exponential(jet: Jet, exponent: Callable[[Jet], Any], E: Any) -> Any:
    """The derivative of E = exp(l) of the orders of a jet, at most two, from those of l, which are
    `exponent` of the jets of log det."""
    axes = [axis for axis in range(3) for _ in range(jet.orders[axis])]
    first = [exponent(LOG_DETERMINANT.along(axis)) for axis in axes]
    if not axes:
        return E
    return E * first[0] if len(axes) == 1 else E * (exponent(jet) + first[0] * first[1])


class System:
    """The equations of the displacement of the foot in the `moving` directions and of the `wanted`
    jets, for the velocity components `c`; jets that the equations need are added. `rates` are the
    derivatives of `jets` in tau, in terms of the foot, t, the jets and the `parameters`."""

    def __init__(
        self, c: Sequence[Expression], moving: Sequence[int], wanted: Sequence[Jet]
    ) -> None:
        self.moving = tuple(moving)
        self._c = c
        self._rates: dict[Jet, Expression] = {}
        todo = [*(foot(axis) for axis in moving), *wanted]
        for jet in todo:
            if jet in self._rates:
                continue
            self._rates[jet] = self._rate(jet)
            for name in sorted(self._rates[jet].variables()):
                if name.startswith("j"):
                    todo.append(Jet.named(name))
        self.jets = tuple(self._rates)
        self.rates = tuple(self._rates.values())
        self.parameters = parameters_in(self.rates)
        self._evaluator: tuple[dict[str, Any], Callable[..., Any]] | None = None

    def evaluator(self, functions: Mapping[str, Any]) -> Callable[..., Any]:
        """The rates as a function of x1, x2, x3, t and the jets; the last result is kept.
        `functions` are the callables of opaque nodes and the numbers of parameters by name."""
        if self._evaluator is None or self._evaluator[0] != functions:
            names = [*COORDINATES, *(jet.name for jet in self.jets)]
            self._evaluator = dict(functions), numpy_function(self.rates, names, functions)
        return self._evaluator[1]

    def start(self, jet: Jet) -> float:
        """The initial value of a jet, at tau = 0: 1 on the diagonal of the Jacobian, else 0."""
        first = jet.component < 3 and sum(jet.orders) == 1
        return 1.0 if first and jet.orders[jet.component] == 1 else 0.0

    def total(self, f: Expression, axis: int) -> Expression:
        """Total derivative of f(X, jets) with respect to a coordinate of the node."""
        result = constant(0.0)
        for q, name in enumerate(COORDINATES[:3]):
            slope = f.derivative(name)
            if q in self.moving:
                result = result + slope * variable(foot(q, axis).name)
            elif q == axis:
                result = result + slope
        for name in sorted(f.variables()):
            if name.startswith("j"):
                inner = variable(Jet.named(name).along(axis).name)
                result = result + f.derivative(name) * inner
        return result

    def _rate(self, jet: Jet) -> Expression:
        if jet.orders == ZERO:
            if jet.component < 3:
                return -self._c[jet.component]
            divergence = constant(0.0)
            for axis in self.moving:
                divergence = divergence + self._c[axis].derivative(COORDINATES[axis])
            return -divergence
        axis = max(q for q in range(3) if jet.orders[q])
        return self.total(self._rate(Jet(jet.component, raised(jet.orders, axis, -1))), axis)


class Composite:
    """Moments of the new field, u(X) for transport and det(dX/dx) u(X) for advection, by the chain
    rule from those of the old one at the foot, where `field(i, j, k)` names a derivative's
    variable."""

    def __init__(self, moving: Sequence[int], advect: bool) -> None:
        self._moving = tuple(moving)
        value = variable(self.field(ZERO))
        if not advect:
            self._value = value
        elif len(self._moving) == 1:
            self._value = variable(foot(self._moving[0], self._moving[0]).name) * value
        else:
            self._value = apply("exp", variable(LOG_DETERMINANT.name)) * value

    @staticmethod
    def field(orders: Orders) -> str:
        """Variable of a derivative of the old field at the foot."""
        return f"f_{''.join(map(str, orders[:3]))}"

    def moment(self, orders: Orders) -> Expression:
        """Derivative of the new field of these orders at the node."""
        if orders == ZERO:
            return self._value
        axis = max(q for q in range(3) if orders[q])
        return self._total(self.moment(raised(orders, axis, -1)), axis)

    def _total(self, f: Expression, axis: int) -> Expression:
        result = constant(0.0)
        for name in sorted(f.variables()):
            slope = f.derivative(name)
            if name.startswith("j"):
                result = result + slope * variable(Jet.named(name).along(axis).name)
            elif name.startswith("f"):
                i, j, k = (int(digit) for digit in name[2:])
                for q in range(3):
                    up = variable(self.field(raised((i, j, k, 0), q)))
                    if q in self._moving:
                        result = result + slope * up * variable(foot(q, axis).name)
                    elif q == axis:
                        result = result + slope * up
        return result
