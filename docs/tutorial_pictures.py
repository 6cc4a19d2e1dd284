"""Writes each tutorial as a notebook and runs it in `out/tutorials/<name>`, for its pictures.

A tutorial whose code is the same as at the last build is not run again.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import jupytext

ROOT = Path(__file__).resolve().parents[1]


def draw(app) -> None:
    """Run what is new; a tutorial that fails is an error of the build."""
    for page in sorted((Path(app.srcdir) / "tutorials").glob("*.md")):
        notebook = jupytext.read(page)
        code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
        folder = ROOT / "out" / "tutorials" / page.stem
        done = folder / "tutorial.py"
        if not code:
            continue
        notebooks = Path(app.outdir) / "_static" / "notebooks"
        notebooks.mkdir(parents=True, exist_ok=True)
        jupytext.write(notebook, notebooks / f"{page.stem}.ipynb")
        if done.exists() and done.read_text() == code:
            continue
        shutil.rmtree(folder, ignore_errors=True)  # a load history does not write over another
        folder.mkdir(parents=True)
        path = os.pathsep.join([str(ROOT / "examples"), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": path}
        subprocess.run(
            [sys.executable, "-"], input=code, text=True, cwd=folder, env=environment, check=True
        )
        done.write_text(code)


def link(app, docname: str, source: list[str]) -> None:
    """Put a link to the notebook below the title of a tutorial."""
    name = Path(docname).name
    if docname.startswith("tutorials/") and "```python" in source[0]:
        title, _, rest = source[0].partition("\n")
        at = f"../_static/notebooks/{name}.ipynb"
        source[0] = f'{title}\n\n<p><a href="{at}" download>As a notebook</a></p>\n{rest}'


def setup(app) -> dict:
    """Register with Sphinx."""
    app.connect("builder-inited", draw)
    app.connect("source-read", link)
    return {"parallel_read_safe": True}
