"""Whatever is given to a public function, it answers or raises an InputError; nothing else.

Matrices of bad values times the arguments that take them. NaN is never accepted in silence.
"""

import numpy as np
import pytest
import scipy.sparse as sp
from skfem import Basis, ElementQuad1, ElementVector, MeshHex, MeshQuad
from skfem.models.poisson import laplace

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadAdiniCut,
    ElementQuadAdiniWeighted,
    ElementQuadBFS,
    FieldLevelSet,
    InputError,
    Polygon,
    cut_quadrature,
    essential_constraints,
    essential_dofs,
    ghost_penalty,
    hanging_constraints,
    near_null_space,
    nitsche,
    nodal_gradient,
    nodal_stress,
    project_trace,
    refined_at_boundary,
    save,
    to_pyvista,
    von_mises,
)

ADINI = ElementQuadAdini()
MESH = MeshQuad().refined(2).with_defaults()
SCALAR, VECTOR = Basis(MESH, ADINI), Basis(MESH, ElementVector(ElementQuadAdini(1)))
GRID = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)


def phi(x):
    return x[0] ** 2 + x[1] ** 2 - 0.6


DOMAIN = CutDomain(GRID, phi)
ON_GRID = Basis(GRID, ADINI)
CURVE = DOMAIN.boundary(ADINI)
VECTOR_CURVE = DOMAIN.boundary(ElementVector(ElementQuadAdini(1)))
EXTENSION = AdiniExtension(ON_GRID, DOMAIN)
STIFFNESS = DOMAIN.assemble(laplace, ADINI)
T, X0 = essential_constraints(SCALAR)
WEIGHTED = Basis(GRID, ElementQuadAdiniWeighted(lambda x: -phi(x), lambda x: -2 * x))
NOT_A_NUMBER = np.nan * T


def refused(call, *arguments):
    with pytest.raises(InputError):
        call(*arguments)


VECTORS = {
    "nan": np.full(SCALAR.N, np.nan),
    "one nan": np.where(np.arange(SCALAR.N) == 3, np.nan, 0.0),
    "inf": np.full(SCALAR.N, -np.inf),
    "too short": np.zeros(3),
    "column": np.zeros((SCALAR.N, 1)),
    "none": None,
    "text": "u",
    "objects": np.array([None] * SCALAR.N),
    "complex": 1j * np.ones(SCALAR.N),
    "ragged": [[1, 2], [3]],
    "matrix": laplace.assemble(SCALAR),
}
OF_VECTORS = {
    "nodal_gradient": lambda x: nodal_gradient(SCALAR, x),
    "to_pyvista": lambda x: to_pyvista(SCALAR, x),
    "to_pyvista named": lambda x: to_pyvista(SCALAR, {"u": x}),
    "FieldLevelSet": lambda x: FieldLevelSet(SCALAR, x),
    "hanging x0": lambda x: hanging_constraints(SCALAR, (T, x)),
    "von_mises": von_mises,
    "value of constraints": lambda x: essential_constraints(SCALAR, None, x),
    "value of trace": lambda x: project_trace(SCALAR, None, x),
    "value of nitsche": lambda x: nitsche(CURVE, x),
    "coefficient": lambda x: nitsche(CURVE, coefficient=x),
    "load": lambda x: EXTENSION.load(None if x is VECTORS["complex"] else x),
    "solve": lambda x: EXTENSION.solve(STIFFNESS, None if x is VECTORS["complex"] else x),
    "expand": lambda x: EXTENSION.expand(None if x is VECTORS["complex"] else x),
    "apply": EXTENSION.apply,
}


@pytest.mark.parametrize("what", VECTORS)
@pytest.mark.parametrize("call", OF_VECTORS)
def test_vectors(call, what):
    refused(OF_VECTORS[call], VECTORS[what])


@pytest.mark.parametrize("what", [key for key in VECTORS if key != "column"])
@pytest.mark.parametrize("suffix", ["vtu", "vtk", "pvd"])
def test_files_are_not_written(tmp_path, suffix, what):
    """Of a series not even the first step, which is sound."""
    good, bad = {"u": SCALAR.zeros()}, VECTORS[what]
    path = tmp_path / f"field.{suffix}"
    if suffix == "pvd":
        refused(save, path, SCALAR, [(0.0, good), (1.0, {"u": bad})])
        if bad is not None:
            refused(save, path, SCALAR, [(0.0, good), (1.0, good, {"s": bad})])
    else:
        refused(save, path, SCALAR, {"u": bad})
        for data in ("point_data", "cell_data"):
            with pytest.raises(InputError, match=data):
                save(path, SCALAR, good, **{data: {"s": bad}})
    assert not list(tmp_path.iterdir())


