"""The README and the performance page: code runs, tables are the committed measurements."""

import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", README, flags=re.S)


@pytest.mark.parametrize("code", BLOCKS, ids=range(len(BLOCKS)))
def test_code_runs(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert "False" not in capsys.readouterr().out


def test_first_result_is_as_long_as_promised() -> None:
    assert len([line for line in BLOCKS[0].splitlines() if line.strip()]) <= 15


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("performance_tables")


def test_tables_come_from_the_results(tables) -> None:
    for page in tables.PAGES:
        assert tables.regenerated(page.read_text()) == page.read_text(), page


def test_every_table_stands_on_a_page(tables) -> None:
    pages = "".join(page.read_text() for page in tables.PAGES)
    assert set(re.findall(r"<!-- (\w+): begin -->", pages)) == set(tables.TABLES)


def test_a_table_follows_its_results(tables) -> None:
    record = json.loads((tables.RESULTS / "contact_block.json").read_text())
    record["rows"][0]["total"] = 1234.56
    assert "1234.56 s" in tables.contact_block(record)
    assert record["machine"]["commit"] in tables.contact_block(record)
