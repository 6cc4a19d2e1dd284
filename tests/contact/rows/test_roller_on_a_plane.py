"""Pressures of a roller pressed on a plane, straight or tilted, with straight and curved cells.

The lower part of a roller of radius one, held along its straight upper side, moves down by D. The
pressure falls off at the edge of the zone like a square root, whose place no mesh knows to better
than a part of a facet: errors are those where |x| < .8 a. The reference is the fine mesh of curved
quadratic cells, and Hertz' law within the square of a / R (K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 4.2), by which his half space differs from this body.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE, STRAIGHT
from scipy.interpolate import CubicSpline
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, MeshQuad

from contact import ContactProblem, ElasticBody, Plane

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

D, NU, REACH = 0.15, 0.3, 0.8
CROSSED = SimpleNamespace(
    init_tensor=lambda *ticks: MeshQuad.init_tensor(*ticks).to_meshtri(style="x")
)
CASES = [(e, c) for e in PLANE for c in (False, True) if not c or e in CURVED]


def roller(element, n, curved, turn, size=1.0, cells=None):
    """Held along its upper side, n facets on a quarter turn, turned by a matrix."""
    across = max(2, n // 2)
    count = 2 * round(REACH / (np.pi / 2 / n))
    mesh = (cells or STRAIGHT[element]).init_tensor(
        np.linspace(-REACH, REACH, count + 1), np.linspace(0, 1, across + 1)
    )
    names = {
        "roller": mesh.facets_satisfying(lambda x: x[1] < 1e-9),
        "held": mesh.facets_satisfying(lambda x: x[1] > 1 - 1e-9),
    }
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    angle, up = mesh.doflocs
    x = np.array([np.sin(angle), -np.cos(angle) * (1 - up)])
    order = {} if curved else {"sort_t": False}
    mesh = type(mesh)(size * turn @ x, mesh.t, **order).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU).fix("held")


def pressed(element, n, curved, tilt=0.0, size=1.0, cells=None):
    """Places along the plane, pressures and weights."""
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    normal = turn[:, 1]
    plane = Plane(tuple(-normal * size * (1 - D)), tuple(normal))
    problem = ContactProblem(roller(element, n, curved, turn, size, cells), "roller", plane)
    result = problem.solve()
    return turn[:, 0] @ result.x / size, result.pressure, result.system.rows.weights / size


@cache
def reference():
    """Half-width, largest pressure, and the pressure as a function of x."""
    x, p, _ = pressed(ElementQuad2, 96, True)
    largest = p.max()
    # The square of the pressure falls linearly at the edge.
    edge = (x > 0) & (p > 0.2 * largest) & (p < 0.6 * largest)
    slope, at = np.polyfit(x[edge], p[edge] ** 2, 1)
    a = -at / slope
    inside = np.abs(x) < 0.95 * a
    along = np.argsort(x[inside])
    x, p = x[inside][along], p[inside][along]
    shape = CubicSpline(x, p / np.sqrt(a**2 - x**2))
    return a, largest, lambda x: shape(np.clip(x, -a, a)) * np.sqrt(np.maximum(a**2 - x**2, 0.0))


def error(element, n, curved, **where):
    """Rms of the pressure where |x| < .8 a, in parts of the largest."""
    a, largest, exact = reference()
    x, p, w = pressed(element, n, curved, **where)
    inside = np.abs(x) < 0.8 * a
    off, w = p[inside] - exact(x[inside]), w[inside]
    return float(np.sqrt(np.sum(w * off**2) / w.sum()) / largest)


def test_reference_is_hertz():
    a, largest, _ = reference()
    assert abs(largest / (a / (2 * (1 - NU**2))) - 1) < a**2


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "curved"), [c for c in CASES if c[0] is not ElementQuad1])
def test_roller(element, curved):
    """What P1 on one diagonal is off by is its displacement's error, see the last test."""
    facets = [12, 24, 48]
    found = [error(element, n, curved) for n in facets]
    assert found[1] < (0.03 if element is ElementTriP1 else 0.01)
    assert order(facets, found) > 1.2


@pytest.mark.sampled(2)
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize(
    ("element", "cells"), [(ElementQuad1, None), (ElementTriP1, CROSSED)], ids=["Q1", "crossed P1"]
)
def test_roller_on_average_over_places_of_the_edge(element, cells, curved):
    """Where facets lie about the zone's edge decides a factor of four of these elements' errors.

    So order and size are those of the rms over four meshes, of n to n + 3 facets, whose facets
    shift by a quarter of one at the edge: it lies at .27 n facets.
    """
    facets = [12, 24, 48, 96] if cells is None else [12, 24, 48]
    found = []
    for n in facets:
        each = [error(element, n + more, curved, cells=cells) for more in range(4)]
        found.append(np.sqrt(np.mean(np.square(each))))
        assert max(each) < 0.02 * 12 / n
    assert found[1] < 0.005
    assert order(np.array(facets) + 1.5, found) > 1.2


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("tilt", "size"), [(0.4, 1.0), (-1.1, 1e-6), (2.5, 1e3), (np.pi / 2, 1.0)])
@pytest.mark.parametrize(("element", "curved"), CASES)
def test_tilted_plane(element, curved, tilt, size):
    """The same pressures in any direction and in any unit of length."""
    x, p, w = pressed(element, 12, curved)
    turned = pressed(element, 12, curved, tilt, size)
    # Rounding of the coordinates over the shortest facets, and of a factorisation.
    assert np.abs(np.sort(turned[0]) - np.sort(x)).max() < 1e-9
    here, there = np.argsort(x), np.argsort(turned[0])
    assert np.abs(turned[1][there] - p[here]).max() < 1e-8 * p.max()
    assert np.abs(turned[2][there] - w[here]).max() < 1e-9 * w.max()


@pytest.mark.parametrize(("element", "curved"), CASES)
def test_errors_are_those_of_the_displacement(element, curved):
    """The exact pressure as a load, and what it displaces as a gap, give the exact pressure.

    So what P1 is off by is its own displacement's error, that a load without contact shows too.
    """
    a, largest, exact = reference()

    def traction(x):
        return -exact(x[0]) * x / np.linalg.norm(x, axis=0)

    body = roller(element, 24, curved, np.eye(2))
    loaded = roller(element, 24, curved, np.eye(2)).load("roller", traction)
    P, _ = loaded.constraint
    u = P @ spsolve((P.T @ loaded.stiffness @ P).tocsc(), P.T @ loaded.f)
    gap = ContactProblem(body, "roller", 0.0).rows.G @ u
    result = ContactProblem(body, "roller", gap).solve()
    x = result.x[0]
    inside = np.abs(x) < 0.8 * a
    # A point's pressure is the mean over its share, off by the square of a facet's length: the same
    # for all elements.
    rms = np.sqrt(np.mean((result.pressure - exact(x))[inside] ** 2))
    assert rms < 0.006 * largest
