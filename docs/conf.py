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
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "myst_parser",
    "numpydoc",
    "gallery",
    "tutorial_pictures",
    "sphinx_copybutton",
]
# The extra `docs` brings MathJax along; without it a browser loads it from the net.
extensions += [name for name in ["sphinx-mathjax-offline"] if find_spec(name)]
exclude_patterns = ["_build", "gallery/front.rst", "paper.md", "upstream"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
templates_path = ["_templates"]
copybutton_exclude = ".linenos, .gp, .go"  # prompts and output
default_role = "py:obj"  # a name in single backticks links to its page of the reference
# One page a name; these two would be one file where case does not count.
autosummary_filename_map = {"contact.uniqueness": "contact.uniqueness-function"}
numpydoc_show_class_members = False  # each class's page lists them with their docstrings
suppress_warnings = ["ref.python"]  # attributes of one name in several classes
autodoc_typehints = "none"  # the docstrings give types with shapes and units
autodoc_member_order = "groupwise"
html_theme = "furo"
html_title = f"skfem-adini {release}"
html_static_path = ["_static"]
html_show_copyright = False
html_css_files = ["site.css"]
