"""The splines of a velocity from snapshots as kernels: all derivatives that a path needs at once.

The weights of an axis, B-splines and their derivatives, come from de Boor's recursion as formulas
that are differentiated exactly; the sums over the coefficients run axis by axis, the inner ones
shared by all derivatives. Only degrees, dimension and the list of derivatives are in the code; the
data come as one array of numbers (`cip.formulas.snapshots.Snapshots.table`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from cip.formulas.expression import (
    COORDINATES,
    Expression,
    constant,
    ordered,
    statements,
    variable,
)


class Layout(NamedTuple):
    """Positions of the numbers of the splines and of their computed values."""

    degrees: tuple[int, ...]  # in time and in each direction
    components: int
    first: int  # the table begins at box[first]
    room: int  # values and weights are written from work[room] on


def derivatives_in(rates: Sequence[Expression]) -> list[Expression]:
    """The derivatives of the splines that occur in some formulas, in a fixed order."""
    found = [node for node in ordered(list(rates)) if node.op == "opaque"]
    return sorted(found, key=lambda node: node.value)


def room_needed(layout: Layout, nodes: Sequence[Expression]) -> int:
    """Length of the array of a kernel for these derivatives: their values, then the weights."""
    weights = sum(len(orders) * (k + 1) for orders, k in _wanted(layout, nodes))
    return len(nodes) + weights


def spline_source(layout: Layout, name: str, nodes: Sequence[Expression]) -> list[str]:
    """Python source of the kernel ``name(x1, x2, x3, t, box, work)``, which writes the derivative
    of node q to ``work[room + q]``. The kernels of `weight_source` come before it."""
    reals = ", ".join(f"{x}: Real" for x in COORDINATES)
    lines = [f"def {name}({reals}, box: Array, work: Out) -> None:"]
    axes = len(layout.degrees)
    # The table begins with three numbers of each axis: coefficients, halvings, period.
    table = f"{layout.first + 3 * axes}"
    place = layout.room + len(nodes)
    starts = []
    for axis, (orders, k) in enumerate(_wanted(layout, nodes)):
        head = layout.first + 3 * axis
        lines += [
            f"    z{axis} = {_axis_name(axis)}",
            f"    n{axis} = floor(box[{head}])",
            f"    knots{axis} = {table}",
            f"    if box[{head + 2}] > 0.0:",
            f"        turns{axis} = floor((z{axis} - box[knots{axis} + {k}]) / box[{head + 2}])",
            f"        z{axis} = z{axis} - box[{head + 2}] * turns{axis}",
            f"    i{axis} = interval(z{axis}, box, knots{axis}, n{axis}, {k}, "
            f"floor(box[{head + 1}]))",
            f"    {_weights_name(k, orders)}(z{axis}, box, knots{axis} + i{axis}, work, {place})",
        ]
        starts.append(place)
        place += len(orders) * (k + 1)
        table = f"knots{axis} + n{axis} + {k + 1}"
    lines.append(f"    data = {table}")
    number = {node: q for q, node in enumerate(nodes)}
    for component in range(layout.components):
        mine = {
            node: _orders(node, axes) for node in nodes if node.value[0] == f"snapshots{component}"
        }
        if mine:
            lines += _sums(layout, component, sorted(set(mine.values())), starts, nodes)
            lines += [
                f"    work[{layout.room + number[node]}] = a0_{_digits(orders)}"
                for node, orders in mine.items()
            ]
    return lines


def _sums(
    layout: Layout, component: int, every: Sequence[tuple[int, ...]], starts: Sequence[int],
    nodes: Sequence[Expression],
) -> list[str]:  # fmt: skip
    """Code of the sums of a component for all orders of derivatives in `every`."""
    axes = len(layout.degrees)
    wanted = _wanted(layout, nodes)
    sizes = " * ".join(f"n{axis}" for axis in range(axes))
    strides = [" * ".join(f"n{q}" for q in range(axis + 1, axes)) or "1" for axis in range(axes)]
    begin = " + ".join(
        f"(i{axis} - {k}) * {stride if axis < axes - 1 else 1}"
        for axis, (k, stride) in enumerate(zip(layout.degrees, strides, strict=True))
    )
    lines = [f"    b0 = data + {component} * {sizes} + {begin}"]

    def level(axis: int, pad: str) -> None:
        tails = sorted({orders[axis:] for orders in every})
        lines.extend(f"{pad}a{axis}_{_digits(tail)} = 0.0" for tail in tails)
        k = layout.degrees[axis]
        lines.append(f"{pad}for q{axis} in range({k + 1}):")
        inner = pad + "    "
        if axis < axes - 1:
            lines.append(f"{inner}b{axis + 1} = b{axis} + q{axis} * {strides[axis]}")
            level(axis + 1, inner)
        else:
            lines.append(f"{inner}value = box[b{axis} + q{axis}]")
        for tail in tails:
            own = f"a{axis}_{_digits(tail)}"
            below = f"a{axis + 1}_{_digits(tail[1:])}" if axis < axes - 1 else "value"
            weight = starts[axis] + wanted[axis][0].index(tail[0]) * (k + 1)
            lines.append(f"{inner}{own} = {own} + work[{weight} + q{axis}] * {below}")

    level(0, "    ")
    return lines


def weight_source(layout: Layout, *lists: Sequence[Expression]) -> list[str]:
    """Python source of the interval search and of all kernels of weights that are called."""
    found = {}
    for nodes in lists:
        for orders, k in _wanted(layout, nodes):
            found[_weights_name(k, orders)] = (k, orders)
    lines = """
