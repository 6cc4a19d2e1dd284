"""How many faults do the tests find? Random mutations of package code, one at a time.

Operators, numbers, conditions and calls of functions are changed at places drawn with a fixed seed;
for each change the quickest tests that run its function are run until one fails. Three commands,
one after the other; the last writes `benchmarks/results/mutations.json`, from which a later state
of the tests can be compared: changes are found again by the text of their lines.

    python benchmarks/mutations.py record          # the fast tests once: which runs what?
    python benchmarks/mutations.py draw --count 300
    python benchmarks/mutations.py run --processes 2

Functions that numba compiles are not seen to run: of them the tests of their module are taken.
Mutations of code for devices survive where there is no device.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import copy
import importlib.machinery
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from machine import describe

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "out" / "mutations"
RESULT = ROOT / "benchmarks" / "results" / "mutations.json"
PACKAGES = ("skfem_adini", "contact", "cip", "gpu")
SEED = 2026
TESTS, SECONDS = 150, 25.0  # most tests of one mutation, and their time without it
SWAPS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,), ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.Mod: (ast.Mult,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,), ast.LShift: (ast.RShift,),
}  # fmt: skip
Mutation = dict[str, Any]  # path, function, number of the mutation in it, line before and after


def functions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield the qualified name and the node of each function of a module."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield from functions(node, f"{prefix}{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            yield f"{prefix}{node.name}", node
            yield from functions(node, f"{prefix}{node.name}.<locals>.")
        else:
            yield from functions(node, prefix)


def all_functions() -> list[tuple[str, str]]:
    """Path and name of the functions of all packages."""
    return [(path, name) for path, tree in modules() for name, _ in functions(tree)]


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Yield the path and the syntax tree of each module."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text())


def compile_from(change: Callable[[str, ast.Module], ast.Module | None]) -> None:
    """Import modules of the packages from the tree that `change` returns, if any."""
    loader: Any = importlib.machinery.SourceFileLoader
    plain = loader.get_code

    def get_code(self: Any, name: str) -> Any:
        path = Path(self.get_filename(name))
        if path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in PACKAGES:
            tree = change(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text()))
            if tree is not None:
                fixed = ast.fix_missing_locations(tree)
                return compile(fixed, str(path), "exec", dont_inherit=True)
        return plain(self, name)

    loader.get_code = get_code


class Recorder:
    """A plugin of pytest that writes which functions each test runs."""

    def __init__(self) -> None:
        numbers = {key: k for k, key in enumerate(all_functions())}
        self.hits = bytearray(len(numbers))
        builtins.__hits__ = self.hits  # type: ignore[attr-defined]
        self.out = (WORK / f"covers_{os.environ['PYTEST_XDIST_WORKER']}.tsv").open("w")

        def marked(path: str, tree: ast.Module) -> ast.Module:
            for name, node in functions(tree):
                mark = ast.parse(f"__hits__[{numbers[path, name]}] = 1").body[0]
                at = int(ast.get_docstring(node, clean=False) is not None)
                for part in ast.walk(mark):
                    ast.copy_location(part, node.body[0])
                node.body.insert(at, mark)
            return tree

        compile_from(marked)
        compile_unmarked()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Count from here."""
        self.hits[:] = bytes(len(self.hits))
        self.start, self.failed = time.perf_counter(), False

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Remember failures."""
        self.failed |= report.failed

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Write what ran."""
        taken = time.perf_counter() - self.start
        hits = ",".join(str(k) for k, hit in enumerate(self.hits) if hit)
        self.out.write(f"{nodeid}\t{taken:.3f}\t{int(self.failed)}\t{hits}\n")
        self.out.flush()


def compile_unmarked() -> None:
    """Let numba compile the functions as they are on disk."""
    from numba.core import registry

    plain, known = registry.CPUDispatcher.__init__, {}

    def codes(code: Any) -> Iterator[tuple[tuple[str, int], Any]]:
        for part in code.co_consts:
            if hasattr(part, "co_code"):
                yield (part.co_qualname, part.co_firstlineno), part
                yield from codes(part)

    def init(self: Any, py_func: Any, *args: Any, **kwargs: Any) -> None:
        code = py_func.__code__
        if "__hits__" in code.co_names:
            path = code.co_filename
            if path not in known:
                source = Path(path).read_text()
                known[path] = dict(codes(compile(source, path, "exec", dont_inherit=True)))
            py_func.__code__ = known[path][code.co_qualname, code.co_firstlineno]
        plain(self, py_func, *args, **kwargs)

    registry.CPUDispatcher.__init__ = init


