"""A table of malformed input: each gives its own error, which names what is wrong."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementQuadP,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    FacetBasis,
    MeshHex,
    MeshLine,
    MeshQuad,
    MeshTri,
)

from contact import (
    ContactError,
    ContactProblem,
    ContactResult,
    ElasticBody,
    Infeasible,
    InputError,
    NotConverged,
    Unbounded,
    cross_check,
)
from skfem_adini import ElementQuadAdini

NAN, INF = np.nan, np.inf
MATERIAL = {"E": 1.0, "nu": 0.3}


def problem(make, *args, obstacle=None, boundary="bottom", **options):
    obstacle = make.foundation[2] if obstacle is None else obstacle
    return ContactProblem(make.block(4), boundary, obstacle, *args, **options)


def body(element=ElementQuad1, mesh=None, **material):
    return ElasticBody.from_mesh(mesh or MeshQuad(), element(), **(MATERIAL | material))


def p2_block(make):
    return make.block(4, ElementQuad2)


def square(*corners):
    return MeshQuad(np.array(corners, dtype=float).T, np.arange(4)[:, None])


def swapped(mesh, a=0, b=1):
    """Two vertices have changed places: cells fold over."""
    p = mesh.p.copy()
    p[:, [a, b]] = p[:, [b, a]]
    return type(mesh)(p, mesh.t)


def with_nan():
    mesh = MeshQuad().refined(1)
    p = mesh.p.copy()
    p[0, 0] = NAN
    return type(mesh)(p, mesh.t)


def result(make):
    return make.solved(n=4)[1]


# name: (what is called with the builders, the error, a word of its message)
BAD = {
    # obstacle
    "gap NaN": (lambda m: problem(m, obstacle=NAN), InputError, "gap holds NaN"),
    "gap minus infinity": (lambda m: problem(m, obstacle=-INF), InputError, "minus infinity"),
    "gap NaN somewhere": (
        lambda m: problem(m, obstacle=lambda x: np.where(x[0] > 0.5, NAN, 1.0)),
        InputError,
        "gap holds NaN",
    ),
    "gap array length": (lambda m: problem(m, obstacle=np.zeros(3)), InputError, "3 gaps given"),
    "gap array NaN": (lambda m: problem(m, obstacle=np.full(10, NAN)), InputError, "gap holds NaN"),
    "gap callable shape": (
        lambda m: problem(m, obstacle=lambda x: np.zeros(7)),
        InputError,
        "gap of shape",
    ),
    "obstacle of space": (
        lambda m: problem(m, obstacle=m.foundation[3]),
        InputError,
        "dimension 3",
    ),
    "no obstacle, Coulomb": (
        lambda m: ContactProblem(m.block(4), "bottom", None, 0.3),
        InputError,
        "obstacle: None",
    ),
    "no obstacle, no friction": (
        lambda m: ContactProblem(m.block(4), "bottom", None, 0.0, "tresca"),
        InputError,
        "obstacle: None",
    ),
    # friction
    "friction negative": (lambda m: problem(m, -0.1), InputError, "friction"),
    "friction NaN": (lambda m: problem(m, NAN), InputError, "friction"),
    "friction infinite": (lambda m: problem(m, INF), InputError, "friction"),
    "friction negative somewhere": (
        lambda m: problem(m, lambda x: x[0] - 0.5),
        InputError,
        "friction",
    ),
    "friction shape": (lambda m: problem(m, np.ones(3)), InputError, "10 values"),
    "friction callable shape": (lambda m: problem(m, lambda x: x), InputError, "10 values"),
    "friction None": (lambda m: problem(m, None), InputError, "friction"),
    # boundary
    "boundary unknown": (lambda m: problem(m, boundary="floor"), InputError, "'floor' is unknown"),
    "boundary unknown in a list": (
        lambda m: problem(m, boundary=["bottom", "floor"]),
        InputError,
        "'floor' is unknown",
    ),
    "boundary without names": (
        lambda m: ContactProblem(body(), "bottom", 0.0),
        InputError,
        "mesh names none",
    ),
    "boundary empty": (lambda m: problem(m, boundary=[]), InputError, "has no facets"),
    "boundary name empty": (
        lambda m: ContactProblem(
            body(mesh=MeshQuad().with_boundaries({"far": lambda x: x[0] > 9})), "far", 0.0
        ),
        InputError,
        "has no facets",
    ),
    "boundary inside": (
        lambda m: problem(m, boundary=np.flatnonzero(m.block(4).mesh.f2t[1] >= 0)),
        InputError,
        "inside the body",
    ),
    "facet number too large": (lambda m: problem(m, boundary=[10**6]), InputError, "must lie in"),
    "facet number negative": (lambda m: problem(m, boundary=[-1]), InputError, "must lie in"),
    "facet numbers as mask": (
        lambda m: problem(m, boundary=np.array([True, False])),
        InputError,
        "whole facet numbers",
    ),
    "facet numbers broken": (lambda m: problem(m, boundary=[0.5]), InputError, "whole facet"),
    "boundary None": (lambda m: problem(m, boundary=None), InputError, "boundary=None"),
    "contact boundary fixed": (
        lambda m: ContactProblem(m.block(4).fix("bottom"), "bottom", 0.0).solve(),
        InputError,
        "is prescribed",
    ),
    # mesh and element
    "triangles for Adini": (lambda m: body(ElementQuadAdini, MeshTri()), InputError, "MeshTri1"),
    "solid for the plane": (lambda m: body(ElementQuad1, MeshHex()), InputError, "MeshHex1"),
    "line mesh": (
        lambda m: ElasticBody.from_mesh(MeshLine(), **MATERIAL),
        InputError,
        "no default for MeshLine1",
    ),
    "cell not convex, Adini": (
        lambda m: body(ElementQuadAdini, square((0, 0), (1, 0), (0.2, 0.2), (0, 1))),
        InputError,
        "convex",
    ),
    "cell not convex, Q1": (
        lambda m: body(ElementQuad1, square((0, 0), (1, 0), (0.2, 0.2), (0, 1))),
        InputError,
        "convex",
    ),
    "cell folded": (
        lambda m: body(ElementQuad2, square((0, 0), (1, 0), (0, 1), (1, 1))),
        InputError,
        "folded",
    ),
    "cell folded, own basis": (
        lambda m: ElasticBody(Basis(swapped(MeshHex()), ElementVector(ElementHex1())), **MATERIAL),
        InputError,
        "folded",
    ),
    "hexahedron folded": (lambda m: body(ElementHex1, swapped(MeshHex())), InputError, "folded"),
    "triangle flat": (
        lambda m: body(
            ElementTriP1, MeshTri(np.array([[0.0, 1, 2], [0, 0, 0]]), np.arange(3)[:, None])
        ),
        InputError,
        "flat",
    ),
    "vertex NaN": (lambda m: body(mesh=with_nan()), InputError, "not finite"),
    "scalar basis": (
        lambda m: ElasticBody(Basis(MeshQuad(), ElementQuad1()), **MATERIAL),
        InputError,
        "ElementVector",
    ),
    "facet basis": (
        lambda m: ElasticBody(FacetBasis(MeshQuad(), ElementVector(ElementQuad1())), **MATERIAL),
        InputError,
        "basis: expected",
    ),
    "mesh for a basis": (lambda m: ElasticBody(MeshQuad(), **MATERIAL), InputError, "basis"),
    "three components in the plane": (
        lambda m: ElasticBody(Basis(MeshQuad(), ElementVector(ElementQuad1(), 3)), **MATERIAL),
        InputError,
        "3 displacement components",
    ),
    "element without functional": (
        lambda m: ContactProblem(
            body(lambda: ElementQuadP(3), MeshQuad().with_defaults()), "bottom", 0.0
        ),
        InputError,
        "no contact functional",
    ),
    # material
    "E zero": (lambda m: body(E=0.0), InputError, "E="),
    "E negative in a cell": (lambda m: body(E=-np.ones(1)), InputError, "E="),
    "E shape": (lambda m: body(E=np.ones(3)), InputError, "E: expected"),
    "nu one half": (lambda m: body(nu=0.5), InputError, "nu="),
    "nu minus one": (lambda m: body(nu=-1.0), InputError, "nu="),
    "nu NaN": (lambda m: body(nu=NAN), InputError, "nu="),
    "nu shape": (lambda m: body(nu=np.zeros((4, 4))), InputError, "nu: expected"),
    "plane": (lambda m: body(plane="paper"), InputError, "plane='paper'"),
    # loads
    "load short": (lambda m: m.block(4).load("top", (1.0,)), InputError, "2 components"),
    "load number": (lambda m: m.block(4).load("top", 1.0), InputError, "2 components"),
    "load long": (lambda m: m.block(4).load("top", (1.0, 0, 0)), InputError, "2 components"),
    "load callable shape": (
        lambda m: m.block(4).load("top", lambda x: np.zeros((2, 7))),
        InputError,
        "does not fit",
    ),
    "load NaN": (lambda m: m.block(4).load("top", (NAN, 0)), InputError, "not finite"),
    "load callable NaN": (
        lambda m: m.block(4).load("top", lambda x: x * NAN),
        InputError,
        "not finite",
    ),
    "load boundary": (lambda m: m.block(4).load("roof", (0, 1)), InputError, "'roof' is unknown"),
    "body force infinite": (lambda m: m.block(4).body_force((INF, 0)), InputError, "not finite"),
    "body force long": (lambda m: m.block(4).body_force((1, 2, 3)), InputError, "2 components"),
    # supports
    "fix unknown boundary": (lambda m: m.block(4).fix("roof"), InputError, "'roof' is unknown"),
    "fix component z": (lambda m: m.block(4).fix("top", "z"), InputError, "components='z'"),
    "fix component w": (lambda m: m.block(4).fix("top", "xw"), InputError, "components='xw'"),
    "fix component 2": (lambda m: m.block(4).fix("top", 2), InputError, "components=2"),
    "fix component 0.5": (lambda m: m.block(4).fix("top", 0.5), InputError, "components=0.5"),
    "fix no component": (lambda m: m.block(4).fix("top", ""), InputError, "components=''"),
    "fix value NaN": (lambda m: m.block(4).fix("top", "y", NAN), InputError, "value=nan"),
    "fix value shape": (lambda m: m.block(4).fix("top", "y", (1, 2)), InputError, "value="),
    "fix callable NaN, Adini": (
        lambda m: m.block(4).fix("top", "y", lambda x: x[0] * NAN).constraint,
        InputError,
        "NaN",
    ),
    "fix callable NaN, Q2": (
        lambda m: p2_block(m).fix("top", "y", lambda x: x[0] * NAN).constraint,
        InputError,
        "finite",
    ),
    "fix callable shape, Adini": (
        lambda m: m.block(4).fix("top", "y", lambda x: np.zeros(3)).constraint,
        InputError,
        "shape",
    ),
    "fix callable shape, Q2": (
        lambda m: p2_block(m).fix("top", "y", lambda x: np.zeros(3)).constraint,
        InputError,
        "shape",
    ),
    "fix contradiction, Adini": (
        lambda m: m.block(4).fix("top", "x", 0.1).constraint,
        InputError,
        "must agree",
    ),
    "fix contradiction, Q2": (
        lambda m: p2_block(m).fix("top", "x", 0.1).constraint,
        InputError,
        "differ where they meet",
    ),
    "prescribed penetration": (
        lambda m: ContactProblem(
            m.block(4, sides=()).fix("bottom", "y", -0.1), "bottom", m.foundation[2]
        ).solve(),
        Infeasible,
        "beyond its gap",
    ),
    "prescribed penetration of 1e-7 of a body of a micrometre": (
        lambda m: ContactProblem(
            body(ElementQuad1, m.box(ElementQuad1, *(np.linspace(0, 1e-6, 5),) * 2)).fix(
                "bottom", "y", -1e-13
            ),
            "bottom",
            0.0,
        ).solve(),
        Infeasible,
        "beyond its gap",
    ),
    "body not held": (
        lambda m: ContactProblem(m.block(4, sides=()), "bottom", INF).solve(),
        Unbounded,
        "translation along y",
    ),
    # problem and method
    "body of another kind": (lambda m: ContactProblem("body", "bottom", 0.0), InputError, "body"),
    "law": (lambda m: problem(m, 0.3, law="newton"), InputError, "law='newton'"),
    "friction without a law": (
        lambda m: problem(m, 0.3, law=None),
        InputError,
        "law=None is contact without friction",
    ),
    "functional": (lambda m: problem(m, functional="magic"), InputError, "functional='magic'"),
    "functional of another family": (
        lambda m: ContactProblem(m.block(4, ElementQuad1), "bottom", 0.0, functional="bernstein"),
        InputError,
        "ElementQuad1 offers",
    ),
    "solver": (lambda m: problem(m, solver="abacus").solve(), InputError, "solver='abacus'"),
    "method": (lambda m: problem(m).solve("bicycle"), InputError, "method='bicycle'"),
    "method None": (lambda m: problem(m).solve(None), InputError, "method=None"),
    "method not for this law": (
        lambda m: problem(m).solve("tresca_loop"),
        InputError,
        "frictionless problem takes",
    ),
    "method not for given friction": (
        lambda m: problem(m, 0.1, law="tresca").solve("tresca_loop"),
        InputError,
        "tresca problem takes",
    ),
    "QP solver unknown": (lambda m: problem(m).solve("qp:abacus"), InputError, "qpsolvers offers"),
    "QP for friction in 3-D": (
        lambda m: m.dome(ElementHex1).solve("qp:osqp"),
        InputError,
        "no QP",
    ),
    "eps for Newton": (lambda m: problem(m, 0.3).solve(eps=1e-3), InputError, "eps"),
    "eps negative": (
        lambda m: problem(m, 0.3).solve("fixed_point", eps=-1.0),
        InputError,
        "eps=-1",
    ),
    "eps NaN": (lambda m: problem(m, 0.3).solve("fixed_point", eps=NAN), InputError, "eps=nan"),
    "eps infinite": (lambda m: problem(m, 0.3).solve("fixed_point", eps=INF), InputError, "eps"),
    "tol negative": (lambda m: problem(m).solve(tol=-1.0), InputError, "tol=-1"),
    "tol NaN": (lambda m: problem(m).solve(tol=NAN), InputError, "tol=nan"),
    "tol large": (lambda m: problem(m).solve(tol=1e3), InputError, "tol=1000"),
    "tol below rounding": (lambda m: problem(m, 0.3).solve(tol=1e-25), NotConverged, "e-2"),
    "no iterations": (lambda m: problem(m).solve(max_iterations=0), InputError, "max_iterations=0"),
    "too few iterations": (
        lambda m: problem(m, 0.9).solve("fixed_point", max_iterations=2),
        NotConverged,
        "after 2 steps",
    ),
    "start of another dimension": (
        lambda m: m.dome(ElementHex1, 2).solve(start=result(m)),
        InputError,
        "start",
    ),
    # results
    "points outside": (lambda m: result(m).sample([[5.0], [5.0]]), InputError, "outside"),
    "points shape": (lambda m: result(m).sample(np.zeros(3)), InputError, "points"),
    "points NaN": (lambda m: result(m).sample([[NAN], [0.0]]), InputError, "points"),
    "stress outside": (lambda m: result(m).stress([[5.0], [5.0]]), InputError, "outside"),
    "cross-check solver": (
        lambda m: cross_check(m.solved(n=4)[0], result(m), "abacus"),
        InputError,
        "qpsolvers offers",
    ),
    "cross-check in 3-D": (
        lambda m: cross_check(m.dome(ElementHex1), m.dome(ElementHex1).solve()),
        InputError,
        "3-D",
    ),
    "cross-check of another problem": (
        lambda m: cross_check(ContactProblem(m.block(5), "bottom", 0.0), result(m)),
        InputError,
        "result: has",
    ),
    "result file missing": (
        lambda m: ContactResult.load("no/such/file.npz"),
        InputError,
        "does not exist",
    ),
    "mesh file missing": (
        lambda m: ElasticBody.from_mesh("no/such/file.msh", **MATERIAL),
        InputError,
        "does not exist",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed(name, make):
    call, error, word = BAD[name]
    with pytest.raises(error) as caught:
        call(make)
    assert type(caught.value) is error
    assert isinstance(caught.value, ContactError)
    assert word in str(caught.value)


def test_the_table_is_long():
    assert len(BAD) >= 30


def test_input_errors_are_value_errors():
    assert issubclass(InputError, ValueError)


def test_history_of_a_failure_is_kept(make):
    with pytest.raises(NotConverged) as caught:
        problem(make, 0.9).solve("fixed_point", max_iterations=3)
    phases = [line.phase for line in caught.value.history]
    assert phases.count("fixed point") == 3


GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "bottom"
2 2 "body"
$EndPhysicalNames
$Entities
0 1 1 0
1 0 0 0 1 0 0 1 1 0
1 0 0 0 1 1 0 1 2 0
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
2 3 1 3
1 1 1 1
1 1 2
2 1 2 2
2 1 2 3
3 1 3 4
$EndElements
"""


