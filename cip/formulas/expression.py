r"""Formulas as graphs: built by arithmetic or traced from a callable, differentiated exactly.

An `Expression` is an interned node: equal sub-formulas are one object. Sub-formulas that occur
again in a derivative need no further nodes, and the emitted code computes each of them once
(Griewank and Walther, Evaluating Derivatives, 2008, chapter 6: common subexpressions by value
numbering).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

COORDINATES = ("x1", "x2", "x3", "t")
Orders = tuple[int, int, int, int]  # of derivatives in these
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "**": operator.pow,
}  # fmt: skip


class Expression:
    """A node of a formula; build it with arithmetic, NumPy functions, `variable` and `constant`."""

    __slots__ = ("_derivatives", "args", "op", "value")
    _nodes: ClassVar[dict[Any, Expression]] = {}
    __array_priority__ = 1000.0

    op: str  # "constant", "variable", "opaque", "linear", an operator or a function
    args: tuple[Expression, ...]
    value: Any  # number, name, or (name, orders) if opaque or linear
    _derivatives: dict[str, Expression]

    def __new__(  # noqa: D102
        cls, op: str, args: tuple[Expression, ...] = (), value: Any = None
    ) -> Expression:
        sign = math.copysign(1.0, value) if op == "constant" else None
        key = (op, tuple(map(id, args)), value, sign)
        node = cls._nodes.get(key)
        if node is None:
            node = object.__new__(cls)
            node.op, node.args, node.value, node._derivatives = op, args, value, {}
            node = cls._nodes.setdefault(key, node)  # atomic: all threads get the same node
        return node

    def __copy__(self) -> Expression:
        return self

    def __deepcopy__(self, memo: Any) -> Expression:
        return self

    def __reduce__(self) -> Any:
        # A flat list, not nested tuples: long sums are deeper than Python's recursion limit.
        nodes = ordered([self])
        place = {node: q for q, node in enumerate(nodes)}
        rows = [(n.op, tuple(place[argument] for argument in n.args), n.value) for n in nodes]
        return _restored, (rows,)

    def __add__(self, other: Any) -> Expression:
        return _add(self, _lift(other))

    def __radd__(self, other: Any) -> Expression:
        return _add(_lift(other), self)

    def __sub__(self, other: Any) -> Expression:
        return _subtract(self, _lift(other))

    def __rsub__(self, other: Any) -> Expression:
        return _subtract(_lift(other), self)

    def __mul__(self, other: Any) -> Expression:
        return _multiply(self, _lift(other))

    def __rmul__(self, other: Any) -> Expression:
        return _multiply(_lift(other), self)

    def __truediv__(self, other: Any) -> Expression:
        return _divide(self, _lift(other))

    def __rtruediv__(self, other: Any) -> Expression:
        return _divide(_lift(other), self)

    def __pow__(self, other: Any) -> Expression:
        return _power(self, _lift(other))

    def __rpow__(self, other: Any) -> Expression:
        return _power(_lift(other), self)

    def __neg__(self) -> Expression:
        return _subtract(constant(0.0), self)

    def __pos__(self) -> Expression:
        return self

    def __abs__(self) -> Expression:
        return apply("abs", self)

    def __bool__(self) -> bool:
        raise TypeError("a formula has no truth value: it cannot steer an if, min or max")

    def __eq__(self, other: object) -> bool:
        # A comparison in a traced callable would be decided once for all points.
        if self is other:
            return True
        raise TypeError("formulas cannot be compared")

    __hash__ = object.__hash__

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> Any:
        names = {"absolute": "abs", "fabs": "abs", "true_divide": "divide"}
        name = names.get(ufunc.__name__, ufunc.__name__)
        if method != "__call__" or kwargs:
            return NotImplemented
        operands = [_lift(value) for value in inputs]
        if name in _BINARY:
            return _BINARY[name](*operands)
        if name == "negative":
            return -operands[0]
        if name == "square":
            return operands[0] * operands[0]
        if name == "positive":
            return operands[0]
        if name in RULES:
            return apply(name, operands[0])
        return NotImplemented

    def derivative(self, name: str) -> Expression:
        """The partial derivative with respect to the variable of this name."""
        if name not in self._derivatives:
            # Arguments first, no recursion: long sums are deeper than Python's recursion limit.
            for node in ordered([self]):
                if name not in node._derivatives:
                    node._derivatives[name] = _differentiate(node, name)
        return self._derivatives[name]

    def variables(self) -> set[str]:
        """Names of the variables that occur; an opaque function counts as using x1, x2, x3, t."""
        found: set[str] = set()
        for node in ordered([self]):
            if node.op == "variable":
                found.add(node.value)
            elif node.op in ("opaque", "linear"):
                found.update(COORDINATES)
        return found


def constant(value: float) -> Expression:
    """The number as a node."""
    return Expression("constant", (), float(value))


def variable(name: str) -> Expression:
    """The variable of this name."""
    return Expression("variable", (), name)


def opaque(name: str, orders: Orders) -> Expression:
    """A partial derivative, at (x1, x2, x3, t), of a function known only by its values; `orders`
    are those in x1, x2, x3 and t."""
    return Expression("opaque", (), (name, orders))


def linear(name: str, orders: Orders, coefficients: Sequence[Expression]) -> Expression:
    """A partial derivative of a sum of functions ``name0, name1, ..``, each times a coefficient;
    the functions, and so their sum, are known only by their values, as those of `opaque`."""
    return Expression("linear", tuple(coefficients), (name, orders))


def raised(orders: Orders, place: int, by: int = 1) -> Orders:
    """Derivative orders, increased in the coordinate with index `place`."""
    i, j, k, l = (order + by * (q == place) for q, order in enumerate(orders))
    return i, j, k, l


def apply(name: str, argument: Expression) -> Expression:
    """The elementary function of this name at a formula."""
    if argument.op == "constant":
        with np.errstate(all="ignore"):
            return constant(float(getattr(np, name)(argument.value)))
    return Expression(name, (argument,))


def ordered(roots: Sequence[Expression]) -> list[Expression]:
    """The roots and all nodes below them, each once and after its arguments."""
    done: dict[Expression, None] = {}
    stack = [(root, False) for root in reversed(roots)]
    while stack:
        node, ready = stack.pop()
        if ready:
            done[node] = None
        elif node not in done:
            stack.append((node, True))
            stack.extend((argument, False) for argument in reversed(node.args))
    return list(done)


def _restored(rows: Sequence[tuple[str, tuple[int, ...], Any]]) -> Expression:
    nodes: list[Expression] = []
    for op, args, value in rows:
        nodes.append(Expression(op, tuple(nodes[q] for q in args), value))
    return nodes[-1]


def with_names(
    roots: Sequence[Expression], names: Mapping[Expression, Expression]
) -> list[Expression]:
    """The formulas with others in place of some of their nodes."""
    done: dict[Expression, Expression] = {}
    for node in ordered(roots):
        args = [done[argument] for argument in node.args]
        if node in names:
            done[node] = names[node]
        elif all(new is old for new, old in zip(args, node.args, strict=True)):
            done[node] = node
        else:
            binary = OPERATORS.get(node.op)
            done[node] = binary(*args) if binary else apply(node.op, args[0])
    return [done[root] for root in roots]


def traced(function: Callable[..., Any], names: Sequence[str]) -> Expression | None:
    """The formula that a callable computes, or None when it is not plain arithmetic."""
    try:
        result = function(*(variable(name) for name in names))
        return _lift(result)
    except Exception:  # a user's function may raise anything when its argument is no number
        return None


def _lift(value: Any) -> Expression:
    if isinstance(value, Expression):
        return value
    array = np.asarray(value)
    if array.dtype == object and array.ndim == 0:
        return _lift(array.item())
    if array.ndim or array.dtype.kind not in "fiub":
        raise TypeError(f"a formula cannot be combined with {value!r}")
    return constant(float(array))


def _add(a: Expression, b: Expression) -> Expression:
    if a.op == b.op == "constant":
        return constant(a.value + b.value)
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    return Expression("+", (a, b))


def _subtract(a: Expression, b: Expression) -> Expression:
    if a.op == b.op == "constant":
        return constant(a.value - b.value)
    if _is(b, 0.0):
        return a
    if a is b:
        return constant(0.0)
    if _is(a, 0.0) and b.op == "-" and _is(b.args[0], 0.0):
        return b.args[1]
    return Expression("-", (a, b))


def _multiply(a: Expression, b: Expression) -> Expression:
    if a.op == b.op == "constant":
        return constant(a.value * b.value)
    if b.op == "constant":
        a, b = b, a
    if _is(a, 0.0):
        return a
    if _is(a, 1.0):
        return b
    if _is(a, -1.0):
        return -b
    if a.op == "constant" and b.op == "*" and b.args[0].op == "constant":
        return _multiply(constant(a.value * b.args[0].value), b.args[1])
    return Expression("*", (a, b))


def _divide(a: Expression, b: Expression) -> Expression:
    if b.op == "constant":
        if a.op == "constant":
            with np.errstate(all="ignore"):
                return constant(float(np.divide(a.value, b.value)))
        if b.value == 0.0:
            return constant(math.nan)
        if math.frexp(b.value)[0] in (0.5, -0.5):  # b is a power of two, so 1 / b is exact
            return _multiply(constant(1.0 / b.value), a)
    if _is(a, 0.0):
        return a
    return Expression("/", (a, b))


def _power(a: Expression, b: Expression) -> Expression:
    if b.op == "constant":
        if b.value == 0.0:
            return constant(1.0)
        if b.value == 1.0:
            return a
        if b.value == 0.5:
            return apply("sqrt", a)
        if b.value.is_integer() and 2 <= abs(b.value) <= 16:
            n, result, square = int(abs(b.value)), None, a
            while n:
                if n & 1:
                    result = square if result is None else result * square
                n >>= 1
                square = square * square if n else square
            assert result is not None
            return result if b.value > 0 else constant(1.0) / result
        if a.op == "constant":
            with np.errstate(all="ignore"):
                return constant(float(np.power(a.value, b.value)))
    return Expression("**", (a, b))


def _is(node: Expression, value: float) -> bool:
    return node.op == "constant" and node.value == value


_BINARY: dict[str, Callable[[Expression, Expression], Expression]] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "power": _power,
    "float_power": _power,
}

# The derivative f'(a) of each elementary function f.
RULES: dict[str, Callable[[Expression], Expression]] = {
    "sin": lambda a: apply("cos", a),
    "cos": lambda a: -apply("sin", a),
    "tan": lambda a: 1.0 + apply("tan", a) ** 2,
    "arcsin": lambda a: 1.0 / apply("sqrt", 1.0 - a**2),
    "arccos": lambda a: -1.0 / apply("sqrt", 1.0 - a**2),
    "arctan": lambda a: 1.0 / (1.0 + a**2),
    "sinh": lambda a: apply("cosh", a),
    "cosh": lambda a: apply("sinh", a),
    "tanh": lambda a: 1.0 - apply("tanh", a) ** 2,
    "exp": lambda a: apply("exp", a),
    "log": lambda a: 1.0 / a,
    "sqrt": lambda a: 0.5 / apply("sqrt", a),
    "abs": lambda a: apply("sign", a),
    "sign": lambda a: constant(0.0),
}


def _differentiate(node: Expression, name: str) -> Expression:
    if node.op == "variable":
        return constant(1.0 if node.value == name else 0.0)
    if node.op == "constant":
        return constant(0.0)
    if node.op == "opaque":
        function, orders = node.value
        if name not in COORDINATES:
            return constant(0.0)
        return opaque(function, raised(orders, COORDINATES.index(name)))
    if node.op == "linear":
        function, orders = node.value
        if name in COORDINATES:
            return linear(function, raised(orders, COORDINATES.index(name)), node.args)
        place = {argument.value: q for q, argument in enumerate(node.args)}
        return opaque(f"{function}{place[name]}", orders) if name in place else constant(0.0)
    slopes = [argument.derivative(name) for argument in node.args]
    if node.op == "+":
        return slopes[0] + slopes[1]
    if node.op == "-":
        return slopes[0] - slopes[1]
    a = node.args[0]
    if node.op == "*":
        return slopes[0] * node.args[1] + a * slopes[1]
    if node.op == "/":
        return (slopes[0] - node * slopes[1]) / node.args[1]
    if node.op == "**":
        b = node.args[1]
        if b.op == "constant":
            return b * a ** (b - 1.0) * slopes[0]
        return node * (slopes[1] * apply("log", a) + b * slopes[0] / a)
    if _is(slopes[0], 0.0):
        return slopes[0]
    return RULES[node.op](a) * slopes[0]


Array = np.ndarray[Any, np.dtype[np.float64]]


def statements(outputs: Mapping[str, Expression], indent: str = "    ") -> list[str]:
    """Lines of code: one assignment for each node after its arguments, then the named outputs."""
    names: dict[Expression, str] = {}
    lines: list[str] = []
    for node in ordered(list(outputs.values())):
        if node.op == "variable":
            names[node] = node.value
        elif node.op == "constant":
            names[node] = _number(node.value)
        else:
            names[node] = f"v{len(lines)}"
            code = _operation(node, [names[argument] for argument in node.args])
            lines.append(f"{indent}{names[node]} = {code}")
    return [*lines, *(f"{indent}{name} = {names[node]}" for name, node in outputs.items())]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "nan" if value != value else ("inf" if value > 0 else "(-inf)")
    return repr(value) if value >= 0 else f"({value!r})"


def _operation(node: Expression, args: list[str]) -> str:
    if node.op in ("opaque", "linear"):
        function, orders = node.value
        return f"{function}_{''.join(map(str, orders))}(x1, x2, x3, t)"
    if node.op in RULES:
        return f"{node.op}({args[0]})"
    if node.op == "-" and node.args[0].op == "constant" and node.args[0].value == 0.0:
        return f"-{args[1]}"
    return f"{args[0]} {node.op} {args[1]}"


def numpy_function(
    outputs: Sequence[Expression],
    arguments: Sequence[str],
    functions: Mapping[str, Any] | None = None,
) -> Callable[..., tuple[Any, ...]]:
    """A function of the arguments that returns a tuple of the formulas' values, numbers if
    constant. `functions` are the callables of opaque nodes and the numbers of parameters, by their
    names."""
    named = {f"out{q}": node for q, node in enumerate(outputs)}
    body = [f"def evaluate({', '.join(arguments)}):", *statements(named)]
    body.append(f"    return ({''.join(f'{name}, ' for name in named)})")
    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(functions or {}, nan=math.nan, inf=math.inf)
    exec("\n".join(body), namespace)
    evaluate: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return evaluate


def rows_of(values: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """The results of such a function as rows of an array, each of this shape."""
    found = np.empty((len(values), *shape))
    for row, value in zip(found, values, strict=True):
        row[:] = value
    return found


def derived(node: Expression, orders: Sequence[int]) -> Expression:
    """The derivative of a formula of these orders in the coordinates and time."""
    for name, order in zip(COORDINATES, orders, strict=True):
        for _ in range(order):
            node = node.derivative(name)
    return node


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
            yield b, node * apply("log", a)