def sites(function: ast.FunctionDef) -> Iterator[tuple[Any, str, int | None, Any]]:
    """Yield node, field, place in it and replacement for the mutations of a function's own body."""
    inner = {id(n) for _, f in functions(function) for n in ast.walk(f)}
    stack: list[ast.AST] = list(reversed(function.body))
    while stack:
        node = stack.pop()
        if id(node) in inner or isinstance(node, ast.Raise | ast.JoinedStr | ast.ClassDef):
            continue
        yield from sites_of(node)
        parts: list[ast.AST] = []
        for name, value in ast.iter_fields(node):
            if name not in {"annotation", "returns", "decorator_list"}:
                values = value if isinstance(value, list) else [value]
                parts += [part for part in values if isinstance(part, ast.AST)]
        stack.extend(reversed(parts))


def sites_of(node: Any) -> Iterator[tuple[Any, str, int | None, Any]]:
    """Yield the mutations of one node."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in SWAPS.get(type(op), ()):
                yield node, "ops", k, other()
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign):
        for other in SWAPS.get(type(node.op), ()):
            yield node, "op", None, other()
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        value: Any = node.value
        is_bool, is_int = isinstance(value, bool), isinstance(value, int)
        yield node, "value", None, not value if is_bool else value + 1 if is_int else 2 * value or 1
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield node, "", None, None
    if isinstance(node, ast.If | ast.IfExp):
        yield node, "test", None, ast.Constant(value=True)
        yield node, "test", None, ast.Constant(value=False)
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield node, "value", None, ast.Constant(value=None)
    if isinstance(node, ast.AugAssign):
        yield node, "value", None, ast.Constant(value=0)


def mutate(tree: ast.AST, name: str, number: int) -> tuple[str, str]:
    """Change a function of a module in place; returns the line before and after."""
    node, field, k, new = list(sites(dict(functions(tree))[name]))[number]
    before = ast.unparse(node).split("\n")[0]
    if not field:  # a sign or `not` is dropped
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(op=ast.Not(), operand=node.operand)
        else:
            node.op = ast.UAdd()
    elif k is None:
        setattr(node, field, new)
    else:
        getattr(node, field)[k] = new
    return before, ast.unparse(node).split("\n")[0]


def draw(count: int) -> list[Mutation]:
    """Draw mutations, all places alike."""
    trees = dict(modules())
    places = [
        (path, name, number)
        for path, tree in trees.items()
        for name, node in functions(tree)
        for number, _ in enumerate(sites(node))
    ]
    drawn = []
    for path, name, number in random.Random(SEED).sample(places, count):
        before, after = mutate(copy.deepcopy(trees[path]), name, number)
        drawn.append(
            {"path": path, "function": name, "number": number, "before": before, "after": after}
        )
    return drawn


def place_again(mutation: Mutation) -> int | None:
    """Number of a mutation in the code of today; None where that line is gone."""
    path = ROOT / mutation["path"]
    tree = ast.parse(path.read_text()) if path.exists() else ast.Module([], [])
    name = mutation["function"]
    count = len(list(sites(dict(functions(tree))[name]))) if name in dict(functions(tree)) else 0
    numbers = sorted(range(count), key=lambda k: abs(k - mutation["number"]))
    for number in numbers:
        if mutate(copy.deepcopy(tree), name, number) == (mutation["before"], mutation["after"]):
            return number
    return None


def recorded() -> dict[int, list[tuple[float, str]]]:
    """For each function by number the seconds and names of the tests that run it."""
    tests: dict[int, list[tuple[float, str]]] = {}
    for path in WORK.glob("covers_*.tsv"):
        for line in path.read_text().splitlines():
            name, taken, failed, hits = line.split("\t")
            for k in hits.split(",") if failed == "0" and hits else ():
                tests.setdefault(int(k), []).append((float(taken), name))
    return tests


def tests_of(mutation: Mutation, tests: dict[int, list[tuple[float, str]]]) -> list[str]:
    """The quickest tests of a function; of its module or folder where none is seen to run it."""
    names = all_functions()
    path, name = Path(mutation["path"]), mutation["function"]
    numbers = [k for k, key in enumerate(names) if key == (mutation["path"], name)]
    of_module = [k for k, key in enumerate(names) if key[0] == mutation["path"]]
    of_folder = [k for k, key in enumerate(names) if Path(key[0]).parent == path.parent]
    for group in (numbers, of_module, of_folder):
        chosen = sorted({test for k in group for test in tests.get(k, ())})
        if chosen:
            break
    total, result = 0.0, []
    for seconds, test in chosen[:TESTS]:
        total += seconds
        if result and total > SECONDS:
            break
        result.append(test)
    return result


class FirstFailure:
    """A plugin of pytest that remembers the first test that failed."""

    name: str | None = None

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Remember a test."""
        if report.failed and self.name is None:
            self.name = report.nodeid

    pytest_collectreport = pytest_runtest_logreport


