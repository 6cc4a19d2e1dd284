"""Taylor and Papadopoulos' patch test with the solver: facets covered in part, slivers among them.

A small block presses with a uniform pressure on a large one, whose surface carries the same
pressure beside it, so that the stress is uniform in both. (R. L. Taylor and P. Papadopoulos, On a
patch test for contact problems in two dimensions, in: Nonlinear Computational Mechanics, Springer
1991.)
"""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from two_blocks import NU, E, block, turned

from contact import ContactProblem, Pair
from contact.facet_basis import facet_basis
from skfem_adini import ElementQuadBFS

PRESSURE, WIDE = 0.7, 0.55
TICKS = np.linspace(0.0, 1.0, 8)  # of the large block


def shifts(seed, count, slivers=(1e-3, 1e-5, 1e-7, 1e-9)):
    """Places of the small block: anywhere, and such that an end is close to a vertex."""
    rng = np.random.default_rng(seed)
    found = list(rng.uniform(0.0, 1.0 - WIDE, count - len(slivers)))
    for k, sliver in enumerate(slivers):
        end = rng.choice(TICKS[1:4]) if k % 2 else rng.choice(TICKS[4:-1]) - WIDE
        found.append(end + sliver * rng.choice([-1, 1]))
    return found


def strain(n):
    """Gradient of the displacement under a uniform pressure along n in plane strain."""
    across, along = NU * (1 + NU) / E, -(1 - NU**2) / E
    t = np.array([-n[1], n[0]])
    return PRESSURE * (along * np.outer(n, n) + across * np.outer(t, t))


def press(body, boundary, n, along, covered):
    """Load a side by the pressure outside of the covered interval, part of a facet by part."""
    points, weights = np.polynomial.legendre.leggauss(4)
    mesh = body.mesh
    for facet in body.facets(boundary):
        a, b = along @ mesh.p[:, mesh.facets[:, facet]]
        cut = np.sort(np.clip((np.array(covered) - a) / (b - a), 0.0, 1.0))
        for low, high in ((0.0, cut[0]), (cut[1], 1.0)):
            if high > low:
                rule = (low + 0.5 * (1 + points) * (high - low))[None], 0.5 * weights * (high - low)
                basis = facet_basis(mesh, body.basis.elem, np.array([facet]), quadrature=rule)
                body.f = body.f + body._load_vector(basis, -PRESSURE * n, "traction")


def patch(element, other, shift, multipliers, angle, friction, count, size=1.0):
    """Errors of the pressure where its weight counts, and of the displacement, relative."""
    place, (c, s) = turned(angle), (np.cos(angle), np.sin(angle))
    n, along = np.array([-s, c]), np.array([c, s])
    xs = shift + np.linspace(0.0, WIDE, count + 1)
    upper = block(element, xs, [0.0, 0.3, 0.8], place=place, size=size)
    lower = block(other, TICKS, [-1.0, -0.4, 0.0], place=place, size=size)
    g = strain(n)
    press(lower, "top", n, along, size * np.array([xs[0], xs[-1]]))
    for k in range(2):
        lower.fix("bottom", k, lambda x, k=k: np.tensordot(g[k], x, 1))
        if angle:
            upper.fix("top", k, lambda x, k=k: np.tensordot(g[k], x, 1))
    if not angle:
        upper.fix("left", "x", lambda x: np.tensordot(g[0], x, 1)).load("top", (0.0, -PRESSURE))
    pair = Pair(upper, "bottom", lower, "top", friction=friction, multipliers=multipliers)
    result = ContactProblem([upper, lower], [pair]).solve()
    assert max(result.kkt.values()) <= 1e-10
    w = result.system.rows.weights
    counts = w > 1e-3 * w.max()
    off = np.abs(result.pressure / PRESSURE - 1)[counts].max()
    moved = []
    for body in (upper, lower):
        x = body.mesh.p
        exact = g @ x
        nodes = 2 * body.scalar_dofs.nodal_dofs[0] + np.arange(2)[:, None]
        moved.append(np.abs(result[body].u[nodes] - exact).max() / np.abs(exact).max())
    return off, max(moved)


def run(element, multipliers, places):
    """Along and turned, with and without friction."""
    turn = 0.0 if element is ElementQuadBFS else 0.37
    for k, shift in enumerate(places):
        angle, friction, count = turn * (k % 2), 0.3 * (k % 3 == 0), 3 + k % 4
        off, moved = patch(element, element, shift, multipliers, angle, friction, count)
        assert off <= 1e-9
        assert moved <= 1e-9


@pytest.mark.sampled(3)
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", PLANE_AND_BFS, ids=lambda e: e.__name__)
def test_some_places(element, multipliers):
    run(element, multipliers, shifts(11, 6))


@pytest.mark.slow
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", PLANE_AND_BFS, ids=lambda e: e.__name__)
def test_twenty_places(element, multipliers):
    run(element, multipliers, shifts(12, 20))
