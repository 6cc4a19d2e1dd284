"""Contact problems as functions of their data, for differences of what a gradient gives."""

from dataclasses import replace

import numpy as np
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)

from contact import ContactProblem, ElasticBody, Pair, PressureOverclosure, Rigid, Sphere, Tie
from skfem_adini import ElementQuadAdini

KIND = {
    ElementTriP1: MeshTri, ElementTriP2: MeshTri, ElementQuad1: MeshQuad, ElementQuad2: MeshQuad,
    ElementQuadAdini: MeshQuad, ElementHex1: MeshHex, ElementTetP1: MeshTet,
}  # fmt: skip
LAYER = PressureOverclosure([0.0, 0.1, 0.3, 2.0], [-0.01, 0.0, 0.01, 0.05])


def mesh(kind, cells, low=0.0, high=1.0, bend=0.15):
    """A block with uneven cells; its bottom is convex, so that every facet is part of a curve."""
    dim = kind.elem.refdom.dim()
    ticks = [np.linspace(0.0, 1.0, cells + 1)] * (dim - 1) + [np.linspace(low, high, cells + 1)]
    made = kind.init_tensor(*ticks)
    sides = {"left": (0, 0.0), "bottom": (-1, low), "top": (-1, high)}
    made = made.with_boundaries(
        {name: lambda x, c=c, at=at: np.isclose(x[c], at) for name, (c, at) in sides.items()}
    )
    p = made.p.copy()
    height = high - low
    inside = np.prod(np.sin(np.pi * p[:-1]), axis=0) * np.sin(np.pi * (p[-1] - low) / height)
    for c in range(dim):
        p[c] += 0.02 * inside * np.cos(5.0 * p.sum(axis=0) + c)
    p[-1] += bend * (high - p[-1]) / height * np.sum(p[:-1] ** 2, axis=0)
    return replace(made, doflocs=p)


class Block:
    """One body on a ball. `theta` are changes of the data, zero in the problem itself."""

    def __init__(self, element=ElementQuad1, law="coulomb", plane="strain", cells=5, **more):
        self.element, self.law, self.plane = element, law, plane
        self.dim = KIND[element].elem.refdom.dim()
        self.friction = 0.0 if law is None else more.pop("friction", 0.25)
        self.over, self.dilatation = more.pop("overclosure", None), more.pop("dilatation", None)
        self.rigid, self.held = more.pop("rigid", None), more.pop("held", False)
        self.mesh = mesh(KIND[element], cells)
        self.ncells = self.mesh.nelements
        self.extra = more

    def along(self, first, last):
        """A vector of the space: along x, and along the last axis."""
        return np.array([first, *([0.0] * (self.dim - 2)), last])

    def __call__(self, **theta):
        moved = replace(self.mesh, doflocs=self.mesh.doflocs + theta.get("vertices", 0.0))
        E, nu = (np.full(self.ncells, v) + theta.get(k, 0.0) for k, v in (("E", 2.0), ("nu", 0.3)))
        plane = self.plane if self.dim == 2 else None
        more = {"dilatation": self.dilatation} if self.dilatation else {}
        body = ElasticBody.from_mesh(moved, self.element(), E=E, nu=nu, plane=plane, **more)
        ring, shift = plane == "axisymmetric", theta.get("support", 0.0)
        if not ring:
            body.fix("left", "x", lambda x: 0.01 * (1.0 + x[-1]) + shift)
            if self.held or self.dim == 3:  # a driven obstacle meets a body that is held
                body.fix("left", "yz"[: self.dim - 1])
        push = 0.0 if ring else 0.1
        down = self.along(push, -0.4).reshape(-1, 1, 1) * (1.0 if self.dim == 2 else 0.25)
        body.load("top", lambda x: down * (1.0 + 0.2 * x[0]))
        body.body_force(self.along(0.0, -0.05))
        if "load" in theta:
            body.f = body.f + theta["load"]
        centre = np.array(
            [0.0 if ring else 0.35] + [0.4] * (self.dim - 2) + [-0.74 + 0.05 * (self.dim - 2)]
        )
        centre = centre + theta.get("place", 0.0)
        obstacle = Sphere(tuple(centre), 0.75)
        if "gap" in theta:
            obstacle = theta["gap"]
        if self.rigid is not None:
            obstacle = self.rigid(obstacle, theta.get("motion", 0.0))
        friction = self.friction
        if self.law is not None:  # it varies along the boundary
            friction = theta.get("friction", lambda x: self.friction * (1.0 + 0.3 * x[0]))
        return ContactProblem(
            body, "bottom", obstacle, friction, self.law, overclosure=self.over, **self.extra
        )


class Stack:
    """Two bodies whose meshes do not match, in contact or tied."""

    def __init__(self, element=ElementQuad1, law="coulomb", kind=Pair, friction=0.3, cells=5):
        self.element, self.law, self.pair, self.friction = element, law, kind, friction
        family = KIND[element]
        self.dim = family.elem.refdom.dim()
        below = mesh(family, cells - 1, -0.8, 0.0, 0.0)
        p = below.doflocs.copy()
        p[:-1] = 1.3 * p[:-1] - 0.13  # wider, so that no end of one body meets one of the other
        p[-1] += 0.1 * (p[-1] + 0.8) / 0.8 * np.sum((p[:-1] - 0.2) ** 2, axis=0)
        self.meshes = mesh(family, cells, 0.0, 0.9), replace(below, doflocs=p)

    def __call__(self, **theta):
        moves = theta.get("vertices", (0.0, 0.0))
        upper, lower = (
            ElasticBody.from_mesh(
                replace(m, doflocs=m.doflocs + move),
                self.element(),
                E=E + theta.get("E", 0.0),
                nu=0.3 + theta.get("nu", 0.0),
            )
            for m, move, E in zip(self.meshes, moves, (2.0, 3.0), strict=True)
        )
        along = "x" if self.dim == 2 else "xy"
        upper.fix("left", along, 0.01 + theta.get("support", 0.0))
        lower.fix("bottom", "xyz"[: self.dim])
        down = np.zeros((self.dim, 1, 1))
        down[0], down[-1] = 0.1, -0.4
        upper.load("top", lambda x: down * (1.0 + 0.2 * x[0]))
        friction = {} if self.pair is Tie else {"friction": self.friction}
        pair = self.pair(upper, "bottom", lower, "top", **friction)
        given = {} if self.law is None else {"law": self.law}
        if "friction" in theta:
            given["friction"] = theta["friction"]
        return ContactProblem([upper, lower], [pair], **given)


def pushed(free):
    """A stamp that is moved, or pressed by a force and free to move in the last direction."""

    def rigid(shape, change):
        change = np.zeros(3) + change
        if free:
            force = (None, 0.35 + float(change[1]))
            return Rigid(shape, (float(change[0]), None), force, float(change[2]))
        return Rigid(shape, (0.004 + float(change[0]), float(change[1])), rotation=float(change[2]))

    return rigid
