"""Every figure in the prose of README and docs has a source in docs/numbers.toml.

An entry names a page and a piece of its text, and where the numbers in this piece come from:

* ``values``, one list a number: a file of benchmarks/results and the keys to a value, which rounds
  to what is printed (per cent and a quotient with the value ``over`` are taken into account);
* ``test``, a test that asserts it: file::function;
* ``given``, why it is no measurement: a parameter of an example, a tolerance, a definition.

Tables between markers are written from the results, code is run: both are left out here.
"""

import json
import re
import tomllib
from decimal import Decimal
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENTRIES = tomllib.loads((ROOT / "docs" / "numbers.toml").read_text())["number"]
PAGES = ["README.md"] + [
    str(path.relative_to(ROOT))
    for path in sorted((ROOT / "docs").rglob("*.md"))
    if path.name != "changelog.md" and "generated" not in path.parts
]
# Decimal numbers, powers of ten, and whole numbers that count as measured by what is around them.
CLAIM = re.compile(
    r"(?<![\w.])(?:\d*\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+"
    r"|(?:(?<=factor of )|(?<=order )|(?<=orders )|(?<=orders are ))\d+"
    r"|\d+(?= ?%| times\b| x (?!\d)| m?s\b| seconds\b))(?!\.?\d)"
)
# What looks like one: numbers of tables, sections and equations, versions.
REFERENCE = (
    r"(?:[Tt]able|[Ff]igure|[Aa]lgorithm|[Ss]ection|Python)s? \d[.\d]*(?:(?:,| and| to) \d[.\d]*)*"
    r"|\(\d\.\d+\)"
)


def blank(match):
    """As many dots as there were characters."""
    return "·" * len(match[0])


@cache
def prose(page):
    """The page's text in one line, and the same with code, links and references blanked."""
    text = (ROOT / page).read_text()
    text = re.sub(r"<!-- (\w+): begin -->.*?<!-- \1: end -->", " ", text, flags=re.S)
    text = " ".join(re.sub(r"```.*?```", " ", text, flags=re.S).split())
    masked = text
    for pattern in (r"`[^`]*`", r"(?<=\])\([^)]*\)", r"<!--.*?-->", REFERENCE):
        masked = re.sub(pattern, blank, masked)
    return text, masked


def span(entry):
    """Where the entry's text stands on its page."""
    start = prose(entry["page"])[0].find(entry["text"])
    assert start >= 0, f"{entry['page']} no longer says: {entry['text']}"
    return start, start + len(entry["text"])


def value(path):
    """What stands under the keys of a results file."""
    name, *keys = path
    found = json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text())
    for key in keys:
        found = found[key]
    return found


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["text"][:40])
def test_an_entry_has_its_source(entry):
    start, end = span(entry)
    kinds = {"values", "test", "given"} & set(entry)
    assert len(kinds) == 1
    claims = list(CLAIM.finditer(prose(entry["page"])[1], start, end))
    assert claims, "there is no number in this text"
    if "test" in entry:
        file, function = entry["test"].split("::")
        assert f"def {function}(" in (ROOT / file).read_text()
    for claim, path in zip(claims, entry.get("values", ()), strict="values" in entry):
        found = value(path) / (value(entry["over"]) if "over" in entry else 1)
        percent = re.match(r" ?%", claim.string[claim.end() :])
        printed = Decimal(claim[0])
        measured = Decimal(repr(abs(float(found)) * (100 if percent else 1)))
        assert measured.quantize(Decimal(1).scaleb(printed.as_tuple().exponent)) == printed


@pytest.mark.parametrize("page", PAGES)
def test_every_number_has_an_entry(page):
    spans = [span(entry) for entry in ENTRIES if entry["page"] == page]
    masked = prose(page)[1]
    missing = [
        masked[max(0, claim.start() - 40) : claim.end() + 20]
        for claim in CLAIM.finditer(masked)
        if not any(start <= claim.start() and claim.end() <= end for start, end in spans)
    ]
    assert not missing


def test_numbers_are_found():
    """What counts as a claim, and what does not."""
    found = CLAIM.findall(
        "off by .6 %, 2.1e-9 and 1e-10, 3 times, 5 x as fast; 8 x 8 cells, n = 40"
    )
    assert found == [".6", "2.1e-9", "1e-10", "3", "5"]
    assert not CLAIM.findall("section 5.1.2, release 10.20.30")
