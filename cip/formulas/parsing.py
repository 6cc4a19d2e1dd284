"""Formulas from texts."""

from __future__ import annotations

import ast
import math
from collections.abc import Collection

from cip.errors import InputError
from cip.formulas.expression import (
    COORDINATES,
    OPERATORS,
    RULES,
    Expression,
    apply,
    constant,
    ordered,
    variable,
)
from cip.formulas.parameters import parameter

ALIASES = {"x": "x1", "y": "x2", "z": "x3", "lon": "x1", "lat": "x2"}


def parse(text: str, name: str = "expression", parameters: Collection[str] = ()) -> Expression:
    """Parse a formula in x1, x2, x3 (or x, y, z; lon, lat), t and `parameters`: Python's operators
    + - * / ** with finite numbers, pi, e and the elementary functions of `expression`. Raises
    `InputError` for anything else, with a message that begins with `name`."""
    if not isinstance(text, str):
        raise InputError(f"{name}: expected a text such as 'x2 * sin(t)', got {text!r}")
    if not text.isascii():  # Python reads letters of other scripts as the Latin ones like them
        odd = next(letter for letter in text if not letter.isascii())
        raise InputError(
            f"{name}: {odd!r} in {text!r} is no ASCII; write formulas in Latin letters, digits and "
            "+ - * / **"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        found = _parsed(tree, text, name, parameters)
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(f"{name}: {text!r} is not a formula: {error.msg}") from error
    except (ValueError, OverflowError) as error:
        raise InputError(f"{name}: {text!r} is not a formula: {error}") from error
    except (RecursionError, MemoryError) as error:
        raise InputError(
            f"{name}: a text of {len(text)} characters, nested too deeply to be read; pass a "
            "callable, whose sums may be as long as you like"
        ) from error
    if any(node.op == "constant" and not math.isfinite(node.value) for node in ordered([found])):
        raise InputError(
            f"{name}: {text!r} holds a number that is not finite: an overflow, a division by zero, "
            "or a root or logarithm of a number that has none"
        )
    return found


def _parsed(tree: ast.expr, text: str, name: str, parameters: Collection[str]) -> Expression:
    if isinstance(tree, ast.Constant) and isinstance(tree.value, int | float):
        if isinstance(tree.value, bool):  # to Python an int
            raise InputError(f"{name}: {tree.value} in {text!r} is no number")
        return constant(tree.value)
    if isinstance(tree, ast.Name):
        if tree.id in ("pi", "e"):
            return constant(getattr(math, tree.id))
        if tree.id in parameters:
            return parameter(tree.id)
        known = ALIASES.get(tree.id, tree.id)
        if known in COORDINATES:
            return variable(known)
        known_names = ", ".join(["x1, x2, x3, t, pi, e", *parameters])
        raise InputError(
            f"{name}: {tree.id!r} in {text!r} is none of {known_names}; other names need values in "
            "parameters={name: value}"
        )
    signs = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
    sign = signs.get(type(tree.op)) if isinstance(tree, ast.BinOp) else None
    if isinstance(tree, ast.BinOp) and sign is not None:
        left = _parsed(tree.left, text, name, parameters)
        right = _parsed(tree.right, text, name, parameters)
        found: Expression = OPERATORS[sign](left, right)
        return found
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub | ast.UAdd):
        inner = _parsed(tree.operand, text, name, parameters)
        return -inner if isinstance(tree.op, ast.USub) else inner
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) and not tree.keywords:
        if tree.func.id in RULES and len(tree.args) == 1:
            return apply(tree.func.id, _parsed(tree.args[0], text, name, parameters))
        raise InputError(
            f"{name}: {tree.func.id!r} in {text!r} is no known function of one argument; "
            f"known are {', '.join(RULES)}"
        )
    numbers = ("np.float64(", "np.float32(")  # as NumPy writes them
    if (
        isinstance(tree, ast.Call)
        and ast.unparse(tree).startswith(numbers)
        and len(tree.args) == 1
        and not tree.keywords
    ):
        return _parsed(tree.args[0], text, name, parameters)
    raise InputError(f"{name}: {ast.unparse(tree)!r} in {text!r} is not arithmetic")
