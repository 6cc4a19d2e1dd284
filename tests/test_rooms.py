"""What is said of the rooms: the map on the site, the files that are named, the doors."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "rooms.md").read_text()
FOLDERS = ("skfem_adini", "contact", "cip", "gpu", "docs", "tests", "benchmarks")


def test_the_page_maps_the_rooms_as_their_docstrings_do() -> None:
    with_map = runpy.run_path(str(ROOT / "docs" / "rooms.py"))["with_map"]
    assert with_map(PAGE) == PAGE, "run `python docs/rooms.py`, which writes the map anew"


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/rooms.md"])
def test_files_that_are_named_exist(page: str) -> None:
    files = [f"/{path}" for folder in FOLDERS for path in (ROOT / folder).glob("**/*.py")]
    named = re.findall(r"`([\w/]+\.py)`", (ROOT / page).read_text())
    assert named
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in files)] == []


def test_what_the_page_finds_is_there() -> None:
    found = re.findall(r"`(\w+)` in `([\w/]+\.py)`", PAGE.split("\n## ")[1])
    assert len(found) >= 5
    for name, file in found:
        assert re.search(rf"^(def|class) {name}\b", (ROOT / file).read_text(), re.MULTILINE), name


def test_contributing_is_short_and_knows_the_rule_of_subjects() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    assert len(text.encode()) <= 5000
    assert "at most 72 characters" in text


def test_every_module_of_skfem_adini_and_gpu_is_entered_by_the_face_or_by_a_door() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    closed, *doors = [
        c["protected_modules"] for c in settings["contracts"] if c["type"] == "protected"
    ]
    rooms_with_doors = {name for names in doors for name in names}
    for package in ("skfem_adini", "gpu"):
        places = {
            f"{package}.{p.stem}" for p in (ROOT / package).glob("[a-z]*") if p.suffix != ".typed"
        } - {"skfem_adini.ground"}
        assert places <= set(closed) | rooms_with_doors
    found = {
        f"{room}.{path.stem}"
        for room in rooms_with_doors
        for path in ROOT.joinpath(*room.split(".")).glob("[a-z]*.py")
    }
    assert {name.rpartition(".")[2] for name in found - set(closed)} == {
        *("factorize", "trace_directions"),
        *("cudss", "cudss_library"),
        "device_triangle",
    }