def interval(x: Real, box: Array, at: Index, count: Index, degree: Index, rounds: Index) -> Index:
    low = degree
    high = count
    for q in range(rounds):
        middle = (low + high) // 2
        if high - low > 1:
            if x < box[at + middle]:
                high = middle
            else:
                low = middle
    return low
""".strip().splitlines()
    for name, (k, orders) in sorted(found.items()):
        lines += [
            "",
            f"def {name}(x: Real, box: Array, at: Index, work: Out, place: Index) -> None:",
        ]
        lines += [f"    k{m} = box[at + {m - k + 1}]" for m in range(2 * k)]
        weights = [weight for order in orders for weight in _basis(k, order)]
        outputs = {f"o{q}": weight for q, weight in enumerate(weights)}
        lines += statements(outputs)
        lines += [f"    work[place + {q}] = {output}" for q, output in enumerate(outputs)]
    return lines


@cache
def _basis(degree: int, order: int) -> tuple[Expression, ...]:
    """The B-splines on an interval, or their derivatives, in terms of x and the knots around it.
    Knot number `degree` - 1 (``k{degree - 1}``) is the left end of the interval."""
    x = variable("x")
    found = [constant(1.0)]
    for d in range(1, degree + 1):
        below, found = found, []
        for j in range(d + 1):
            total = constant(0.0)
            left = degree - 1 - d + j  # number of the first knot of this B-spline
            if j > 0:
                a, b = variable(f"k{left}"), variable(f"k{left + d}")
                total = total + (x - a) / (b - a) * below[j - 1]
            if j < d:
                a, b = variable(f"k{left + 1}"), variable(f"k{left + d + 1}")
                total = total + (b - x) / (b - a) * below[j]
            found.append(total)
    for _ in range(order):
        found = [weight.derivative("x") for weight in found]
    return tuple(found)


def _wanted(layout: Layout, nodes: Sequence[Expression]) -> list[tuple[tuple[int, ...], int]]:
    """For each axis the orders of derivatives that occur, and the degree."""
    axes = len(layout.degrees)
    every = [_orders(node, axes) for node in nodes]
    return [
        (tuple(sorted({orders[axis] for orders in every})), k)
        for axis, k in enumerate(layout.degrees)
    ]


def _orders(node: Expression, axes: int) -> tuple[int, ...]:
    """Orders of a derivative, in time and in each direction."""
    orders = node.value[1]
    return (orders[3], *orders[: axes - 1])


def _axis_name(axis: int) -> str:
    return COORDINATES[3] if axis == 0 else COORDINATES[axis - 1]


def _weights_name(degree: int, orders: Sequence[int]) -> str:
    return f"weights{degree}_{_digits(orders)}"


def _digits(orders: Sequence[int]) -> str:
    return "".join(map(str, orders))
