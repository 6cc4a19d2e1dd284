"""Translation of kernels to C: one source for numba on the CPU and NVRTC on the device.

The kernel language is the part of Python in `ground.jit`. A function becomes an inline C
function with the same arithmetic in the same order; several results become output pointers, records
(`cip.profiles.catalogue`) structs. Types follow from the annotations of the arguments and from the
operations: whole numbers are `index`, all others `real`, which the prelude sets to double or float.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from types import ModuleType

# For each record the C types of its fields by name.
Records = dict[str, dict[str, str]]

_TYPES = {
    "Index": "index", "Real": "real", "Array": "const real* __restrict__",
    "Out": "real* __restrict__", "Sizes": "const index* __restrict__", "Widths": "widths",
}  # fmt: skip
_OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Lt: "<", ast.LtE: "<=",
    ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.And: "&&", ast.Or: "||",
}  # fmt: skip


def prelude(real: str = "double", index: str = "int", uniform: bool = False) -> str:
    """C types (`uniform`: all cells of a direction have one width) and functions that C lacks."""
    types = f"typedef {real} real;\ntypedef {index} index;\n"
    if uniform:
        types += "typedef real widths;\n#define WIDTH(h, k) (h)\n"
    else:
        types += "typedef const real* __restrict__ widths;\n#define WIDTH(h, k) h[k]\n"
    return (
        types
        + """
