"""Functionals of every element, rollers and whole rings for the tests of contact rows."""

import numpy as np
from families import CURVED, SOLID, STRAIGHT, turn
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import ContactProblem, ElasticBody, Plane
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

NAMES = {
    ElementTriP1: ["nodal"],
    ElementQuad1: ["nodal"],
    ElementTriP2: ["bernstein", "gauss"],
    ElementQuad2: ["bernstein", "gauss"],
    ElementQuadAdini: ["bernstein", "gauss", "centroid", "nodal", "thesis"],
    ElementQuadBFS: ["bernstein", "gauss", "centroid", "nodal"],
    ElementTetP1: ["nodal"],
    ElementTetP2: ["bernstein"],
    ElementHex1: ["nodal"],
    ElementHex2: ["bernstein", "gauss"],
    ElementHexAdini: ["centroid"],
}
OFFERED = [(element, name) for element, names in NAMES.items() for name in names]
CUBIC = (ElementQuadAdini, ElementQuadBFS)
# Those that carry a uniform pressure.
PATCH = [c for c in OFFERED if c[0] not in CUBIC or c[1] in ("bernstein", "gauss", "centroid")]


NU, REACH, DEPTH, DOWN = 0.3, 0.8, 0.1, 0.15  # of rollers: angle to either side, thickness, way


def lengths(pattern, n):
    """Of n facets, in parts of anything."""
    return {
        "equal": np.ones(n),
        "one beside two": np.where(np.arange(n) % 2, 2.0, 1.0),
        "one beside four": np.where(np.arange(n) % 2, 4.0, 1.0),
        "any": np.random.default_rng(0).uniform(1, 3, n),
    }[pattern]


def roller(element, n, curved=False, pattern="equal", tilt=0.0, size=1.0):
    """The lower part of a roller held along its upper side, n facets on a quarter turn."""
    solid = element in SOLID
    parts = lengths(pattern, 2 * round(REACH / (np.pi / 2 / n)))
    angle = REACH * (2 * np.r_[0.0, np.cumsum(parts)] / parts.sum() - 1)
    ticks = [angle, np.linspace(0, 1, max(2, n // 2) + 1)]
    mesh = STRAIGHT[element].init_tensor(*ticks, *([np.array([0.0, DEPTH])] if solid else []))
    names = {
        "roller": mesh.facets_satisfying(lambda x: x[1] < 1e-9),
        "held": mesh.facets_satisfying(lambda x: x[1] > 1 - 1e-9),
    }
    if solid:
        names["ends"] = mesh.facets_satisfying(lambda x: np.abs(x[2] - DEPTH / 2) > 0.499 * DEPTH)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    x = mesh.doflocs.copy()
    x[:2] = np.sin(x[0]), -np.cos(x[0]) * (1 - x[1])
    x[:2] = turn(tilt) @ x[:2]
    mesh = type(mesh)(size * x, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU).fix("held")
    return body.fix("ends", "z") if solid else body


def pressed(element, n, functional=None, tilt=0.0, size=1.0, **more):
    """The roller moved by DOWN into a plane: places along it, pressures and weights."""
    body = roller(element, n, tilt=tilt, size=size, **more)
    along, up = np.zeros((2, body.dim))
    along[:2], up[:2] = turn(tilt).T
    plane = Plane(-size * (1 - DOWN) * up, up)
    result = ContactProblem(body, "roller", plane, functional=functional).solve()
    return along @ result.x / size, result.pressure, result.system.rows.weights / size


def whole_ring(element, around, radii, turn):
    """A ring of `around` facets and its sides "bore" and "rim"; plane strain, E of one."""
    kind, radii = STRAIGHT[element], np.asarray(radii)
    strip = kind.init_tensor(np.arange(radii.size + 0.0), np.arange(around + 1.0))
    i, j = strip.p.round().astype(int)
    number = i * around + j % around  # the first and the last row of vertices are one
    p, angle = np.zeros((2, radii.size * around)), turn + 2 * np.pi * j / around
    p[:, number] = radii[i] * np.array([np.cos(angle), np.sin(angle)])
    mesh = kind(p, number[strip.t], sort_t=False)
    facets = mesh.boundary_facets()
    inner = np.linalg.norm(p[:, mesh.facets[0, facets]], axis=0) < radii.mean()
    mesh = mesh.with_boundaries({"bore": facets[inner], "rim": facets[~inner]})
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU)
