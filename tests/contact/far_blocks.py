"""Blocks under rigid tools that move far."""

import numpy as np
from skfem import (
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshQuad,
)

from contact import Cylinder, ElasticBody, LoadStepper
from skfem_adini import ElementQuadAdini

F, R, BALL = 0.2, 0.8, 0.6
PLANE = (ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini)
LAWS = {"none": {}, "coulomb": {"friction": F}, "tresca": {"friction": 3e-3, "law": "tresca"}}


def block(element=ElementQuad1, n=20, shift=0.0, E=1.0, size=1.0):
    """A block from -1 to 1, with its upper side at zero, held at its lower one."""
    down = np.linspace(-0.5, 0, max(n // 4, 2) + 1)
    if element in PLANE:
        mesh = MeshQuad.init_tensor(np.linspace(-1, 1, n + 1) + shift, down)
        mesh = mesh.to_meshtri() if element in PLANE[:2] else mesh
    else:
        across = np.linspace(-0.5, 0.5, n // 2 + 1)
        mesh = MeshHex.init_tensor(np.linspace(-1, 1, n + 1), across, down)
        mesh = mesh.to_meshtet() if element is ElementTetP1 else mesh
    names = {"top": lambda x: x[-1] == 0, "bottom": lambda x: x[-1] == -0.5}
    mesh = mesh.with_boundaries(names).scaled(size)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3).fix("bottom")


ROLLER, AXLE = Cylinder((0, R), R), (0.0, R)


def run(problem, tool, times, **more):
    return LoadStepper(problem, sliding="finite", **more).obstacle(tool).run(times)
