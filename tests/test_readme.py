"""The README and the performance page: code runs, tables are the committed measurements."""

import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def blocks(page: Path) -> list[str]:
    """Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S)


TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
# A block of the README and of the guide stands alone; those of a tutorial follow one another.
CODE = {
    f"{page.stem}-{k}": code
    for page in PAGES
    if page not in TUTORIALS
    for k, code in enumerate(blocks(page))
}
LESSONS = {page.stem: "\n".join(blocks(page)) for page in TUTORIALS if blocks(page)}


def run(name: str, code: str, capsys: pytest.CaptureFixture[str]) -> None:
    import matplotlib.pyplot as plt

    exec(compile(code, f"{name}.md", "exec"), {"__name__": name})
    plt.close("all")
    assert "False" not in capsys.readouterr().out


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somewhere to write, with the examples at hand."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(ROOT / "examples")


@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize("name", [name for name in CODE if name.startswith("README")])
def test_code_of_the_readme_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    run(name, CODE[name], capsys)


@pytest.mark.sampled(4)
@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize("name", [name for name in CODE if not name.startswith("README")])
def test_code_of_the_pages_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    if "petsc4py" in CODE[name]:
        pytest.importorskip("petsc4py", reason="the block is about PETSc")
    run(name, CODE[name], capsys)


# The build of the site, which CI makes each time, runs them all and fails where one does.
@pytest.mark.sampled(3)
@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize("name", LESSONS)
def test_tutorials_run(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    run(name, LESSONS[name], capsys)


def test_readme_is_short_and_its_first_result_as_long_as_promised() -> None:
    assert len(README.splitlines()) <= 120
    assert len(blocks(PAGES[0])) == 3
    assert len([line for line in blocks(PAGES[0])[0].splitlines() if line.strip()]) <= 15


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_and_files_that_pages_name_exist(page: Path) -> None:
    text = page.read_text()
    for link in re.findall(r"\]\(([^)#:]+)[^):]*\)", text):
        if "/out/" not in link:  # drawn while the site is built
            assert (page.parent / link).exists(), link
    for name in re.findall(r"`((?:examples|benchmarks|tests)/[\w/.]+?\.(?:py|json))`", text):
        assert (ROOT / name).exists(), name
    for name in re.findall(r"`(test_\w+\.py)`", text):
        assert list((ROOT / "tests").rglob(name)), name


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("performance_tables")


def test_tables_stand_on_a_page_and_come_from_the_results(tables) -> None:
    for page in tables.PAGES:
        assert tables.regenerated(page.read_text()) == page.read_text(), page
    pages = "".join(page.read_text() for page in tables.PAGES)
    assert set(re.findall(r"<!-- (\w+): begin -->", pages)) == set(tables.TABLES)
    record = json.loads((tables.RESULTS / "contact_block.json").read_text())
    record["rows"][0]["total"] = 1234.56
    assert "1234.56 s" in tables.contact_block(record)
    assert record["machine"]["commit"] in tables.contact_block(record)
