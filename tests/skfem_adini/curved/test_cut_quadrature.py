"""Areas, lengths, moments and normals of cut cells: closed forms, any disk, corners, polygons."""

from functools import reduce
from operator import and_

import numpy as np
import pytest
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, ElementQuad2

import skfem_adini
from skfem_adini import CutDomain, ElementQuadAdini, InputError, LevelSet, Polygon, cut_quadrature
from tests.skfem_adini.cut_problems import R, ball, box, half_plane, unit_square


def cells(n):
    corners = unit_square(n).p[:, unit_square(n).t]
    return corners.min(axis=1), corners.max(axis=1)


def distance(x=0.5, y=0.5, r=R):
    return LevelSet(lambda p: np.hypot(p[0] - x, p[1] - y) - r)


def moment(rule, power):
    """Integrate x^power over the domain, full cells in closed form."""
    a, b = rule.lower[:, rule.full], rule.upper[:, rule.full]
    inner = (b[0] ** (power + 1) - a[0] ** (power + 1)) / (power + 1) * (b[1] - a[1])
    return inner.sum() + rule.points[0] ** power @ rule.weights


def check(rule, area, length, tolerance=1e-11):
    assert rule.area == pytest.approx(area, abs=tolerance)
    assert rule.perimeter == pytest.approx(length, abs=tolerance)
    assert (rule.weights > 0).all()
    assert (rule.boundary_weights > 0).all()
    np.testing.assert_allclose(np.linalg.norm(rule.normals, axis=0), 1, atol=1e-14)
    for points, owner in ((rule.points, rule.cells), (rule.boundary_points, rule.boundary_cells)):
        assert (points >= rule.lower[:, owner] - 1e-14).all()
        assert (points <= rule.upper[:, owner] + 1e-14).all()
    flux = (rule.normals * rule.boundary_points * rule.boundary_weights).sum(axis=1)
    np.testing.assert_allclose(flux, area, atol=tolerance)  # int x_i n_i = area


@pytest.mark.parametrize("n", [1, 4, 8, 32])
@pytest.mark.parametrize("level_set", [ball(), distance()], ids=["quadratic", "distance"])
def test_disk(level_set, n):
    rule = cut_quadrature(level_set, *cells(n))
    check(rule, np.pi * R**2, 2 * np.pi * R)
    assert moment(rule, 2) == pytest.approx(np.pi * R**2 / 4 + np.pi * R**4 / 4, abs=1e-12)
    radial = (rule.boundary_points - 0.5) / R
    # The direction of the normals is that of an interpolant of degree 8.
    np.testing.assert_allclose(rule.normals, radial, atol=1e-9)


@pytest.mark.parametrize("q", [1, 2, 3])
def test_error_falls_with_twice_the_points(q):
    n = np.array([16, 24, 32, 48, 64])
    disk = ball(0.47, 0.52)
    errors = [abs(cut_quadrature(disk, *cells(k), q=q).area - np.pi * R**2) for k in n]
    assert order(n, errors) == pytest.approx(2 * q, abs=0.5)


def test_given_gradient_gives_the_normals():
    level_set = distance().function

    def gradient(x):
        return np.array([x[0] - 0.5, x[1] - 0.5]) / np.hypot(x[0] - 0.5, x[1] - 0.5)

    rule = cut_quadrature(level_set, *cells(8), gradient=gradient)
    np.testing.assert_allclose(rule.normals, (rule.boundary_points - 0.5) / R, atol=1e-14)
    with pytest.raises(InputError, match="gradient: at"):
        cut_quadrature(level_set, *cells(8), gradient=lambda x: gradient(x)[::-1])


@given(
    x=st.floats(0.45, 0.55), y=st.floats(0.45, 0.55), r=st.floats(0.02, 0.44), n=st.integers(1, 12)
)
def test_any_disk(x, y, r, n):
    check(cut_quadrature(ball(x, y, r), *cells(n)), np.pi * r**2, 2 * np.pi * r)