def test_the_message_says_which_entry():
    with pytest.raises(InputError, match=r"x\['u'\]: 1 of 75 entries are NaN.*nan at \(3,\)"):
        to_pyvista(SCALAR, VECTORS["one nan"])


BASES = {
    "none": None,
    "text": "u",
    "mesh": MESH,
    "element": ADINI,
    "Q1": Basis(MESH, ElementQuad1()),
}
OF_BASES = {
    "essential_dofs": essential_dofs,
    "essential_constraints": essential_constraints,
    "hanging_constraints": hanging_constraints,
    "near_null_space": near_null_space,
    "project_trace": lambda basis: project_trace(basis, None, 1.0),
    "nodal_gradient": lambda basis: nodal_gradient(basis, np.zeros(25)),
    "nodal_stress": lambda basis: nodal_stress(basis, np.zeros(25), 1.0, 0.3),
    "AdiniExtension": lambda basis: AdiniExtension(basis, DOMAIN),
    "domain": lambda domain: AdiniExtension(ON_GRID, domain),
    "nitsche": nitsche,
    "ghost_penalty": lambda domain: ghost_penalty(domain, ADINI),
    "to_pyvista": lambda basis: to_pyvista(basis, np.zeros(7)),
    "save": lambda basis: save("never.vtu", basis, {"u": np.zeros(7)}),
    "series": lambda basis: save("never.pvd", basis, [(0.0, {"u": np.zeros(7)})]),
}


@pytest.mark.parametrize("what", BASES)
@pytest.mark.parametrize("call", OF_BASES)
def test_bases(call, what):
    refused(OF_BASES[call], BASES[what])


@pytest.mark.parametrize(
    "call",
    [
        essential_dofs,
        essential_constraints,
        near_null_space,
        lambda basis: nodal_gradient(basis, basis.zeros()),
        lambda basis: project_trace(basis, None, 1.0),
    ],
)
def test_dofs_of_a_weighted_element_are_not_those_of_u(call):
    with pytest.raises(InputError, match="u over the weight"):
        call(WEIGHTED)


