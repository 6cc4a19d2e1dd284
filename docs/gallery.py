"""Writes one page for each script in `examples/`: its docstring, the pictures it drew, its code.

Pictures are those in `out/` whose names stand in the script, so `make examples` comes first;
without them the pages have no pictures.
"""

import ast
import re
from pathlib import Path

from sphinx.util import logging

ROOT = Path(__file__).resolve().parents[1]
INDEX = """Examples
========

Each is a script of one screen that runs in seconds: ``python examples/<name>.py --help``.

.. toctree::
   :maxdepth: 1

{pages}
"""
PAGE = """{title}
{line}

{text}

{pictures}

.. literalinclude:: {script}
   :language: python
   :lines: {code}-
   :caption: examples/{name}.py
"""


def docstring(source: str) -> tuple[str, str, int]:
    """Split a script into its first sentence, the text below it, and the first line of its code."""
    tree = ast.parse(source)
    title, _, rest = (ast.get_docstring(tree) or "").partition("\n\n")
    # Indented blocks are commands and formulas: literal, whatever ended the line before.
    text = re.sub(r"\n\n((?: {4}.*(?:\n|$))+)", r"\n\n::\n\n\1", "\n\n" + rest)
    # |x| is an absolute value here; reStructuredText knows it as a substitution.
    lines = (l if l.startswith("    ") else l.replace("|", r"\|") for l in text.splitlines())
    code = (tree.body[0].end_lineno or 0) + 2
    return " ".join(title.split()).rstrip("."), "\n".join(lines), code


def write(app) -> None:
    """Generate `docs/gallery/*.rst`."""
    folder = Path(app.srcdir) / "gallery"
    folder.mkdir(exist_ok=True)
    scripts = sorted((ROOT / "examples").glob("*.py"))
    drawn = 0
    for script in scripts:
        source = script.read_text(encoding="utf-8")
        named = re.findall(r'"(\w+\.(?:png|gif))"', source)
        found = [name for name in dict.fromkeys(named) if (ROOT / "out" / name).exists()]
        drawn += len(found)
        title, text, code = docstring(source)
        page = PAGE.format(
            title=title,
            line="=" * len(title),
            text=text,
            code=code,
            pictures="\n".join(f".. image:: ../../out/{name}" for name in found),
            script=f"../../examples/{script.name}",
            name=script.stem,
        )
        (folder / f"{script.stem}.rst").write_text(page, encoding="utf-8")
    pages = "\n".join(f"   {script.stem}" for script in scripts)
    (folder / "index.rst").write_text(INDEX.format(pages=pages), encoding="utf-8")
    logging.getLogger(__name__).info(f"gallery: {len(scripts)} examples, {drawn} pictures")


def setup(app) -> dict:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
