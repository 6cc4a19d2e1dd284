"""Sphinx settings: README as the guide, the packages' docstrings, and the examples as a gallery."""

import sys
from importlib.metadata import version as _version
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
]
exclude_patterns = ["_build"]
napoleon_google_docstring = False
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]  # attributes of one name in several classes
autodoc_typehints = "none"  # the docstrings give types with shapes and units
autodoc_member_order = "groupwise"
html_theme = "furo"
html_title = f"skfem-adini {release}"
