"""Polygons are integrated exactly, however the grid cuts them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skfem_adini import InputError, Polygon, cut_quadrature


def cells(n):
    t = np.linspace(0, 1, n + 1)
    X, Y = (a.ravel() for a in np.meshgrid(t[:-1], t[:-1], indexing="ij"))
    U, V = (a.ravel() for a in np.meshgrid(t[1:], t[1:], indexing="ij"))
    return np.array([X, Y]), np.array([U, V])


def green(p, degree):
    """Integrate x^degree over a polygon: the integral of x^(degree+1) n_x / (degree + 1)."""
    q = np.roll(p, -1, axis=1)
    t, w = np.polynomial.legendre.leggauss(degree // 2 + 2)
    x = p[0, :, None] + (q - p)[0, :, None] * (t + 1) / 2
    return np.sum(x ** (degree + 1) @ (w / 2) * (q - p)[1]) / (degree + 1)


def check(rule, p, holes=()):
    for degree in (0, 1, 4):
        a, b = rule.lower[0, rule.full], rule.upper[0, rule.full]
        height = (rule.upper - rule.lower)[1, rule.full]
        inner = ((b ** (degree + 1) - a ** (degree + 1)) / (degree + 1) * height).sum()
        exact = abs(green(p, degree)) - sum(abs(green(hole, degree)) for hole in holes)
        found = inner + rule.points[0] ** degree @ rule.weights
        assert found == pytest.approx(exact, abs=2e-14)
    length = sum(
        np.linalg.norm(np.roll(loop, -1, axis=1) - loop, axis=0).sum() for loop in (p, *holes)
    )
    assert rule.perimeter == pytest.approx(length, abs=1e-13)
    flux = (rule.normals * rule.boundary_points * rule.boundary_weights).sum(axis=1)
    np.testing.assert_allclose(flux, rule.area, atol=1e-13)
    assert (rule.weights > 0).all()
    assert (rule.boundary_weights > 0).all()


@given(
    radii=st.lists(st.floats(0.05, 0.5), min_size=3, max_size=9),
    turn=st.floats(0, 2 * np.pi),
    n=st.integers(1, 7),
)
def test_star_shaped(radii, turn, n):
    angles = turn + 2 * np.pi * np.arange(len(radii)) / len(radii)
    p = 0.5 + np.array(radii) * np.array([np.cos(angles), np.sin(angles)])
    check(cut_quadrature(Polygon(p), *cells(n), q=4), p)


@given(st.lists(st.integers(0, 4), min_size=4, max_size=4), st.integers(1, 4))
def test_corners_and_sides_on_the_grid(offsets, n):
    """An L whose corners are multiples of 1/8, on grids of 2, 4, 6, 8 cells."""
    a, b, c, d = np.array(offsets) / 8
    p = np.array([[a / 2, 1 - b / 2, 1 - b / 2, 0.5, 0.5, a / 2],
                  [c / 2, c / 2, 0.5, 0.5, 1 - d / 2, 1 - d / 2]])  # fmt: skip
    check(cut_quadrature(Polygon(p), *cells(2 * n), q=4), p)


def test_full_cells_are_recognised():
    p = np.array([[0.25, 0.75, 0.75, 0.25], [0.125, 0.125, 0.5, 0.5]])
    rule = cut_quadrature(Polygon(p), *cells(8))
    assert rule.full.sum() == 12
    assert not rule.cut.any()
    check(rule, p)


def test_hole_and_both_directions():
    outer = np.array([[0.1, 0.9, 0.8, 0.2], [0.1, 0.2, 0.9, 0.7]])
    hole = np.array([[0.4, 0.6, 0.5], [0.4, 0.45, 0.6]])
    for p in (outer, outer[:, ::-1]):
        for q in (hole, hole[:, ::-1]):
            check(cut_quadrature(Polygon(p, [q]), *cells(5), q=4), outer, [hole])


def test_parts_are_sides():
    p = np.array([[0.1, 0.9, 0.3], [0.2, 0.3, 0.8]])
    rule = cut_quadrature(Polygon(p), *cells(6))
    lengths = np.bincount(rule.parts, rule.boundary_weights)
    np.testing.assert_allclose(lengths, np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=0))


@pytest.mark.parametrize(
    ("p", "message"),
    [
        (np.zeros((2, 2)), "n >= 3"),
        ([[0, 1, np.nan], [0, 0, 1]], "finite corners"),
        ([[0, 1, 1, 0], [0, 0, 0, 1]], "two corners in a row are equal"),
        ([[0, 1, 2], [0, 1, 2]], "no area"),
        ([[0.0, 1, 1, 0], [0.0, 1, 0, 0.7]], "cross"),
    ],
)
def test_bad_polygons_are_refused(p, message):
    with pytest.raises(InputError, match=message):
        Polygon(p)


def test_a_polygon_takes_no_gradient():
    triangle = Polygon([[0.1, 0.9, 0.3], [0.2, 0.3, 0.8]])
    with pytest.raises(InputError, match="gradient: a polygon has none"):
        cut_quadrature(triangle, *cells(2), gradient=lambda x: x)
