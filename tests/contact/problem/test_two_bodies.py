"""Several elastic bodies in one problem: forces, ties, meshes that do not match, warnings."""

import warnings

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID, half_disk
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2, ElementTetP2
from solid_boxes import box
from two_blocks import block, facing, ring

from contact import (
    ContactProblem,
    ContactWarning,
    InputError,
    LayeredBlock,
    Pair,
    Plane,
    Rigid,
    Tie,
)
from skfem_adini import ElementQuadAdini

PRESSURE = 0.7


def pressed(element, n, m, **more):
    """A block on a block of the same material, under a uniform pressure from above."""
    upper, lower = facing(element, n, m, **more)
    lower.fix("bottom", "y").fix("left", "x")
    return upper.fix("left", "x").load("top", (0.0, -PRESSURE)), lower


def test_a_rigid_stamp_presses_two_bodies():
    upper, lower = pressed(ElementQuad2, 5, 4)
    upper.f = np.zeros_like(upper.f)
    stamp = Rigid(0.0, force=(None, -PRESSURE))
    pairs = [Pair(upper, "bottom", lower, "top"), Pair(upper, "top", stamp)]
    result = ContactProblem([upper, lower], pairs).solve()
    assert np.abs(result.pressure - PRESSURE).max() <= 1e-10


def test_meshes_that_do_not_resolve_their_contact_are_named():
    for n, m, warned in ((40, 4, True), (8, 6, False)):
        upper, lower = facing(ElementQuad1, n, m)
        lower.fix("bottom", "xy")
        upper.fix("top", "x").fix("top", "y", -0.02)
        curve = lower.surface("top", clearance=lambda x: 0.1 * (x[0] - 0.5) ** 2)
        problem = ContactProblem(upper, "bottom", curve)
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            problem.solve()
        assert any("the coarser mesh" in str(w.message) for w in found) == warned


def test_a_layered_block_on_an_elastic_one():
    upper = LayeredBlock(1.0, [(1.0, 6, 2.0, 0.3)], columns=6, top="x").load("top", (0.0, -0.1))
    lower = block(ElementQuadAdini, np.linspace(0, 1, 9), [-1.0, -0.5, 0.0]).fix("bottom", "xy")
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.4).solve()
    again = ContactProblem(upper.elastic(), "bottom", lower.surface("top"), friction=0.4).solve()
    assert np.abs(result.pressure - again.pressure).max() <= 1e-9 * again.pressure.max()
    np.testing.assert_allclose(result[upper].u, again[0].u, atol=1e-9)


def test_polygons_that_follow_a_curve_worse_than_they_overlap_are_named():
    """A ring shrunk onto another by less than the sagitta of its facets."""
    upper, lower = (
        block(ElementQuad1, r, np.linspace(0, np.pi / 2, k + 1), place=ring(1.0, (0, 0), 0.0))
        for r, k in (([1.0, 1.5, 2.0], 6), ([0.5, 0.75, 1.001], 7))
    )
    for body in (upper, lower):
        body.fix("bottom", "y").fix("top", "x")
    with pytest.warns(ContactWarning, match="if the contact boundary stands for a curve"):
        ContactProblem(upper, "left", lower.surface("right")).solve()
    known = lower.surface("right", clearance=-0.001)
    ContactProblem(upper, "left", known).solve()


def test_a_cut_body_touches_a_plane_beside_a_pair():
    """The arc of a cut body and facets of others, in one problem."""
    disk = half_disk().fix("top", "x").fix("top", "y", -0.05)
    floor = Plane((0.0, -1.02), (0.0, 1.0))
    upper, lower = pressed(ElementQuad2, 3, 4)
    pairs = [Pair(disk, disk.arc(), floor), Pair(upper, "bottom", lower, "top")]
    result = ContactProblem([disk, upper, lower], pairs).solve()
    alone = ContactProblem(disk, disk.arc(), floor).solve()
    np.testing.assert_allclose(result.pressure[result.part == 0], alone.pressure, atol=1e-10)
    assert np.abs(result.pressure[result.part == 1] - PRESSURE).max() <= 1e-10
    with pytest.raises(InputError, match="two pairs"):
        ContactProblem([disk], [Pair(disk, disk.arc(), floor), Pair(disk, disk.arc(), floor)])
    with pytest.raises(InputError, match="the arc of a CutBody"):
        ContactProblem(disk, disk.arc(), lower.surface("top"))


