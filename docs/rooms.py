"""The map of rooms in docs/rooms.md, made of the docstrings of the rooms.

`python docs/rooms.py` writes it anew; a test holds that it is what the docstrings say. The order is
that in which data flow: the layers of import-linter's contracts from below, in pyproject.toml.
"""

from __future__ import annotations

import ast
import re
import textwrap
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- map of rooms: python docs/rooms.py -->\n", "<!-- end of the map -->\n"


def layers() -> dict[str, list[str]]:
    """What each package consists of, the lowest first, by the linter's contracts."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    return {
        container: [name for layer in reversed(c["layers"]) for name in re.findall(r"\w+", layer)]
        for c in settings["contracts"]
        if c["type"] == "layers"
        for container in c.get("containers", [])
    }


def entry(name: str, depth: int, order: dict[str, list[str]]) -> list[str]:
    """A module's line, and below it those of the rooms inside."""
    place = ROOT.joinpath(*name.split("."))
    is_room = place.is_dir()
    module = place / "__init__.py" if is_room else place.with_suffix(".py")
    doc = ast.get_docstring(ast.parse(module.read_text())) or ""
    text = " ".join(doc.split()) if is_room and depth else doc.splitlines()[0]
    text = re.sub(r":\w+:`", "`", text)  # roles of reStructuredText, on a page in Markdown
    indent = 2 * (depth - 1) * " "
    line = f"{indent}- `{name.split('.')[-1]}`: {text}" if depth else f"### {name}\n\n{text}\n"
    if depth:
        line = textwrap.fill(
            line,
            118,
            subsequent_indent=f"{indent}  ",
            break_on_hyphens=False,
            break_long_words=False,
        )
    rooms = sorted(p.parent.name for p in place.glob("*/__init__.py"))
    known = order.get(name, [])
    inside = [n for n in known if depth == 0 or n in rooms]
    inside += [n for n in rooms if n not in known]
    return [line, *(row for n in inside for row in entry(f"{name}.{n}", depth + 1, order))]


def rooms() -> str:
    """The map of the four packages."""
    order = layers()
    packages = ("skfem_adini", "contact", "cip", "gpu")
    return "\n\n".join("\n".join(entry(name, 0, order)) for name in packages) + "\n"


def with_map(text: str) -> str:
    """A text with the map of today between its two marks."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{rooms()}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    page = ROOT / "docs" / "rooms.md"
    page.write_text(with_map(page.read_text()))