OTHERS = {
    "components a fraction": lambda: essential_dofs(VECTOR, "left", components=0.9),
    "components truth": lambda: essential_dofs(VECTOR, "left", components=True),
    "components ragged": lambda: essential_dofs(VECTOR, "left", components=[[0], [0, 1]]),
    "facets of objects": lambda: essential_dofs(SCALAR, np.array([None, 1])),
    "facets NaN": lambda: essential_constraints(SCALAR, np.array([np.nan])),
    "hanging T alone": lambda: hanging_constraints(SCALAR, T),
    "hanging three": lambda: hanging_constraints(SCALAR, (T, X0, 0)),
    "hanging T NaN": lambda: hanging_constraints(SCALAR, (NOT_A_NUMBER, X0)),
    "hanging T dense": lambda: hanging_constraints(SCALAR, (T.toarray(), X0)),
    "dofs NaN": lambda: near_null_space(SCALAR, NOT_A_NUMBER),
    "dofs ragged": lambda: near_null_space(SCALAR, [[1, 2], [3]]),
    "A NaN": lambda: EXTENSION.apply(STIFFNESS * np.nan),
    "A of another size": lambda: EXTENSION.apply(sp.eye_array(4)),
    "A NaN in solve": lambda: EXTENSION.solve(STIFFNESS * np.nan, np.zeros(STIFFNESS.shape[0])),
    "law NaN": lambda: nodal_stress(VECTOR, VECTOR.zeros(), law=lambda g: g * np.nan),
    "law a number": lambda: nodal_stress(VECTOR, VECTOR.zeros(), law=1),
    "law nothing": lambda: nodal_stress(VECTOR, VECTOR.zeros(), law=lambda g: None),
    "plane stress in 3-D": lambda: nodal_stress(
        Basis(MeshHex(), ElementVector(ElementHexAdini(1))), np.zeros(96), 1.0, 0.3, "stress"
    ),
    "E complex": lambda: nodal_stress(VECTOR, VECTOR.zeros(), 1j, 0.3),
    "E NaN": lambda: nodal_stress(VECTOR, VECTOR.zeros(), np.nan, 0.3),
    "von Mises NaN": lambda: von_mises(np.full((3, 3, 4), np.nan)),
    "corners complex": lambda: cut_quadrature(phi, [[0j], [0]], [[1], [1]]),
    "corners text": lambda: cut_quadrature(phi, "a", "b"),
    "corners ragged": lambda: cut_quadrature(phi, [[0], [0, 1]], [[1], [1]]),
    "polygon text": lambda: Polygon("abc"),
    "polygon ragged": lambda: Polygon([[0, 1], [0]]),
    "polygon complex": lambda: Polygon([[0, 1, 1j], [0, 0, 1]]),
    "element of a cut domain": lambda: DOMAIN.assemble(laplace, None),
    "class of an element": lambda: DOMAIN.basis(ElementQuadAdini),
    "element of other cells": lambda: DOMAIN.boundary(ElementHexAdini()),
    "form a function": lambda: DOMAIN.assemble(lambda u, v, _: u * v, ADINI),
    "no form": lambda: DOMAIN.assemble(None, ADINI),
    "where a number": lambda: refined_at_boundary(GRID, phi, where=1),
    "where NaN": lambda: refined_at_boundary(GRID, phi, where=lambda x: x[0] * np.nan),
    "where nothing": lambda: refined_at_boundary(GRID, phi, where=lambda x: None),
    "where of coordinates": lambda: refined_at_boundary(GRID, phi, where=lambda x: x > 0),
    "lame NaN": lambda: nitsche(VECTOR_CURVE, lame=(np.nan, 1.0)),
    "lame text": lambda: nitsche(VECTOR_CURVE, lame=("a", "b")),
    "2012 without a function": lambda: ElementQuadAdiniCut(GRID, 1.0),
    "2012 of wrong shape": lambda: ElementQuadAdiniCut(GRID, lambda x: x),
    "2012 complex": lambda: ElementQuadAdiniCut(GRID, lambda x: 1j * x[0]),
    "orders of a list": lambda: ElementQuadAdini([1]),
    "orders of an array": lambda: ElementQuadBFS(np.array([1, 2])),
    "orders NaN": lambda: ElementHexAdini(np.nan),
    "Hessian of a weighted element": lambda: WEIGHTED.basis[0][0].hess,
    "no path": lambda: save(None, SCALAR, {"u": SCALAR.zeros()}),
    "path of bytes": lambda: save(b"a.vtu", SCALAR, {"u": SCALAR.zeros()}),
    "no fields": lambda: save("a.vtu", SCALAR, None),
    "numbers as names": lambda: save("a.vtu", SCALAR, {1: SCALAR.zeros()}),
    "no series": lambda: save("a.pvd", SCALAR, None),
    "text as series": lambda: save("a.pvd", SCALAR, "steps"),
    "numbers as steps": lambda: save("a.pvd", SCALAR, [1, 2]),
    "steps without fields": lambda: save("a.pvd", SCALAR, [(0.0,)]),
    "text as time": lambda: save("a.pvd", SCALAR, [("0", {"u": SCALAR.zeros()})]),
    "subdivide text": lambda: to_pyvista(SCALAR, SCALAR.zeros(), subdivide="2"),
    "subdivide NaN": lambda: to_pyvista(SCALAR, SCALAR.zeros(), subdivide=np.nan),
    "subdivide truth": lambda: to_pyvista(SCALAR, SCALAR.zeros(), subdivide=True),
    "point data no mapping": lambda: to_pyvista(SCALAR, SCALAR.zeros(), point_data=np.zeros(25)),
}


@pytest.mark.parametrize("case", OTHERS)
def test_other_arguments(case):
    refused(OTHERS[case])


@pytest.mark.parametrize("dtype", [np.int32, np.uint8, np.float32, bool])
def test_other_kinds_of_real_numbers_are_taken(dtype):
    x = (np.arange(SCALAR.N) % 2).astype(dtype)
    grid = to_pyvista(SCALAR, x)
    expected = to_pyvista(SCALAR, x.astype(float))
    np.testing.assert_allclose(grid.point_data["u"], expected.point_data["u"], rtol=1e-6)
    if dtype is not bool:
        found = nodal_gradient(SCALAR, x)
        assert found.dtype == float
        np.testing.assert_array_equal(found, nodal_gradient(SCALAR, x.astype(float)))


def test_complex_loads_keep_their_imaginary_part():
    b = np.ones(STIFFNESS.shape[0])
    load = EXTENSION.load((1 + 2j) * b)
    np.testing.assert_allclose(load, (1 + 2j) * EXTENSION.load(b))
    np.testing.assert_allclose(EXTENSION.expand(load).imag, 2 * EXTENSION.expand(load).real)