def test_thin_bodies_on_each_other():
    """Plates a thousand times as long as high: what bends softly loses no digits."""

    def thin(x):
        return x * np.array([[1.0], [1e-3]])

    upper = block(ElementQuad2, np.linspace(0, 1, 9), [0, 1], place=thin).fix("left", "x")
    lower = block(ElementQuad2, np.linspace(0, 1, 13), [-1, 0], place=thin).fix("left", "x")
    upper.load("top", (0.0, -1e-6))
    lower.fix("bottom", "y")
    result = ContactProblem(upper, "bottom", lower.surface("top")).solve()
    assert np.abs(result.pressure / 1e-6 - 1).max() <= 1e-6


def stacked(element, n, m, **more):
    """A block of n facets on one of m, in the plane or in space, between planes of symmetry."""
    if element not in SOLID:
        upper, lower = facing(element, n, m, **more)
        return upper.fix("left", "x"), lower.fix("bottom", "y").fix("left", "x"), 1
    upper, lower = box(element, (n, n, 2), (0, 0, 1.0), **more), box(element, (m, m + 1, 2), **more)
    lower.fix("bottom", "z").fix("left", "x").fix("front", "y")
    return upper.fix("left", "x").fix("front", "y"), lower, 2


@pytest.mark.parametrize("element", PLANE_AND_BFS + SOLID, ids=lambda e: e.__name__)
def test_a_tie_carries_tension(element):
    upper, lower, axis = stacked(element, 2, 3)
    upper.load("top", 0.5 * np.eye(axis + 1)[axis])
    result = ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve()
    assert np.abs(result.tie_pressure + 0.5).max() <= 1e-10
    for body in (upper, lower):
        assert np.abs(result[body].stress()[axis, axis] - 0.5).max() <= 1e-10


@pytest.mark.parametrize("element", [ElementQuad2, ElementHex1])
def test_a_stiff_body_is_a_rigid_obstacle(element):
    axis = element().dim - 1
    if axis == 1:
        upper, lower = facing(element, 8, 8)
    else:
        upper, lower = box(element, (4, 4, 2), (0, 0, 1.0)), box(element, (4, 5, 2))
        upper.fix("top", "y")
    lower.E = 1e7 * np.max(upper.E)
    lower.fix("bottom")
    upper.fix("top", axis, lambda x: -0.03 - 0.02 * x[0]).fix("top", "x", 0.01)
    up = np.eye(axis + 1)[axis]
    floor = Plane((axis - 1.0) * up, up)
    rigid = ContactProblem(upper, "bottom", floor, friction=0.3).solve()
    two = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    size = rigid.contact_force
    np.testing.assert_allclose(two.resultant, rigid.resultant, atol=1e-5 * size)
    if axis == 1:
        assert np.abs(two.pressure - rigid.pressure).max() <= 1e-4 * size


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP2])
@pytest.mark.parametrize("m", [2, 3, 4])
def test_ties_that_end_at_held_edges(element, m):
    """Both bodies held where the tie ends: the traction across it does not oscillate."""
    upper, lower, _ = stacked(element, m, 3)
    lower.fix("left", "xyz").fix("bottom", "xyz")
    upper.fix("left", "xyz").load("top", (0.1, 0.0, 0.5))
    result = ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve()
    free = result.x_nominal[0] > 1e-9
    assert result.tie_pressure[free].max() < 0
    assert result.tie_pressure[free].min() > -0.6
