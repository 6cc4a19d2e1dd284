"""Facets in space cut by those of the other side: areas, integrals, places, curved facets."""

import numpy as np
import pytest
from families import SOLID
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError
from skfem import ElementHex1, ElementHex2, ElementTetP1, ElementTetP2
from solid_boxes import box, pair, rows

from contact import InputError
from contact.rows.mortar.face_maps import anticlockwise, clipped, measured, shapes
from contact.rows.mortar.mortar_rows import Interface, mortar_rows
from contact.rows.outline import reference_corners
from skfem_adini import ElementHexAdini

elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)


def tilted(x):
    a, b = 0.4, 0.3
    one = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    two = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return one @ two @ x


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(3, 4), m=st.integers(3, 4))
def test_area_of_the_common_part_of_convex_polygons(seed, n, m):
    """Against an intersection of half planes."""
    rng = np.random.default_rng(seed)

    def convex(k):
        angles = np.sort(rng.uniform(0, 2 * np.pi, k))
        around = np.array([np.cos(angles), np.sin(angles)]).T
        return around * rng.uniform(0.5, 2.0) + rng.uniform(-0.7, 0.7, 2)

    one, two = (anticlockwise(convex(k)[None]) for k in (n, m))
    polygon, size = two, np.array([m])
    for k in range(n):
        polygon, size = clipped(polygon, size, one[:, k], one[:, (k + 1) % n])
    found = float(measured(polygon, size)[0][0])
    lines = []
    for corners in (one[0], two[0]):
        way = np.roll(corners, -1, axis=0) - corners
        normal = np.array([way[:, 1], -way[:, 0]]).T
        lines.append(np.column_stack((normal, -np.sum(normal * corners, axis=1))))
    lines = np.vstack(lines)
    grid = np.stack(np.meshgrid(*[np.linspace(-2.7, 2.7, 400)] * 2), axis=-1).reshape(-1, 2)
    depth = (grid @ lines[:, :2].T + lines[:, 2]).max(axis=1)
    if depth.min() > -1e-2:  # nothing in common, or hardly anything
        assert found <= 0.3
        return
    try:
        exact = ConvexHull(HalfspaceIntersection(lines, grid[depth.argmin()]).intersections).volume
    except QhullError:
        return
    assert abs(found - exact) <= 1e-9


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("place", [None, tilted], ids=["flat", "tilted"])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_integrals_over_covered_parts(element, place, unit):
    upper, lower = pair(element, shift=(0.3, -0.2), unit=unit, place=place)
    found = rows(upper, lower)
    q, area = found.quadrature, unit**2 * 0.7 * 0.8
    assert abs(q.w.sum() - area) <= 1e-12 * area
    assert abs(found.rows.weights.sum() - area) <= 1e-12 * area
    assert np.abs(q.x - q.y).max() <= 1e-12 * unit  # the two sides are in one plane
    assert np.abs(found.rows.gap).max() <= 1e-12 * unit
    assert np.abs(np.asarray(found.P.sum(axis=1)) - 1).max() <= 1e-11
    if place is None:  # products of the traces' degrees
        a, b = q.x[0] / unit, q.x[1] / unit
        exact = (1.0**3 - 0.3**3) / 3 * 0.8**2 / 2 * unit**2
        assert abs(q.w @ (a**2 * b) - exact) <= 1e-12 * exact


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("functional", [None, "standard", "hat"])
def test_forces_and_moments_of_normal_forces_cancel(element, functional):
    def bent(x):
        return np.array([x[0], x[1], x[2] + 0.1 * (x[0] - 0.5) ** 2])

    place = None if element is ElementHexAdini else bent
    upper, lower = pair(element, shift=(0.2, 0.1), place=place)
    found = rows(upper, lower, functional=functional)
    mu = np.random.default_rng(0).random(found.rows.gap.size)
    from contact.body.rigid_modes import rigid_field

    sums = [
        rigid_field(body, np.zeros(3)).T @ (G.T @ mu)
        for body, G in ((upper, found.rows.G), (lower, found.other_G))
    ]
    size = mu.sum()
    assert np.abs(sums[0] + sums[1])[:3].max() <= 1e-12 * size
    assert np.abs(sums[0] + sums[1])[3:].max() <= 1e-12 * size


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP1, ElementTetP2])
def test_dual_functions_have_the_trace_as_their_partner(element):
    upper, lower = pair(element, shift=(0.25, 0.0))
    found = rows(upper, lower)
    interface = Interface.of(upper, upper.facets("bottom"), lower, lower.facets("top"))
    q = found.quadrature
    N = interface.basis.values(q.facet, q.X)
    number = interface.basis.number[q.facet]
    mixed = np.zeros((found.P.shape[0], interface.basis.size))
    P = found.P.tocoo()
    for k in range(N.shape[1]):
        np.add.at(mixed, (P.row, number[P.col, k]), P.data * N[P.col, k])
    own = mixed.argmax(axis=1)
    rest = mixed.copy()
    rest[np.arange(own.size), own] -= 1.0
    assert np.abs(rest).max() <= 1e-9
    assert np.unique(own).size == own.size


@pytest.mark.sampled(2)
@pytest.mark.parametrize("element", [ElementHex2, ElementTetP2])
def test_second_order_facets_follow_a_sphere(element):
    """Patches of two concentric spheres: area and gap converge with the order of the cells."""

    def ball(radius):
        def place(x):
            a, b = 0.5 * (x[0] - 0.5), 0.5 * (x[1] - 0.5)
            r = radius + x[2]
            n = np.array([np.tan(a), np.tan(b), np.ones_like(a)])
            return r * n / np.linalg.norm(n, axis=0)

        return place

    errors = []
    for n in (2, 4):
        upper = box(element, (n, n, 1), (0, 0, 0.01), place=ball(2.0), curved=True)
        lower = box(element, (n + 1, n + 1, 1), (0, 0, -1.0), place=ball(2.0), curved=True)
        found = rows(upper, lower)
        errors.append(np.abs(found.rows.gap - 0.01).max())
    assert errors[1] <= 2e-4
    assert errors[1] <= errors[0] / 5


@pytest.mark.parametrize("nodes", [3, 4, 6, 9])
def test_facet_polynomials_are_nodal(nodes):
    corner = reference_corners(3, 3 if nodes in (3, 6) else 4)
    middle = 0.5 * (corner + np.roll(corner, -1, axis=1))
    X = np.hstack((corner, middle, [[0.5], [0.5]]))[:, :nodes]
    np.testing.assert_allclose(shapes(X, nodes)[0], np.eye(nodes), atol=1e-14)
    at, step = np.random.default_rng(1).random((2, 5)), 1e-6
    for i in range(2):
        off = np.zeros((2, 1))
        off[i] = step
        slope = (shapes(at + off, nodes)[0] - shapes(at - off, nodes)[0]) / (2 * step)
        np.testing.assert_allclose(shapes(at, nodes)[1][:, i], slope, atol=1e-8)


def test_bodies_that_do_not_face_each_other():
    upper, lower = pair(ElementHex1)
    for sides, message in (
        ((upper, upper.facets("top"), lower, lower.facets("top")), "point the same way"),
        ((upper, upper.facets("bottom"), *_far(lower)), "no facet lies opposite"),
        ((upper, upper.facets("bottom"), upper, upper.facets("bottom")), "both sides"),
    ):
        with pytest.raises(InputError, match=message):
            mortar_rows(*sides)


def _far(lower):
    far = box(ElementHex1, (2, 2, 1), (5.0, 0.0, 0.0))
    return far, far.facets("top")
