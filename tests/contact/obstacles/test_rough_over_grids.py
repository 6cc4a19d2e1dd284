"""Gaps over a whole grid are those of its points, on the points of the heights and between."""

import numpy as np
import pytest

from contact import GridContact, HalfSpace, Rough, self_affine

HEIGHTS = 1e-2 * self_affine((12, 10), hurst=0.8, rms=1.0, cutoffs=(1, 4), seed=3)


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("shape", [(12, 10), (24, 5), (7, 9)])
@pytest.mark.parametrize("point", [None, (0.25, -0.2, -0.3), (0.11, 0.0, 0.0)])
def test_gaps_of_points(interpolation, shape, point):
    rough = Rough(HEIGHTS, (3.0, 2.0), point=point, interpolation=interpolation)
    axes = [length * np.arange(m) / m for length, m in zip((3.0, 2.0), shape, strict=True)]
    n = np.array([0.0, 0.0, -1.0])
    x = np.array([*np.meshgrid(*axes, indexing="ij"), np.zeros(shape)])
    found = rough.gap_over(axes, n)
    exact = rough(x, np.broadcast_to(n[:, None, None], x.shape))
    np.testing.assert_allclose(found, exact, atol=1e-15)
    contact = GridContact(HalfSpace((3.0, 2.0), shape, E=1.0, nu=0.3), rough)
    np.testing.assert_allclose(contact.gap(), found, atol=1e-15)


def test_surfaces_along_another_axis():
    rough = Rough(HEIGHTS, (3.0, 2.0), normal=(0.0, 2.0, 0.0), point=(0.0, -0.1, 0.0))
    axes = [np.arange(4) * 0.75, np.arange(5) * 0.4]
    x = np.array(np.meshgrid(axes[0], [0.0], axes[1], indexing="ij"))[:, :, 0]
    n = np.array([0.0, -1.0, 0.0])
    exact = rough(x, np.broadcast_to(n[:, None, None], x.shape))
    np.testing.assert_allclose(rough.gap_over(axes, n), exact, atol=1e-15)


@pytest.mark.parametrize(
    ("settings", "n"),
    [
        ({"periodic": False}, (0.0, 0.0, -1.0)),
        ({"normal": (0.0, 0.1, 1.0)}, (0.0, 0.0, -1.0)),
        ({}, (0.0, 0.0, 1.0)),
        ({}, (-1.0, 0.0, 0.0)),
    ],
)
def test_other_surfaces_are_left_to_points(settings, n):
    rough = Rough(HEIGHTS, (3.0, 2.0), **settings)
    assert rough.gap_over([np.arange(3.0), np.arange(2.0)], np.array(n)) is None
