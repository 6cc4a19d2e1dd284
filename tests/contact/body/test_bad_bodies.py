"""What bodies refuse, by name: materials, supports, loads, links, heat, meshes, cut domains."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skfem import (
    Basis,
    ElementQuad1,
    ElementQuad2,
    ElementTriP1,
    ElementVector,
    MeshHex,
    MeshQuad,
    MeshTri,
)

from contact import (
    Anisotropic,
    ContactProblem,
    CutBody,
    DistributedBody,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadStepper,
    Orthotropic,
    Plane,
)
from skfem_adini import LevelSet

E, NU, G = (11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3)
WOOD, TILTED = (Orthotropic(E, NU, G, turn) for turn in (0.0, Rotation.from_euler("x", 0.3)))
MESH = MeshQuad().refined(2).with_defaults()
N = 2 * 25  # dofs of its Q1 elements
TIP = MeshTri(np.array([[0.0, 1.0, 1.0], [0.0, -1.0, 1.0]]), np.array([[0], [1], [2]]))


def flat(mesh=MESH, **more):
    more = {"E": 1.0, "nu": 0.3} | more if "material" not in more else more
    return ElasticBody.from_mesh(mesh, ElementQuad1(), **more)


def ring(mesh=MESH, **more):
    return flat(mesh, plane="axisymmetric", **more)


def circle(x):
    return x[0] ** 2 + x[1] ** 2 - 0.83**2


@cache
def disk():
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 6)] * 2).with_defaults()
    return CutBody(mesh, LevelSet(circle), E=1.0, nu=0.3, q=3)


def cut(mesh=MESH, level=circle, E=1.0, nu=0.3, **more):
    return CutBody(mesh, level, E, nu, **more)


@cache
def half():
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    return cut(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1)


def stiff(place, value):
    C = WOOD.C.copy()
    C[place] = value
    return C


def vectors(material):
    return ElasticBody(Basis(MESH, ElementVector(ElementQuad2())), material=material)


def spread(**more):
    return DistributedBody(MESH, ElementQuad1(), contact="bottom", E=1.0, nu=0.3, **more)


LAYERS, ASKEW = ((1.0, 1.0), [(1.0, 4, 1.0, 0.3)]), np.arange(9.0).reshape(3, 3)
MATERIALS = {
    "E of zero": (lambda: flat(E=0.0), "E="),
    "E NaN": (lambda: flat(E=np.nan), "E="),
    "E infinite": (lambda: flat(E=np.inf), "E="),
    "nu of a half": (lambda: flat(nu=0.5), "nu="),
    "nu of minus one": (lambda: flat(nu=-1), "nu="),
    "E alone": (lambda: ElasticBody.from_mesh(MESH, E=1.0), "E, nu"),
    "E of an axis": (lambda: Orthotropic((1, 2, 0), NU, G), "E="),
    "G below zero": (lambda: Orthotropic(E, NU, (1, -2, 1)), "G="),
    "nu12": (lambda: Orthotropic(E, (2.4, 0, 0), G), r"nu: nu12\*\*2 must be less than E1 / E2"),
    "nu23": (lambda: Orthotropic(E, (0, 0, 1.5), G), r"nu: nu23\*\*2"),
    "nu together": (lambda: Orthotropic((1, 1, 1), (0.9, 0.9, 0.9), G), "nu: nu12"),
    "two moduli": (lambda: Orthotropic((1, 2), NU, G), "E: expected three"),
    "moduli of other cells": (
        lambda: Orthotropic(np.ones((3, 3)), np.ones((2, 3)) / 9, G),
        "nu: shape",
    ),
    "C of five": (lambda: Anisotropic(np.eye(5)), "C: expected"),
    "C negative": (lambda: Anisotropic(-np.eye(6)), "C: must be positive definite"),
    "C askew": (lambda: Anisotropic(stiff((0, 1), 7.0)), "C: must be symmetric"),
    "no rotation": (lambda: Anisotropic(np.eye(6), rotation=np.ones((3, 3))), "rotation: expected"),
    "rotation by name": (lambda: Anisotropic(np.eye(6), rotation="z"), "rotation"),
    "two rotations": (lambda: Anisotropic([np.eye(6)] * 3, rotation=[0.1, 0.2]), "rotation: 2"),
    "material and E": (lambda: flat(material=WOOD, E=1.0, nu=0.3), "material: it takes"),
    "a matrix": (lambda: flat(material=np.eye(6)), "material: expected"),
    "mean dilatation of wood": (lambda: flat(material=WOOD, dilatation="mean"), "dilatation"),
    "axes out of the plane": (lambda: flat(material=TILTED), "material: in two dim"),
    "other cells": (lambda: flat(material=Anisotropic([np.eye(6)] * 3)), "material: it has 3"),
    "E of wood": (lambda: setattr(vectors(WOOD), "E", 2.0), "material: it takes"),
    "E once heated": (lambda: setattr(flat().heat(1.0, 1.0), "E", 2.0), "E: the body was heated"),
    "unknown dilatation": (lambda: flat(dilatation="b-bar"), "'pointwise' or 'mean'"),
    "mean of Q2": (
        lambda: ElasticBody.from_mesh(MESH, ElementQuad2(), E=1.0, nu=0.3, dilatation="mean"),
        "ElementQuad2",
    ),
    "back end": (lambda: spread(backend="amg"), "amg"),
    "multigrid": (lambda: spread(multigrid="ml"), "ml"),
    "temperature NaN": (lambda: flat().heat(np.nan, 1.0), "temperature: expected"),
    "vector of temperature": (lambda: flat().heat(lambda x: x, 1.0), "temperature: expected"),
    "hot": (lambda: flat().heat("hot", 1.0), "temperature"),
    "expansion infinite": (lambda: flat().heat(1.0, np.inf), "expansion: holds"),
    "two expansions": (lambda: flat().heat(1.0, (1.0, 2.0)), "expansion: expected"),
    "expansion askew": (lambda: flat().heat(1.0, ASKEW), "expansion: the tensor must be symm"),
    "heat of layers": (
        lambda: LoadStepper(ContactProblem(LayeredBlock(*LAYERS), "bottom", 0.0)).heat(1.0, 1.0),
        "heat: a LayeredBlock",
    ),
}
RINGS = {
    "negative radius": (lambda: ring(MESH.translated((-0.2, 0.0))), "x = -0.2"),
    "touches in a point": (
        lambda: ElasticBody.from_mesh(TIP, ElementTriP1(), E=1.0, nu=0.3, plane="axisymmetric"),
        "vertex 0",
    ),
    "load on the axis": (lambda: ring().load("left", (1.0, 0.0)), "axis x = 0"),
    "contact on the axis": (lambda: ContactProblem(ring(), "left", 0.0), "axis x = 0"),
    "moves on the axis": (lambda: ring().fix("left", "x", 0.1).constraint, "differ"),
    "to a plane": (lambda: setattr(ring(), "plane", "strain"), "make a new body"),
    "to a ring": (lambda: setattr(flat(), "plane", "axisymmetric"), "make a new body"),
    "in space": (
        lambda: ElasticBody.from_mesh(MeshHex(), E=1.0, nu=0.3, plane="axisymmetric"),
        "three dim",
    ),
    "layers": (lambda: LayeredBlock(*LAYERS, plane="axisymmetric"), "ElasticBody"),
    "spread": (lambda: spread(plane="axisymmetric"), "ElasticBody"),
    "cut": (lambda: cut(plane="axisymmetric"), "ElasticBody"),
    "periodic radii": (
        lambda: ring(MESH.translated((0.5, 0.0)).with_defaults()).periodic("left", "right"),
        "along its axis",
    ),
    "rigid boundary": (lambda: ring().tie("top", rigid=True), r"tie\(boundary, 'y'\)"),
    "twist": (lambda: ring(material=TILTED), "symmetry"),
}
LINKS = {
    "held apart": (
        lambda: flat().fix("left").fix("right").periodic("right", "left", 0.1).constraint,
        "supports",
    ),
    "two jumps": (
        lambda: flat().periodic("right", "left", 0.1).periodic("right", "left").constraint,
        "contra",
    ),
    "tied and apart": (
        lambda: flat().periodic("right", "left", 0.1).tie(["left", "right"]).constraint,
        "tie",
    ),
    "other side": (lambda: flat().periodic("right", "top"), "other: has no vertex"),
    "same side": (lambda: flat().periodic("right", "right"), "same place"),
    "jump NaN": (lambda: flat().periodic("right", "left", np.nan), "jump"),
    "three jumps": (lambda: flat().periodic("right", "left", (1.0, 2.0, 3.0)), "jump"),
    "no jump": (lambda: flat().periodic("right", "left", (None, None)), "jump"),
    "tie along z": (lambda: flat().tie("right", "z"), "components"),
    "rigid along x": (lambda: flat().tie("right", "x", rigid=True), "components"),
    "rigid of one": (lambda: flat().tie("right", rigid=1), "rigid"),
    "shape": (lambda: flat().constrain(np.ones((1, 3))), "C: expected the shape"),
    "no equation": (lambda: flat().constrain(np.zeros((1, N))), "C: an equation"),
    "contradiction": (lambda: flat().constrain(np.ones((2, N)), [0.0, 1.0]).constraint, "contra"),
    "two sides": (lambda: flat().constrain(np.ones((1, N)), [0.0, 1.0]), "c: expected"),
    "infinite": (lambda: flat().constrain(np.full((1, N), np.inf)), "finite"),
}
CUT = {
    "spacing": (lambda: disk().arc(spacing=0.0), "spacing"),
    "parts, a function": (lambda: disk().arc(lambda x: x[0] > 0), "parts: .* is where="),
    "empty": (lambda: disk().arc(where=lambda x: x[0] > 5), "where: holds on no point"),
    "not booleans": (lambda: disk().arc(where=lambda x: x[0]), "booleans"),
    "parts": (lambda: disk().arc(parts=7), "parts"),
    "functional": (lambda: ContactProblem(disk(), disk().arc(), 0.1, functional="gauss"), "hat"),
    "fix": (lambda: disk().fix(disk().arc()), "mesh lines"),
    "fix beyond": (
        lambda: half().fix("bottom"),
        "lies outside the level set; supports are on mesh",
    ),
    "plates": (lambda: ContactProblem(half(), half().arc(), [Plane((0, -1), (0, 1))]), "as many"),
    "cut facets": (lambda: disk().load("left", (1.0, 0.0)), "belongs to a cut cell"),
    "traction": (lambda: disk().load(disk().arc(), (1.0, 0.0, 0.0)), "traction"),
    "traction NaN": (lambda: disk().load(disk().arc(), (np.nan, 0.0)), "traction"),
    "gaps": (lambda: ContactProblem(disk(), disk().arc(), [0.1, 0.2]), "gaps given"),
    "gap NaN": (lambda: ContactProblem(disk(), disk().arc(), lambda x: x[0] * np.nan), "NaN"),
    "overlap": (lambda: ContactProblem(disk(), [disk().arc()] * 2, [0.1] * 2), "two contact"),
    "another body": (lambda: ContactProblem(disk(), cut().arc(), 0.1), "another body"),
    "from_mesh": (lambda: CutBody.from_mesh(MESH, E=1, nu=0), "CutBody"),
    "E of cells": (lambda: cut(E=[1.0, 2.0]), "E: expected a number or one value"),
    "E below zero": (lambda: cut(E=-1.0), "modulus"),
    "nu of a half": (lambda: cut(nu=0.5), "ratio"),
    "nothing inside": (lambda: cut(level=lambda x: x[0] + 9), "inside"),
    "heat": (lambda: cut().heat(1.0, 1.0), "heat: a CutBody"),
    "periodic": (lambda: half().periodic("right", "left"), "CutBody"),
    "tie": (lambda: cut().tie("top", "y"), "CutBody"),
    "constrain": (lambda: half().constrain(np.ones((1, half().basis.N))), "CutBody"),
}
CASES = {
    f"{kind}: {name}": case
    for kind, cases in {"material": MATERIALS, "ring": RINGS, "link": LINKS, "cut": CUT}.items()
    for name, case in cases.items()
}


@pytest.mark.parametrize("case", CASES)
def test_refused(case):
    call, words = CASES[case]
    with pytest.raises(InputError, match=words):
        call()


def test_what_is_refused_changes_nothing():
    body = flat()
    with pytest.raises(InputError, match="expansion"):
        body.heat(1.0, np.inf)
    assert body.thermal is None
    assert np.abs(body.f).max() == 0
