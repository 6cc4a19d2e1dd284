"""Writes one page for each script in `examples/`: its docstring, the pictures it drew, its code.

The index shows the scripts in groups, contact first, each by a small copy of its first picture.
Pictures are those in `out/` whose names stand in the script, so `make examples` comes first;
without them the pages have no pictures.

This is less than sphinx-gallery would need here: it runs the scripts again in the build, wants a
folder for each group, and would have to be told where the pictures lie that a script saves.
"""

import ast
import re
from pathlib import Path

from scenes import scene
from sphinx.util import logging

ROOT = Path(__file__).resolve().parents[1]
GROUPS = {
    "Contact": "contact_part contact_block rubber hardness surface_mesh rolling rough_surface "
    "cut_hertz layered_block bumper_mesh contact_impact adhesion hard_surface wear_pin "
    "identify_friction punch_shape",
    "Bodies that touch each other": "lap_joint ironing press_fit validation_two_cylinders "
    "shrink_fit tied_meshes hot_contact",
    "Contact beside closed forms": "validation_axisymmetric validation_cattaneo "
    "validation_far_field validation_flat_punch validation_hertz_line validation_hertz_sphere "
    "validation_membrane validation_order validation_periodic half_space",
    "Elements": "poisson_adini eigenvalues plate bending hanging_nodes shape_functions open_vtk",
    "Curved domains": "curved_2012",
    "Transport": "cip_zalesak cip_jiang_shu cip_deformation cip_dissertation cip_two_dimensions "
    "cip_week cip_lyapunov cip_level_set cip_regional cip_sphere",
    "Data assimilation": "identify_velocity cip_sensors cip_ash cip_gain cip_ensemble",
    "Quadratic programs and eigenvalues": "qp_mpc qp_penalty qp_sqp eigs_spectrum gpu_appendix",
    "Regulators": "heat_skfem heat_control heat_model",
}
FRONT = ("cut_hertz", "plate", "cip_zalesak", "heat_control")
INDEX = """Examples
========

Each is a script of one screen: ``python examples/<name>.py --help``.

{groups}
"""
PAGE = """{title}
{line}

{text}

{pictures}

{scene}
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


def card(folder: Path, name: str, title: str, picture: str, at: str = "") -> str:
    """Return a small picture that links to the page of a script."""
    from PIL import Image

    (folder / "small").mkdir(exist_ok=True)
    with Image.open(ROOT / "out" / picture) as image:
        small = image.convert("RGB")
    small.thumbnail((640, 420))
    small.save(folder / "small" / f"{name}.png")
    return (
        f"   .. figure:: {at}small/{name}.png\n      :target: {at}{name}.html\n"
        f"      :alt: {name}\n\n      {title}\n"
    )


def group(
    title: str, names: list[str], pages: dict[str, tuple[str, list[str]]], folder: Path
) -> str:
    """Return a section of the index: scripts with a picture as cards, the others as a list."""
    drawn = [name for name in names if pages[name][1]]
    lines = [title, "-" * len(title), ""]
    if drawn:
        cards = (card(folder, name, pages[name][0], pages[name][1][0]) for name in drawn)
        lines += [".. container:: cards", "", *cards]
    lines += [f"* :doc:`{name}`" for name in names if name not in drawn]
    lines += ["", ".. toctree::", "   :hidden:", "", *(f"   {name}" for name in names), ""]
    return "\n".join(lines)


def write(app) -> None:
    """Generate `docs/gallery/*.rst`."""
    folder = Path(app.srcdir) / "gallery"
    folder.mkdir(exist_ok=True)
    pages = {}
    for script in sorted((ROOT / "examples").glob("*.py")):
        source = script.read_text(encoding="utf-8")
        named = re.findall(r'"(\w+\.(?:png|gif))"', source)
        found = [name for name in dict.fromkeys(named) if (ROOT / "out" / name).exists()]
        title, text, code = docstring(source)
        pages[script.stem] = (title, found)
        page = PAGE.format(
            title=title,
            line="=" * len(title),
            text=text,
            code=code,
            scene=scene(script.stem, Path(app.outdir) / "_static"),
            pictures="\n".join(f".. image:: ../../out/{name}" for name in found),
            script=f"../../examples/{script.name}",
            name=script.stem,
        )
        (folder / f"{script.stem}.rst").write_text(page, encoding="utf-8")
    groups = {title: names.split() for title, names in GROUPS.items()}
    grouped = {name for names in groups.values() for name in names}
    for name in grouped ^ set(pages):
        logging.getLogger(__name__).warning(f"gallery: {name} is in no group, or no script")
    known = {title: [name for name in names if name in pages] for title, names in groups.items()}
    sections = "\n".join(group(title, names, pages, folder) for title, names in known.items())
    (folder / "index.rst").write_text(INDEX.format(groups=sections), encoding="utf-8")
    front = [name for name in FRONT if name in pages and pages[name][1]]
    cards = (card(folder, name, pages[name][0], pages[name][1][0], "gallery/") for name in front)
    text = "\n".join((".. container:: cards", "", *cards)) if front else ""
    (folder / "front.rst").write_text(text, encoding="utf-8")


def setup(app) -> dict:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