@pytest.mark.parametrize("sign", [1, -1])
def test_tangencies_and_slivers(sign):
    """The disk ends 10^power of a cell beyond a grid line, or before it, or on it."""
    n = 16
    for power in (0, *range(-16, -3), -1):
        r = 0.5 - 1 / n + sign * 10.0**power / n * (power < 0)
        check(cut_quadrature(ball(r=r), *cells(n)), np.pi * r**2, 2 * np.pi * r)


def test_boundary_on_grid_lines_and_through_vertices():
    rule = cut_quadrature(box(0.25, 0.75, 0.125, 0.5), *cells(8))
    check(rule, 0.1875, 1.75)
    assert not rule.cut.any()
    assert rule.full.sum() == 12
    assert rule.full[rule.boundary_cells].all()
    diagonal = half_plane((0.5, 0.5), (1, 1)) & box(0, 1, 0, 1)
    check(cut_quadrature(diagonal, *cells(4)), 0.5, 2 + np.sqrt(2))


def doubled(level_set):
    return LevelSet(lambda x: 2 * level_set.function(x))


COMPOSED = {
    "box": (box(0.23, 0.71, 0.11, 0.53), 0.48 * 0.42, 1.8),
    "L": (box(0.1, 0.9, 0.1, 0.9) - box(0.53, 1, 0.53, 1), 0.64 - 0.37**2, 3.2),
    "seam": (box(0.1, 0.53, 0.1, 0.9) | box(0.53, 0.9, 0.1, 0.9), 0.64, 3.2),
    "function": ((lambda x: ball(r=0.4).function(x)) - ball(r=0.2), np.pi * 0.12, 1.2 * np.pi),
    "ring": (ball(r=0.4) - ball(r=0.1), np.pi * 0.15, np.pi),
    "half": (ball(r=0.4) & half_plane((0.5, 0), (1, 0)), np.pi * 0.08, 0.4 * np.pi + 0.8),
    "same twice": (ball(r=0.4) & doubled(ball(r=0.4)), np.pi * 0.16, 0.8 * np.pi),
    "apart": (ball(0.2, 0.2, 0.11) | ball(0.71, 0.6, 0.2), np.pi * 0.0521, 0.62 * np.pi),
    "touching": (ball(0.3, 0.5, 0.1) | ball(0.5, 0.5, 0.1), 0.02 * np.pi, 0.4 * np.pi),
}


@pytest.mark.parametrize("name", COMPOSED)
def test_compositions(name):
    # Circles that touch are told apart down to rounding in phi, so 1e-8 in place.
    tolerance = 1e-10 if name == "touching" else 1e-11
    for n in (3, 8):
        check(cut_quadrature(COMPOSED[name][0], *cells(n)), *COMPOSED[name][1:], tolerance)


def segment(r, d):
    """Area and arc of the part of a disk beyond a line at the distance d from its centre."""
    return r**2 * np.arccos(d / r) - d * np.sqrt(r**2 - d**2), 2 * r * np.arccos(d / r)


@pytest.mark.parametrize("n", [4, 9])
@pytest.mark.parametrize("angle", [0, 1e-7, 0.1, 0.3, np.pi / 4, 1.2])
def test_turned_square(angle, n):
    c, s = np.cos(angle), np.sin(angle)
    sides = (
        half_plane((0.5 + 0.3 * x, 0.5 + 0.3 * y), (x, y))
        for x, y in ((c, s), (-s, c), (-c, -s), (s, -c))
    )
    # Corners that almost lie on a line parallel to an axis lose digits.
    check(cut_quadrature(reduce(and_, sides), *cells(n)), 0.36, 2.4, tolerance=1e-9)


def test_maximum_as_a_plain_function():
    """Nobody told us where the corners are."""
    d, r = 0.2, 0.4
    one, two = (ball(0.5 + side, 0.5, r).function for side in (d, -d))
    rule = cut_quadrature(lambda x: np.maximum(one(x), two(x)), *cells(7))
    check(rule, *(2 * np.array(segment(r, d))))


