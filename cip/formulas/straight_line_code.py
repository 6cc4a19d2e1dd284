"""Formulas as straight-line code for NumPy and for the kernels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cip.formulas.expression import RULES, Expression, ordered

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
