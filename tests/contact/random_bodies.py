"""Bodies above random outlines: smooth, kinked, graded and noisy, of straight and curved cells."""

import numpy as np
import skfem
from families import CURVED, SOLID
from skfem import ElementHex2, ElementQuad2, ElementTetP2, ElementTriP2

from contact import ElasticBody
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

ADINI = (ElementQuadAdini, ElementHexAdini)
QUADRATIC = (ElementTriP2, ElementQuad2, ElementTetP2, ElementHex2)
BFS = (ElementQuadBFS, skfem.ElementQuadBFS)
DEPTH = 0.3  # of solids, across the plane of the outline


def outline(kind, bend):
    """Lower side of a body as functions of s in [0, 1]: places, and where the body is not."""

    def curve(s):
        angle = bend * (2 * s - 1)
        return {
            "line": lambda: (s, 0.0 * s),
            "arc": lambda: (np.sin(angle), 1 - np.cos(angle)),
            "ellipse": lambda: (1.3 * np.sin(angle), 0.7 * (1 - np.cos(angle))),
            "hollow": lambda: (1.5 * np.sin(angle), 1.5 * (np.cos(angle) - 1)),
            "wavy": lambda: (s, 0.008 * bend * np.cos(4 * np.pi * s)),
            "kinked": lambda: (s, np.tan(bend) * np.maximum(s - 0.5, 0.0)),
        }[kind]()

    def both(s):
        step = 1e-5
        ahead, behind = np.array(curve(s + step)), np.array(curve(s - step))
        if kind == "kinked":  # the body leans, so that no cell folds beside the kink
            return np.array(curve(s)), np.array([0.0 * s, -1.0 + 0.0 * s])
        tangent = (ahead - behind) / np.linalg.norm(ahead - behind, axis=0)
        return np.array(curve(s)), np.array([tangent[1], -tangent[0]])

    return both


def ticks(rng, n, grading):
    """Ends of facets in [0, 1], neighbours of ratios up to `grading`."""
    size = grading ** rng.uniform(0, 1, n) if grading > 1 else np.ones(n)
    return np.concatenate(([0.0], np.cumsum(size) / size.sum()))


def body_of(
    make,
    element,
    shape,
    s,
    layers,
    curved=False,
    noise=None,
    kink=(0, 0),
    size=1.0,
    E=1.0,
    nu=0.3,
    rough=None,
):
    """A body above the outline, as thick as .6."""
    solid = element in SOLID
    r = np.linspace(0.0, 1.0, layers + 1)
    depth = np.linspace(0.0, DEPTH, 2 if rough is None else rough.shape[1])
    cells = ElementQuadBFS if element in BFS else element
    mesh = make.box(cells, s, *([depth] if solid else []), r)
    names = dict(mesh.boundaries)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    place = mesh.doflocs.copy()
    c, n = shape(place[0])
    place[0], place[-1] = c - 0.6 * place[-1] * n
    low = mesh.doflocs[-1] == 0.0
    if noise is not None:
        for axis, part in zip((0, -1), noise, strict=True):
            place[axis, low] += np.interp(mesh.doflocs[0, low], s, part)
    if rough is not None:
        at = (np.abs(t[:, None] - mesh.doflocs[c, low]).argmin(0) for c, t in ((0, s), (1, depth)))
        place[-1, low] += rough[tuple(at)]
    place[-1] += np.tan(kink[1]) * np.maximum(mesh.doflocs[0] - kink[0], 0.0)
    mesh = type(mesh)(size * place, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)


def turned(body, angle, shift):
    """The body rotated in the plane of its first and last axis, and shifted."""
    mesh, (c, s) = body.mesh, (np.cos(angle), np.sin(angle))
    place = mesh.doflocs.copy()
    first, last = place[0].copy(), place[-1].copy()
    place[0], place[-1] = c * first - s * last + shift[0], s * first + c * last + shift[1]
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(dict(mesh.boundaries))
    return ElasticBody.from_mesh(mesh, type(body.element)(), E=float(body.E), nu=float(body.nu))