def attempt(mutation: Mutation, tests: list[str]) -> tuple[str, str | None]:
    """Outcome of tests on one mutation, in a process of its own, and the test that found it."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.setsid()
        os.close(read)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1), os.dup2(nowhere, 2)
        with tempfile.TemporaryDirectory(dir=WORK) as folder:
            os.environ["NUMBA_CACHE_DIR"] = folder  # callers of a compiled function keep it inside
            os.write(write, "\t".join(map(str, run_mutated(mutation, tests))).encode())
        os._exit(0)
    os.close(write)
    limit = time.monotonic() + 240.0 + 8.0 * SECONDS
    while time.monotonic() < limit:
        if os.waitpid(child, os.WNOHANG)[0]:
            with os.fdopen(read) as stream:
                code, _, name = stream.read().partition("\t")
            outcome = {"0": "survived", "1": "found", "2": "found", "": "crashed"}
            return outcome.get(code, f"exit {code}"), name or None
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "timed out", None


def run_mutated(mutation: Mutation, tests: list[str]) -> tuple[int, str | None]:
    """Exit code of pytest, and the first test that failed."""

    def changed(path: str, tree: ast.Module) -> ast.Module | None:
        if path != mutation["path"]:
            return None
        mutate(tree, mutation["function"], mutation["number"])
        return tree

    compile_from(changed)
    import pytest

    first = FirstFailure()
    quiet = ["-W", "ignore::pytest.PytestAssertRewriteWarning", "-p", "no:cacheprovider"]
    options = ["-x", "-q", *quiet, "-m", "not slow"]
    return int(pytest.main([*options, *tests], [first])), first.name


def work(part: int, parts: int) -> None:
    """Run each `parts`-th mutation from `part` on and append the outcomes to a file."""
    sys.path.remove(str(ROOT / "benchmarks"))  # which has a module `cip`
    for name in ("matplotlib.pyplot", "numba", "pyvista", "skfem", "sympy", "hypothesis", "osqp"):
        __import__(name)  # once for all processes
    tests = recorded()
    drawn = json.loads((WORK / "drawn.json").read_text())
    out = WORK / f"outcomes_{part}.jsonl"
    done = len(out.read_text().splitlines()) if out.exists() else 0
    with out.open("a") as stream:
        for mutation in drawn[part::parts][done:]:
            names, number = tests_of(mutation, tests), place_again(mutation)
            outcome, name = "not run" if names else "no test", None
            if number is not None and names:
                outcome, name = attempt(mutation | {"number": number}, names)
            stream.write(json.dumps(mutation | {"outcome": outcome, "test": name}) + "\n")
            stream.flush()


def main() -> None:
    """Record, draw or run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("command", choices=("record", "draw", "again", "work", "run"))
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--part", type=int, default=0)
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    os.chdir(ROOT)
    here = [sys.executable, __file__]
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(ROOT / "benchmarks")])
    environment = os.environ | one | {"PYTHONPATH": path, "RECORD_MUTATIONS": "1"}
    if options.command == "record":
        pytest = ["-m", "pytest", "-q", "-p", "mutations", "-n", str(options.processes)]
        more = ["--dist", "worksteal", "-m", "not slow"]
        subprocess.run([sys.executable, *pytest, *more], env=environment, check=False)
    elif options.command == "draw":
        (WORK / "drawn.json").write_text(json.dumps(draw(options.count), indent=1))
    elif options.command == "again":  # those of the last result
        drawn = json.loads(RESULT.read_text())["mutations"]
        (WORK / "drawn.json").write_text(json.dumps(drawn, indent=1))
    elif options.command == "work":
        work(options.part, options.processes)
    else:
        each = ["--processes", str(options.processes)]
        running = [
            subprocess.Popen([*here, "work", "--part", str(k), *each], env=environment)
            for k in range(options.processes)
        ]
        if any(process.wait() for process in running):
            sys.exit("a process failed")
        report()


def report() -> None:
    """Write all outcomes and print the share that was found."""
    found = [
        json.loads(line)
        for path in sorted(WORK.glob("outcomes_*.jsonl"))
        for line in path.read_text().splitlines()
    ]
    found.sort(key=lambda one: (one["path"], one["function"], one["number"], one["after"]))
    killed = [one for one in found if one["outcome"] in ("found", "crashed", "timed out")]
    summary = {"seed": SEED, "found": len(killed), "of": len(found)}
    RESULT.write_text(json.dumps(describe() | summary | {"mutations": found}, indent=1) + "\n")
    print(f"{len(killed)} of {len(found)} mutations found by the tests")


# As a plugin of pytest's processes, by `record`.
if os.environ.get("RECORD_MUTATIONS") and os.environ.get("PYTEST_XDIST_WORKER"):
    RECORDER = Recorder()

    def pytest_configure(config: Any) -> None:
        """Register the recorder in a process that runs tests."""
        config.pluginmanager.register(RECORDER)


if __name__ == "__main__":
    main()
