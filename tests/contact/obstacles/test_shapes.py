"""Gaps to rigid shapes: closed forms, misses, signed distances, cones, bores; Lame and Hertz."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from skfem import ElementQuad1

from contact import (
    ClosestPoint,
    Cone,
    ContactProblem,
    Cylinder,
    ElasticBody,
    Parabola,
    Plane,
    Rigid,
    SignedDistance,
    Sphere,
)

number = st.floats(-3.0, 3.0)
size = st.floats(0.1, 3.0)
angle = st.floats(-np.pi, np.pi)


def vectors(dim):
    return st.tuples(*(number,) * dim).map(np.array)


def units(dim):
    flat = angle.map(lambda a: np.array([np.cos(a), np.sin(a)]))
    if dim == 2:
        return flat
    height = st.floats(-1.0, 1.0)
    return st.tuples(flat, height).map(
        lambda pair: np.array([*(pair[0] * np.sqrt(1 - pair[1] ** 2)), pair[1]])
    )


def at(obstacle, x, n):
    return float(obstacle(x[:, None], n[:, None])[0])


planar_or_solid = pytest.mark.parametrize("dim", [2, 3])


@planar_or_solid
def test_plane(dim):
    @given(vectors(dim), vectors(dim), units(dim), units(dim), size)
    def check(x, point, normal, n, length):
        facing = -n @ normal
        assume(abs(facing) > 1e-3)
        d = at(Plane(point, length * normal), x, n)
        if facing < 0:
            assert d == np.inf
        else:
            # The ray ends on the plane; rounding over the slope.
            assert abs((x + d * n - point) @ normal) < 1e-12 / facing

    check()


def closest(x, n, centre):
    """Distance of the centre from the ray's line, and where along the ray it is closest."""
    along = (centre - x) @ n
    return np.linalg.norm(x + along * n - centre), along


@pytest.mark.parametrize("hollow", [False, True])
@planar_or_solid
def test_ball(dim, hollow):
    """The ray enters where it should, or leaves the hole, from outside and inside; or it misses."""
    kind = Cylinder if dim == 2 else Sphere

    @given(vectors(dim), vectors(dim), size, units(dim))
    def check(x, centre, radius, n):
        distance, along = closest(x, n, centre)
        inside = np.linalg.norm(x - centre) < radius
        # Not at grazing incidence, not on the surface: there rounding decides.
        assume(abs(distance - radius) > 1e-3)
        assume(abs(np.linalg.norm(x - centre) - radius) > 1e-3)
        half = np.sqrt(max(radius**2 - distance**2, 0.0))
        for obstacle in (
            kind(centre, radius, hollow=hollow),
            Sphere(centre, radius, hollow=hollow),
        ):
            d = at(obstacle, x, n)
            if distance > radius or (not inside and (along > 0 if hollow else along < 0)):
                assert d == np.inf
            else:
                # Pythagoras; the lesser of two meetings, or the far one from within.
                assert abs(d - (along + half if hollow else along - half)) < 1e-11
                assert (d < 0) == (inside != hollow)

    check()


@given(vectors(3), vectors(3), size, units(3), units(3))
def test_cylinder_in_space(x, centre, radius, axis, n):
    """Seen along its axis a cylinder is a disk."""
    across = n - (n @ axis) * axis
    assume(np.linalg.norm(across) > 1e-2)
    u = across / np.linalg.norm(across)
    offset = (x - centre) - ((x - centre) @ axis) * axis
    distance, along = closest(offset, u, np.zeros(3))
    inside = np.linalg.norm(offset) < radius
    assume(abs(distance - radius) > 1e-3)
    assume(abs(np.linalg.norm(offset) - radius) > 1e-3)
    d = at(Cylinder(centre, radius, 2.0 * axis), x, n)
    if distance > radius or (along < 0 and not inside):
        assert d == np.inf
    else:
        expected = (along - np.sqrt(radius**2 - distance**2)) / np.linalg.norm(across)
        # Rounding over the grazing distance and the slope towards the axis.
        assert abs(d - expected) < 1e-9
    assert at(Cylinder(centre + 5.0 * axis, radius, -axis), x, n) == pytest.approx(d, abs=1e-9)


def test_cylinder_along_its_axis_and_hollow():
    down = np.array([0.0, 0.0, -1.0])
    assert at(Cylinder((0, 0, -5), 1.0), np.array([2.0, 0, 0]), down) == np.inf
    rng = np.random.default_rng(1)
    x, n = rng.uniform(-0.5, 0.5, (3, 30)), rng.standard_normal((3, 30))
    n /= np.linalg.norm(n, axis=0)
    solid = Cylinder((0.1, 0.2, 5.0), 2.0, axis=(0.0, 0.0, -3.0), hollow=True)
    across = np.hypot(n[0], n[1])
    flat = Cylinder((0.1, 0.2), 2.0, hollow=True)(x[:2], n[:2] / across)
    np.testing.assert_allclose(solid(x, n), flat / across, rtol=1e-12)


