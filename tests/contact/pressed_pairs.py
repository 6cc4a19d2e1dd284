"""Solved problems of several bodies: pairs, a stack, a rigid foundation, self contact."""

import numpy as np
from skfem import ElementQuad2, ElementTriP1
from solid_boxes import box
from two_blocks import block

from contact import ContactProblem, ElasticBody, Plane
from contact.rows.pairs import Pair, Tie
from skfem_adini import ElementQuadAdini


def pair(element=ElementQuadAdini, friction=0.3, size=1.0, E=2.0, names=True, **more):
    """A punch of 5 facets on a wider block of 9; both carry names."""
    upper = block(element, np.linspace(-0.6, 0.6, 6), [0.0, 0.4, 1.0], size=size, E=3 * E)
    lower = block(element, np.linspace(-1, 1, 10), [-1.0, -0.4, 0.0], size=size, E=E)
    upper.fix("top", "x", 0.01 * size).load("top", (0.0, -0.05 * E))
    lower.fix("bottom", "xy")
    if names:
        upper.named("upper"), lower.named("lower")
    return ContactProblem(upper, "bottom", lower.surface("top"), friction=friction, **more)


def stack(element=ElementQuadAdini):
    """Three blocks on a rigid plane: friction, a tie, and the foundation."""
    ticks = [np.linspace(0, 1, n + 1) for n in (4, 7, 5)]
    top, middle, low = (
        block(element, x, [y, y + 0.5, y + 1.0])
        for x, y in zip(ticks, (1.0, 0.0, -1.0), strict=True)
    )
    for body in (top, middle, low):
        body.fix("left", "x")
    top.named("top block").load("top", (0.0, -0.1))
    low.named("low/block")
    pairs = [
        Pair(top, "bottom", middle, "top", friction=0.2),
        Tie(middle, "bottom", low, "top"),
        Pair(low, "bottom", Plane((0.0, -1.02), (0.0, 1.0)), friction=0.4),
    ]
    return ContactProblem([top, middle, low], pairs)


def slit(
    element=ElementQuadAdini,
    tip=False,
    load=(0.0, -0.05),
    friction=0.3,
    supports=(("bottom", "xy"),),
):
    """A body of two halves, joined on the right, whose faces on the left touch up to their tip."""
    x, y = np.linspace(0, 2, 7), np.linspace(-0.5, 0.5, 5)
    body = block(element, x, y)
    mesh = body.mesh
    cut = np.flatnonzero((np.abs(mesh.p[1]) < 1e-9) & (mesh.p[0] < 1.0 - 1e-9))
    twin = np.arange(mesh.nvertices)
    twin[cut] = mesh.nvertices + np.arange(cut.size)
    below = mesh.p[1, mesh.t].mean(axis=0) < 0
    t = np.where(below, twin[mesh.t], mesh.t)
    opened = type(mesh)(np.hstack([mesh.p, mesh.p[:, cut]]), t).with_defaults()
    middle = opened.p[:, opened.facets].mean(axis=1)
    on_cut = np.intersect1d(
        np.flatnonzero((np.abs(middle[1]) < 1e-9) & (middle[0] < 1.0)), opened.boundary_facets()
    )
    on_cut = on_cut[middle[0, on_cut] < (1.0 if tip else 0.6)]  # facets at the tip share a vertex
    above = opened.p[1, opened.t[:, opened.f2t[0, on_cut]]].mean(axis=0) > 0
    whole = ElasticBody.from_mesh(opened, element(), E=2.0, nu=0.3)
    for side, components in supports:
        whole.fix(side, components)
    faces = on_cut[above], whole.load("top", load).surface(on_cut[~above])
    return ContactProblem(whole, *faces, friction=friction)


def sandwich(element, friction):
    """Three boxes in space: friction above, a tie below, pushed aside and down."""
    top = box(element, (2, 2, 1), (0.1, 0.1, 1.0), (0.8, 0.8, 0.5))
    middle = box(element, (3, 3, 1), (0.0, 0.0, 0.5), (1.0, 1.0, 0.5))
    low = box(element, (2, 2, 1), (0.0, 0.0, 0.0), (1.0, 1.0, 0.5)).fix("bottom", "xyz")
    top.fix("top", "x", 0.005).fix("top", "y", 0.002).fix("top", "z", -0.01)
    pairs = [Pair(top, "bottom", middle, "top", friction=friction)]
    return ContactProblem([top, middle, low], [*pairs, Tie(middle, "bottom", low, "top")])


PROBLEMS = {
    "Adini": pair,
    "Q2": lambda: pair(ElementQuad2),
    "P1": lambda: pair(ElementTriP1),
    "without names": lambda: pair(names=False),
    "frictionless": lambda: pair(friction=0.0),
    "Tresca": lambda: pair(friction=0.01, law="tresca"),
    "units": lambda: pair(ElementQuad2, size=1e-3, E=2.1e11),
    "stack": stack,
    "slit": slit,
}
