"""All derivatives of one formula at once, by the reverse mode of differentiation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cip.formulas.expression import (
    COORDINATES,
    RULES,
    Expression,
    constant,
    linear,
    opaque,
    ordered,
    raised,
    variable,
)
from cip.formulas.expression import apply as function


def gradient(
    output: Expression, names: Sequence[str], parts: Sequence[Expression] = ()
) -> list[Expression]:
    """The derivatives of a formula in variables and in nodes of it (`parts`), by reverse
    accumulation: together they take a few times the operations of the formula, however many the
    variables are (Griewank and Walther, Evaluating Derivatives, 2008, chapter 3)."""
    every = [*(variable(name) for name in names), *parts]
    nodes, wanted = ordered([output]), set(every)
    moves = any(name in COORDINATES for name in names)
    active: set[Expression] = set()
    for node in nodes:
        depends = node in wanted or (node.op in ("opaque", "linear") and moves)
        if depends or any(argument in active for argument in node.args):
            active.add(node)
    slopes = {output: constant(1.0)}
    for node in reversed(nodes):
        if node not in active or node not in slopes:
            continue
        for argument, partial in _partials(node):
            if argument in active or argument in wanted:
                part = slopes[node] * partial
                slopes[argument] = slopes[argument] + part if argument in slopes else part
    return [slopes.get(node, constant(0.0)) for node in every]


def _partials(node: Expression) -> Iterator[tuple[Expression, Expression]]:
    """Each argument of a node and the derivative of the node with respect to it."""
    if node.op == "opaque":
        name, orders = node.value
        for place, coordinate in enumerate(COORDINATES):
            yield variable(coordinate), opaque(name, raised(orders, place))
    elif node.op == "linear":
        name, orders = node.value
        for place, coordinate in enumerate(COORDINATES):
            yield variable(coordinate), linear(name, raised(orders, place), node.args)
        for place, argument in enumerate(node.args):
            yield argument, opaque(f"{name}{place}", orders)
    elif node.op in RULES:
        yield node.args[0], RULES[node.op](node.args[0])
    elif len(node.args) == 2:
        a, b = node.args
        if node.op in ("+", "-"):
            yield a, constant(1.0)
            yield b, constant(1.0 if node.op == "+" else -1.0)
        elif node.op == "*":
            yield a, b
            yield b, a
        elif node.op == "/":
            yield a, 1.0 / b
            yield b, -node / b
        elif b.op == "constant":
            yield a, b * a ** (b - 1.0)
        else:
            yield a, b * node / a
            yield b, node * function("log", a)
