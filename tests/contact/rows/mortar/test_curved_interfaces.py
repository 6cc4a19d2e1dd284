"""Curved interfaces in space with a gap, hidden facets, bent quadrilaterals, narrow parts."""

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementTetP1,
    ElementTetP2,
    Functional,
    LinearForm,
    MeshHex,
)
from solid_boxes import box, pair, rows

from contact import ElasticBody
from contact.rows.mortar.face_maps import anticlockwise, measured, nearest_polygons

elements = pytest.mark.parametrize(
    "element", [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2], ids=lambda e: e.__name__
)
TOP, BOTTOM = "top", "bottom"


@elements
@pytest.mark.parametrize("gap", [0.0, 1e-3, 0.1])
def test_moments_cancel_across_a_gap(element, gap):
    """Forces act along the lines from x to y, which are the averaged normals."""

    def saddle(x):
        return np.array(
            [x[0], x[1], x[2] + 0.3 * (x[0] - 0.5) ** 2 + 0.2 * (x[1] - 0.4) ** 2 * x[0]]
        )

    found = rows(
        box(element, (3, 2, 1), (0, 0, 1 + gap), place=saddle),
        box(element, (4, 5, 1), place=saddle),
    )
    q = found.quadrature
    force = q.n * (found.P.T @ np.random.default_rng(0).random(found.rows.gap.size))
    moment = np.cross(q.y - q.x, force, axis=0).sum(axis=1)
    assert np.abs(moment).max() <= 1e-14 * np.abs(force).sum()
    assert abs(found.rows.weights.sum() - q.w.sum()) <= 1e-13


@pytest.mark.sampled(3)
@elements
@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_cells_of_second_order_are_covered_up_to_their_edges(element, gap):
    """Two patches of concentric spheres: covered area, gap, and resultant of a pressure."""

    def ball(radius):
        def place(x):
            a, b = 0.8 * (x[0] - 0.5), 0.8 * (x[1] - 0.5)
            n = np.array([np.tan(a), np.tan(b), np.ones_like(a)])
            return (radius + 0.5 * x[2]) * n / np.linalg.norm(n, axis=0)

        return place

    upper = box(element, (6, 5, 1), place=ball(1 + gap), curved=True)
    lower = box(element, (8, 9, 1), (0, 0, -1), place=ball(1.0), curved=True)
    found = rows(upper, lower)
    basis = upper.basis.boundary(upper.facets(BOTTOM), intorder=10)
    area = Functional(lambda w: np.ones_like(w.x[0])).assemble(basis)
    resultant = Functional(lambda w: w.n[2]).assemble(basis)
    # What is left are the rims, of second order, which do not lie on top of each other.
    assert abs(found.quadrature.w.sum() - area) <= 5e-5 * area
    assert np.abs(found.rows.gap - gap).max() <= 5e-5
    q = found.quadrature
    assert abs(q.w @ q.n[2] - resultant) <= 1e-3 * abs(resultant)  # hats of normals


def test_only_the_nearest_of_two_layers_takes_part():
    """Two shelves, one below the other: the upper one hides the lower one, all or in part."""
    for width in (1.0, 0.55):
        near = MeshHex.init_tensor(np.linspace(0, width, 5), np.linspace(0, 1, 5), [0.4, 0.6])
        far = MeshHex.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1, 4), [0.0, 0.2])
        mesh = (near + far).with_boundaries(
            {TOP: lambda x: (np.abs(x[2] - 0.2) < 1e-9) | (np.abs(x[2] - 0.6) < 1e-9)}
        )
        upper = box(ElementHex1, (3, 3, 1), (0, 0, 0.6))
        found = rows(upper, ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3))
        q = found.quadrature
        assert abs(q.w.sum() - 1) <= 1e-12
        np.testing.assert_allclose(q.gap, np.where(q.x[0] < width, 0.0, 0.4), atol=1e-14)
        if width == 1.0:
            assert np.abs(found.rows.gap).max() <= 1e-14


@pytest.mark.turns(4)
def test_areas_of_polygons_that_hide_each_other():
    """Three layers of a random kind: areas by counting the points of a fine grid."""
    rng = np.random.default_rng(7)
    depth = np.array([0.1, 0.2, 0.3])
    grid = np.stack(np.meshgrid(*[(np.arange(600) + 0.5) / 600] * 2), axis=-1).reshape(-1, 2)
    for _ in range(20):
        angles = np.sort(rng.uniform(0, 2 * np.pi, (3, 4)), axis=1)
        ring = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        polygon = anticlockwise(0.5 + 0.35 * ring + rng.uniform(-0.15, 0.15, (3, 1, 2)))
        _, _, source = parts = nearest_polygons(
            polygon, np.full(3, 4), np.zeros(3, dtype=int), np.array([1e-3]), lambda k, _: depth[k]
        )
        found = np.bincount(source, measured(*parts[:2])[0], 3)
        inside = np.ones((3, len(grid)), dtype=bool)
        for k, corners in enumerate(polygon):
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                inside[k] &= (b - a)[0] * (grid - a)[:, 1] - (b - a)[1] * (grid - a)[:, 0] >= 0
        seen = [inside[0], inside[1] & ~inside[0], inside[2] & ~inside[0] & ~inside[1]]
        np.testing.assert_allclose(found, [s.mean() for s in seen], atol=5e-3)


@elements
def test_uniform_pressure_on_quadrilaterals_that_are_no_parallelograms(element):
    """Nodal forces of either body against the load of its own traction, by another rule."""

    def bent(seed):
        def place(x):
            inner = np.prod(x[:2] * (1 - x[:2]), axis=0)
            turn = np.sin(7 * x[0] + 5 * x[1] + seed), np.cos(6 * x[1] - 4 * x[0] + seed)
            return x + np.array([0.3 * inner * turn[0], 0.3 * inner * turn[1], 0 * x[0]])

        return place

    upper = box(element, (3, 2, 1), (0, 0, 1), place=bent(1))
    lower = box(element, (4, 5, 1), place=bent(2))
    found = rows(upper, lower)
    for body, name, sign, G in (
        (upper, BOTTOM, -1, found.rows.G),
        (lower, TOP, 1, found.other_G),
    ):
        basis = body.basis.boundary(body.facets(name), intorder=16)
        load = LinearForm(lambda v, w: v[2]).assemble(basis)
        force = G.T @ found.rows.weights
        assert np.abs(force - sign * load).max() <= 1e-11 * np.abs(load).max()


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("digits", range(1, 14, 2))
def test_narrow_parts_carry_their_share_of_a_uniform_pressure(element, digits):
    """Multiplier functions sum to one where a strip of 1e-13 of a facet is covered, too."""
    shift = 1 / 3 - 10.0**-digits, 0.5 - 3 * 10.0**-digits
    found = rows(*pair(element, shift=shift))
    q, area = found.quadrature, (1 - shift[0]) * (1 - shift[1])
    assert abs(q.w.sum() - area) <= 1e-13
    assert np.all(found.rows.weights > 0)
    share = (found.P.T @ found.rows.weights) / q.w
    np.testing.assert_allclose(share, 1.0, atol=1e-11)
