r"""Open a field in pyvista, exact to the last digit.

An Adini function is a polynomial of degree 3 in each reference coordinate, so a 16-node Lagrange
quadrilateral holds it exactly:

    u(X, Y) = sum_ij u(i/3, j/3) l_i(X) l_j(Y),   l_i the cubic Lagrange polynomials.

`save` writes one such cell for each mesh cell. This script opens a .vtu or .vtk file in pyvista;
with no file it first writes the interpolant of sin(2 pi x) cos(pi y) on 3 x 3 cells, and its
picture.

    python examples/open_vtk.py [file] [--screenshot picture.png]
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import pyvista as pv
from skfem import Basis, MeshQuad

from skfem_adini import ElementQuadAdini, save


def write_field(path):
    """Write sin(2 pi x) cos(pi y) on 3 x 3 cells."""
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 4)] * 2), ElementQuadAdini())
    x, y = 2 * np.pi * basis.mesh.p[0], np.pi * basis.mesh.p[1]
    u = np.empty(basis.N)
    u[basis.nodal_dofs] = [
        np.sin(x) * np.cos(y),
        2 * np.pi * np.cos(x) * np.cos(y),
        -np.pi * np.sin(x) * np.sin(y),
    ]
    return save(path, basis, {"u": u})


def picture(grid, screenshot=None):
    """Show the first point field, vectors by their length; off screen when a file is given."""
    plotter = pv.Plotter(off_screen=screenshot is not None)
    surface = grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=4)
    name = grid.point_data.keys()[0]
    bar = {"title": f"{name}, arbitrary units", "vertical": True, "position_x": 0.87, "fmt": "%.2f"}
    plotter.add_mesh(surface, scalars=name, lighting=False, scalar_bar_args=bar)
    plotter.add_mesh(grid.extract_all_edges(), color="black", line_width=1)
    if np.ptp(grid.points[:, 2]) == 0:
        plotter.view_xy()
    plotter.show_bounds(xtitle="x", ytitle="y", ztitle="z", fmt="%g", font_size=10)
    plotter.show(screenshot=screenshot)


def has_display():
    """Tell whether a window can open."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())


def main(argv=()):
    """Return the number of cells, the VTK cell type, and the range of the first field."""
    parser = argparse.ArgumentParser(description="open a .vtu or .vtk file in pyvista")
    parser.add_argument("file", nargs="?", help="without it, an Adini field is written to out/")
    parser.add_argument("--screenshot", help="write this picture instead of opening a window")
    arguments = parser.parse_args(list(argv))
    path = arguments.file or write_field("out/adini_field.vtu")
    grid = pv.read(path)
    name = grid.point_data.keys()[0]
    low, high = grid.get_data_range(name)
    kind = int(grid.celltypes[0])
    print(f"{path}: {grid.n_cells} cells of VTK type {kind}, {name} from {low:.6f} to {high:.6f}")
    if not arguments.file:
        picture(grid, Path("out") / "open_vtk.png")
    if arguments.screenshot or has_display():
        picture(grid, arguments.screenshot)
    else:
        print("no display: pass --screenshot picture.png to render off screen")
    return grid.n_cells, kind, low, high


if __name__ == "__main__":
    main(sys.argv[1:])
