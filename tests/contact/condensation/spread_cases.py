"""Contact problems that are solved on one process and on several."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem

from contact import ContactProblem, DistributedBody, ElasticBody, Sphere
from skfem_adini import ElementHexAdini, ElementQuadAdini


@dataclass
class Case:
    """A body, its supports and loads, and what it touches."""

    mesh: Any
    element: Any
    boundary: str
    hold: Callable[[Any], Any]
    obstacle: Any = 0.0
    friction: float = 0.3
    E: Any = 2.0
    nu: float = 0.3
    dilatation: str = "pointwise"

    @property
    def material(self) -> dict[str, Any]:
        return {"E": self.E, "nu": self.nu, "dilatation": self.dilatation}


def cases() -> Iterator[tuple[str, Case]]:
    """By name; elements, friction, supports and obstacles are mixed."""
    quads = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 17), np.linspace(0, 1, 13))
    quads = quads.with_defaults()
    tris = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 7)).with_defaults()
    bricks = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, k) for k in (5, 6, 5)]).with_defaults()
    tets = skfem.MeshTet().refined(2).with_defaults()
    circle, ball = Sphere((0.5, -2.0), 2.0), Sphere((0.5, 0.5, -2.0), 2.0)
    adini = ElementQuadAdini()

    def dragged(b: Any) -> Any:
        return b.fix("left", "x").load("top", (0.3, -1.0)).body_force((0.0, -0.1))

    def tilted(x: Any) -> Any:
        return np.array([0 * x[0], -1.0 - 0.2 * x[0]])

    stiffer = np.linspace(1.0, 3.0, quads.nelements)
    yield "Adini .9", Case(quads, adini, "bottom", dragged, 0.03, 0.9)
    yield "Adini 0", Case(quads, adini, "bottom", dragged, 0.03, 0.0)
    yield "E by cell", Case(quads, adini, "bottom", dragged, 0.03, 0.3, E=stiffer)
    yield "P2", Case(tris, None, "bottom", lambda b: b.fix("top", "xy", -0.02), 0.01)
    floating = Case(quads, skfem.ElementQuad2(), "bottom", lambda b: b.load("top", tilted), 0.01)
    yield "Q2 floating", floating
    yield "circle", Case(quads, adini, "bottom", lambda b: b.fix("top", "xy", -0.05), circle)
    mean = Case(quads, skfem.ElementQuad1(), "bottom", lambda b: b.fix("top", "xy", -0.02), 0.0)
    mean.nu, mean.dilatation = 0.49, "mean"
    yield "Q1 mean", mean
    for friction in (0.0, 0.3, 0.9):

        def pushed(b: Any) -> Any:
            return b.fix("back", "z", -0.02).fix("back", "x", 0.01).fix("back", "y")

        obstacle = ball if friction == 0.3 else 0.0
        yield f"Hex1 {friction:g}", Case(bricks, None, "front", pushed, obstacle, friction)
    P2 = skfem.ElementTetP2()
    yield "Tet2 floating", Case(tets, P2, "bottom", lambda b: b.load("top", (0, -1.0, 0)), 0.01)
    brick = Case(bricks, ElementHexAdini(), "front", lambda b: b.fix("back", "xyz", -0.02))
    yield "Adini brick", brick


ADINI = ElementQuadAdini()
PAIRS = {  # dimension, element, whether the upper and the lower body are spread
    "pair of Adini": (2, ADINI, (True, True)),
    "pair of Q2": (2, skfem.ElementQuad2(), (True, True)),
    "pair of Hex1": (3, skfem.ElementHex1(), (True, True)),
    "upper alone": (2, ADINI, (True, False)),
    "lower alone": (2, ADINI, (False, True)),
}


def pair(dim: int, element: Any, spread: tuple[bool, bool]) -> tuple[Any, Any, ContactProblem]:
    """A body pressed and pushed on a larger one whose cells do not match."""
    fine, coarse = (np.linspace(0, 1, n) for n in ((13, 17) if dim == 2 else (5, 6)))
    last = dim - 1
    named = {
        "low": lambda x: x[last] < x[last].min() + 1e-9,
        "high": lambda x: x[last] > x[last].max() - 1e-9,
    }
    kind = skfem.MeshQuad if dim == 2 else skfem.MeshHex
    above = kind.init_tensor(*[fine] * last, 1 + fine).with_boundaries(named)
    below = kind.init_tensor(*[-0.25 + 1.5 * coarse] * last, coarse).with_boundaries(named)

    def body(mesh: Any, name: str, E: float, on_all: bool) -> Any:
        if on_all:
            return DistributedBody(mesh, element, contact=name, E=E, nu=0.3)
        return ElasticBody.from_mesh(mesh, element, E=E, nu=0.3)

    upper, lower = body(above, "low", 1.0, spread[0]), body(below, "high", 3.0, spread[1])
    upper.fix("high", "xyz"[last], -0.02).fix("high", "x", 0.01)
    if dim == 3:
        upper.fix("high", "y")
    lower.fix("low", "xyz"[:dim]).body_force((0.0,) * last + (-1e-3,))
    return upper, lower, ContactProblem(upper, "low", lower.surface("high"), friction=0.3)
