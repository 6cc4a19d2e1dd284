"""Results of bodies of every material and support are the same from a file and from a pickle."""

import copy
import pickle

import numpy as np
import pytest
from families import PLANE, STRAIGHT
from skfem import ElementQuad1, MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody, Orthotropic
from skfem_adini import ElementQuadAdini

WOOD = (11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3)
MESH = MeshQuad().refined(2).with_defaults()


def body(element=ElementQuadAdini, mesh=MESH, **more):
    more = {"E": 1.0, "nu": 0.3} | more if "material" not in more else more
    return ElasticBody.from_mesh(mesh, element(), **more)


def anisotropic():
    material = Orthotropic(*WOOD, rotation=np.linspace(0, 1, MESH.nelements))
    return body(material=material, plane="stress").fix("top", "xy", -0.01)


def ring(element):
    mesh = STRAIGHT[element]().refined(2).with_defaults()
    ring = body(element, mesh, plane="axisymmetric")
    return ring.load("top", (0.0, -0.2)).load("right", (-0.1, 0.0))


def periodic(element):
    free = body(element, MESH.translated((-0.5, 0.0))).periodic("right", "left").fix("top", "x")
    return free.load("top", (0.0, -0.01)).tie("top", rigid=True)


BODIES = {
    "anisotropic": anisotropic,
    "heated": lambda: body().fix("top", "xy").heat(lambda x: np.sin(x[0]), 0.1),
    "mean dilatation": lambda: body(ElementQuad1, nu=0.4999, dilatation="mean").fix(
        "top", "xy", lambda x: -0.02 * x[0]
    ),
    **{f"ring of {e.__name__}": lambda e=e: ring(e) for e in PLANE},
    **{f"periodic {e.__name__}": lambda e=e: periodic(e) for e in (ElementQuad1, ElementQuadAdini)},
}


def gap(x):
    return 0.01 * (1 - np.cos(2 * np.pi * x[0]))


@pytest.mark.parametrize("name", BODIES)
def test_stored_and_pickled(name, tmp_path):
    made = BODIES[name]()
    problem = ContactProblem(made, "bottom", gap if "periodic" in name else 0.0, 0.2)
    result = problem.solve()
    again = ContactResult.load(result.save(tmp_path / "a.npz"))
    other, twin = pickle.loads(pickle.dumps(result)), copy.deepcopy(problem).solve()
    moved = pickle.loads(pickle.dumps(made))
    before = result.nodal_stress().copy()
    if name == "heated":
        made.heat(5.0, 1.0)  # which does not touch a result
    for kept in (result, again, other, twin):
        assert np.array_equal(kept.u, result.u)
        assert np.array_equal(kept.nodal_stress(), before)
        assert np.array_equal(kept.stress(), result.stress())
        assert np.array_equal(kept.cell_stress(), result.cell_stress())
        assert np.array_equal(kept.von_mises(), result.von_mises())
        assert max(kept.kkt.values()) < 1e-9
        for attribute in ("plane", "dilatation"):
            assert getattr(kept.system.body, attribute) == getattr(moved, attribute)
    assert again.kkt == pytest.approx(result.kkt, abs=1e-12)
    assert repr(again.body) == repr(result.body)
    assert abs(moved.constraint[0] - made.constraint[0]).max() == 0.0
    assert abs(moved.picked - made.picked).max() == 0.0
