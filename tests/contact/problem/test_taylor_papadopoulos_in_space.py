"""Taylor and Papadopoulos' patch test in space: a small box on a large one, along and tilted.

The surface beside the small box carries its pressure, integrated over what the box leaves of each
facet, so that the stress is uniform in both bodies.
"""

import numpy as np
import pytest
from families import SOLID
from scipy.spatial.transform import Rotation
from solid_boxes import box

from contact import ContactProblem, Pair
from contact.facet_basis import facet_basis

PRESSURE, E, NU = 0.7, 2.0, 0.3
WIDE, CELLS = np.array([0.55, 0.45]), 3
TILT = Rotation.from_euler("xyz", [0.3, -0.4, 0.2]).as_matrix()
REFERENCE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def clipped(polygon, low, high):
    """The part of a convex polygon (2, k) in a rectangle."""
    for axis in (0, 1):
        for sign, bound in ((1, low[axis]), (-1, -high[axis])):
            above = sign * polygon[axis] - bound
            kept = []
            for i in range(polygon.shape[1]):
                k = (i + 1) % polygon.shape[1]
                if above[i] >= 0:
                    kept.append(polygon[:, i])
                if above[i] * above[k] < 0:
                    s = above[i] / (above[i] - above[k])
                    kept.append((1 - s) * polygon[:, i] + s * polygon[:, k])
            if len(kept) < 3:
                return np.zeros((2, 0))
            polygon = np.array(kept).T
    return polygon


def rule(polygon):
    """Gauss points and weights of degree 5 on a convex polygon, through Duffy's map of its fan."""
    t, v = np.polynomial.legendre.leggauss(4)
    s, r = (a.ravel() for a in np.meshgrid(0.5 * (1 + t), 0.5 * (1 + t)))
    weight = np.outer(0.5 * v, 0.5 * v).ravel() * r
    points, weights = [], []
    a = polygon[:, 0]
    for b, c in zip(polygon.T[1:-1], polygon.T[2:], strict=True):
        points.append(a[:, None] + r * ((b - a)[:, None] * (1 - s) + (c - a)[:, None] * s))
        weights.append(abs(np.linalg.det([b - a, c - a])) * weight)
    return np.hstack(points), np.hstack(weights)


def press_beside(body, turn, low, high):
    """Load the top of a body by the pressure, but for what a rectangle covers."""
    normal = turn @ [0.0, 0.0, 1.0]
    body.load("top", -PRESSURE * normal)
    for facet in body.facets("top"):
        facet = np.array([facet])
        at = facet_basis(body.mesh, body.basis.elem, facet, quadrature=(REFERENCE, np.ones(3)))
        a, b, c = ((turn.T @ np.asarray(at.global_coordinates())[:, 0])[:2]).T
        slope = np.array([b - a, c - a]).T
        corners = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
        if body.mesh.refdom.nnodes == 4:
            corners = REFERENCE
        part = clipped(a[:, None] + slope @ corners, low, high)
        if part.size:
            part = np.linalg.solve(slope, part - a[:, None])
            basis = facet_basis(body.mesh, body.basis.elem, facet, quadrature=rule(part))
            body.f = body.f + body._load_vector(basis, PRESSURE * normal, "traction")


def patch(element, other, shift, multipliers, tilted, friction, cells=(2, 2)):
    """Errors of the pressure where its weight counts, and of the displacement, relative."""
    turn = TILT if tilted else np.eye(3)
    place = lambda x: turn @ x  # noqa: E731
    upper = box(element, (*cells, 1), (*shift, 1.0), (*WIDE, 0.5), place=place)
    lower = box(other, (CELLS, CELLS, 2), place=place)
    n = turn @ [0.0, 0.0, 1.0]
    sigma = -PRESSURE * np.outer(n, n)
    g = ((1 + NU) * sigma - NU * np.trace(sigma) * np.eye(3)) / E
    press_beside(lower, turn, shift, shift + WIDE)
    for body, side in ((upper, "top"), (lower, "bottom")):
        for k in range(3):
            body.fix(side, k, lambda x, k=k: np.tensordot(g[k], x, 1))
    pair = Pair(upper, "bottom", lower, "top", friction=friction, multipliers=multipliers)
    result = ContactProblem([upper, lower], [pair]).solve()
    assert max(result.kkt.values()) <= 1e-10
    w = result.system.rows.weights
    counts = w > 1e-3 * w.max()
    off = np.abs(result.pressure / PRESSURE - 1)[counts].max()
    moved = []
    for body in (upper, lower):
        exact = g @ body.mesh.p
        nodes = 3 * body.scalar_dofs.nodal_dofs[0] + np.arange(3)[:, None]
        moved.append(np.abs(result[body].u[nodes] - exact).max() / np.abs(exact).max())
    return off, max(moved)


def shifts(seed, count, slivers):
    """Places of the small box: anywhere, or with an edge close to vertices of the large one."""
    rng = np.random.default_rng(seed)
    found = list(rng.uniform(0.0, 1.0 - WIDE, (count, 2)))
    found += [1 / 3 + s * rng.choice([-1, 1], 2) for s in slivers]
    return found


@pytest.mark.sampled(7)
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
def test_in_space(element, multipliers):
    run(element, multipliers, shifts(11, 2, [1e-3, 1e-7]))


@pytest.mark.slow
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
def test_at_twenty_places(element, multipliers):
    run(element, multipliers, shifts(12, 15, [1e-2, 1e-3, 1e-5, 1e-7, 1e-9]))


def run(element, multipliers, places):
    for k, shift in enumerate(places):
        tilted, friction, cells = k % 2 == 0, 0.3 * (k % 3 == 0), (2 + k % 2, 2)
        off, moved = patch(element, element, shift, multipliers, tilted, friction, cells)
        assert off <= 1e-9
        assert moved <= 1e-9
