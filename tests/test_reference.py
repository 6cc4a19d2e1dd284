"""The reference of the site: every public name stands in it, once."""

import re
from pathlib import Path

import public_names
import pytest

import contact

ROOT = Path(__file__).parents[1]
PAGES = ("skfem_adini", "contact", "cip", "gpu")
BLOCK = re.compile(r"^\.\. autosummary::\n +:toctree: generated\n\n((?: +\S+\n)+)", flags=re.M)


def entries(page: str) -> list[str]:
    """Names that a page of the reference lists."""
    text = (ROOT / "docs" / "api" / f"{page}.rst").read_text()
    return [name for block in BLOCK.findall(text) for name in block.split()]


@pytest.mark.parametrize("page", PAGES)
def test_every_public_name_stands_there_once(page: str) -> None:
    names = public_names.all_of_them()
    assert sorted(f"{page}.{name}" for name in entries(page)) == sorted(
        name for name in names if name.startswith(f"{page}.")
    )


def test_obstacles_stand_in_a_section_of_their_own() -> None:
    """`contact.obstacles` exports nothing by itself; its classes are names of `contact`."""
    page = (ROOT / "docs" / "api" / "contact.rst").read_text()
    section = page.partition("Obstacles\n---------\n")[2].partition("\n---")[0]
    names = {name for block in BLOCK.findall(section) for name in block.split()}
    homes = {name: getattr(contact, name).__module__ for name in contact.__all__}
    assert names == {name for name, home in homes.items() if home.startswith("contact.obstacles")}


def test_pages_do_not_share_a_file_where_case_does_not_count() -> None:
    settings = (ROOT / "docs" / "conf.py").read_text()
    for page in PAGES:
        names = [name for name in entries(page) if f'"{page}.{name}":' not in settings]
        assert len({name.lower() for name in names}) == len(names)
