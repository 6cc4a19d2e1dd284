"""Loads and supports that a body gets after its problem was made, or solved."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, MeshHex, MeshQuad

from contact import ContactProblem, ElasticBody, LayeredBlock, Plane
from skfem_adini import ElementQuadAdini


def plane_body(element):
    mesh = MeshQuad().refined(2).with_defaults()
    return ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3).fix("left", "x")


def cube():
    mesh = MeshHex().refined(1)
    sides = {
        "left": lambda x: x[0] == 0.0,
        "right": lambda x: x[0] == 1.0,
        "bottom": lambda x: x[2] == 0.0,
        "top": lambda x: x[2] == 1.0,
    }
    body = ElasticBody.from_mesh(mesh.with_boundaries(sides), ElementHex1(), E=1.0, nu=0.3)
    return body.fix("left", "xy")


BODIES = {
    "adini": lambda: plane_body(ElementQuadAdini()),
    "bilinear": lambda: plane_body(ElementQuad1()),
    "space": cube,
    "layers": lambda: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)], sides=("x", None)),
}


def slanted(dim):
    """An obstacle that meets the body askew."""
    normal = np.zeros(dim)
    normal[0], normal[-1] = 0.1, 1.0
    return Plane(np.zeros(dim), normal)


@pytest.mark.parametrize(("name", "solved"), [*((name, True) for name in BODIES), ("space", False)])
def test_problem_follows_its_body(name, solved):
    """Fixed or loaded later, the solution is that of a problem made later."""
    body = BODIES[name]()
    pull = np.zeros(body.dim)
    pull[0], pull[-1] = 0.02, -0.1
    body.load("top", pull)
    problem = ContactProblem(body, "bottom", slanted(body.dim), friction=0.3)
    if solved:
        first = problem.solve()
        kept = first.kkt, first.balance()["support"]
    body.fix("right", "x", 0.01).load("top", 0.5 * pull)
    ours = problem.solve()
    theirs = ContactProblem(body, "bottom", slanted(body.dim), friction=0.3).solve()
    assert np.abs(ours.u - theirs.u).max() <= 1e-12 * np.abs(theirs.u).max()
    if solved:  # and the first result still speaks of the body that it was solved for
        assert np.abs(ours.u - first.u).max() > 1e-3
        assert first.kkt == kept[0]
        assert np.array_equal(first.balance()["support"], kept[1])
