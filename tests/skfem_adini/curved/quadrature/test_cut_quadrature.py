"""Area, length, moments and normals of cut cells, against closed forms."""

import numpy as np
import pytest
from convergence import order
from hypothesis import given
from hypothesis import strategies as st
from skfem import Basis, ElementQuad2, MeshQuad

from skfem_adini import ElementQuadAdini, FieldLevelSet, InputError, LevelSet, cut_quadrature

R = 0.411


def cells(n, low=0.0, high=1.0):
    t = np.linspace(low, high, n + 1)
    X, Y = (a.ravel() for a in np.meshgrid(t[:-1], t[:-1], indexing="ij"))
    U, V = (a.ravel() for a in np.meshgrid(t[1:], t[1:], indexing="ij"))
    return np.array([X, Y]), np.array([U, V])


def circle(x=0.5, y=0.5, r=R):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


def distance(x=0.5, y=0.5, r=R):
    return LevelSet(lambda p: np.hypot(p[0] - x, p[1] - y) - r)


def half_plane(p, normal):
    return LevelSet(lambda x: normal[0] * (x[0] - p[0]) + normal[1] * (x[1] - p[1]))


def box(a, b, c, d):
    sides = ((a, 0, -1, 0), (b, 0, 1, 0), (0, c, 0, -1), (0, d, 0, 1))
    planes = [half_plane(side[:2], side[2:]) for side in sides]
    return planes[0] & planes[1] & planes[2] & planes[3]


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
@pytest.mark.parametrize("level_set", [circle(), distance()], ids=["quadratic", "distance"])
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
    disk = circle(0.47, 0.52)
    errors = [abs(cut_quadrature(disk, *cells(k), q=q).area - np.pi * R**2) for k in n]
    rate = order(n, errors)
    assert rate == pytest.approx(2 * q, abs=0.5)


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
    check(cut_quadrature(circle(x, y, r), *cells(n)), np.pi * r**2, 2 * np.pi * r)


@pytest.mark.parametrize("power", [0, *range(-16, -3), -1])
@pytest.mark.parametrize("sign", [1, -1])
def test_tangencies_and_slivers(power, sign):
    """The disk ends 10^power of a cell beyond a grid line, or before it, or on it."""
    n = 16
    r = 0.5 - 1 / n + sign * 10.0**power / n * (power < 0)
    check(cut_quadrature(circle(r=r), *cells(n)), np.pi * r**2, 2 * np.pi * r)


def test_boundary_on_grid_lines():
    rule = cut_quadrature(box(0.25, 0.75, 0.125, 0.5), *cells(8))
    check(rule, 0.1875, 1.75)
    assert not rule.cut.any()
    assert rule.full.sum() == 12
    assert rule.full[rule.boundary_cells].all()


def test_lines_through_vertices():
    diagonal = half_plane((0.5, 0.5), (1, 1)) & box(0, 1, 0, 1)
    rule = cut_quadrature(diagonal, *cells(4))
    check(rule, 0.5, 2 + np.sqrt(2))


