"""Gradients through steps of finite sliding, of pairs and of tools, beside differences."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from cases import KIND, Stack, mesh
from skfem import ElementHex1, ElementQuad1, ElementQuad2
from test_gradients import difference

from contact import (
    ContactProblem,
    Cylinder,
    ElasticBody,
    InputError,
    LoadStepper,
    Pair,
    Rigid,
    Sphere,
)

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
TIMES = (0.5, 1.0)
PARTS = ("u", "pressure", "shear", "contact_forces", "resultant")


def stepper(problem):
    return LoadStepper(problem, sliding="finite", halvings=0, tol=1e-12, largest_rotation=1.0)


def pair(element=ElementQuad1, E=0.0, friction=0.0, push=0.0):
    bodies = [
        ElasticBody.from_mesh(m, element(), E=young + E, nu=0.3)
        for m, young in zip(Stack(element).meshes, (2.0, 3.0), strict=True)
    ]
    upper, lower = bodies
    lower.fix("bottom", "xy")
    upper.fix("top", "xy")
    found = stepper(
        ContactProblem(bodies, [Pair(upper, "bottom", lower, "top", friction=0.3 + friction)])
    )
    found.move("top", "y", -0.03, lambda t: min(1, 2 * t), body=upper)
    return found.move("top", "x", 0.25 + push, body=upper)


def tool(
    element=ElementQuad1, driven=False, law="coulomb", E=0.0, friction=0.0, push=0.0, turn=0.0,
    guided=(),
):  # fmt: skip
    """A roller or ball that is pressed on a block, dragged and turned."""
    dim = KIND[element].elem.refdom.dim()
    body = ElasticBody.from_mesh(mesh(KIND[element], 9 - 3 * dim + 3, bend=0.0), element(),
                                 E=2.0 + E, nu=0.3).fix("bottom")  # fmt: skip
    for side in guided:
        body.fix(side, "x")
    shape = Cylinder((0.3, 1.25), 0.25) if dim == 2 else Sphere((0.3, 0.45, 1.6), 0.6)
    aside = () if dim == 2 else (0.05,)

    def at(t):
        spin = (0.5 + turn) * t if dim == 2 else ((0.1 + turn) * t, 0.5 * t, 0.2)
        if driven:
            return Rigid(shape, ((0.3 + push) * t, None), (None, -0.03), spin)
        return Rigid(shape, ((0.3 + push) * t, *aside, -0.03), rotation=spin)

    friction = (0.3 if law == "coulomb" else 0.02) + friction
    return stepper(ContactProblem(body, "top", at(0.1), friction=friction, law=law)).obstacle(at)


CASES = {
    "pair": lambda **k: pair(**k),
    "roller": lambda **k: tool(**k),
    "roller Q2": lambda **k: tool(ElementQuad2, **k),
    "roller tresca": lambda **k: tool(law="tresca", **k),
    "driven roller": lambda **k: tool(driven=True, **k),
    "roller beside a support": lambda **k: tool(guided=("left",), **k),
    "ball": lambda **k: tool(ElementHex1, **k),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", CASES)
def test_gradients_of_sliding_are_differences(name):
    made = CASES[name]
    stepper = made()
    history = stepper.run(TIMES)
    rng = np.random.default_rng(0)
    parts = (*PARTS, "motion") if "driven" in name else PARTS
    given = {p: rng.standard_normal((2, *np.shape(getattr(history[0], p)))) for p in parts}
    given = {p: v / v.size for p, v in given.items()}
    assert any((result.status == 2).any() for result in history)
    gradient = history.vjp(**given)
    backward = []
    stepper.vjp(TIMES, lambda k, _: {p: v[k] for p, v in given.items()},
                lambda k, step: backward.append(step.friction))  # fmt: skip
    np.testing.assert_allclose(sum(backward), gradient.friction, rtol=1e-7, atol=1e-10)

    def value(**changed):
        results = made(**changed).run(TIMES)
        pairs = (
            (w, getattr(r, p)) for p, v in given.items() for w, r in zip(v, results, strict=True)
        )
        return sum(np.sum(w * found) for w, found in pairs)

    bodies = stepper.problem.body.bodies
    found = {
        "E": gradient.total(lambda g: sum(g[k].E for k in range(len(bodies)))),
        "friction": gradient.friction.sum(),
    }
    if "pair" in name:
        moved = np.zeros(gradient.steps[0].support.size)
        moved[: bodies[0].ndofs] = bodies[0].support_motion("top", "x", 1.0)
        found["push"] = sum(
            t * g.support @ moved for t, g in zip(TIMES, gradient.steps, strict=True)
        )
    else:
        each = list(zip(TIMES, gradient.steps, strict=True))
        found["push"] = sum(t * g.motion[0] for t, g in each)
        if name != "ball":  # whose rotation about three axes is none of a vector's components
            found["turn"] = sum(t * g.motion[2] for t, g in each)
    for argument, one in found.items():
        expected = difference(lambda s, a=argument: value(**{a: s}), 2e-6)
        assert abs(one - expected) < 1e-6 * (abs(expected) + 1e-2), (argument, one, expected)


def _tresca():
    made = pair()
    problem = ContactProblem(made.problem.body.bodies, made.problem.pairs, law="tresca")
    again = stepper(problem).move("top", "y", -0.03, body=made.problem.body.bodies[0])
    return again.run([1.0])[0].vjp(resultant=(0.0, 1.0))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (_tresca, "per area"),
        (lambda: tool().run([0.5])[0].vjp(slip=np.ones((7, 1))), "no cotangent"),
        (lambda: tool().run([0.5])[0].vjp(u=np.ones(98)).vertices, "of finite sliding"),
    ],
)
def test_what_sliding_has_not(made, words):
    with pytest.raises(InputError, match=words):
        made()