def test_complement_has_the_opposite_normal():
    rule = cut_quadrature(~ball(), *cells(8))
    assert rule.area == pytest.approx(1 - np.pi * R**2, abs=1e-12)
    np.testing.assert_allclose(rule.normals, (0.5 - rule.boundary_points) / R, atol=1e-9)


def test_parts_name_the_leaf():
    plane, disk = half_plane((0.53, 0), (1, 0)), ball(r=0.4)
    rule = cut_quadrature(disk & plane, *cells(8))
    chord = rule.boundary_weights[rule.parts == 1].sum()
    assert chord == pytest.approx(2 * np.sqrt(0.16 - 0.03**2), abs=1e-12)
    assert set(rule.parts) == {0, 1}


@pytest.mark.parametrize("element", [ElementQuad2(), ElementQuadAdini()], ids=["Quad2", "Adini"])
def test_finite_element_function_as_level_set(element):
    mesh = unit_square(8)
    basis = Basis(mesh, element)
    x = basis.project(ball().function)
    rule = cut_quadrature(skfem_adini.FieldLevelSet(basis, x), *cells(8))
    check(rule, np.pi * R**2, 2 * np.pi * R)


@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_units_and_origin(offset):
    """Relative errors do not depend on units, and offsets cost only their own rounding."""
    tolerance = 1e-11 if offset == 0 else 1e-9
    for scale in (1e-6, 1.0, 1e6):
        lower, upper = (scale * (corner + offset) for corner in cells(8))
        at = scale * (0.5 + offset)
        disk = LevelSet(lambda x, s=scale, a=at: ((x[0] - a) ** 2 + (x[1] - a) ** 2) / s**2 - R**2)
        rule = cut_quadrature(disk, lower, upper)
        assert rule.area / scale**2 == pytest.approx(np.pi * R**2, rel=tolerance)
        assert rule.perimeter / scale == pytest.approx(2 * np.pi * R, rel=tolerance)


def test_outside_and_inside_everywhere():
    outside = cut_quadrature(lambda x: 1 + x[0], *cells(3))
    assert outside.area == outside.perimeter == 0
    inside = cut_quadrature(lambda x: x[0] - 2, *cells(3))
    assert inside.full.all()
    assert inside.area == pytest.approx(1)
    assert inside.perimeter == 0


# Corners of compositions anywhere in the cells: areas and lengths in closed form.


def half_disk(x, y, r, turn, d):
    c, s = np.cos(turn), np.sin(turn)
    area, arc = segment(r, d)
    level_set = ball(x, y, r) & LevelSet(lambda p: c * (p[0] - x) + s * (p[1] - y) + d)
    return level_set, area, arc + 2 * np.sqrt(r**2 - d**2)


def two_disks(x, y, r, turn, distance, s, how):
    first = ball(x, y, r)
    second = ball(x + distance * np.cos(turn), y + distance * np.sin(turn), s)
    d = (distance**2 + r**2 - s**2) / (2 * distance)
    (area_1, arc_1), (area_2, arc_2) = segment(r, d), segment(s, distance - d)
    lens, whole, round_ = area_1 + area_2, np.pi * r**2, 2 * np.pi * r
    if how == "and":
        return first & second, lens, arc_1 + arc_2
    if how == "or":
        around = round_ + 2 * np.pi * s - arc_1 - arc_2
        return first | second, whole + np.pi * s**2 - lens, around
    return first & ~second, whole - lens, round_ - arc_1 + arc_2


