"""Bodies that conduct heat: a block on a floor, two blocks of cells that do not match."""

import numpy as np
from families import box
from skfem import ElementQuad1, ElementQuad2

from contact import ContactProblem, ElasticBody, Pair, ThermalContact


def blocks(friction=0.0):
    """Two blocks of cells that do not match, pressed by .02."""
    meshes = [
        box(ElementQuad2, np.linspace(0, 1, n + 1), y)
        for n, y in ((3, [0.0, 0.5, 1.0]), (4, [-1.0, -0.5, 0.0]))
    ]
    upper, lower = (ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.0) for mesh in meshes)
    upper.fix("left", "x").load("top", (0.0, -0.02))
    lower.fix("left", "x").fix("bottom", "y")
    return (
        upper,
        lower,
        ContactProblem([upper, lower], [Pair(upper, "bottom", lower, "top", friction)]),
    )


def floor(element=ElementQuad1, functional=None, body=None, **options):
    """A square, or cube, that is hot above, on a floor of temperature 0."""
    ticks = [np.linspace(0, 1, 4)] * element().dim
    body = body or ElasticBody.from_mesh(box(element, *ticks), element(), E=1.0, nu=0.3)
    body.fix("top", None, 0.0).fix("left", "x")
    problem = ContactProblem(body, "bottom", -0.01, functional=functional)
    given = {"conductivity": 1.0, "conductance": 2.0, "obstacle_temperature": 0.0} | options
    return ThermalContact(problem, given.pop("conductivity"), given.pop("conductance"), **given)


def two_bodies():
    upper, lower, problem = blocks()
    model = ThermalContact(
        problem, 1.0, lambda p, g: 50 * p, capacity=1.0, expansion=1e-3, method="crank-nicolson"
    )
    return model.fix("top", 1.0, body=upper).fix("bottom", 0.0, body=lower)
