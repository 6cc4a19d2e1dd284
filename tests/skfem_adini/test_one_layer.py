"""Sparse systems are solved in one place, so that every part of the package gains from it."""

import ast
from pathlib import Path

import skfem_adini

MODULES = sorted(Path(skfem_adini.__file__).parent.glob("**/*.py"))
SOLVERS = {"splu", "spilu", "spsolve", "factorized", "cg", "gmres", "minres", "solve", "pypardiso"}
ALLOWED = {"factorize": {"splu"}, "multigrid": {"cg"}, "pardiso": {"pypardiso"}}


def test_solvers_are_imported_by_the_layer_alone():
    for path in MODULES:
        found = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found |= {alias.name for alias in node.names} | {(node.module or "").split(".")[0]}
        assert found & SOLVERS == ALLOWED.get(path.stem, set()), path
