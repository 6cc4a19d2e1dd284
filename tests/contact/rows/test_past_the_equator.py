"""Contact boundaries of balls that reach to their equator and past it.

There a normal runs along the plane below, which it meets far off or not at all. The force of a
ball that is pressed on a plane does not depend on where its contact boundary ends, as long as that
is beyond the contact.
"""

import functools

import numpy as np
import pytest
from families import CURVED, SOLID
from hypothesis import given, settings
from hypothesis import strategies as st
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
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

DEPTH = 0.004
LAST, EQUATOR = np.deg2rad(120.0), np.deg2rad(np.linspace(85.0, 92.0, 15))
# Fine at the pole, which touches, and at the equator, from where the plane is far along normals.
ANGLES = np.unique((*np.linspace(0.0, 0.3, 13), *np.linspace(0.3, LAST, 10), *EQUATOR))
PLANE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]


@functools.cache
def roller(box, element, curved, plane):
    """Ring from its pole, at (0, -1), to 120 degrees, its inner side to be pressed down."""
    mesh = box(element, np.array([0.3, 0.55, 0.8, 0.95, 1.0]), ANGLES)
    names = dict(mesh.boundaries)
    if curved:
        mesh = CURVED[element].from_mesh(mesh)
    r, angle = mesh.doflocs
    place = np.array([r * np.sin(angle), -r * np.cos(angle)])
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3, plane=plane)
    return body.fix("left", "y", -DEPTH).fix("bottom" if plane == "strain" else "left", "x")


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


@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("element", PLANE)
def test_where_the_boundary_ends_does_not_matter(make, element, curved, plane):
    if curved and element is ElementQuadAdini:
        pytest.skip("Adini cells are straight")
    forces_of_sweep(make, element, curved, plane, np.linspace(60.0, 120.0, 5))


@pytest.mark.slow
@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
@pytest.mark.parametrize("element", PLANE)
def test_two_hundred_ends(make, element, plane):
    curved = element is not ElementQuadAdini
    forces_of_sweep(make, element, curved, plane, np.linspace(60.0, 120.0, 200))


def forces_of_sweep(make, element, curved, plane, ends):
    body = roller(make.box, element, curved, plane)
    known = ContactProblem(body, facets_to(body, 50.0), lambda x: x[1] + 1.0).solve()
    for degrees in ends:
        problem = ContactProblem(body, facets_to(body, degrees), Plane((0.0, -1.0), (0.0, 1.0)))
        # Along the normals and along the plane's normal gaps differ by the square of the angle.
        assert problem.solve().contact_force == pytest.approx(known.contact_force, rel=0.01)


@pytest.mark.parametrize("ground", range(5))
def test_every_ground(make, ground):
    body = roller(make.box, ElementTriP2, True, "strain")
    known = ContactProblem(body, facets_to(body, 50.0), lambda x: x[1] + 1.0).solve()
    obstacle = list(grounds(2))[ground]
    for degrees in (75.0, 89.0, 91.0, 120.0):
        result = ContactProblem(body, facets_to(body, degrees), obstacle).solve()
        assert result.contact_force == pytest.approx(known.contact_force, rel=0.01)


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
    body = roller(make.box, element, element is not ElementTriP1, "strain")
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


def straight_side(make, element, n=5):
    solid = element in SOLID
    ticks = np.linspace(0.0, 1.0, n + 1)
    mesh = make.box(element, ticks, ticks, *([ticks] if solid else []))
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).fix("top", "xy")


FUNCTIONALS = [
    (ElementTriP1, None),
    (ElementTriP2, "bernstein"),
    (ElementQuad2, "gauss"),
    (ElementQuadAdini, "bernstein"),
    (ElementQuadAdini, "centroid"),
    (ElementQuadAdini, "gauss"),
    (ElementQuadBFS, "bernstein"),
    (ElementTetP2, None),
    (ElementHex2, "bernstein"),
    (ElementHexAdini, None),
]


@pytest.mark.parametrize(("element", "functional"), FUNCTIONALS)
@settings(max_examples=25, deadline=None)
@given(edge=st.floats(0.01, 0.99), turn=st.floats(0.0, 6.3), height=st.floats(1e-3, 1e6))
def test_no_mean_of_a_step_lies_outside_its_gaps(make, element, functional, edge, turn, height):
    """Functionals with negative weights made -height / 2 of gaps 0 and height."""
    body = straight_side(make, element, 3)
    across = np.array([np.cos(turn), np.sin(turn) if body.dim == 3 else 0.0])

    def step(x):
        return np.where(across[0] * x[0] + across[1] * x[1] > edge * across[0], height, 0.0)

    gap = ContactProblem(body, "bottom", step, functional=functional).rows.gap
    assert gap.min() >= -1e-12 * height
    assert gap.max() <= height * (1 + 1e-12)


@pytest.mark.parametrize(("element", "functional"), FUNCTIONALS[1:])
def test_means_of_smooth_gaps_stay_as_they_are(make, element, functional):
    """The mean of a parabola dips below its points, as that of a displacement of the same form."""
    body = straight_side(make, element)
    gap = ContactProblem(body, "bottom", lambda x: 0.1 * (x[0] - 0.47) ** 2, functional=functional)
    down = np.eye(body.dim)[-1]
    u = body.basis.project(
        lambda x: -0.1 * (x[0] - 0.47) ** 2 * down.reshape(-1, *(1,) * (x.ndim - 1))
    )
    assert np.abs(gap.rows.G @ u - gap.rows.gap).max() < 1e-10


@pytest.mark.parametrize("ground", range(5))
def test_a_wall_does_not_face_the_ground_that_it_stands_on(ground):
    """Its side leans over by a millionth, and would be held from moving sideways at a gap of 0."""
    x, wall, sole = np.array([[0.0], [-1.0]]), np.array([[1.0], [-1e-6]]), np.array([[0.0], [-1.0]])
    obstacle = list(grounds(2))[ground]
    if isinstance(obstacle, SignedDistance):
        return
    assert np.isinf(obstacle(x, wall))
    assert abs(obstacle(x, sole)) < 1e-9


def test_closest_points_are_no_rays(make):
    body = roller(make.box, ElementTriP2, True, "strain")
    obstacle = ClosestPoint(Plane((0.0, -1.0), (0.0, 1.0)))
    gap = ContactProblem(body, facets_to(body, 120.0), obstacle).rows.gap
    assert np.all(np.isfinite(gap))
