"""Elements the contact tests run over, and the meshes of each: straight cells and curved ones."""

import numpy as np
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
)

from contact import CutBody
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

PLANE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
SOLID = [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini]
PLANE_AND_BFS = [*PLANE, ElementQuadBFS]  # those of rectangles too
STRAIGHT = {
    ElementTriP1: MeshTri,
    ElementTriP2: MeshTri,
    ElementQuad1: MeshQuad,
    ElementQuad2: MeshQuad,
    ElementQuadAdini: MeshQuad,
    ElementQuadBFS: MeshQuad,
    ElementTetP1: MeshTet,
    ElementTetP2: MeshTet,
    ElementHex1: MeshHex,
    ElementHex2: MeshHex,
    ElementHexAdini: MeshHex,
}
CURVED = {
    ElementTriP1: MeshTri2,
    ElementTriP2: MeshTri2,
    ElementQuad1: MeshQuad2,
    ElementQuad2: MeshQuad2,
    ElementTetP1: MeshTet2,
    ElementTetP2: MeshTet2,
    ElementHex1: MeshHex2,
    ElementHex2: MeshHex2,
}


def box(element, *ticks):
    """Tensor mesh of a rectangle or a box with named sides, for the element's cell shape."""
    mesh = STRAIGHT[element].init_tensor(*(np.asarray(t, dtype=float) for t in ticks))
    last = mesh.dim() - 1

    def side(axis, i):
        value = ticks[axis][i]
        return lambda x: np.abs(x[axis] - value) < 1e-9 * np.ptp(ticks[axis])

    sides = {"left": side(0, 0), "right": side(0, -1), "bottom": side(last, 0)}
    sides |= {"top": side(last, -1)}
    if last == 2:
        sides |= {"front": side(1, 0), "back": side(1, -1)}
    return mesh.with_boundaries(sides)


def mapped(element, ticks, place=None, curved=False):
    """A box whose places are mapped, of straight or of curved cells, its names kept."""
    mesh = box(element, *ticks)
    names = dict(mesh.boundaries)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    x = mesh.doflocs if place is None else place(mesh.doflocs)
    return type(mesh)(x, mesh.t, sort_t=False).with_boundaries(names)


def half_disk(cells=(11, 6), **material):
    """The lower half of the unit disk, cut out of a grid that ends at its diameter, "top"."""
    ticks = np.linspace(-1.1, 1.1, cells[0] + 1), np.linspace(-1.1, 0, cells[1] + 1)
    mesh, material = MeshQuad.init_tensor(*ticks).with_defaults(), {"E": 1.0, "nu": 0.3} | material
    return CutBody(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 1, **material)


def turn(angle):
    """Rotation in the plane."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