@planar_or_solid
def test_parabola(dim):
    @given(vectors(dim), vectors(dim), size, number, units(dim))
    def check(x, apex, radius, offset, n):
        tangential = (np.eye(dim) - np.outer(n, n)) @ (x - apex)
        expected = offset + tangential @ tangential / (2 * radius)
        # Rounding.
        assert abs(at(Parabola(apex, radius, offset), x, n) - expected) < 1e-11 / radius

    check()


ANALYTIC = {
    "plane": (lambda c, r: Plane(c, np.eye(c.size)[-1]), lambda c, r: lambda x: x[-1] - c[-1]),
    "ball": (
        lambda c, r: Sphere(c, r),
        lambda c, r: lambda x: np.linalg.norm(x - c[:, None], axis=0) - r,
    ),
    "cautious-ball": (  # never more than the distance, as sphere tracing asks
        lambda c, r: Sphere(c, r),
        lambda c, r: lambda x: 0.4 * (np.linalg.norm(x - c[:, None], axis=0) - r),
    ),
}


@pytest.mark.parametrize("kind", ANALYTIC)
@planar_or_solid
def test_signed_distance(dim, kind):
    closed_form, distance = ANALYTIC[kind]

    @settings(max_examples=max(settings().max_examples // 4, 8))  # each traces a ray in steps
    @given(vectors(dim), vectors(dim), size, units(dim))
    def check(x, centre, radius, n):
        if kind == "plane":
            assume(abs(n[-1]) > 1e-2)
            # From behind, rays that leave the half space have no gap on the way out.
            assume(x[-1] - centre[-1] > 1e-3 or n[-1] < 0)
            assume(abs(x[-1] - centre[-1]) > 1e-6)
        else:
            nearest, _ = closest(x, n, centre)
            assume(abs(nearest - radius) > 1e-2)
            assume(abs(np.linalg.norm(x - centre) - radius) > 1e-2)
        expected = at(closed_form(centre, radius), x, n)
        # Bisection to rounding, over the slope at which the surface is met.
        assert at(SignedDistance(distance(centre, radius)), x, n) == pytest.approx(
            expected, abs=1e-11
        )

    check()


def test_signed_distance_gives_up_at_its_reach():
    floor = SignedDistance(lambda x: x[1] + 5.0, reach=3.0)
    x, down = np.array([[0.0, 0.0], [0.0, -3.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])
    # Bisection to rounding.
    assert np.abs(floor(x, down)[1] - 2.0) < 1e-12
    assert floor(x, down)[0] == np.inf


def test_signed_distance_of_a_union():
    """Two disks: whichever is met first."""
    disks = [Cylinder((0.0, -2.0), 1.0), Cylinder((0.5, -3.0), 1.8)]

    def union(x):
        return np.minimum(np.hypot(x[0], x[1] + 2.0) - 1.0, np.hypot(x[0] - 0.5, x[1] + 3.0) - 1.8)

    x = np.array([np.linspace(-2, 3, 40), np.zeros(40)])
    down = np.array([np.zeros(40), -np.ones(40)])
    expected = np.minimum(disks[0](x, down), disks[1](x, down))
    assert 0 < np.isinf(expected).sum() < 20
    found = SignedDistance(union)(x, down)
    assert np.array_equal(np.isinf(found), np.isinf(expected))
    met = np.isfinite(expected)
    # Bisection to rounding over the slope at grazing incidence.
    assert np.abs(found[met] - expected[met]).max() < 1e-9


CLOSE = {
    "plane": (Plane((0.1, -1.0), (0.3, 1.0)), None),
    "disk": (Cylinder((0.2, -2.0), 1.5), lambda x: np.hypot(x[0] - 0.2, x[1] + 2.0) - 1.5),
    "ball": (
        Sphere((0.2, 0.1, -2.0), 1.5),
        lambda x: np.sqrt((x[0] - 0.2) ** 2 + (x[1] - 0.1) ** 2 + (x[2] + 2.0) ** 2) - 1.5,
    ),
    "cylinder": (
        Cylinder((0.2, 0.1, -2.0), 1.5, (1.0, 0.0, 0.0)),
        lambda x: np.hypot(x[1] - 0.1, x[2] + 2.0) - 1.5,
    ),
}
CLOSE |= {
    f"hole in {d} dimensions": (
        Sphere(np.zeros(d), 0.9, hollow=True),
        lambda x: 0.9 - np.linalg.norm(x, axis=0),
    )
    for d in (2, 3)
}


@pytest.mark.parametrize("name", CLOSE)
def test_closest_point(name):
    """x + d n lies on the surface, and no other point of it is closer: the gradient is n."""
    obstacle, function = CLOSE[name]
    dim = len(getattr(obstacle, "centre", (0, 0)))
    x = np.random.default_rng(0).uniform(-1, 1, (dim, 3, 5))
    close = ClosestPoint(obstacle)
    d, n = close(x, 0 * x), close.direction(x)
    assert d.shape == (3, 5)
    np.testing.assert_allclose(np.linalg.norm(n, axis=0), 1.0, rtol=1e-12)
    # Rounding.
    assert np.abs(obstacle.distance(x + d * n)[0]).max() < 1e-12
    if function is not None:
        np.testing.assert_allclose(d, function(x), atol=1e-12)
        numeric = ClosestPoint(SignedDistance(function))
        # Central differences with a step of 1e-6.
        np.testing.assert_allclose(numeric.direction(x), n, atol=1e-8)
        np.testing.assert_allclose(numeric(x, n), d, atol=1e-12)


def test_pressure_acts_along_the_normal_of_the_closest_point(make):
    """Frictionless on a slope: the force is normal to the slope, or to the body, as asked."""
    body = make.block(6, sides=()).fix("left", "xy")
    slope = Plane((0.0, -0.01), (0.2, 1.0))
    along = ContactProblem(body, "bottom", slope).solve().resultant
    closest = ContactProblem(body, "bottom", ClosestPoint(slope)).solve().resultant
    # Rounding.
    assert abs(along[0]) < 1e-12 * along[1]
    assert closest[0] / closest[1] == pytest.approx(0.2, rel=1e-10)


def first_inside(apex, axis, angle, x, n, reach=40.0, steps=400_001):
    """Where the ray enters the cone: forwards from outside, backwards from inside."""
    d = np.linspace(-reach, reach, steps)
    at = (x - apex)[:, None] + d * n[:, None]
    along = axis / np.linalg.norm(axis) @ at
    across = np.linalg.norm(at - np.outer(axis / np.linalg.norm(axis), along), axis=0)
    inside = np.flatnonzero(across <= along * np.tan(angle))
    if not inside.size or inside[0] == 0:  # it comes from far inside the cone
        return np.inf
    here = steps // 2 in inside
    return d[inside[0]] if here or d[inside[0]] >= 0 else np.inf


@pytest.mark.sampled(3)
@pytest.mark.parametrize("dim", [2, 3])
def test_rays_to_a_cone(dim):
    rng = np.random.default_rng(7)
    seen = {"outside": 0, "inside": 0, "never": 0}
    for k in range(60):
        apex, axis, x, n = rng.standard_normal((4, dim))
        n = axis if k % 5 == 0 else n  # steeper than the surface
        n, angle = n / np.linalg.norm(n), rng.uniform(0.1, 1.45)
        found = Cone(apex, axis, angle)(x[:, None], n[:, None])[0]
        wanted = first_inside(apex, axis, angle, x, n)
        if np.abs(found) > 39 and np.isfinite(found):
            continue
        assert np.isinf(found) == np.isinf(wanted)
        if np.isfinite(wanted):
            assert found == pytest.approx(wanted, abs=3e-4)
        seen["never" if np.isinf(wanted) else "inside" if wanted < 0 else "outside"] += 1
    assert min(seen.values()) >= 5


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_vertical_rays_have_the_gap_of_the_theory(unit):
    """r / tan(half angle), at the tip as well, in any unit."""
    r = unit * np.linspace(0, 2, 9)
    cone = Cone((0.0, -unit), (0.0, -3.0), np.arctan(4.0))
    n = np.array([0 * r, 0 * r - 1])
    assert cone(np.array([r, 0 * r]), n) == pytest.approx(unit + r / 4, rel=1e-14)
    assert cone(np.array([r, 0 * r - 2 * unit]), n) == pytest.approx(r / 4 - unit, abs=1e-14 * unit)
    assert np.all(np.isinf(cone(np.array([r, 0 * r]), -n)))


def test_seat_of_a_cone(make):
    """On its own cone a body has the gap zero everywhere, not rounding that looks like none."""
    flat = make.box(ElementQuad1, np.linspace(0, 1, 7), np.linspace(0, 1, 3))
    mesh = make.remesh(flat, np.array([flat.p[0], flat.p[1] + 0.37 * flat.p[0]]))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3, plane="axisymmetric")
    below = Cone((0.0, 0.0), (0.0, -1.0), np.pi / 2 - 1e-3)
    assert np.all(np.isfinite(ContactProblem(body, "bottom", below).rows.gap))
    # The complement of a cone is none: a pin of the same slope from above touches at the tip.
    moved = Rigid(below, displacement=(None, 0.01))
    assert ContactProblem(body.fix("top", "y"), "bottom", moved).solve().contact_force > 0
