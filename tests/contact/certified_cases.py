"""Problems of every family of bodies, laws and condensations, whose certificates are compared."""

import numpy as np
from families import CURVED, PLANE, PLANE_AND_BFS, SOLID
from pressed_pairs import PROBLEMS
from rings import ring
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTetP2, ElementTriP2

from contact import (
    ContactProblem,
    ElasticBody,
    LayeredBlock,
    Orthotropic,
    PressureOverclosure,
    Rigid,
)
from contact.checks.paired_bodies import paired_body
from contact.checks.recheck import PairedResiduals
from skfem_adini import ElementHexAdini, ElementQuadAdini
from tests.contact.condensation.device_cases import CASES as HELD

WOOD = Orthotropic(E=(3.0, 1.0, 2.0), nu=(0.2, 0.1, 0.15), G=(0.6, 0.5, 0.7))
COATED = [(0.25, 2, 1.0, 0.4), (0.75, 3, 10.0, 0.3)]


def square(make, n, element=ElementQuad1):
    mesh = make.box(element, *[np.linspace(0, 1, n + 1)] * 2)
    return ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)


def shrunk(make, element, curved=False):
    return ContactProblem(ring(make, element, 4, curved), "left", -0.01, 0.2)


def layered(*more, **options):
    block = LayeredBlock(1.0, COATED, *more, **options).fix("top", "y", -0.03)
    return ContactProblem(block, "bottom", lambda x: 0.05 * (x[0] - 0.4) ** 2, 0.3)


def waves(sides, element=None):
    block = LayeredBlock((1.0, 1.2), COATED, sides, "xy", cells=(4, 5), element=element)
    block.fix("top", "z", -0.03)
    return ContactProblem(block, "bottom", lambda x: 0.4 * ((x[:2] - 0.5) ** 2).sum(axis=0), 0.3)


def disk_on_axis(make):
    mesh = make.box(ElementQuad1, np.linspace(0, 1, 7), np.linspace(0, 0.5, 4))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=2.0, nu=0.3, plane="axisymmetric")
    return ContactProblem(body.fix("top", "y", -0.02), "bottom", lambda x: 0.02 * x[0] ** 2, 0.3)


def slender(make, element, **material):
    """Cells a thousand times as wide as high; forces come from their strains."""
    solid = element in SOLID
    across, up = np.linspace(0, 1, 4 if solid else 7), np.linspace(0, 2e-3, 3) / 3
    mesh = make.box(element, *([across] * (2 if solid else 1)), up)
    material = {"E": 2.0, "nu": 0.3} | material if "material" not in material else material
    body = ElasticBody.from_mesh(mesh, element(), **material)
    traction = (0.02, 0.0, -0.1) if solid else (0.02 * (not body.is_ring), -0.1)
    return ContactProblem(body.load("top", traction), "bottom", 0.0, 0.4)


def on_curve(make):
    law = PressureOverclosure([0.0, 0.1, 0.5], [0.0, 0.01, 0.02])
    return ContactProblem(make.block(4), "bottom", 0.0, 0.3, overclosure=law)


def stamped(make):
    body = make.block(4, sides=()).fix("top", "y").fix("left", "x")
    stamp = Rigid(0.0, force=(None, 0.1), moment=0.0, centre=(0.5, 0.0))
    return ContactProblem(body, "bottom", stamp, 0.3)


def heated(make):
    body = make.block(4, ElementQuad2, sides=()).fix("left", "x")
    return ContactProblem(body.heat(lambda x: 10 * x[1], 1e-3), "bottom", 0.0, 0.3)


def fibres(make):
    mesh = make.box(ElementQuadAdini, *[np.linspace(0, 1, 5)] * 2)
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), material=WOOD)
    return ContactProblem(body.fix("top", "xy", -0.01), "bottom", 0.0, 0.3)


def linked(make):
    body = make.block(4, ElementQuad1, sides=()).periodic("right", "left")
    return ContactProblem(body, "bottom", lambda x: 0.01 * (1 + np.cos(6.3 * x[0])), 0.3)


CASES = {
    **{e.__name__: lambda make, e=e: make.problem(4, 0.3, element=e) for e in PLANE_AND_BFS},
    **{e.__name__: lambda make, e=e: make.dome(e, 2) for e in SOLID},
    **{
        f"curved {e.__name__}": lambda make, e=e: shrunk(make, e, e in CURVED)
        for e in (*PLANE, ElementHexAdini, ElementTetP2)
    },
    **{f"several: {name}": lambda make, p=p: p() for name, p in PROBLEMS.items()},
    **{f"held: {name}": lambda make, p=p: p[0](make, p[1]) for name, p in HELD.items()},
    "Tresca": lambda make: make.problem(4, 0.02, "tresca"),
    "Tresca in space": lambda make: make.dome(ElementHex1, 3, 0.01, "tresca"),
    "no friction": lambda make: make.problem(4, 0.0, None, element=ElementTriP2),
    "layers": lambda make: layered("x"),
    "mirrored layers": lambda make: layered("x", columns=6, path="fourier"),
    "periodic layers": lambda make: layered("periodic", columns=6),
    "waves in space": lambda make: waves(("periodic", "x")),
    "waves of Adini bricks": lambda make: waves("periodic", ElementHexAdini()),
    "axisymmetric": disk_on_axis,
    "slender": lambda make: slender(make, ElementQuadAdini),
    "slender, mean dilatation": lambda make: slender(make, ElementQuad1, dilatation="mean"),
    "slender, triangles": lambda make: slender(make, ElementTriP2),
    "slender bricks": lambda make: slender(make, ElementHex1),
    "slender, anisotropic": lambda make: slender(make, ElementQuad2, material=WOOD),
    "slender ring": lambda make: slender(make, ElementQuad2, plane="axisymmetric"),
    "slender ring, mean dilatation": lambda make: slender(
        make, ElementQuad1, plane="axisymmetric", dilatation="mean"
    ),
    "compliant": on_curve,
    "driven": stamped,
    "heated": heated,
    "anisotropic": fibres,
    "periodic": linked,
}


def in_pairs(result):
    """The residuals, whatever their size."""
    return PairedResiduals(result, [paired_body(body) for body in result.system.body.bodies]).all()
