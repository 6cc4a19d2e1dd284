"""Intersection, union and difference of polygons, against areas by hand and points at random."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import MeshQuad

from skfem_adini import CutDomain, InputError, LevelSet, Polygon

MESH = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2)


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
    "a triangle over two sides": (
        Polygon([[0.4, 1.0, 0.4], [0.1, 0.1, 0.7]]), 0.18, 0.16,
    ),
}  # fmt: skip


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


def test_equal_polygons():
    same = rectangle(0.1, 0.8, 0.1, 0.8)
    assert CutDomain(MESH, LARGE | same).perimeter == pytest.approx(2.8, abs=1e-13)
    assert CutDomain(MESH, LARGE & same).area == pytest.approx(0.49, abs=1e-13)
    with pytest.raises(InputError, match="nothing is left"):
        _ = LARGE - same


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


def test_compositions_compose():
    frame = LARGE - rectangle(0.3, 0.6, 0.3, 0.6) - rectangle(0.65, 0.75, 0.65, 0.75)
    assert CutDomain(MESH, frame).area == pytest.approx(0.49 - 0.09 - 0.01, abs=1e-13)


@pytest.mark.parametrize("other", [LevelSet(lambda x: x[0] - 0.5), lambda x: x[0], 3])
def test_others_are_refused(other):
    with pytest.raises(InputError, match="half planes"):
        _ = LARGE - other


def test_a_level_set_minus_a_polygon_is_refused():
    with pytest.raises(InputError, match="half planes"):
        _ = LevelSet(lambda x: x[0]) - LARGE
