"""Pressures of a roller pressed on a plane: straight, tilted, graded, in space, past its equator.

The pressure falls off at the edge of the zone like a square root, whose place no mesh knows to
better than a part of a facet: errors are those where |x| < .8 a. The reference is the fine mesh of
curved quadratic cells, and Hertz' law within the square of a / R (K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 4.2), by which his half space differs from this body.
"""

from functools import cache

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE
from scipy.interpolate import CubicSpline
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

from contact import (
    ClosestPoint,
    ContactProblem,
    Cylinder,
    ElasticBody,
    Pair,
    Plane,
    Rough,
    SignedDistance,
    SurfaceMesh,
)
from skfem_adini import ElementHexAdini
from tests.contact.rows.cases import NU, pressed

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

CASES = [(e, c) for e in PLANE for c in (False, True) if not c or e in CURVED]


@cache
def reference():
    """Half-width, largest pressure, and the pressure as a function of x."""
    x, p, _ = pressed(ElementQuad2, 96, curved=True)
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


def error(element, n, **where):
    """Rms of the pressure where |x| < .8 a, in parts of the largest."""
    a, largest, exact = reference()
    x, p, w = pressed(element, n, **where)
    inside = np.abs(x) < 0.8 * a
    off, w = p[inside] - exact(x[inside]), w[inside]
    return float(np.sqrt(np.sum(w * off**2) / w.sum()) / largest)


def test_reference_is_hertz():
    a, largest, _ = reference()
    assert abs(largest / (a / (2 * (1 - NU**2))) - 1) < a**2


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("element", "curved", "pattern"),
    [(*case, "equal") for case in CASES if case[0] is not ElementQuad1]
    + [(e, False, p) for e in PLANE for p in ("one beside four", "any")],
)
def test_roller(element, curved, pattern):
    """The mean normal of a long facet beside a short one is that of a place aside."""
    facets, first = [12, 24, 48], element is ElementTriP1
    found = [error(element, n, curved=curved, pattern=pattern) for n in facets]
    limits = {"equal": (0.01, 0.03), "one beside four": (0.02, 0.07), "any": (0.014, 0.07)}
    assert found[1] < limits[pattern][first]
    if element is ElementQuad1:  # its errors cancel on coarse meshes
        assert found[-1] < (0.012 if pattern == "one beside four" else 0.006)
    else:
        assert order(facets, found) > (0.4 if first and pattern != "equal" else 1.2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("element", [ElementTetP1, ElementTetP2, ElementHex1, ElementHexAdini])
def test_roller_in_space(element):
    """Triangles at the ends of a slice lie unevenly about their vertices."""
    facets = [8, 16, 24] if element is not ElementHexAdini else [8, 16]
    found = [error(element, n) for n in facets]
    assert found[-1] < (0.03 if element is ElementTetP1 else 0.01)
    assert order(facets, found) > 1.2 or element is ElementHex1


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("tilt", "size"), [(0.4, 1.0), (-1.1, 1e-6), (2.5, 1e3), (np.pi / 2, 1.0)])
@pytest.mark.parametrize(("element", "curved"), CASES)
def test_tilted_plane(element, curved, tilt, size):
    """The same pressures in any direction and in any unit of length."""
    x, p, w = pressed(element, 12, curved=curved)
    turned = pressed(element, 12, curved=curved, tilt=tilt, size=size)
    here, there = np.argsort(x), np.argsort(turned[0])
    # Rounding of the coordinates over the shortest facets, and of a factorisation.
    assert np.abs(turned[0][there] - x[here]).max() < 1e-9
    assert np.abs(turned[1][there] - p[here]).max() < 1e-8 * p.max()
    assert np.abs(turned[2][there] - w[here]).max() < 1e-9 * w.max()


# Contact boundaries that reach to the equator and past it: there a normal runs along the plane
# below, which it meets far off or not at all. The force does not depend on where they end.
SINK = 0.004
LAST, EQUATOR = np.deg2rad(120.0), np.deg2rad(np.linspace(85.0, 92.0, 15))
# Fine at the pole, which touches, and at the equator, from where the plane is far along normals.
ANGLES = np.unique((*np.linspace(0.0, 0.3, 13), *np.linspace(0.3, LAST, 10), *EQUATOR))


@cache
def half_roller(box, element, curved, plane="strain"):
    """Ring from its pole, at (0, -1), to 120 degrees, its inner side to be pressed down."""
    mesh = box(element, np.array([0.3, 0.55, 0.8, 0.95, 1.0]), ANGLES)
    names = dict(mesh.boundaries)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    r, angle = mesh.doflocs
    place = np.array([r * np.sin(angle), -r * np.cos(angle)])
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3, plane=plane)
    return body.fix("left", "y", -SINK).fix("bottom" if plane == "strain" else "left", "x")


