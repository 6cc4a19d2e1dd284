"""Sagittas of two polygons, and the ratio of their facets, against closed forms."""

import numpy as np
import pytest
from families import PLANE
from skfem import ElementQuad1, ElementQuad2, ElementTriP2
from two_blocks import block, facing, ring, sides

from contact.rows.interfaces import facet_ratio, interface_rise
from contact.rows.mortar.mortar_rows import mortar_rows
from contact.rows.outline import Outline


def arcs(element, n, m, size, curved=False):
    """Two concentric arcs of one radius, the second one twice as wide."""
    place = ring(size, (0.0, 0.0), 0.0)
    one = block(element, [0.5, 1.0], np.linspace(-0.5, 0.5, n + 1), place=place, curved=curved)
    two = block(element, [1.0, 2.0], np.linspace(-1, 1, m + 1), place=place, curved=curved)
    return one, one.facets("right"), two, two.facets("left")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("element", PLANE)
def test_rise_is_the_error_of_the_measured_gap(element, turned, size):
    """The arcs touch; the polygons do not. Its ends know one facet only, and are left out."""
    counts, left = [8, 16, 32], []
    for n in counts:
        pair = arcs(element, n, round(1.37 * n), size)
        pair = pair[2:] + pair[:2] if turned else pair
        found = mortar_rows(*pair)
        rise = interface_rise(Outline(*pair[:2]), Outline(*pair[2:]), found)
        x, y = found.rows.x_nominal
        inside = np.abs(np.arctan2(y, x)) < 0.2
        measured = np.abs(found.rows.gap[inside]).max()
        assert measured > 1e-4 / n**2 * size
        left.append(np.abs(found.rows.gap + rise)[inside].max() / size)
        assert left[-1] < 0.05 * measured / size
    assert -np.polyfit(np.log(counts), np.log(left), 1)[0] > 2.8


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
def test_facets_of_second_order_are_not_raised(element):
    pair = arcs(element, 8, 11, 1.0, curved=True)
    found = mortar_rows(*pair)
    assert np.all(interface_rise(Outline(*pair[:2]), Outline(*pair[2:]), found) == 0.0)


@pytest.mark.parametrize("multipliers", ["upper", "lower"])
def test_ratio_of_facets(multipliers):
    pair = sides(*facing(ElementQuad1, 12, 3), multipliers)
    found = mortar_rows(*pair)
    ratio = facet_ratio(Outline(*pair[:2]), Outline(*pair[2:]), found)
    assert np.abs(ratio - 4.0).max() < 1e-12
    assert np.all(interface_rise(Outline(*pair[:2]), Outline(*pair[2:]), found) == 0.0)
    # A graded side: facets of 1/8 and 3/8 against those of 1/4.
    upper = block(ElementQuad1, [0.0, 0.125, 0.5, 1.0], [0.0, 1.0])
    lower = block(ElementQuad1, [0.0, 0.25, 0.5, 1.0], [-1.0, 0.0])
    pair = sides(upper, lower)
    ratio = facet_ratio(Outline(*pair[:2]), Outline(*pair[2:]), mortar_rows(*pair))
    assert np.abs(ratio - [2.0, 2.0, 1.5, 1.0]).max() < 1e-12
