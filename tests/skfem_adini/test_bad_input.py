"""Each malformed input gives a typed error that names the argument."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementQuad1,
    ElementTriP1,
    ElementVector,
    ElementWedge1,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTri,
    MeshWedge1,
)

from skfem_adini import (
    AdiniError,
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    InputError,
    essential_constraints,
    essential_dofs,
    project_trace,
    save,
    to_pyvista,
)

MESH = MeshQuad().refined(1).with_defaults()
SCALAR = Basis(MESH, ElementQuadAdini())
VECTOR = Basis(MESH, ElementVector(ElementQuadAdini()))
Q1 = Basis(MESH, ElementQuad1())
BRICK = Basis(MeshHex().with_defaults(), ElementHexAdini())
ORDER = np.array([[0, 1, 2, 3]]).T


def cell(*corners):
    return MeshQuad(np.array(corners, float).T, ORDER, validate=False)


def basis(mesh):
    return Basis(mesh, ElementQuadAdini())


def curved(by=0.01):
    p = MeshQuad2().doflocs.copy()
    p[0, 8] += by
    return MeshQuad2(p)


def nan(x):
    return np.full(x.shape[1:], np.nan)


CASES = {
    "derivatives negative": (lambda: ElementQuadAdini(-1), "derivatives"),
    "derivatives too many": (lambda: ElementQuadAdini(7), "derivatives"),
    "derivatives fractional": (lambda: ElementQuadAdini(1.5), "derivatives"),
    "derivatives of bricks": (lambda: ElementHexAdini(8), "derivatives"),
    "derivatives of BFS": (lambda: ElementQuadBFS(-2), "derivatives"),
    "concave cell": (lambda: basis(cell((0, 0), (1, 0), (0.2, 0.2), (0, 1))), "convex"),
    "crossed cell": (lambda: basis(cell((0, 0), (1, 0), (0, 1), (1, 1))), "convex"),
    "flat cell": (lambda: basis(cell((0, 0), (1, 0), (2, 0), (3, 0))), "convex"),
    "three corners": (lambda: basis(cell((0, 0), (1, 0), (1, 1), (1, 1))), "convex"),
    "straight corner": (lambda: basis(cell((0, 0), (1, 0), (2, 0), (0, 1))), "convex"),
    "NaN vertex": (lambda: basis(cell((0, 0), (1, 0), (1, np.nan), (0, 1))), "convex"),
    "curved cells": (lambda: basis(curved()), "straight-sided"),
    "curved bricks": (
        lambda: Basis(MeshHex2(MeshHex2().p + 0.01 * np.eye(3, 27, 20)), ElementHexAdini()),
        "1 of 1 cells of the MeshHex2 are curved",
    ),
    "NaN midpoint": (lambda: basis(curved(np.nan)), "straight-sided"),
    "triangles": (lambda: basis(MeshTri()), "Incompatible Mesh and Element"),
    "unknown boundary": (lambda: essential_dofs(SCALAR, "lid"), "lid.*bottom"),
    "empty facets": (lambda: essential_dofs(SCALAR, np.array([], dtype=int)), "empty"),
    "empty callable": (lambda: essential_dofs(SCALAR, lambda x: x[0] > 9), "empty"),
    "facet out of range": (lambda: essential_dofs(SCALAR, np.array([99])), "0 to 11"),
    "boolean facets": (lambda: essential_dofs(SCALAR, np.ones(12, dtype=bool)), "whole numbers"),
    "facets of no kind": (lambda: essential_dofs(SCALAR, 1.5), "facets"),
    "another element": (lambda: essential_dofs(Q1, "left"), "ElementQuadAdini"),
    "faces out of range": (lambda: essential_dofs(BRICK, np.array([6])), "0 to 5"),
    "no face": (lambda: essential_constraints(BRICK, lambda x: x[0] > 9), "empty"),
    "NaN on faces": (lambda: essential_constraints(BRICK, "left", nan), "NaN"),
    "trace NaN on faces": (lambda: project_trace(BRICK, "left", nan), "NaN"),
    "scalar basis, two components": (lambda: project_trace(BRICK, "left", (1, 2)), "expected 1"),
    "brick field too short": (lambda: to_pyvista(BRICK, np.zeros(5)), "length 32"),
    "component out of range": (lambda: essential_dofs(VECTOR, "left", components=2), "components"),
    "no components": (lambda: essential_constraints(VECTOR, "left", components=[]), "components"),
    "NaN value": (lambda: essential_constraints(SCALAR, "left", np.nan), "NaN"),
    "NaN function": (lambda: essential_constraints(SCALAR, "left", nan), "NaN"),
    "value of wrong shape": (
        lambda: essential_constraints(VECTOR, "left", lambda x: x[0]),
        "shape",
    ),
    "too many components": (lambda: essential_constraints(VECTOR, "left", (1, 2, 3)), "expected 2"),
    "text value": (lambda: essential_constraints(SCALAR, "left", "zero"), "real number"),
    "complex value": (lambda: project_trace(SCALAR, "left", 1j), "real number"),
    "no boundaries": (lambda: essential_constraints(SCALAR, {}), "empty"),
    "trace of no edges": (lambda: project_trace(SCALAR, np.array([], dtype=int), 1.0), "empty"),
    "trace NaN": (lambda: project_trace(SCALAR, "left", nan), "NaN"),
    "field too short": (lambda: to_pyvista(SCALAR, np.zeros(5)), "length 27"),
    "complex field": (lambda: to_pyvista(SCALAR, 1j * SCALAR.zeros()), "real"),
    "subdivide zero": (lambda: to_pyvista(SCALAR, SCALAR.zeros(), subdivide=0), "subdivide"),
    "cell data too long": (
        lambda: to_pyvista(SCALAR, SCALAR.zeros(), cell_data={"c": np.zeros(5)}),
        "cell_data",
    ),
    "point data too long": (
        lambda: to_pyvista(SCALAR, SCALAR.zeros(), point_data={"c": np.zeros(5)}),
        "point_data",
    ),
    "composite basis": (
        lambda: to_pyvista(Basis(MESH, ElementQuad1() * ElementQuad1()), np.zeros(18)),
        "composite|scalar or vector",
    ),
    "unknown suffix": (lambda: save("field.png", SCALAR, {"u": SCALAR.zeros()}), "path"),
    "series without pvd": (lambda: save("a.vtu", SCALAR, [(0, {"u": SCALAR.zeros()})]), "pvd"),
    "empty series": (lambda: save("a.pvd", SCALAR, []), "non-empty"),
    "single field as series": (lambda: save("a.pvd", SCALAR, {"u": SCALAR.zeros()}), "pairs"),
    "wedges": (
        lambda: to_pyvista(Basis(MeshWedge1(), ElementWedge1()), np.zeros(6)),
        "cannot write",
    ),
    "fractional subdivide": (lambda: to_pyvista(Q1, Q1.zeros(), subdivide=1.5), "subdivide"),
    "three intervals in triangles": (
        lambda: to_pyvista(Basis(MeshTri(), ElementTriP1()), np.zeros(4), subdivide=3),
        "power of two",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    attempt, message = CASES[case]
    expected = ValueError if case == "triangles" else InputError
    with pytest.raises(expected, match=message):
        attempt()


def test_errors_share_one_base():
    assert issubclass(InputError, AdiniError)
    assert issubclass(InputError, ValueError)
