"""Gaps to flat facets: every facet tried in turn, the plane, and inscribed polygons of a circle."""

import numpy as np
import pytest
from convergence import order
from hypothesis import given
from hypothesis import strategies as st

from contact import Cylinder, Plane
from contact.obstacles.box_tree import BoxTree
from contact.obstacles.facets import gap_to_facets


def gap(corners, x, n):
    return gap_to_facets(corners, BoxTree(corners), x, n)


def one_by_one(corners, x, n):
    """The meetings of one line with each facet by a linear solve."""
    met = []
    for c in corners:
        edges = (c[1:] - c[0]).T
        try:
            *s, d = np.linalg.solve(np.column_stack((edges, -n)), x - c[0])
        except np.linalg.LinAlgError:
            continue
        if min(s) >= 0 and sum(s) <= 1:
            turn = np.linalg.det(np.column_stack((edges, n)))
            met.append((d, (turn if len(n) == 3 else -turn) < 0))
    ahead, behind = [m for m in met if m[0] >= 0], [m for m in met if m[0] < 0]
    enters = [m[0] for m in (*sorted(ahead)[:1], *sorted(behind)[-1:]) if m[1]]
    return min(enters, key=abs, default=np.inf)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_as_if_every_facet_were_tried(dim, unit):
    @given(st.integers(0, 10**6), st.integers(1, 40))
    def check(seed, facets):
        rng = np.random.default_rng(seed)
        corners = rng.uniform(-1, 1, (facets, dim, dim)) * unit
        x, n = rng.uniform(-1, 1, (20, dim)) * unit, rng.standard_normal((20, dim))
        n /= np.linalg.norm(n, axis=1)[:, None]
        expected = [one_by_one(corners, *pair) for pair in zip(x, n, strict=True)]
        # The oracle's solve loses the digits of facets seen edge on.
        np.testing.assert_allclose(gap(corners, x, n), expected, rtol=1e-7, atol=1e-9 * unit)

    check()


def test_two_triangles_are_their_plane():
    p = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    rng = np.random.default_rng(0)
    x, n = rng.uniform(-1, 1, (200, 3)), rng.uniform(-0.3, 0.3, (200, 3))
    n[:, 2] = -1
    n /= np.linalg.norm(n, axis=1)[:, None]
    plane = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    found = gap(p[[[0, 1, 2], [0, 2, 3]]], x, n)
    np.testing.assert_allclose(found, plane(x.T, n.T), rtol=0, atol=1e-12)


def test_inscribed_polygons_approach_the_circle_with_order_two():
    t = np.random.default_rng(1).uniform(0, 2 * np.pi, 300)
    n = -np.stack((np.cos(t), np.sin(t)), axis=1)
    x = -1.3 * n
    exact, errors, counts = Cylinder((0.0, 0.0), 1.0)(x.T, n.T), [], [16, 32, 64, 128]
    for count in counts:
        a = 2 * np.pi * np.arange(count) / count
        p = np.stack((np.cos(a), np.sin(a)), axis=1)
        errors.append(
            np.abs(gap(np.stack((p, np.roll(p, -1, axis=0)), axis=1), x, n) - exact).max()
        )
    assert abs(order(counts, errors) - 2) < 0.1


@pytest.mark.parametrize("dim", [2, 3])
def test_lines_along_an_axis_pass_few_boxes(dim):
    """Components of n that are zero make infinite slopes, which must not keep every facet."""
    cells = np.stack(np.meshgrid(*(np.arange(20),) * (dim - 1)), axis=-1).reshape(-1, dim - 1)
    corners = np.zeros((len(cells), dim, dim))
    corners[:, :, :-1] = cells[:, None, :]
    corners[:, 1:, :-1] += np.eye(dim - 1)
    x = np.random.default_rng(2).uniform(0, 20, (50, dim))
    x[:, -1] = 1.0
    line, _ = BoxTree(corners).near_lines(x, np.tile(-np.eye(dim)[-1], (50, 1)))
    assert np.bincount(line, minlength=50).tolist() == [1] * 50