def test_sound_mesh_file(tmp_path):
    """What the next test truncates is a mesh with a named boundary."""
    (tmp_path / "square.msh").write_text(GMSH)
    loaded = ElasticBody.from_mesh(tmp_path / "square.msh", **MATERIAL)
    assert loaded.mesh.nelements == 2
    assert loaded.facets("bottom").size == 1
    assert isinstance(loaded.element, ElementTriP2)


WHOLE = GMSH.index("\n$EndElements")  # from here on nothing is missing


@pytest.mark.parametrize("length", range(0, WHOLE, 9))
def test_truncated_mesh_file(length, tmp_path):
    path = tmp_path / "square.msh"
    path.write_text(GMSH[:length])
    with pytest.raises(InputError, match=r"square\.msh"):
        ElasticBody.from_mesh(path, E=1.0, nu=0.3)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("noise.msh", b"\x00\x01\x02 no mesh"),
        ("text.msh", b"hello\n"),
        ("empty.vtu", b""),
        ("mesh.xyzzy", b"1 2 3"),
        ("text.vtk", b"# vtk DataFile Version 3.0\nbroken"),
    ],
)
def test_not_a_mesh_file(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        ElasticBody.from_mesh(tmp_path / name, E=1.0, nu=0.3)


def test_surface_in_space_is_no_body(tmp_path):
    """Triangles that are not flat, in three dimensions."""
    bent = GMSH.replace("1 1 0\n0 1 0\n$EndNodes", "1 1 5\n0 1 0\n$EndNodes")
    assert bent != GMSH
    (tmp_path / "bent.msh").write_text(bent)
    with pytest.raises(InputError):
        ElasticBody.from_mesh(tmp_path / "bent.msh", **MATERIAL)