def domains():
    """A corner that a side of a sub-box nearly touched, then random ones; seed 5."""
    yield (*half_disk(0.5, 0.5, 0.411, np.arctan2(0.6, 0.8), -0.002), 64)
    rng = np.random.default_rng(5)
    for case in range(40):
        x, y = rng.uniform(0.45, 0.55, 2)
        n, r, turn = int(rng.integers(20, 70)), rng.uniform(0.2, 0.3), rng.uniform(0, 2 * np.pi)
        if case % 5 == 0:
            x, y, turn = np.round(n * x) / n, np.round(n * y) / n, np.pi / 4 * rng.integers(8)
        if case % 4 == 0:
            yield (*half_disk(x, y, r, turn, rng.uniform(-0.9, 0.9) * r), n)
            continue
        s = rng.uniform(0.1, 0.18)
        distance = rng.uniform(abs(r - s) + 0.01, 0.34)
        how = ("", "and", "or", "without")[case % 4]
        yield (*two_disks(x, y, r, turn, distance, s, how), n)


def test_areas_and_perimeters():
    for level_set, area, perimeter, n in domains():
        domain = CutDomain(unit_square(n), level_set, q=5)
        assert domain.area == pytest.approx(area, abs=1e-10)
        assert domain.perimeter == pytest.approx(perimeter, abs=1e-9)


# Polygons are integrated exactly, however the grid cuts them.


def green(p, degree):
    """Integrate x^degree over a polygon: the integral of x^(degree+1) n_x / (degree + 1)."""
    q = np.roll(p, -1, axis=1)
    t, w = np.polynomial.legendre.leggauss(degree // 2 + 2)
    x = p[0, :, None] + (q - p)[0, :, None] * (t + 1) / 2
    return np.sum(x ** (degree + 1) @ (w / 2) * (q - p)[1]) / (degree + 1)


def check_polygon(rule, p, holes=()):
    for degree in (0, 1, 4):
        exact = abs(green(p, degree)) - sum(abs(green(hole, degree)) for hole in holes)
        assert moment(rule, degree) == pytest.approx(exact, abs=2e-14)
    area = abs(green(p, 0)) - sum(abs(green(hole, 0)) for hole in holes)
    length = sum(np.linalg.norm(np.roll(q, -1, axis=1) - q, axis=0).sum() for q in (p, *holes))
    check(rule, area, length, tolerance=1e-13)


@given(
    radii=st.lists(st.floats(0.05, 0.5), min_size=3, max_size=9),
    turn=st.floats(0, 2 * np.pi),
    n=st.integers(1, 7),
)
def test_star_shaped(radii, turn, n):
    angles = turn + 2 * np.pi * np.arange(len(radii)) / len(radii)
    p = 0.5 + np.array(radii) * np.array([np.cos(angles), np.sin(angles)])
    check_polygon(cut_quadrature(Polygon(p), *cells(n), q=4), p)


@given(st.lists(st.integers(0, 4), min_size=4, max_size=4), st.integers(1, 4))
def test_corners_and_sides_on_the_grid(offsets, n):
    """An L whose corners are multiples of 1/8, on grids of 2, 4, 6, 8 cells."""
    a, b, c, d = np.array(offsets) / 8
    p = np.array([[a / 2, 1 - b / 2, 1 - b / 2, 0.5, 0.5, a / 2],
                  [c / 2, c / 2, 0.5, 0.5, 1 - d / 2, 1 - d / 2]])  # fmt: skip
    check_polygon(cut_quadrature(Polygon(p), *cells(2 * n), q=4), p)


def test_hole_and_both_directions():
    outer = np.array([[0.1, 0.9, 0.8, 0.2], [0.1, 0.2, 0.9, 0.7]])
    hole = np.array([[0.4, 0.6, 0.5], [0.4, 0.45, 0.6]])
    for p in (outer, outer[:, ::-1]):
        for q in (hole, hole[:, ::-1]):
            check_polygon(cut_quadrature(Polygon(p, [q]), *cells(5), q=4), outer, [hole])


def test_parts_are_sides_and_full_cells_are_recognised():
    p = np.array([[0.1, 0.9, 0.3], [0.2, 0.3, 0.8]])
    rule = cut_quadrature(Polygon(p), *cells(6))
    lengths = np.bincount(rule.parts, rule.boundary_weights)
    np.testing.assert_allclose(lengths, np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=0))
    p = np.array([[0.25, 0.75, 0.75, 0.25], [0.125, 0.125, 0.5, 0.5]])
    rule = cut_quadrature(Polygon(p), *cells(8))
    assert rule.full.sum() == 12
    assert not rule.cut.any()
    check_polygon(rule, p)


