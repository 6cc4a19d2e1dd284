"""Gaps to rigid obstacles: closed forms, overlap, misses, and signed distances."""

import numpy as np
import pytest
from convergence import order
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from contact import (
    ClosestPoint,
    ContactProblem,
    Cylinder,
    InputError,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
)
from contact.obstacles.shapes import evaluate_gap

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


@planar_or_solid
def test_ball(dim):
    """The ray enters where it should, from outside and from inside; else it misses."""
    kind = Cylinder if dim == 2 else Sphere

    @given(vectors(dim), vectors(dim), size, units(dim))
    def check(x, centre, radius, n):
        distance, along = closest(x, n, centre)
        inside = np.linalg.norm(x - centre) < radius
        # Not at grazing incidence, not on the surface: there rounding decides.
        assume(abs(distance - radius) > 1e-3)
        assume(abs(np.linalg.norm(x - centre) - radius) > 1e-3)
        for obstacle in (kind(centre, radius), Sphere(centre, radius)):
            d = at(obstacle, x, n)
            if distance > radius or (along < 0 and not inside):
                assert d == np.inf
            else:
                # Pythagoras; the lesser of two meetings. Rounding over the grazing distance.
                assert abs(d - (along - np.sqrt(radius**2 - distance**2))) < 1e-11
                assert (d < 0) == inside

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


def test_cylinder_misses_along_its_axis():
    down = np.array([0.0, 0.0, -1.0])
    assert at(Cylinder((0, 0, -5), 1.0), np.array([2.0, 0, 0]), down) == np.inf


@planar_or_solid
def test_parabola(dim):
    @given(vectors(dim), vectors(dim), size, number, units(dim))
    def check(x, apex, radius, offset, n):
        tangential = (np.eye(dim) - np.outer(n, n)) @ (x - apex)
        expected = offset + tangential @ tangential / (2 * radius)
        # Rounding.
        assert abs(at(Parabola(apex, radius, offset), x, n) - expected) < 1e-11 / radius

    check()


@planar_or_solid
def test_parabola_is_the_ball_to_second_order(dim):
    """Order four in the distance from the apex, over three distances."""
    down = -np.eye(dim)[-1]
    x = np.array([0.2, 0.1, 0.05])
    errors = []
    for step in x:
        place = np.zeros(dim)
        place[0] = step
        ball = at(Sphere(2.0 * down, 2.0), place, down)
        errors.append(abs(ball - at(Parabola(np.zeros(dim), 2.0), place, down)))
    assert 3.9 < np.polyfit(np.log(x), np.log(errors), 1)[0] < 4.1


ANALYTIC = {
    "plane": (
        lambda c, r: Plane(c, np.eye(c.size)[-1]),
        lambda c, r: lambda x: x[-1] - c[-1],
    ),
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


@pytest.mark.parametrize("shape", [(5,), (4, 3)])
@pytest.mark.parametrize(
    "obstacle",
    [
        Plane((0, -1), (0, 1)),
        Cylinder((0, -2), 1.5),
        Sphere((0, -2), 1.5),
        Parabola((0, 0), 1.0),
        SignedDistance(lambda x: x[1] + 1.0),
        lambda x: 1.0 + x[0],
        0.3,
        None,
    ],
    ids=lambda o: type(o).__name__,
)
def test_shapes(obstacle, shape):
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.5, 0.5, (2, *shape))
    n = np.broadcast_to(np.array([0.0, -1.0]).reshape(2, *(1,) * len(shape)), x.shape)
    gap = evaluate_gap(obstacle, x, n)
    assert gap.shape == shape
    flat = evaluate_gap(obstacle, x.reshape(2, -1), n.reshape(2, -1))
    np.testing.assert_allclose(gap.ravel(), flat, rtol=1e-12)
    if obstacle is None:
        assert np.all(np.isposinf(gap))


@pytest.mark.parametrize(
    "obstacle", [Plane((0, 0.2), (0, 1)), Cylinder((0, -1.8), 2.0), 0.0 - 0.2], ids=str
)
def test_overlap_at_rest_is_negative(obstacle):
    gap = evaluate_gap(obstacle, np.array([[0.0], [0.0]]), np.array([[0.0], [-1.0]]))
    # Rounding.
    assert abs(gap[0] + 0.2) < 1e-15


BAD = {
    "plane-zero-normal": (Plane((0, 0), (0, 0)), "normal"),
    "plane-nan": (Plane((0, np.nan), (0, 1)), "point"),
    "plane-four-numbers": (Plane((0, 0, 0, 0), (0, 1)), "point"),
    "plane-of-space": (Plane((0, 0, 0), (0, 0, 1)), "dimension 3"),
    "disk-negative-radius": (Cylinder((0, 0), -1.0), "radius"),
    "disk-nan-radius": (Cylinder((0, 0), np.nan), "radius"),
    "ball-zero-radius": (Sphere((0, 0), 0.0), "radius"),
    "ball-of-space": (Sphere((0, 0, 0), 1.0), "dimension 3"),
    "parabola-zero-radius": (Parabola((0, 0), 0.0), "radius"),
    "distance-nan": (SignedDistance(lambda x: x[0] * np.nan), "NaN"),
    "distance-shape": (SignedDistance(lambda x: 1.0), "must return"),
    "gap-nan": (np.nan, "NaN"),
    "gap-minus-infinity": (-np.inf, "minus infinity"),
    "gap-shape": (lambda x: np.zeros(7), "shape"),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed(name):
    obstacle, word = BAD[name]
    x, n = np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])
    with pytest.raises(InputError, match=word):
        evaluate_gap(obstacle, x, n)


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


def test_both_gaps_agree_to_second_order(make):
    """On ever flatter disks the two solutions approach each other as the square of the slope."""
    differences, radii = [], [4.0, 8.0, 16.0]
    for radius in radii:
        body = make.block(8, sides=()).fix("top", "y", -0.1 / radius).fix("left", "x")
        body.f = 0 * body.f
        disk = Cylinder((0.0, -radius), radius)
        one, other = (ContactProblem(body, "bottom", o).solve() for o in (disk, ClosestPoint(disk)))
        size = one.contact_force
        differences.append(abs(one.resultant[1] - other.resultant[1]) / size)
    rate = order(radii, differences)
    assert 0.8 < rate < 3.0
    assert differences[-1] < 0.01


@pytest.mark.parametrize("obstacle", [Parabola((0, 0), 1.0), 0.1, lambda x: x[0], None])
def test_no_closest_point(obstacle):
    with pytest.raises(InputError, match="distance"):
        ClosestPoint(obstacle)


def test_closest_point_of_the_centre():
    with pytest.raises(InputError, match="centre"):
        ClosestPoint(Sphere((0.0, 0.0), 1.0)).direction(np.zeros((2, 1)))
