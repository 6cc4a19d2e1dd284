"""Gradients of random problems beside differences: laws, elements, bodies, supports, units."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from cases import KIND, mesh
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP1, ElementTriP2
from test_gradients import cotangents, difference, value

from contact import ContactProblem, ElasticBody, LoadStepper, Pair, Sphere
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
ELEMENTS = ElementTriP1, ElementQuad1, ElementTriP2, ElementQuadAdini, ElementHex1, ElementTetP1


class Random:
    """A block on a ball, or on a block, in any units; `s` along a direction of one argument."""

    def __init__(self, element, law, two, side, length, young, seed):
        rng = np.random.default_rng(seed)
        self.element, self.law, self.two, self.side = element, law, two, side
        self.dim, self.length = KIND[element].elem.refdom.dim(), length
        cells = 4 if self.dim == 2 else 2
        found = mesh(KIND[element], cells)
        below = mesh(KIND[element], cells - 1, -0.8, -0.0, 0.0)
        p = below.doflocs.copy()
        p[:-1] = 1.3 * p[:-1] - 0.13
        p[-1] += 0.1 * (p[-1] + 0.8) / 0.8 * np.sum((p[:-1] - 0.2) ** 2, axis=0)
        meshes = (found, replace(below, doflocs=p)) if two else (found,)
        self.meshes = [replace(m, doflocs=length * m.doflocs) for m in meshes]
        self.young = [young * rng.uniform(1.0, 3.0) for _ in meshes]
        self.down, self.push = rng.uniform(0.05, 0.2), rng.uniform(-0.1, 0.1)
        self.friction = rng.uniform(0.1, 0.4)
        self.ways = [rng.uniform(-1.0, 1.0, m.doflocs.shape) for m in self.meshes]

    def __call__(self, name="", s=0.0):
        L, moved = self.length, s * self.length * 0.05 if name == "vertices" else 0.0
        bodies = [
            ElasticBody.from_mesh(
                replace(m, doflocs=m.doflocs + moved * way),
                self.element(), E=E * (1.0 + s * (name == "E")), nu=0.3,
            )
            for m, way, E in zip(self.meshes, self.ways, self.young, strict=True)
        ]  # fmt: skip
        upper, traction = bodies[0], np.zeros(self.dim)
        traction[0], traction[-1] = self.push * self.down, -self.down
        upper.fix(self.side, None, 0.0)
        upper.load("top", self.young[0] * (1.0 + s * (name == "load")) * 0.2 * traction)
        g = self.friction * (1.0 + s * (name == "friction"))
        g = g * (0.05 * self.young[0] if self.law == "tresca" else 1.0)
        if self.two:
            bodies[1].fix("bottom")
            return ContactProblem(
                bodies, [Pair(upper, "bottom", bodies[1], "top", friction=g)], law=self.law
            )
        below = -0.76 + 0.05 * (self.dim - 2)
        centre = np.array([0.35, *([0.4] * (self.dim - 2)), below])
        ball = Sphere(tuple(L * centre), 0.77 * L)
        return ContactProblem(upper, "bottom", ball, g, law=self.law)

    def found(self, gradient, problem):
        """Derivatives along the directions."""
        each = [gradient[k] for k in range(len(self.meshes))]
        load = np.concatenate([body.f for body in problem.body.bodies])
        ways = zip(each, self.ways, strict=True)
        return {
            "E": sum(g.E * E for g, E in zip(each, self.young, strict=True)),
            "load": gradient.load @ load,
            "friction": gradient.friction @ problem.friction,
            "vertices": sum(0.05 * self.length * np.sum(g.vertices * way) for g, way in ways),
        }


@pytest.mark.turns(3)
@settings(max_examples=4)
@given(
    st.sampled_from(ELEMENTS), st.sampled_from(["coulomb", "tresca"]), st.booleans(),
    st.sampled_from(["left", "top"]), st.sampled_from([1e-3, 1.0, 1e3]),
    st.sampled_from([1e-2, 1.0, 2e11]), st.integers(0, 10**6),
)  # fmt: skip
def test_random_gradients(element, law, two, side, length, young, seed):
    case = Random(element, law, two, side, length, young, seed)
    problem = case()
    result = problem.solve()
    units = {"u": length, "slip": length, "pressure": young, "shear": young}
    force = young * length ** (case.dim - 1)
    weights = {k: v / units.get(k, force) for k, v in cotangents(result).items()}
    gradient = result.vjp(**weights)
    assume(not gradient.degenerate.any())
    size = sum(abs(np.sum(v * getattr(result, k))) for k, v in weights.items())
    for name, found in case.found(gradient, problem).items():
        step = 2e-6 if name == "vertices" else 2e-5
        expected = difference(lambda s, n=name: value(case(n, s).solve(), weights), step)
        assert abs(found - expected) < 1e-6 * (abs(expected) + size), (name, found, expected)


@pytest.mark.slow
@settings(max_examples=5)
@given(
    st.sampled_from(ELEMENTS[:4]), st.sampled_from(["coulomb", "tresca"]), st.booleans(),
    st.sampled_from([1.0, 2e11]), st.integers(0, 10**6),
)  # fmt: skip
def test_random_histories_of_fifty_steps(element, law, two, young, seed):
    """With checkpoints, by modulus and friction."""
    case, times = Random(element, law, two, "top", 1.0, young, seed), np.linspace(0.02, 1.0, 50)

    def stepper(name="", s=0.0):
        made = LoadStepper(case(name, s), halvings=0)
        body = made.problem.body.bodies[0]
        made.move("top", "y", -0.04, lambda t: min(1.0, 4 * t), body=body)
        return made.move("top", "x", 0.02, lambda t: np.sin(7 * t), body=body)

    weights = np.random.default_rng(seed).standard_normal((50, 2)) / young
    weak, steps = [], []
    stepper().vjp(
        times,
        lambda k, _: {"resultant": weights[k]},
        lambda _, g: (weak.append(g.degenerate.any()), steps.append(g)),
    )
    assume(not any(weak))
    found = {
        "E": sum(E * sum(g[k].E for g in steps) for k, E in enumerate(case.young)),
        "friction": sum(g.friction @ case().friction for g in steps),
    }
    for name, one in found.items():
        expected = difference(
            lambda s, n=name: np.sum(weights * stepper(n, s).run(times).resultant), 1e-6
        )
        # The load of the top is a part of E: tractions are given times the modulus at rest.
        assert abs(one - expected) < 1e-6 * (abs(expected) + 1.0), (name, one, expected)