# Intersection, union and difference of polygons, against areas by hand and points at random.


MESH = unit_square(8)


def rectangle(a, b, c, d):
    return Polygon([[a, b, b, a], [c, c, d, d]])


LARGE = rectangle(0.1, 0.8, 0.1, 0.8)
OTHERS = {
    "inside": (rectangle(0.3, 0.5, 0.3, 0.5), 0.04, 0.04),
    "over a corner": (rectangle(0.5, 0.9, 0.5, 0.9), 0.16, 0.09),
    "over a side": (rectangle(0.4, 0.9, 0.3, 0.5), 0.1, 0.08),
    "in a corner": (rectangle(0.1, 0.5, 0.1, 0.5), 0.16, 0.16),
    "along a side": (rectangle(0.8, 0.9, 0.1, 0.8), 0.07, 0.0),
    "along a part of a side": (rectangle(0.8, 0.9, 0.3, 0.4), 0.01, 0.0),
    "apart": (rectangle(0.85, 0.9, 0.1, 0.2), 0.005, 0.0),
    "a triangle over two sides": (Polygon([[0.4, 1.0, 0.4], [0.1, 0.1, 0.7]]), 0.18, 0.16),
}


@pytest.mark.parametrize("case", OTHERS)
def test_areas(case):
    other, own, common = OTHERS[case]
    assert CutDomain(MESH, LARGE | other).area == pytest.approx(0.49 + own - common, abs=1e-13)
    assert CutDomain(MESH, LARGE - other).area == pytest.approx(0.49 - common, abs=1e-13)
    if common:
        assert CutDomain(MESH, LARGE & other).area == pytest.approx(common, abs=1e-13)
    else:
        with pytest.raises(InputError, match="nothing is left"):
            _ = LARGE & other


def test_equal_polygons_and_compositions_of_compositions():
    same = rectangle(0.1, 0.8, 0.1, 0.8)
    assert CutDomain(MESH, LARGE | same).perimeter == pytest.approx(2.8, abs=1e-13)
    assert CutDomain(MESH, LARGE & same).area == pytest.approx(0.49, abs=1e-13)
    with pytest.raises(InputError, match="nothing is left"):
        _ = LARGE - same
    frame = LARGE - rectangle(0.3, 0.6, 0.3, 0.6) - rectangle(0.65, 0.75, 0.65, 0.75)
    assert CutDomain(MESH, frame).area == pytest.approx(0.49 - 0.09 - 0.01, abs=1e-13)


@st.composite
def stars(draw):
    """Polygons around a point, of random radii."""
    radii = draw(st.lists(st.floats(0.05, 0.3), min_size=3, max_size=8))
    x, y = draw(st.floats(0.35, 0.65)), draw(st.floats(0.35, 0.65))
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii) + draw(st.floats(0, 2))
    return Polygon([x + np.cos(angle) * radii, y + np.sin(angle) * radii])


@settings(max_examples=60, deadline=None)
@given(stars(), stars())
def test_points_lie_in_a_composition_as_in_its_parts(first, second):
    x = np.random.default_rng(0).uniform(0, 1, (2, 500))
    a, b = first.contains(x), second.contains(x)
    assert (first | second).contains(x).tolist() == (a | b).tolist()
    for compose, expected in ((lambda: first & second, a & b), (lambda: first - second, a & ~b)):
        try:
            found = compose().contains(x)
        except InputError:  # nothing is left
            found = np.zeros(500, dtype=bool)
        assert found.tolist() == expected.tolist()
