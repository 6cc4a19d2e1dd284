"""Runs the code of each tutorial in `out/tutorials/<name>`, where its pictures are then found.

A tutorial whose code is the same as at the last build is not run again.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def draw(app) -> None:
    """Run what is new; a tutorial that fails is an error of the build."""
    for page in sorted((Path(app.srcdir) / "tutorials").glob("*.md")):
        code = "\n".join(re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S))
        folder = ROOT / "out" / "tutorials" / page.stem
        done = folder / "tutorial.py"
        if not code or (done.exists() and done.read_text() == code):
            continue
        shutil.rmtree(folder, ignore_errors=True)  # a load history does not write over another
        folder.mkdir(parents=True)
        path = os.pathsep.join([str(ROOT / "examples"), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": path}
        subprocess.run(
            [sys.executable, "-"], input=code, text=True, cwd=folder, env=environment, check=True
        )
        done.write_text(code)


def setup(app) -> dict:
    """Register with Sphinx."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True}
