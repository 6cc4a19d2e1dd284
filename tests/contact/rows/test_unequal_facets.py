"""Rollers whose facets differ in length: pressures converge as those of curved cells do.

The mean normal of a long facet beside a short one is that of a place aside, and what the body
slides along the curve must not count as a way towards the plane.
"""

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE, STRAIGHT
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTetP2, ElementTriP1, ElementTriP2

from contact import ContactProblem, ElasticBody, Plane
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

D, NU, REACH, DEPTH = 0.15, 0.3, 0.8, 0.1
SOLID = [ElementTetP1, ElementTetP2, ElementHex1, ElementHexAdini]


def lengths(pattern, n):
    """Of n facets, in parts of anything."""
    return {
        "equal": np.ones(n),
        "one beside two": np.where(np.arange(n) % 2, 2.0, 1.0),
        "one beside four": np.where(np.arange(n) % 2, 4.0, 1.0),
        "any": np.random.default_rng(0).uniform(1, 3, n),
    }[pattern]


def pressed(element, n, pattern, curved=False, functional=None):
    """Roller of radius one, held along its upper side, moved by D into a plane: x, p, weights."""
    solid = element in SOLID
    size = lengths(pattern, 2 * round(REACH / (np.pi / 2 / n)))
    angle = REACH * (2 * np.r_[0.0, np.cumsum(size)] / size.sum() - 1)
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
    mesh = type(mesh)(x, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU).fix("held")
    if solid:
        body.fix("ends", "z")
    up = np.eye(body.dim)[1]
    problem = ContactProblem(body, "roller", Plane(-(1 - D) * up, up), functional=functional)
    result = problem.solve()
    return result.x[0], result.pressure, result.system.rows.weights


@pytest.fixture(scope="module")
def exact():
    """Half-width, largest pressure, and the pressure on curved quadratic triangles."""
    x, p, _ = pressed(ElementTriP2, 64, "equal", curved=True)
    along = np.argsort(x)
    x, p = x[along], p[along]
    edge = (x > 0) & (p > 0.2 * p.max()) & (p < 0.6 * p.max())
    slope, at = np.polyfit(x[edge], p[edge] ** 2, 1)  # linear at the edge
    a = -at / slope
    inside = np.abs(x) < 0.95 * a
    round_ = np.sqrt(a**2 - x[inside] ** 2)
    return (
        a,
        p.max(),
        lambda s: np.interp(s, x[inside], p[inside] / round_) * np.sqrt(a**2 - s**2),
    )


def error(exact, *case, **more):
    """Rms of the pressure where |x| < .8 a, in parts of the largest."""
    a, largest, p = exact
    x, found, w = pressed(*case, **more)
    inside = np.abs(x) < 0.8 * a
    off, w = (found[inside] - p(x[inside])) / largest, w[inside]
    return float(np.sqrt(np.sum(w * off**2) / w.sum()))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", PLANE)
def test_one_beside_two(element, exact):
    """Rms over four meshes whose facets lie differently about the edge of the zone.

    Stresses of linear triangles, and of bilinear cells where long and short ones alternate, are of
    first order.
    """
    facets = [12, 24, 48]
    found = [
        np.sqrt(np.mean([error(exact, element, n + k, "one beside two") ** 2 for k in range(4)]))
        for n in facets
    ]
    first = element in (ElementTriP1, ElementQuad1)
    assert found[1] < (0.04 if element is ElementTriP1 else 0.01)
    assert order(facets, found) > (0.5 if first else 1.8)
    assert found[2] < (0.6 * found[1] if first else 0.0025)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("pattern", ["one beside four", "any"])
@pytest.mark.parametrize("element", PLANE)
def test_roller(element, pattern, exact):
    """Straight cells in the plane; stresses of linear triangles are of first order."""
    facets = [12, 24, 48]
    found = [error(exact, element, n, pattern) for n in facets]
    coarse = pattern == "one beside four"
    limit = 0.07 if element is ElementTriP1 else 0.02 if coarse else 0.014
    assert found[1] < limit
    if element is ElementQuad1:  # its errors cancel on coarse meshes
        assert found[-1] < (0.012 if coarse else 0.006)
    else:
        assert order(facets, found) > (0.4 if element is ElementTriP1 else 1.2)


def test_shares_of_the_mean(exact):
    """Adini's other functional that passes the patch test."""
    facets, case = [24, 48], (ElementQuadAdini, "one beside two")
    found = [error(exact, case[0], n, case[1], functional="centroid") for n in facets]
    assert found[0] < 0.02
    assert found[1] < 0.5 * found[0]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("element", SOLID)
def test_roller_in_space(element, exact):
    """Triangles at the ends of a slice lie unevenly about their vertices."""
    facets = [8, 16, 24] if element is not ElementHexAdini else [8, 16]
    found = [error(exact, element, n, "equal") for n in facets]
    assert found[-1] < (0.03 if element is ElementTetP1 else 0.01)
    assert order(facets, found) > 1.2 or element is ElementHex1
