"""First light's malformed input in three dimensions: typed errors that name what is wrong."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementTetP1,
    ElementTetP2,
    ElementVector,
    MeshHex,
    MeshTet,
)

from contact import (
    ContactError,
    ContactProblem,
    ElasticBody,
    Infeasible,
    InputError,
    LoadStepper,
    Plane,
    Rigid,
    Sphere,
    Unbounded,
)
from skfem_adini import ElementHexAdini

NAN, INF = np.nan, np.inf
MATERIAL = {"E": 1.0, "nu": 0.3}
FLOOR = Plane((0, 0, 0), (0, 0, 1))


def cube(make, element=ElementHex1, n=2, **material):
    ticks = np.linspace(0, 1, n + 1)
    mesh = make.box(element, ticks, ticks, ticks)
    return ElasticBody.from_mesh(mesh, element(), **(MATERIAL | material))


def problem(make, obstacle=FLOOR, friction=0.3, boundary="bottom", **options):
    return ContactProblem(cube(make).fix("top"), boundary, obstacle, friction, **options)


def with_nan(make):
    mesh = cube(make).mesh
    p = mesh.p.copy()
    p[2, 0] = NAN
    return type(mesh)(p, mesh.t)


def folded(straight):
    mesh = straight()
    p = mesh.p.copy()
    p[:, [0, 1]] = p[:, [1, 0]]
    return type(mesh)(p, mesh.t)


def flat_tetrahedron():
    return MeshTet(np.array([[0.0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0]]), np.arange(4)[:, None])


# name: (what is called with the builders, the error, a word of its message)
BAD = {
    # obstacle
    "gap NaN": (lambda m: problem(m, NAN), InputError, "gap holds NaN"),
    "gap minus infinity": (lambda m: problem(m, -INF), InputError, "minus infinity"),
    "gap array length": (lambda m: problem(m, np.zeros(4)), InputError, "4 gaps given"),
    "gap callable shape": (
        lambda m: problem(m, lambda x: np.zeros((3, 7))),
        InputError,
        "gap of shape",
    ),
    "gap complex": (lambda m: problem(m, lambda x: 1j * x[0]), InputError, "real numbers"),
    "obstacle of the plane": (
        lambda m: problem(m, Plane((0, 0), (0, 1))),
        InputError,
        "dimension 2",
    ),
    "normal zero": (lambda m: problem(m, Plane((0, 0, 0), (0, 0, 0))), InputError, "normal"),
    "radius negative": (lambda m: problem(m, Sphere((0, 0, -1), -1.0)), InputError, "radius"),
    "radius NaN": (lambda m: problem(m, Sphere((0, 0, -1), NAN)), InputError, "radius"),
    "centre short": (lambda m: problem(m, Sphere((0, -1), 1.0)), InputError, "dimension 2"),
    "force on the obstacle short": (
        lambda m: problem(m, Rigid(FLOOR, force=(0.0, 1.0))),
        InputError,
        "force",
    ),
    "force on the obstacle NaN": (
        lambda m: problem(m, Rigid(FLOOR, force=(0.0, 0.0, NAN))),
        InputError,
        "force",
    ),
    "no obstacle, Coulomb": (lambda m: problem(m, None), InputError, "obstacle: None"),
    # friction
    "friction negative": (lambda m: problem(m, friction=-0.1), InputError, "friction"),
    "friction NaN": (lambda m: problem(m, friction=NAN), InputError, "friction"),
    "friction of each direction": (
        lambda m: problem(m, friction=np.ones((9, 2))),
        InputError,
        "9 values",
    ),
    "law": (lambda m: problem(m, law="stokes"), InputError, "law='stokes'"),
    # boundary
    "boundary unknown": (
        lambda m: problem(m, boundary="floor"),
        InputError,
        "'floor' is unknown",
    ),
    "boundary empty": (lambda m: problem(m, boundary=[]), InputError, "has no facets"),
    "boundary inside": (
        lambda m: problem(m, boundary=np.flatnonzero(cube(m).mesh.f2t[1] >= 0)),
        InputError,
        "inside the body",
    ),
    "facet number": (lambda m: problem(m, boundary=[10**6]), InputError, "must lie in"),
    "contact boundary fixed": (
        lambda m: ContactProblem(cube(m).fix("bottom"), "bottom", FLOOR).solve(),
        InputError,
        "is prescribed",
    ),
    # mesh and element
    "plane element": (
        lambda m: ElasticBody.from_mesh(MeshHex(), ElementQuad1(), **MATERIAL),
        InputError,
        "MeshHex1",
    ),
    "tetrahedra for hexahedra": (
        lambda m: ElasticBody.from_mesh(MeshTet(), ElementHex2(), **MATERIAL),
        InputError,
        "MeshTet1",
    ),
    "tetrahedron flat": (
        lambda m: ElasticBody.from_mesh(flat_tetrahedron(), ElementTetP1(), **MATERIAL),
        InputError,
        "flat",
    ),
    "hexahedron folded, Adini": (
        lambda m: ElasticBody.from_mesh(folded(MeshHex), ElementHexAdini(), **MATERIAL),
        InputError,
        "",
    ),
    "hexahedron folded, Q2": (
        lambda m: ElasticBody.from_mesh(folded(MeshHex), ElementHex2(), **MATERIAL),
        InputError,
        "folded",
    ),
    "vertex NaN": (
        lambda m: ElasticBody.from_mesh(with_nan(m), ElementHex1(), **MATERIAL),
        InputError,
        "not finite",
    ),
    "two components in space": (
        lambda m: ElasticBody(Basis(MeshTet(), ElementVector(ElementTetP2(), 2)), **MATERIAL),
        InputError,
        "2 displacement components",
    ),
    # material, loads, supports
    "E negative": (lambda m: cube(m, E=-1.0), InputError, "E="),
    "nu one half": (lambda m: cube(m, nu=0.5), InputError, "nu="),
    "E of too few cells": (lambda m: cube(m, E=np.ones(3)), InputError, "E: expected"),
    "load of the plane": (lambda m: cube(m).load("top", (0, -1)), InputError, "3 components"),
    "load NaN": (lambda m: cube(m).load("top", (0, 0, NAN)), InputError, "not finite"),
    "load callable shape": (
        lambda m: cube(m).load("top", lambda x: np.zeros((3, 5))),
        InputError,
        "does not fit",
    ),
    "body force short": (lambda m: cube(m).body_force((1, 2)), InputError, "3 components"),
    "fix component w": (lambda m: cube(m).fix("top", "w"), InputError, "components='w'"),
    "fix value NaN": (lambda m: cube(m).fix("top", "z", NAN), InputError, "value=nan"),
    "fix contradiction": (
        lambda m: cube(m).fix("top", "z", 0.1).fix("left", "z").constraint,
        InputError,
        "differ where they meet",
    ),
    "prescribed penetration": (
        lambda m: ContactProblem(cube(m).fix("bottom", "z", -0.1), "bottom", FLOOR).solve(),
        Infeasible,
        "beyond its gap",
    ),
    "body not held": (
        lambda m: ContactProblem(cube(m).load("top", (0, 0, 1.0)), "bottom", FLOOR).solve(),
        Unbounded,
        "the body is not held: a translation",
    ),
    "body slides away": (
        lambda m: ContactProblem(cube(m).load("top", (0.5, 0, -1.0)), "bottom", FLOOR, 0.3).solve(),
        Unbounded,
        "the body is not held: a translation",
    ),
    # method, result, history
    "method": (lambda m: problem(m).solve("bicycle"), InputError, "method='bicycle'"),
    "QP": (lambda m: problem(m).solve("qp:osqp"), InputError, "no QP"),
    "tol NaN": (lambda m: problem(m).solve(tol=NAN), InputError, "tol=nan"),
    "points of the plane": (
        lambda m: problem(m).solve().sample(np.zeros((2, 1))),
        InputError,
        "points",
    ),
    "points outside": (
        lambda m: problem(m).solve().sample(np.full((3, 1), 5.0)),
        InputError,
        "outside",
    ),
    "history: load of the plane": (
        lambda m: LoadStepper(problem(m)).load("top", (0, 1)),
        InputError,
        "3 components",
    ),
    "history: not fixed": (
        lambda m: LoadStepper(problem(m)).move("left", "x"),
        InputError,
        "not fixed",
    ),
    "history: after another problem": (
        lambda m: problem(m).solve(after=m.dome(ElementHex1, 4).solve()),
        InputError,
        "after",
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