COMPOSED = {
    "box": (box(0.23, 0.71, 0.11, 0.53), 0.48 * 0.42, 1.8),
    "L": (box(0.1, 0.9, 0.1, 0.9) - box(0.53, 1, 0.53, 1), 0.64 - 0.37**2, 3.2),
    "seam": (box(0.1, 0.53, 0.1, 0.9) | box(0.53, 0.9, 0.1, 0.9), 0.64, 3.2),
    "ring": (circle(r=0.4) - circle(r=0.1), np.pi * 0.15, np.pi),
    "half": (circle(r=0.4) & half_plane((0.5, 0), (1, 0)), np.pi * 0.08, 0.4 * np.pi + 0.8),
    "same twice": (
        circle(r=0.4) & LevelSet(lambda x: 2 * ((x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.16)),
        np.pi * 0.16,
        0.8 * np.pi,
    ),
    "apart": (circle(0.2, 0.2, 0.11) | circle(0.71, 0.6, 0.2), np.pi * 0.0521, 0.62 * np.pi),
    "touching": (circle(0.3, 0.5, 0.1) | circle(0.5, 0.5, 0.1), 0.02 * np.pi, 0.4 * np.pi),
}


@pytest.mark.parametrize("n", [3, 8])
@pytest.mark.parametrize("name", COMPOSED)
def test_compositions(name, n):
    # Circles that touch are told apart down to rounding in phi, so 1e-8 in place.
    tolerance = 1e-10 if name == "touching" else 1e-11
    check(cut_quadrature(COMPOSED[name][0], *cells(n)), *COMPOSED[name][1:], tolerance)


@pytest.mark.parametrize("n", [4, 9])
@pytest.mark.parametrize("angle", [0, 1e-7, 0.1, 0.3, np.pi / 4, 1.2])
def test_turned_square_and_lens(angle, n):
    c, s = np.cos(angle), np.sin(angle)
    square = None
    for normal in ((c, s), (-s, c), (-c, -s), (s, -c)):
        side = half_plane((0.5 + 0.3 * normal[0], 0.5 + 0.3 * normal[1]), normal)
        square = side if square is None else square & side
    # Corners that almost lie on a line parallel to an axis lose digits.
    check(cut_quadrature(square, *cells(n)), 0.36, 2.4, tolerance=1e-9)
    d, r = 0.2, 0.4
    half = np.arccos(d / r)
    lens = circle(0.5 + d * c, 0.5 + d * s, r) & circle(0.5 - d * c, 0.5 - d * s, r)
    area = 2 * (r**2 * half - d * np.sqrt(r**2 - d**2))
    check(cut_quadrature(lens, *cells(n)), area, 4 * r * half)


def test_maximum_as_a_plain_function():
    """Nobody told us where the corners are."""
    d, r = 0.2, 0.4
    half = np.arccos(d / r)

    def lens(x):
        first = (x[0] - 0.5 - d) ** 2 + (x[1] - 0.5) ** 2 - r**2
        return np.maximum(first, (x[0] - 0.5 + d) ** 2 + (x[1] - 0.5) ** 2 - r**2)

    area = 2 * (r**2 * half - d * np.sqrt(r**2 - d**2))
    check(cut_quadrature(lens, *cells(7)), area, 4 * r * half)


def test_complement_has_the_opposite_normal():
    rule = cut_quadrature(~circle(), *cells(8))
    assert rule.area == pytest.approx(1 - np.pi * R**2, abs=1e-12)
    np.testing.assert_allclose(rule.normals, (0.5 - rule.boundary_points) / R, atol=1e-9)


def test_parts_name_the_leaf():
    plane, disk = half_plane((0.53, 0), (1, 0)), circle(r=0.4)
    rule = cut_quadrature(disk & plane, *cells(8))
    chord = rule.boundary_weights[rule.parts == 1].sum()
    assert chord == pytest.approx(2 * np.sqrt(0.16 - 0.03**2), abs=1e-12)
    assert set(rule.parts) == {0, 1}


@pytest.mark.parametrize("element", [ElementQuad2(), ElementQuadAdini()], ids=["Quad2", "Adini"])
def test_finite_element_function_as_level_set(element):
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    basis = Basis(mesh, element)
    x = basis.project(lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - R**2)
    corners = mesh.p[:, mesh.t]
    rule = cut_quadrature(FieldLevelSet(basis, x), corners.min(axis=1), corners.max(axis=1))
    check(rule, np.pi * R**2, 2 * np.pi * R)


@pytest.mark.parametrize("offset", [0.0, 1e3])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_and_origin(scale, offset):
    """Relative errors do not depend on units, and offsets cost only their own rounding."""
    lower, upper = (scale * (corner + offset) for corner in cells(8))
    middle = scale * (0.5 + offset)
    level_set = LevelSet(lambda x: ((x[0] - middle) ** 2 + (x[1] - middle) ** 2) / scale**2 - R**2)
    rule = cut_quadrature(level_set, lower, upper)
    tolerance = 1e-11 if offset == 0 else 1e-9
    assert rule.area / scale**2 == pytest.approx(np.pi * R**2, rel=tolerance)
    assert rule.perimeter / scale == pytest.approx(2 * np.pi * R, rel=tolerance)


def test_outside_and_inside_everywhere():
    outside = cut_quadrature(lambda x: 1 + x[0], *cells(3))
    assert outside.area == outside.perimeter == 0
    inside = cut_quadrature(lambda x: x[0] - 2, *cells(3))
    assert inside.full.all()
    assert inside.area == pytest.approx(1)
    assert inside.perimeter == 0


def sign(x):
    return np.sign(np.hypot(x[0] - 0.5, x[1] - 0.5) - R)


BAD = {
    "not a function": (3.0, "level_set: expected a function"),
    "NaN": (lambda x: np.log(x[0] - 0.5), "level_set: the function returned NaN"),
    "shape": (lambda x: x, "level_set: the function returned shape"),
    "complex": (lambda x: x[0] * 1j, "level_set: expected real numbers"),
    "jump": (sign, "level_set: not smooth along its zero line"),
    "double zero": (
        lambda x: (x[0] - 0.51) ** 2 * (x[1] - 2) + 0 * x[0],
        "level_set: its zero line is degenerate",
    ),
}


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
@pytest.mark.parametrize("name", BAD)
def test_bad_level_sets_are_refused(name):
    level_set, message = BAD[name]
    with pytest.raises(InputError, match=message):
        cut_quadrature(level_set, *cells(4))


@pytest.mark.parametrize(
    ("lower", "upper", "q", "message"),
    [
        (np.zeros(2), np.ones(2), 4, "lower, upper"),
        (np.zeros((2, 1)), np.zeros((2, 1)), 4, "positive sides"),
        (np.zeros((2, 1)), np.full((2, 1), np.nan), 4, "finite"),
        (np.zeros((2, 1)), np.ones((2, 1)), 0, "q: expected"),
        (np.zeros((2, 1)), np.ones((2, 1)), 4.5, "q: expected"),
    ],
)
def test_bad_cells_and_orders_are_refused(lower, upper, q, message):
    with pytest.raises(InputError, match=message):
        cut_quadrature(circle(), lower, upper, q=q)