def facets_to(body, degrees):
    """Facets of the outer side up to an angle from the pole."""
    facets = body.mesh.boundaries["right"]
    middle = body.mesh.p[:, body.mesh.facets[:, facets]].mean(axis=1)
    angle = np.arctan2(np.linalg.norm(middle[:-1], axis=0), -middle[-1])
    return facets[np.rad2deg(angle) < degrees]


def grounds(dim):
    """The plane below the pole, by every obstacle that follows the normals."""
    low, up = (0.0,) * (dim - 1) + (-1.0,), np.eye(dim)[-1]
    yield Plane(low, up)
    yield SignedDistance(lambda x: x[-1] + 1.0)
    yield Rough(np.zeros((5,) * (dim - 1)), (10.0,) * (dim - 1), point=low)
    if dim == 2:
        corners = [[-9.0, 9.0, 9.0, -9.0], [-1.0, -1.0, -2.0, -2.0]]
        yield SurfaceMesh(corners, [[0, 1, 2, 3], [1, 2, 3, 0]])
        yield Cylinder((0.0, -1e4 - 1.0), 1e4)


def force(body, end, obstacle=lambda x: x[1] + 1.0):
    """Of what is pressed up to an angle; the gap of a function is that along the vertical."""
    return ContactProblem(body, facets_to(body, end), obstacle).solve().contact_force


@pytest.mark.parametrize("ends", [5, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
@pytest.mark.parametrize(("element", "curved"), CASES)
def test_where_the_boundary_ends_does_not_matter(make, element, curved, plane, ends):
    body = half_roller(make.box, element, curved, plane)
    known = force(body, 50.0)
    for end in np.linspace(60.0, 120.0, ends):
        # Along the normals and along the plane's normal gaps differ by the square of the angle.
        assert force(body, end, Plane((0.0, -1.0), (0.0, 1.0))) == pytest.approx(known, rel=0.01)


@pytest.mark.parametrize("ground", range(5))
def test_every_ground(make, ground):
    body = half_roller(make.box, ElementTriP2, True)
    known, obstacle = force(body, 50.0), list(grounds(2))[ground]
    for end in (75.0, 89.0, 91.0, 120.0):
        assert force(body, end, obstacle) == pytest.approx(known, rel=0.01)
    # A wall does not face the ground that it stands on, were it to lean over by a millionth.
    x, wall, sole = np.array([[0.0], [-1.0]]), np.array([[1.0], [-1e-6]]), np.array([[0.0], [-1.0]])
    if not isinstance(obstacle, SignedDistance):
        assert np.isinf(obstacle(x, wall))
        assert abs(obstacle(x, sole)) < 1e-9


def test_closest_points_are_no_rays(make):
    body = half_roller(make.box, ElementTriP2, True)
    obstacle = ClosestPoint(Plane((0.0, -1.0), (0.0, 1.0)))
    assert np.all(np.isfinite(ContactProblem(body, facets_to(body, 120.0), obstacle).rows.gap))


@pytest.mark.parametrize("element", [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2])
def test_balls_in_space(make, element):
    """A shell around the pole, whose corners lie past the equator."""
    ticks = np.array([-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0])
    mesh = make.box(element, ticks, ticks, np.array([0.5, 0.8, 1.0]))
    names = {"right": mesh.boundaries["top"], "inside": mesh.boundaries["bottom"]}
    if element in (ElementTetP2, ElementHex2):
        mesh = CURVED[element].from_mesh(mesh)
    a, b, r = mesh.doflocs
    rho = np.hypot(a, b)
    angle, rho = np.deg2rad(80.0) * rho, np.where(rho > 0, rho, 1.0)
    place = r * np.array([np.sin(angle) * a / rho, np.sin(angle) * b / rho, -np.cos(angle)])
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    body.fix("inside", "xy").fix("inside", "z", -0.02)
    pole = facets_to(body, 50.0)
    known = ContactProblem(body, pole, Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))).solve()
    for obstacle in grounds(3):
        result = ContactProblem(body, "right", obstacle).solve()
        assert result.contact_force == pytest.approx(known.contact_force, rel=1e-9)


@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad2, ElementTriP2])
def test_roller_on_an_elastic_ground(make, element):
    body = half_roller(make.box, element, element is not ElementTriP1)
    across = np.concatenate((np.linspace(0.0, 0.3, 13), np.linspace(0.3, 3.0, 12)[1:]))
    mesh = make.box(element, across, np.linspace(-2.0, -1.0, 6))
    ground = ElasticBody.from_mesh(mesh, element(), E=10.0, nu=0.3)
    ground.fix("bottom", "xy").fix("left", "x")
    forces = [
        ContactProblem([body, ground], [Pair(body, facets_to(body, end), ground, "top")])
        .solve()
        .contact_force
        for end in (50.0, 70.0, 88.0, 95.0, 120.0)
    ]
    assert np.ptp(forces) < 1e-3 * forces[0]
