"""Contact problems that are solved on one process and on several."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem

from contact import Sphere
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
