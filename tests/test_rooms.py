"""What is said of the rooms: the map in CONTRIBUTING.md, the files it names, the doors."""

import re
import runpy
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("skfem_adini", "contact", "cip", "gpu", "docs", "tests")


def test_contributing_maps_the_rooms_as_their_docstrings_do() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    with_map = runpy.run_path(str(ROOT / "docs" / "rooms.py"))["with_map"]
    assert text == with_map(text), "run `python docs/rooms.py`, which writes the map anew"


def test_contributing_names_files_that_exist() -> None:
    files = [path for folder in FOLDERS for path in (ROOT / folder).glob("**/*.py")]
    named = re.findall(r"`([\w/]+\.py)`", (ROOT / "CONTRIBUTING.md").read_text())
    assert named
    known = [str(path) for path in files]
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in known)] == []


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
        *("pardiso", "superlu", "vtk_files", "vertex_normals"),
        *("cudss", "cudss_schur", "cudss_library"),
        "device_triangle",
    }
