"""The reproduction page holds every table, figure and algorithm, with the numbers of the runs."""

import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "reproduction.md").read_text()


@pytest.fixture
def script(monkeypatch):
    """Import a script of benchmarks/."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module


@pytest.fixture
def record(script):
    return json.loads((script("performance_tables").RESULTS / "reproduce.json").read_text())


def test_everything_stands_on_the_page_once(script):
    places = script("dissertation").PLACES
    headings = re.findall(r"^## ((?:Table|Figure|Algorithm) [\w.]+), (.+?):", PAGE, flags=re.M)
    assert headings == list(places.items())
    for name in places:
        marker = name.lower().replace(" ", "_").replace(".", "_")
        section = PAGE.split(f"## {name}, ")[1].split("\n## ")[0]
        assert f"<!-- {marker}: begin -->" in section, name


def test_places_are_complete(script):
    """Nine tables, eighteen figures and seven algorithms, numbered without a gap."""
    names = list(script("dissertation").PLACES)
    counts = {"Table": {2: 3, 5: 4, 6: 2}, "Figure": {2: 7, 3: 3, 5: 6, 6: 1}}
    expected = {
        f"{kind} {chapter}.{k + 1}"
        for kind, chapters in counts.items()
        for chapter, count in chapters.items()
        for k in range(count)
    } | {"Figure A.1", *(f"Algorithm {k}" for k in range(1, 8))}
    assert len(names) == len(set(names)) == 34
    assert set(names) == expected


def test_checks_tell_the_errata_from_their_corrections(script, record):
    checks = script("errata").CHECKS
    named = [check for *_, check in script("errata_list").ERRATA if check]
    assert sorted(named) == sorted(checks)
    for name, check in checks.items():
        printed, right = check()
        assert printed > 0.03 > 1e-7 > right, name
        assert printed == pytest.approx(record["errata"][name][0], rel=1e-4), name


@pytest.mark.parametrize("name", ["element", "characteristics", "algorithms"])
def test_quick_runs_give_the_committed_numbers(name, script, record):
    for item, found in getattr(script("reproduction_runs"), name)().items():
        for key, value in found.items():
            old = record[item][key]
            if isinstance(value, dict):  # products until convergence hang on the last bit
                assert value == pytest.approx(old, rel=0.2)
            else:  # counts, and errors near rounding, which have no digits to keep
                assert abs(value - old) < 1e-5


def test_coarse_eigenvalues_are_the_committed_ones(script, record):
    runs = script("reproduction_runs")
    found = runs.eigenvalue_tables((4, 8, 16))
    for table in ("Table 5.1", "Table 5.2"):
        for mode, row in found[table].items():
            for n, error in row.items():
                assert error == pytest.approx(record[table][mode][n], rel=1e-4)
    for n, errors in runs.disk((8,))["Table 5.4"]["extension"].items():
        assert errors == pytest.approx(record["Table 5.4"]["extension"][n], rel=1e-3)
