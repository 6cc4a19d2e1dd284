"""The reference of the site: every public name stands in it, once."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = ("skfem_adini", "contact", "cip", "gpu")
BLOCK = re.compile(r"^\.\. autosummary::\n +:toctree: generated\n\n((?: +\S+\n)+)", flags=re.M)


def entries(page: str) -> list[str]:
    """Names that a page of the reference lists."""
    text = (ROOT / "docs" / "api" / f"{page}.rst").read_text()
    return [name for block in BLOCK.findall(text) for name in block.split()]


def tree(package: str, module: str) -> ast.Module:
    """Syntax of a module: its public names are read, not imported."""
    return ast.parse((ROOT / package / f"{module}.py").read_text())


def exported(package: str) -> list[str]:
    """Names in `__all__`."""
    (names,) = (
        node.value
        for node in tree(package, "face" if package == "skfem_adini" else "__init__").body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    return list(ast.literal_eval(names))


def drawing(package: str) -> list[str]:
    """Public functions of the module `plot`."""
    if not (ROOT / package / "plot.py").exists():
        return []
    functions = (n for n in tree(package, "plot").body if isinstance(n, ast.FunctionDef))
    return [f"plot.{f.name}" for f in functions if not f.name.startswith("_")]


@pytest.mark.parametrize("page", PAGES)
def test_every_public_name_stands_there_once(page: str) -> None:
    assert sorted(entries(page)) == sorted(exported(page) + drawing(page))


def test_obstacles_stand_in_a_section_of_their_own() -> None:
    """`contact.obstacles` exports nothing by itself; its classes are names of `contact`."""
    page = (ROOT / "docs" / "api" / "contact.rst").read_text()
    section = page.partition("Obstacles\n---------\n")[2].partition("\n---")[0]
    names = {name for block in BLOCK.findall(section) for name in block.split()}
    imported = (
        {alias.name for alias in node.names}
        for node in tree("contact", "__init__").body
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("contact.obstacles")
    )
    assert names == set.union(*imported)


def test_pages_do_not_share_a_file_where_case_does_not_count() -> None:
    settings = (ROOT / "docs" / "conf.py").read_text()
    for page in PAGES:
        names = [name for name in entries(page) if f'"{page}.{name}":' not in settings]
        assert len({name.lower() for name in names}) == len(names)
