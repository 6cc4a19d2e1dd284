"""Bodies that a device condenses, held, floating, cut and in contact with each other."""

import numpy as np
from skfem import ElementHex1, ElementQuad1, ElementTetP2, ElementTriP2, MeshQuad

from contact import ContactProblem, CutBody, ElasticBody, Orthotropic, Plane
from contact.arrays.dense_arrays import DeviceMatrix, HostArrays
from contact.arrays.sparse_rows import SparseRows
from skfem_adini import ElementQuadAdini


class Elsewhere(HostArrays):
    """The host's arrays in the place of a device's."""

    def matrix(self, W):
        return DeviceMatrix(self, W)

    def values(self, W):
        return W.values

    def room(self):
        return 2**40

    def rows(self, matrix):
        rows = SparseRows(matrix)
        rows.placed = matrix.indptr, matrix.indices, matrix.data
        return rows


def box_body(make, element, cells=None, **material):
    dim = element().dim
    ticks = [np.linspace(0.0, 1.0, 1 + (cells or (3 if dim == 3 else 8)))] * dim
    return ElasticBody.from_mesh(make.box(element, *ticks), element(), **material)


def held(make, element, unit=1.0, cells=None):
    body = box_body(make, element, cells, E=2.0 * unit, nu=0.3)
    last = "xyz"[body.dim - 1]
    body.fix("top", last, -0.05).fix("top", "x", lambda x: 0.02 + 0.01 * x[0])
    return ContactProblem(body, "bottom", bowl, 0.3)


def pushed(make, element):
    """A block pressed and pushed at its end, where supports prescribe the slip."""
    body = box_body(make, element, E=2.0, nu=0.3)
    body.fix("top", "xyz"[body.dim - 1], -0.05).fix("left", "x", 0.04)
    if body.dim == 3:
        body.fix("front", "y", 0.01)
    return ContactProblem(body, "bottom", 0.0, 0.3)


def bowl(x):
    return 0.04 * np.sum((x[:-1] - 0.45) ** 2, axis=0)


def floating(make, element):
    """Pressed down on rigid ground by its load; contact and friction alone hold it."""
    body = box_body(make, element, E=2.0, nu=0.3)
    down = np.zeros(body.dim)
    down[-1], down[0] = -0.1, 0.01
    return ContactProblem(body.load("top", tuple(down)), "bottom", 0.0, 0.5)


def nearly_incompressible(make, element):
    body = box_body(make, element, E=2.0, nu=0.4999, dilatation="mean")
    return ContactProblem(body.fix("top", "y", -0.05).fix("top", "x"), "bottom", bowl, 0.3)


def turned_wood(make, element):
    """A third of it with its axes turned by another angle."""
    dim, cells = element().dim, 8 if element().dim == 2 else 4
    angles = np.where(np.arange(cells**dim) % 3, 0.4, -0.7)
    wood = Orthotropic((11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3), rotation=angles)
    body = box_body(make, element, cells, material=wood)
    body.fix("top", "xyz"[:dim], -0.03)
    return ContactProblem(body, "bottom", bowl, 0.3)


def cut(make, element):
    """A disk, cut out of a grid that ends inside it."""
    mesh = MeshQuad.init_tensor(np.linspace(-1.2, 1.2, 13), np.linspace(-1.2, 0.0, 7))
    disk = CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)
    disk.fix("top", "x").fix("top", "y", -0.05)
    return ContactProblem(disk, disk.arc(), Plane((0.0, -1.02), (0.0, 1.0)), 0.3)


def pair(make, element):
    """A block pressed and dragged on another, each with a stiffness of its own."""
    dim = element().dim
    ticks = [np.linspace(0.0, 1.0, 4 if dim == 3 else 6)] * (dim - 1)
    low, high = (
        ElasticBody.from_mesh(
            make.box(element, *ticks, np.linspace(z, z + 1.0, 4)), element(), E=E, nu=0.3
        )
        for z, E in ((0.0, 1.0), (1.0, 3.0))
    )
    high.fix("top", "xyz"[dim - 1], -0.05).fix("top", "x", 0.01)
    if dim == 3:
        high.fix("top", "y")
    return ContactProblem(high, "bottom", low.fix("bottom").surface("top"), 0.3)


CASES = {
    "pair of Quad1": (pair, ElementQuad1),
    "pair of Hex1": (pair, ElementHex1),
    "Adini": (held, ElementQuadAdini),
    "P2": (held, ElementTriP2),
    "Hex1": (held, ElementHex1),
    "TetP2": (held, ElementTetP2),
    "pushed Adini": (pushed, ElementQuadAdini),
    "pushed Hex1": (pushed, ElementHex1),
    "floating Adini": (floating, ElementQuadAdini),
    "floating Quad1": (floating, ElementQuad1),
    "floating Hex1": (floating, ElementHex1),
    "turned wood": (turned_wood, ElementQuadAdini),
    "turned bricks of wood": (turned_wood, ElementHex1),
    "cut": (cut, ElementQuadAdini),
    "mean dilatation": (nearly_incompressible, ElementQuad1),
}
