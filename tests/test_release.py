"""What a release says of itself in several places agrees, and its citation can be read."""

import ast
import re
import tomllib
from datetime import date
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = (ROOT / "CITATION.cff").read_text()


def _of_citation(key: str) -> str:
    found = re.findall(rf"^{key}: *(.+)$", CITATION, flags=re.MULTILINE)
    assert len(found) == 1, key
    return found[0].strip('"')


@pytest.mark.parametrize("package", ["skfem_adini", "contact", "cip", "gpu"])
def test_packages_have_the_version_of_the_project(package: str) -> None:
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    given = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__version__"
    ]
    assert given == [PROJECT["version"]]


def test_the_citation_and_the_changelog_are_of_this_version() -> None:
    version, released = _of_citation("version"), _of_citation("date-released")
    assert version == PROJECT["version"]
    assert date.fromisoformat(released)
    headings = re.findall(r"^## \[(.+?)\](.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[:2] == [("Unreleased", ""), (version, f" - {released}")]


def test_the_citation_holds_what_its_format_requires() -> None:
    """Citation File Format 1.2.0: four required keys, and known kinds of things."""
    keys = re.findall(r"^([a-z-]+):", CITATION, flags=re.MULTILINE)
    assert len(keys) == len(set(keys))
    assert {"cff-version", "message", "title", "authors"} <= set(keys)
    assert set(keys) <= {
        *("cff-version", "message", "type", "title", "abstract", "authors", "version", "doi"),
        *("date-released", "license", "keywords", "references", "url", "repository-code"),
    }
    assert _of_citation("cff-version") == "1.2.0"
    assert _of_citation("type") == "software"
    assert _of_citation("license") == PROJECT["license"]
    assert re.search(r"^authors:\n  - (name|family-names): ", CITATION, flags=re.MULTILINE)


def test_the_places_that_the_project_names_exist() -> None:
    assert [place for place in PROJECT["urls"].values() if not (ROOT / place).is_file()] == []


@pytest.mark.parametrize("package", ["skfem_adini", "contact", "cip", "gpu"])
def test_hints_to_install_ask_for_what_the_project_asks_for(package: str) -> None:
    """A bound or an extra in a message is the project's own, and so grows with it."""
    text = "".join(path.read_text() for path in sorted((ROOT / package).rglob("*.py")))
    bounds = set(re.findall(r"pip install '([\w-]+[<>=]+[\d.]+)'", text))
    extras = set(re.findall(r"skfem-adini\[(\w+)\]", text))
    assert bounds <= set(PROJECT["dependencies"])
    assert extras <= set(PROJECT["optional-dependencies"])


def test_the_paper_cites_what_its_bibliography_holds() -> None:
    cited = set(re.findall(r"\[@(\w+)\]", (ROOT / "docs" / "paper.md").read_text()))
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "docs" / "paper.bib").read_text(), re.MULTILINE)
    assert cited
    assert sorted(cited) == sorted(entries)