#ifndef DEVICE
#include <math.h>
#define DEVICE static inline
#endif
DEVICE index whole_mod(index a, index b) { index r = a % b; return r < 0 ? r + b : r; }
DEVICE index whole_div(index a, index b) { return (a - whole_mod(a, b)) / b; }
DEVICE real c_min(real a, real b) { return b < a ? b : a; }
DEVICE real c_max(real a, real b) { return b > a ? b : a; }
DEVICE real sign(real a) { return (real)((a > 0) - (a < 0)); }
"""
    )


def translate(modules: Sequence[ModuleType | str], *entries: str) -> str:
    """C code of the kernels `entries` and of all that they call: first the records, then the
    functions, each before its use. `modules` (or generated source) hold them in any order.
    """
    trees: dict[str, ast.FunctionDef] = {}
    records: Records = {}
    for module in modules:
        text = module if isinstance(module, str) else inspect.getsource(module)
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef):
                trees[node.name] = node
            elif isinstance(node, ast.ClassDef) and _is_record(node):
                records[node.name] = _fields(node)
    done: dict[str, str] = {}

    def visit(name: str) -> None:
        if name in done:
            return
        for node in ast.walk(trees[name]):
            called = node.func if isinstance(node, ast.Call) else None
            if isinstance(called, ast.Name) and called.id in trees:
                visit(called.id)
        done[name] = _Function(trees[name], trees, records).code()

    for entry in entries:
        visit(entry)
    return "\n".join([*(_struct(name, of) for name, of in records.items()), *done.values()])


def _is_record(node: ast.ClassDef) -> bool:
    return any(isinstance(base, ast.Name) and base.id == "NamedTuple" for base in node.bases)


def _fields(record: ast.ClassDef) -> dict[str, str]:
    """C types of the fields of a record."""
    return {
        item.target.id: _TYPES[item.annotation.id]
        for item in record.body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and isinstance(item.annotation, ast.Name)
    }


def _struct(name: str, fields: dict[str, str]) -> str:
    return f"typedef struct {{ {' '.join(f'{of} {x};' for x, of in fields.items())} }} {name};"


def results(tree: ast.FunctionDef) -> list[str]:
    """Types of what a kernel returns."""
    returns = tree.returns
    if returns is None or (isinstance(returns, ast.Constant) and returns.value is None):
        return []
    if isinstance(returns, ast.Name):
        return [_TYPES.get(returns.id, returns.id)]
    assert isinstance(returns, ast.Subscript)
    assert isinstance(returns.slice, ast.Tuple)
    return [_TYPES[item.id] for item in returns.slice.elts if isinstance(item, ast.Name)]


class _Function:
    def __init__(
        self, tree: ast.FunctionDef, trees: dict[str, ast.FunctionDef], records: Records
    ) -> None:
        self.tree, self.trees, self.records = tree, trees, records
        self.types: dict[str, str] = {}
        self.arguments = []
        for argument in tree.args.args:
            assert isinstance(argument.annotation, ast.Name), argument.arg
            kind = argument.annotation.id
            self.types[argument.arg] = _TYPES.get(kind, kind)
            self.arguments.append(argument.arg)
        self.returned = results(tree)

    def code(self) -> str:
        body = self.block(self.tree.body, 1)
        parameters = [f"{self.types[name]} {name}" for name in self.arguments]
        single = len(self.returned) == 1
        if not single:
            parameters += [f"{kind}* result{q}" for q, kind in enumerate(self.returned)]
        locals_ = [
            f"    {kind} {name};" for name, kind in self.types.items() if name not in self.arguments
        ]
        kind = self.returned[0] if single else "void"
        head = f"DEVICE {kind} {self.tree.name}({', '.join(parameters)})"
        return "\n".join([head + " {", *locals_, *body, "}"])

    def block(self, statements: Sequence[ast.stmt], depth: int) -> list[str]:
        pad = "    " * depth
        lines: list[str] = []
        for node in statements:
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                continue
            if isinstance(node, ast.Expr):
                lines.append(f"{pad}{self.expression(node.value)};")
            elif isinstance(node, ast.Assign):
                lines.extend(pad + line for line in self.assign(node.targets[0], node.value))
            elif isinstance(node, ast.AugAssign):
                total = ast.BinOp(node.target, node.op, node.value)
                lines += [pad + line for line in self.assign(node.target, total)]
            elif isinstance(node, ast.If):
                lines.append(f"{pad}if ({self.expression(node.test)}) {{")
                lines += self.block(node.body, depth + 1)
                if node.orelse:
                    lines += [f"{pad}}} else {{", *self.block(node.orelse, depth + 1)]
                lines.append(f"{pad}}}")
            elif isinstance(node, ast.For):
                lines += self.loop(node, depth)
            elif isinstance(node, ast.Return):
                lines += [pad + line for line in self.result(node.value)]
            else:
                raise TypeError(f"{self.tree.name}: {ast.unparse(node)!r} is no kernel language")
        return lines

    def loop(self, node: ast.For, depth: int) -> list[str]:
        assert isinstance(node.target, ast.Name)
        assert isinstance(node.iter, ast.Call)
        bounds = [self.expression(argument) for argument in node.iter.args]
        low, high = ("0", bounds[0]) if len(bounds) == 1 else bounds
        name = node.target.id
        self.types[name] = "index"
        pad = "    " * depth
        head = f"{pad}for ({name} = {low}; {name} < {high}; {name}++) {{"
        return [head, *self.block(node.body, depth + 1), f"{pad}}}"]

    def assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        if isinstance(target, ast.Tuple):
            names = [item.id for item in target.elts if isinstance(item, ast.Name)]
            assert isinstance(value, ast.Call)
            assert isinstance(value.func, ast.Name)
            for name, kind in zip(names, results(self.trees[value.func.id]), strict=True):
                self.types.setdefault(name, kind)
            call = [self.expression(a) for a in value.args] + [f"&{name}" for name in names]
            return [f"{value.func.id}({', '.join(call)});"]
        if isinstance(target, ast.Name):
            self.types.setdefault(target.id, self.kind(value))
            if self.types[target.id] in self.records and self.made(value):
                return [f"{{ {self.made(value)} {target.id} = made; }}"]
        return [f"{self.expression(target)} = {self.expression(value)};"]

    def result(self, value: ast.expr | None) -> list[str]:
        if value is None:
            return ["return;"]
        if len(self.returned) == 1 and self.made(value):
            return [self.made(value), "return made;"]
        if len(self.returned) == 1:
            return [f"return {self.expression(value)};"]
        if isinstance(value, ast.Call):
            assert isinstance(value.func, ast.Name)
            call = [self.expression(a) for a in value.args]
            call += [f"result{q}" for q in range(len(self.returned))]
            return [f"{value.func.id}({', '.join(call)});", "return;"]
        assert isinstance(value, ast.Tuple)
        lines = [f"*result{q} = {self.expression(item)};" for q, item in enumerate(value.elts)]
        return [*lines, "return;"]

    def made(self, node: ast.expr) -> str:
        """C code that declares the record `made` if an expression constructs one, else empty."""
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            return ""
        if node.func.id not in self.records:
            return ""
        values = ", ".join(self.expression(a) for a in node.args)
        return f"const {node.func.id} made = {{{values}}};"

    def kind(self, node: ast.expr) -> str:
        """Type of an expression."""
        if isinstance(node, ast.Constant):
            return "index" if isinstance(node.value, int) else "real"
        if isinstance(node, ast.Name):
            return self.types[node.id]
        if isinstance(node, ast.Attribute):
            return self.records[self.kind(node.value)][node.attr]
        if isinstance(node, ast.Subscript):
            return "index" if self.kind(node.value) == _TYPES["Sizes"] else "real"
        if isinstance(node, ast.UnaryOp):
            return self.kind(node.operand)
        if isinstance(node, ast.BinOp):
            kinds = {self.kind(node.left), self.kind(node.right)}
            return "index" if kinds == {"index"} else "real"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == "floor":
                return "index"
            if node.func.id in self.records:
                return node.func.id
            if node.func.id in self.trees:
                return results(self.trees[node.func.id])[0]
            return "real"
        raise TypeError(f"{self.tree.name}: {ast.unparse(node)!r} is no kernel language")

    def expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return str(node.value) if isinstance(node.value, int) else f"(real){node.value!r}"
        if isinstance(node, ast.Name):
            return node.id
        if isinstance(node, ast.Subscript):
            name, place = self.expression(node.value), self.expression(node.slice)
            widths = self.kind(node.value) == "widths"
            return f"WIDTH({name}, {place})" if widths else f"{name}[{place}]"
        if isinstance(node, ast.Attribute):
            return f"{self.expression(node.value)}.{node.attr}"
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return f"(-{self.expression(node.operand)})"
        if isinstance(node, ast.BinOp):
            left, right = self.expression(node.left), self.expression(node.right)
            if isinstance(node.op, ast.Mod | ast.FloorDiv):
                name = "whole_mod" if isinstance(node.op, ast.Mod) else "whole_div"
                return f"{name}({left}, {right})"
            if isinstance(node.op, ast.Pow):
                return f"pow({left}, {right})"
            return f"({left} {_OPERATORS[type(node.op)]} {right})"
        if isinstance(node, ast.BoolOp):
            joined = f" {_OPERATORS[type(node.op)]} ".join(map(self.expression, node.values))
            return f"({joined})"
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            left, right = self.expression(node.left), self.expression(node.comparators[0])
            return f"({left} {_OPERATORS[type(node.ops[0])]} {right})"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self.call(node.func.id, node.args)
        raise TypeError(f"{self.tree.name}: {ast.unparse(node)!r} is no kernel language")

    def call(self, name: str, args: Sequence[ast.expr]) -> str:
        joined = ", ".join(self.expression(a) for a in args)
        if name == "floor":
            return f"(index)floor({joined})"
        names = {
            "abs": "fabs", "min": "c_min", "max": "c_max", "arcsin": "asin", "arccos": "acos",
            "arctan": "atan",
        }  # fmt: skip
        return f"{names.get(name, name)}({joined})"
