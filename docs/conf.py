"""Sphinx settings: pages, tutorials that are run, a gallery of examples, and docstrings."""

import sys
from importlib.metadata import version as _version
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "skfem-adini"
author = "The skfem-adini developers"
release = version = _version("skfem-adini")
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "myst_parser",
    "gallery",
    "tutorial_pictures",
]
# The extra `docs` brings MathJax along; without it a browser loads it from the net.
extensions += [name for name in ["sphinx-mathjax-offline"] if find_spec(name)]
exclude_patterns = ["_build", "gallery/front.rst"]
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]  # attributes of one name in several classes
autodoc_typehints = "none"  # the docstrings give types with shapes and units
autodoc_member_order = "groupwise"
html_theme = "furo"
html_title = f"skfem-adini {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
