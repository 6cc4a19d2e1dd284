"""Formulas as straight-line code: Python for NumPy and numba, C for the device."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cip.expression import RULES, Expression, ordered

Array = np.ndarray[Any, np.dtype[np.float64]]
_C_NAMES = {"abs": "fabs", "arcsin": "asin", "arccos": "acos", "arctan": "atan"}


def statements(
    outputs: Mapping[str, Expression], language: str = "python", indent: str = "    "
) -> list[str]:
    """One assignment a node, arguments first, then the outputs by their names.

    `language` is ``"python"`` (functions are looked up in `math` style names without prefix) or
    ``"c"`` (numbers and declarations of type real).
    """
    declare, end = ("const real ", ";") if language == "c" else ("", "")
    names: dict[Expression, str] = {}
    lines: list[str] = []
    for node in ordered(list(outputs.values())):
        if node.op == "variable":
            names[node] = node.value
        elif node.op == "constant":
            names[node] = _number(node.value, language)
        else:
            names[node] = f"v{len(lines)}"
            code = _operation(node, [names[argument] for argument in node.args], language)
            lines.append(f"{indent}{declare}{names[node]} = {code}{end}")
    for name, node in outputs.items():
        target = name if language == "python" else f"*{name}"
        lines.append(f"{indent}{target} = {names[node]}{end}")
    return lines


def _number(value: float, language: str) -> str:
    if not math.isfinite(value):
        text = "nan" if value != value else ("inf" if value > 0 else "(-inf)")
        return text if language == "python" else {"nan": "(real)NAN"}.get(text, f"(real){text}")
    return (
        f"(real)({value!r})" if language == "c" else (repr(value) if value >= 0 else f"({value})")
    )


def _operation(node: Expression, args: list[str], language: str) -> str:
    if node.op == "opaque":
        function, orders = node.value
        return f"{function}_{''.join(map(str, orders))}(x1, x2, x3, t)"
    if node.op in RULES:
        return f"{_C_NAMES.get(node.op, node.op) if language == 'c' else node.op}({args[0]})"
    if node.op == "**" and language == "c":
        return f"pow({args[0]}, {args[1]})"
    if node.op == "-" and node.args[0].op == "constant" and node.args[0].value == 0.0:
        return f"-{args[1]}"
    return f"{args[0]} {node.op} {args[1]}"


def numpy_function(
    outputs: Sequence[Expression],
    arguments: Sequence[str],
    functions: Mapping[str, Callable[..., Any]] | None = None,
) -> Callable[..., tuple[Any, ...]]:
    """A function of arrays that returns the values of the formulas, each as computed."""
    named = {f"out{q}": node for q, node in enumerate(outputs)}
    body = [f"def evaluate({', '.join(arguments)}):", *statements(named)]
    body.append(f"    return ({''.join(f'{name}, ' for name in named)})")
    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(functions or {}, nan=math.nan, inf=math.inf)
    exec("\n".join(body), namespace)
    evaluate: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return evaluate
