"""Results in space that can be turned in the page: each is a file of `out/`, shown by vtk.js.

pyvista writes them where its extension trame-pyvista is installed, as the extra `docs` does.
"""

import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
FRAME = """.. raw:: html

   <iframe class="scene" src="../_static/scenes/{name}.html" loading="lazy" title="{text}"></iframe>

*{text}: drag to turn, scroll to come nearer.*
"""


def stressed(grid, name="von Mises stress"):
    """A body as it is deformed, by von Mises' stress."""
    grid[name] = grid["nodal_von_mises"]
    shown = grid.warp_by_vector("displacement").extract_surface(algorithm="dataset_surface")
    return shown, {"scalars": name, "cmap": "viridis"}


def corner(grid):
    """What lies around the contact, seen from the planes of symmetry, the contact above."""
    near = grid.cell_centers().points.max(axis=1) < 3.0
    surface, look = stressed(grid.extract_cells(near))
    surface.points[:] *= (-1, 1, -1)
    return surface.flip_faces(), look


def pressed(grid):
    """The gap of a rough contact as a landscape, seen from the side that is pressed."""
    depth = grid["opening"].max() - grid["opening"]
    grid["height"] = 0.15 * depth / depth.max()
    shown = grid.warp_by_scalar("height").extract_surface(algorithm=None)
    return shown, {"scalars": "pressure", "cmap": "YlOrRd"}


SCENES: dict[str, tuple[str, Callable, str]] = {
    "surface_mesh": ("surface_mesh.vtu", stressed, "The block below the stamp, stress in MPa"),
    "validation_hertz_sphere": (
        "validation_hertz_sphere.vtu",
        corner,
        "The half space below the sphere, cut open in its planes of symmetry",
    ),
    "rough_surface": ("rough_surface.vti", pressed, "The gap, hills where it is closed, pressure"),
}


def scene(name: str, static: Path) -> str:
    """Write the scene of an example into a folder; return what its page shows of it."""
    if name not in SCENES or find_spec("trame_pyvista") is None:
        return ""
    import pyvista

    # Not needed for scenes, and would load a program from the net.
    sys.modules.setdefault("trame.widgets.vtklocal", None)  # type: ignore[arg-type]
    file, shape, text = SCENES[name]
    source, target = ROOT / "out" / file, static / "scenes" / f"{name}.html"
    if not source.exists():
        return ""
    if not target.exists() or os.path.getmtime(target) < os.path.getmtime(source):
        target.parent.mkdir(parents=True, exist_ok=True)
        plotter = pyvista.Plotter(off_screen=True)
        surface, look = shape(pyvista.read(source))
        kept = surface.copy()
        kept.clear_data()
        kept[look["scalars"]] = np.asarray(surface[look["scalars"]], dtype=np.float32)
        plotter.add_mesh(kept, show_scalar_bar=True, **look)
        plotter.trame.export_html(target)
        plotter.close()
    return FRAME.format(name=name, text=text)
