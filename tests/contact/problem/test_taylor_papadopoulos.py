"""Taylor and Papadopoulos' patch test with the solver, in the plane and in space, along and tilted.

A small block presses with a uniform pressure on a large one, whose surface carries the same
pressure beside it, integrated over what the block leaves of each facet, so that the stress is
uniform in both. (R. L. Taylor and P. Papadopoulos, On a patch test for contact problems in two
dimensions, in: Nonlinear Computational Mechanics, Springer 1991.)
"""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from scipy.spatial.transform import Rotation
from solid_boxes import box
from two_blocks import NU, E, block

from contact import ContactProblem, Pair
from contact.facet_basis import facet_basis
from skfem_adini import ElementQuadBFS

PRESSURE = 0.7
WIDE = {2: np.array([0.55]), 3: np.array([0.55, 0.45])}
TICKS = {2: np.linspace(0.0, 1.0, 8), 3: np.linspace(0.0, 1.0, 4)}  # of the large block
TILT = {
    2: Rotation.from_euler("z", 0.37).as_matrix()[:2, :2],
    3: Rotation.from_euler("xyz", [0.3, -0.4, 0.2]).as_matrix(),
}
GAUSS = np.polynomial.legendre.leggauss(4)
REFERENCE = {2: np.array([[0.0, 1.0]]), 3: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])}


def shifts(seed, count, slivers, dim):
    """Places of the small block: anywhere, or with an end close to a vertex of the large one."""
    rng, wide, ticks = np.random.default_rng(seed), WIDE[dim], TICKS[dim]
    found = list(rng.uniform(0.0, 1.0 - wide, (count, dim - 1)))
    starts, ends = ticks[1:2], ticks[1:2]
    if dim == 2:
        starts, ends = ticks[1:4], ticks[4:-1] - wide[0]
    for k, sliver in enumerate(slivers):
        found.append(rng.choice(starts if k % 2 else ends) + sliver * rng.choice([-1, 1], dim - 1))
    return found


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
    """Gauss points and weights on an interval, or on a convex polygon through Duffy's map."""
    t, v = 0.5 * (1 + GAUSS[0]), 0.5 * GAUSS[1]
    if polygon.shape[0] == 1:
        low, high = np.sort(polygon[0])
        return (low + t * (high - low))[None], v * (high - low)
    s, r = (a.ravel() for a in np.meshgrid(t, t))
    weight = np.outer(v, v).ravel() * r
    points, weights = [], []
    a = polygon[:, 0]
    for b, c in zip(polygon.T[1:-1], polygon.T[2:], strict=True):
        points.append(a[:, None] + r * ((b - a)[:, None] * (1 - s) + (c - a)[:, None] * s))
        weights.append(abs(np.linalg.det([b - a, c - a])) * weight)
    return np.hstack(points), np.hstack(weights)


def press_beside(body, turn, low, high):
    """Load the top of a body by the pressure, but for what the small block covers."""
    dim = len(turn)
    normal, reference = turn[:, -1], REFERENCE[dim]
    body.load("top", -PRESSURE * normal)
    for facet in body.facets("top"):
        facet = np.array([facet])
        rule_at = reference, np.ones(reference.shape[1])
        at = facet_basis(body.mesh, body.basis.elem, facet, quadrature=rule_at)
        a, *ends = (turn.T @ np.asarray(at.global_coordinates())[:, 0])[:-1].T
        slope = np.array([b - a for b in ends]).T
        if dim == 2:
            ends = np.clip([a, a + slope[0]], low, high).T
            part = ends if np.ptp(ends) > 0 else ends[:, :0]
        else:
            square = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
            corners = reference if body.mesh.refdom.nnodes == 4 else square
            part = clipped(a[:, None] + slope @ corners, low, high)
        if part.size:
            part = np.linalg.solve(slope, part - a[:, None])
            basis = facet_basis(body.mesh, body.basis.elem, facet, quadrature=rule(part))
            body.f = body.f + body._load_vector(basis, PRESSURE * normal, "traction")


def blocks(element, shift, count, place):
    """The small block and the large one."""
    if element not in SOLID:
        xs = shift[0] + np.linspace(0.0, WIDE[2][0], count + 1)
        upper = block(element, xs, [0.0, 0.3, 0.8], place=place)
        return upper, block(element, TICKS[2], [-1.0, -0.4, 0.0], place=place)
    upper = box(element, (2 + count % 2, 2, 1), (*shift, 0.0), (*WIDE[3], 0.5), place=place)
    return upper, box(element, (3, 3, 2), (0.0, 0.0, -1.0), place=place)


def run(element, multipliers, places):
    """Along and tilted, with and without friction."""
    dim = element().dim
    for k, shift in enumerate(places):
        turn = TILT[dim] if k % 2 and element is not ElementQuadBFS else np.eye(dim)
        upper, lower = blocks(element, shift, 3 + k % 4, lambda x, turn=turn: turn @ x)
        sigma = -PRESSURE * np.outer(turn[:, -1], turn[:, -1])
        trace = np.trace(sigma) * (1 if dim == 3 else 1 + NU)
        g = ((1 + NU) * sigma - NU * trace * np.eye(dim)) / E
        press_beside(lower, turn, shift, shift + WIDE[dim])
        for body, side in ((upper, "top"), (lower, "bottom")):
            for c in range(dim):
                body.fix(side, c, lambda x, c=c, g=g: np.tensordot(g[c], x, 1))
        friction = 0.3 * (k % 3 == 0)
        pair = Pair(upper, "bottom", lower, "top", friction=friction, multipliers=multipliers)
        result = ContactProblem([upper, lower], [pair]).solve()
        assert max(result.kkt.values()) <= 1e-10
        w = result.system.rows.weights
        counts = w > 1e-3 * w.max()
        assert np.abs(result.pressure / PRESSURE - 1)[counts].max() <= 1e-9
        for body in (upper, lower):
            exact = g @ body.mesh.p
            nodes = dim * body.scalar_dofs.nodal_dofs[0] + np.arange(dim)[:, None]
            assert np.abs(result[body].u[nodes] - exact).max() <= 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize(
    "twenty",
    [pytest.param(False, marks=pytest.mark.sampled(5)), pytest.param(True, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", PLANE_AND_BFS + SOLID, ids=lambda e: e.__name__)
def test_patches(element, multipliers, twenty):
    dim, slivers = element().dim, [1e-3, 1e-5, 1e-7, 1e-9]
    few = 11, 2, slivers[:: dim - 1], dim
    run(element, multipliers, shifts(*((12, 15, [1e-2, *slivers], dim) if twenty else few)))
