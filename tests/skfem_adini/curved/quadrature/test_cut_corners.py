"""Corners of compositions anywhere in the cells: areas and lengths in closed form."""

import numpy as np
import pytest
from skfem import MeshQuad

from skfem_adini import CutDomain, InputError, LevelSet, Polygon

CASES = 40


def disk(x, y, r):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


def segment(r, d):
    """Area and arc of the part of a disk beyond a line at the distance d from its centre."""
    return r**2 * np.arccos(d / r) - d * np.sqrt(r**2 - d**2), 2 * r * np.arccos(d / r)


def half_disk(x, y, r, turn, d):
    c, s = np.cos(turn), np.sin(turn)
    area, arc = segment(r, d)
    level_set = disk(x, y, r) & LevelSet(lambda p: c * (p[0] - x) + s * (p[1] - y) + d)
    return level_set, area, arc + 2 * np.sqrt(r**2 - d**2)


def two_disks(x, y, r, turn, distance, s, how):
    first = disk(x, y, r)
    second = disk(x + distance * np.cos(turn), y + distance * np.sin(turn), s)
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
    for case in range(CASES):
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
        mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
        domain = CutDomain(mesh, level_set, q=5)
        assert domain.area == pytest.approx(area, abs=1e-10)
        assert domain.perimeter == pytest.approx(perimeter, abs=1e-9)


def test_functions_compose_with_level_sets_and_polygons_are_refused():
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2)
    ring = (lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.16) - disk(0.5, 0.5, 0.2)
    assert CutDomain(mesh, ring).area == pytest.approx(np.pi * (0.16 - 0.04), abs=1e-11)
    triangle = Polygon([[0.1, 0.9, 0.5], [0.1, 0.2, 0.9]])
    for compose in (
        lambda: triangle & disk(0.5, 0.5, 0.2),
        lambda: disk(0.5, 0.5, 0.2) & triangle,
        lambda: disk(0.5, 0.5, 0.2) - triangle,
        lambda: triangle - disk(0.5, 0.5, 0.2),
        lambda: triangle | disk(0.5, 0.5, 0.2),
    ):
        with pytest.raises(InputError, match="a Polygon is not composed"):
            compose()
