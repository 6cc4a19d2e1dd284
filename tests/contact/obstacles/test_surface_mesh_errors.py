"""What is no surface of an obstacle is refused by name."""

import numpy as np
import pytest
from surfaces import ball, brick, ring

from contact import ClosestPoint, InputError, SurfaceMesh

POINTS, FACETS = brick((0, 0, 0), (1, 1, 1))
TURNED = FACETS.copy()
TURNED[:, 0] = TURNED[::-1, 0]
SQUARE, SIDES = brick((0, 0), (1, 1))
AT = np.array([[0.2, np.nan, 0.1, 0.0]])


def two(shift, turned=False, size=1.0):
    """A box beside, or in, another one."""
    second = FACETS[::-1] if turned else FACETS
    points = np.hstack((POINTS, size * POINTS + np.reshape(shift, (3, 1))))
    return points, np.hstack((FACETS, second + POINTS.shape[1]))


CASES = {
    "no points": (np.zeros((3, 0)), FACETS, "facets: facet 0 has the points"),
    "rows for columns": (POINTS.T, FACETS, r"points: expected shape.*transpose"),
    "four coordinates": (np.zeros((4, 5)), FACETS, r"points: expected shape"),
    "words": ("ball", FACETS, "points"),
    "NaN": (np.where(POINTS == 1, np.nan, POINTS), FACETS, "points: point 1 is not finite"),
    "facets as rows": (POINTS, FACETS.T, r"facets: expected shape \(3, nfacets\).*transpose"),
    "no facets": (POINTS, np.zeros((3, 0), int), "facets: expected shape"),
    "segments in space": (POINTS, FACETS[:2], "facets: expected shape"),
    "facets of real numbers": (POINTS, FACETS + 0.5, "facets: expected whole numbers"),
    "facets of nothing": (POINTS, None, "facets"),
    "point out of range": (POINTS, FACETS + 1, "facets: facet .* there are 8"),
    "point below zero": (POINTS, FACETS - 1, "facets: facet"),
    "point twice": (POINTS, np.c_[FACETS, [1, 1, 2]], "facets: facet 12 names a point twice"),
    "one place": (np.ones((3, 8)), FACETS, "points: all of them are one point"),
    "no area": (
        np.c_[POINTS, [0.5, 0.5, 0.0], [0.7, 0.7, 0.0]],
        np.c_[FACETS, [0, 8, 9]],
        r"facets: 1 have no area, the first at \(0.4, 0.4, 0\)",
    ),
    "open": (POINTS, FACETS[:, 1:], "facets: the surface is open at 3 edges.*sheet=True"),
    "open outline": (SQUARE, SIDES[:, 1:], "facets: the surface is open at 2 ends.*sheet=True"),
    "turned": (POINTS, TURNED, r"facets: at 3 edges the two triangles are turned differently"),
    "turned outline": (SQUARE, np.c_[SIDES[::-1, :1], SIDES[:, 1:]], "facets: at 2 ends the two"),
    "double": (POINTS, np.c_[FACETS, FACETS[:, :1]], "facets: 3 edges belong to more than two"),
    "fork": (
        np.c_[SQUARE, [3.0, 3.0]],
        np.c_[SIDES, [0, 4]],
        "facets: 1 ends belong to more than two segments",
    ),
    "touching edges": (*two((1.0, 1.0, 0.0)), "facets: 1 edges belong to more than two"),
    "island turned": (
        *two((3.0, 0.0, 0.0), True),
        "inside no other part, but is turned like a hole",
    ),
    "cavity not turned": (*two((0.3, 0.3, 0.3), size=0.3), "inside another part, but is turned"),
}


@pytest.mark.parametrize("case", CASES)
def test_refused_by_name(case):
    points, facets, message = CASES[case]
    with pytest.raises(InputError, match=message):
        SurfaceMesh(points, facets)


@pytest.mark.parametrize("name", ["hollow", "sheet"])
def test_flags_are_true_or_false(name):
    with pytest.raises(InputError, match=f"{name}="):
        SurfaceMesh(POINTS, FACETS, **{name: 1.0})


def test_what_is_no_mistake():
    """A cavity, boxes apart, boxes that touch at a corner, an island within a cavity."""
    for good in (
        two((0.3, 0.3, 0.3), True, 0.3),
        two((3.0, 0.0, 0.0)),
        two((1.0, 1.0, 1.0)),
        ring(3),
        ball(1),
    ):
        SurfaceMesh(*good)
    rings = [ring(20, r) for r in (3.0, 2.0, 1.0)]
    outlines = [f[:: -1 if k == 1 else 1] + 20 * k for k, (_, f) in enumerate(rings)]
    nested = SurfaceMesh(np.hstack([p for p, _ in rings]), np.hstack(outlines))
    inside = nested.distance(np.array([[0.0, 1.5, 2.5, 4.0], [0.0] * 4]))[0] < 0
    assert inside.tolist() == [True, False, True, False]


def test_places_of_another_dimension():
    cube = SurfaceMesh(POINTS, FACETS)
    for ask in (
        cube.closest,
        cube.distance,
        lambda x: cube(x, x),
        lambda x: ClosestPoint(cube)(x, x),
    ):
        with pytest.raises(InputError, match="dimension 3 against a body of 2"):
            ask(np.zeros((2, 4)))
    with pytest.raises(InputError, match="x: expected finite"):
        cube.closest(AT)
    with pytest.raises(InputError, match="displacement="):
        cube.translated((0.0, 1.0))
    with pytest.raises(InputError, match="displacement="):
        cube.translated((0.0, 1.0, np.inf))


def test_what_was_given_is_kept():
    points = POINTS.copy()
    cube = SurfaceMesh(points, FACETS)
    points += 1
    assert np.array_equal(cube.points, POINTS)
    with pytest.raises(ValueError, match="read-only"):
        cube.points += 1
    assert repr(cube) == "SurfaceMesh(8 points, 12 triangles)"
