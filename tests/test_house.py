"""The house: which package may import what, and when."""

import ast
import importlib
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("skfem_adini", "contact", "cip", "gpu")
MODULES = [path for package in PACKAGES for path in sorted((ROOT / package).glob("**/*.py"))]
STANDARD_SCIENTIFIC = {"numpy", "scipy"}
# At import time. Everything else third-party is imported where it is used.
GROUND = "skfem_adini.ground"  # all stand on it, and it on none of ours
ALLOWED = {
    "skfem_adini": STANDARD_SCIENTIFIC | {"skfem", "skfem_adini", GROUND},
    GROUND: STANDARD_SCIENTIFIC | {GROUND},
    "contact": STANDARD_SCIENTIFIC | {"skfem", "skfem_adini", "gpu", "contact", GROUND},
    "cip": STANDARD_SCIENTIFIC | {"cip", GROUND},
    "gpu": STANDARD_SCIENTIFIC | {"gpu", GROUND},
}
LAZY = {
    *("numba", "cupy", "pyvista", "meshio", "matplotlib", "qpsolvers", "pypardiso", "osqp"),
    *("pyamg", "xarray", "threadpoolctl", "tqdm", "zarr"),
}


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def _owner(module: str) -> str:
    return GROUND if module.startswith(GROUND) else module.split(".")[0]


def _imports(tree: ast.AST, top_level_only: bool) -> set[str]:
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            inside = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typing_only = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test)
            if top_level_only and (inside or typing_only):
                continue
            if isinstance(child, ast.Import):
                found.update(_owner(alias.name) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                found.add("" if child.level else _owner(child.module or ""))
            visit(child)

    visit(tree)
    return found


def _beyond(package: str, found: Callable[[ast.AST], set[str]]) -> dict[str, set[str]]:
    """What files of a package import that they may not: file -> names."""
    beyond = {
        str(path.relative_to(ROOT)): found(_tree(path)) - ALLOWED[package]
        for path in ROOT.joinpath(*package.split(".")).glob("**/*.py")
    }
    return {path: names for path, names in beyond.items() if names}


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_at_import_time(package: str) -> None:
    ours = sys.stdlib_module_names | {""}
    assert _beyond(package, lambda tree: _imports(tree, top_level_only=True) - ours) == {}


@pytest.mark.parametrize("package", ALLOWED)
def test_arrows_go_one_way(package: str) -> None:
    ours = {*PACKAGES, GROUND, "examples", "benchmarks", "tests"}
    assert _beyond(package, lambda tree: _imports(tree, top_level_only=False) & ours) == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_import_leaves_optional_packages_alone(package: str) -> None:
    code = f"import sys; from {package} import *; print(*sys.modules)"
    output = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    loaded = {name.split(".")[0] for name in output.split()}
    # scikit-fem itself imports meshio.
    assert loaded & LAZY <= {"meshio"}
    assert package in ("skfem_adini", "contact") or "skfem" not in loaded
    # A quarter of the time; SciPy loads what is written as scipy.spatial.KDTree where it is used.
    assert not {"scipy.optimize", "scipy.spatial"} & set(output.split())


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_typed_and_exports_what_it_says(package: str) -> None:
    assert (ROOT / package / "py.typed").is_file()
    module = importlib.import_module(package)
    for name in getattr(module, "__all__", []):
        assert hasattr(module, name)


# Of all that solve sparse systems, by the modules of skfem_adini that import them.
SOLVERS = {"splu", "spilu", "spsolve", "factorized", "cg", "gmres", "minres", "solve", "pypardiso"}
ONE_LAYER = {"factorize": {"splu"}, "multigrid": {"cg"}, "pardiso": {"pypardiso"}}


def test_sparse_systems_are_solved_by_one_layer() -> None:
    for path in ROOT.joinpath("skfem_adini").glob("**/*.py"):
        found = set()
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.Import | ast.ImportFrom):
                found |= {alias.name.split(".")[0] for alias in node.names}
                found.add((getattr(node, "module", None) or "").split(".")[0])
        assert found & SOLVERS == ONE_LAYER.get(path.stem, set()), path


def test_modules_hold_one_concept() -> None:
    for path in MODULES:
        assert len(path.read_text().splitlines()) <= 800, path
        assert path.stem not in {"utils", "helpers", "common", "misc"}, path


# Modules below 150 lines that only one other imports, faces not counted, and why they stay alone.
ALONE = {
    "skfem_adini.ground.progress": "the one door to tqdm, for whoever has a loop of steps",
    "cip.sphere.kernels": "kernels that numba compiles, imported where they run",
    "contact.condensation.bisection": "kernels that numba compiles, imported where they run",
    "contact.nonlinear.arc_length": "its stepper would pass 800 lines with it",
    "gpu.qp.active_set.dual_device": "the door to one CUDA kernel, imported where a device is",
    "skfem_adini.assembly.affine_kernels": "kernels that numba compiles, imported where they run",
}


def test_small_modules_serve_several_others() -> None:
    """Or are imported by the face of their package, or say why they stand alone."""
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in MODULES}
    users: dict[str, set[str]] = {name: set() for name in names}
    for user, path in names.items():
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.ImportFrom):
                found = {str(node.module), *(f"{node.module}.{part.name}" for part in node.names)}
                for name in found & set(names) - {user}:
                    users[name].add(user)
    alone = {
        name
        for name, path in names.items()
        if len(users[name]) == 1 and len(path.read_text().splitlines()) < 150
        if not next(iter(users[name])).endswith(("__init__", ".face"))
    }
    assert alone == set(ALONE)


def test_functions_fit_on_a_page() -> None:
    """At most 60 lines of body, what stands in them and comments included, the docstring not."""
    longer = {}
    for path in MODULES:
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[ast.get_docstring(node) is not None :] or node.body
                lines = (body[-1].end_lineno or 0) - body[0].lineno + 1
                if lines > 60:
                    longer[f"{path.relative_to(ROOT)}:{node.name}"] = lines
    assert longer == {}
