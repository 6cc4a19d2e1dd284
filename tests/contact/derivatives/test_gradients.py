"""Gradients of results beside differences of solved problems, for all data of a problem."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from cases import LAYER, Block, Stack, pushed
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
)

from contact import Tie
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
PARTS = ("u", "pressure", "shear", "slip", "contact_forces", "resultant")
CASES = {
    "P1": Block(ElementTriP1),
    "P2 tresca": Block(ElementTriP2, "tresca", friction=0.05),
    "Q1": Block(ElementQuad1),
    "Q1 mean, no friction": Block(ElementQuad1, None, dilatation="mean"),
    "Q2 plane stress": Block(ElementQuad2, plane="stress", cells=4),
    "Adini": Block(ElementQuadAdini, cells=4),
    "ring": Block(ElementQuad2, plane="axisymmetric", cells=4),
    "ring tresca": Block(ElementQuad1, "tresca", plane="axisymmetric", friction=0.05),
    "layer": Block(ElementQuad2, overclosure=LAYER, cells=4),
    "layer without friction": Block(ElementQuad1, None, overclosure=LAYER),
    "stamp": Block(ElementQuad1, rigid=pushed(False)),
    "driven stamp": Block(ElementQuad1, rigid=pushed(True), held=True),
    "space": Block(ElementHex1, cells=2),
    "space tresca": Block(ElementTetP1, "tresca", friction=0.05, cells=2),
    "pair": Stack(),
    "pair tresca": Stack(ElementQuad2, "tresca", friction=0.05, cells=4),
    "pair without friction": Stack(ElementTriP2, None, friction=0.0, cells=4),
    "tie": Stack(kind=Tie, law=None),
    "pair in space": Stack(ElementHex1, cells=2),
}


def cotangents(result):
    rng = np.random.default_rng(0)
    weights = {part: rng.standard_normal(np.shape(getattr(result, part))) for part in PARTS}
    return {part: v / v.size for part, v in weights.items()}


def value(result, given):
    return sum(np.sum(v * getattr(result, part)) for part, v in given.items())


def difference(function, step):
    """Of fourth order."""
    ahead, back = function(step) - function(-step), function(2 * step) - function(-2 * step)
    return (8 * ahead - back) / (12 * step)


def directions(case, problem, gradient):
    """Name, change of the data and derivative along it for each argument of a problem."""
    rng = np.random.default_rng(1)
    bodies, m = problem.body.bodies, problem.rows.gap.size
    several = len(bodies) > 1
    each = [gradient[k] for k in range(len(bodies))]
    if several:
        yield "E", 1.0, sum(float(g.E) for g in each)
        yield "nu", 1.0, sum(float(g.nu) for g in each)
    else:
        for name in ("E", "nu"):
            v = rng.uniform(-1.0, 1.0, case.ncells)
            yield name, v, getattr(gradient, name) @ v
        v = rng.uniform(-1.0, 1.0, gradient.load.size)
        yield "load", 0.01 * v, gradient.load @ (0.01 * v)
    if not bodies[0].is_ring:
        moved = [b.constraint[1] for b in case(support=1.0).body.bodies]
        moved = np.concatenate(moved) - np.concatenate([b.constraint[1] for b in bodies])
        yield "support", 1.0, gradient.support @ moved
    if problem.law is not None:
        v = rng.uniform(-1.0, 1.0, m) * problem.friction
        yield "friction", v, gradient.friction @ v
    moves = [0.05 * rng.uniform(-1.0, 1.0, b.mesh.doflocs.shape) for b in bodies]
    for body, move in zip(bodies, moves, strict=True):
        if body.is_ring:
            move[0, body.mesh.doflocs[0] == 0.0] = 0.0
    total = sum(np.sum(g.vertices * v) for g, v in zip(each, moves, strict=True))
    yield "vertices", moves if several else moves[0], total
    if not several:
        v = 0.1 * rng.uniform(-1.0, 1.0, m)
        yield "gap", v, gradient.gap @ v
        if not bodies[0].is_ring:
            place = rng.uniform(-1.0, 1.0, case.dim)
            yield "place", place, gradient.pose()[0, : case.dim] @ place
    if not several and case.rigid is not None:
        v = rng.uniform(-1.0, 1.0, 3)
        yield "motion", v, gradient.motion @ v + gradient.force @ v


def changed(case, problem, name, v, s):
    if isinstance(v, list):
        return case(**{name: [s * one for one in v]})
    base = {"friction": problem.friction, "gap": problem.rows.gap}.get(name, 0.0)
    return case(**{name: base + s * v})


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", CASES)
def test_gradients_are_differences(name):
    case = CASES[name]
    problem = case()
    result = problem.solve()
    given = cotangents(result)
    gradient = result.vjp(**given)
    assert not gradient.degenerate.any()
    for argument, v, found in directions(case, problem, gradient):
        # Rows of two bodies have kinks in their slopes as vertices move.
        step = 2e-6 if argument == "vertices" else 2e-5
        expected = difference(
            lambda s, a=argument, v=v: value(changed(case, problem, a, v, s).solve(), given), step
        )
        size = abs(expected) + 1e-3 * max(map(np.linalg.norm, given.values()))
        assert abs(found - expected) < 1e-6 * size, (argument, found, expected)
