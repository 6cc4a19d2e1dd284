"""Several bodies in one problem: forces, ties, ends of interfaces, meshes that do not match."""

import dataclasses
import warnings
from itertools import product

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS, SOLID, half_disk
from pressed_pairs import slit
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2, ElementTetP2, ElementTriP2
from solid_boxes import box
from two_blocks import block, facing, ring

from contact import (
    ContactProblem,
    ContactWarning,
    ElasticBody,
    InputError,
    LayeredBlock,
    Pair,
    Plane,
    Rigid,
    Status,
    Tie,
    cross_check,
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


quiet = pytest.mark.filterwarnings("ignore::contact.ContactWarning")

# Adini's derivative along the normal is continuous in the whole body alone.
LAGRANGE = PLANE[:4] + SOLID[:4]
lagrange = pytest.mark.parametrize("element", LAGRANGE, ids=lambda e: e.__name__)
PUSH, MATERIAL = 0.2, {"E": 2.0, "nu": 0.3}


def ticks(element):
    """Graded along x; the layers of three bodies."""
    space = element in LAGRANGE[4:]
    along = np.linspace(0, 1, 4 if space else 8) ** 1.3
    return [along] + [np.linspace(0, 1, 4)] * space, np.linspace(0.0, 3.0, 7)


def press(body):
    """Push the upper side down, aside and round."""
    dim = body.mesh.dim()
    u = [0.004, 0.003, -PUSH] if dim == 3 else [0.004, -PUSH]
    for k in range(dim):
        body.fix("top", k, lambda x, k=k: u[k] + (0.03 * x[0] if k == dim - 1 else 0.0 * x[0]))


def same(part, whole, mesh):
    """Displacement and stress in the middle of each cell."""
    x = mesh.p[:, mesh.t].mean(axis=1)
    assert np.abs(part.sample(x) - whole.sample(x)).max() <= 1e-8 * PUSH
    off = np.abs(part.stress(x) - whole.stress(x)).max()
    assert off <= 1e-8 * np.abs(whole.stress()).max()


def whole(element, make):
    """The body in one piece, which does not touch the obstacle far away."""
    sides, heights = ticks(element)
    body = ElasticBody.from_mesh(make.box(element, *sides, heights), element(), **MATERIAL)
    press(body.fix("bottom"))
    return ContactProblem(body, "right", 1e3).solve()


def layers(element, make):
    """Three bodies of the same cells, from below to above."""
    sides, heights = ticks(element)
    return [
        ElasticBody.from_mesh(make.box(element, *sides, part), element(), **MATERIAL)
        for part in (heights[:3], heights[2:5], heights[4:])
    ]


@pytest.mark.sampled(9)
@lagrange
@pytest.mark.parametrize("side", ["first", "second"])
@pytest.mark.parametrize(("upper", "lower"), [(Pair, Pair), (Pair, Tie), (Tie, Pair)])
def test_a_stack_of_three(element, upper, lower, side, make):
    low, middle, top = layers(element, make)
    low.fix("bottom")
    press(top)
    pairs = [
        kind(
            one,
            "bottom",
            two,
            "top",
            multipliers=side,
            **({"friction": 5.0} if kind is Pair else {}),
        )
        for kind, one, two in ((upper, top, middle), (lower, middle, low))
    ]
    result = ContactProblem([top, middle, low], pairs).solve()
    assert set(result.status) <= {Status.STICK, Status.BONDED}
    expected = whole(element, make)
    for part in (low, middle, top):
        same(result[part], expected, part.mesh)


def with_slit(mesh, low, high):
    """The mesh with the vertices on the middle plane between two places doubled, and both lips."""
    on = (np.abs(mesh.p[-1] - 1.5) < 1e-9) & (mesh.p[0] > low) & (mesh.p[0] < high)
    cut = np.flatnonzero(on)
    twin = np.arange(mesh.nvertices)
    twin[cut] = mesh.nvertices + np.arange(cut.size)
    above = mesh.p[-1, mesh.t].mean(axis=0) > 1.5
    t = np.where(above, twin[mesh.t], mesh.t)
    opened = type(mesh)(np.hstack([mesh.p, mesh.p[:, cut]]), t, sort_t=False)
    middle = opened.p[:, opened.facets].mean(axis=1)
    lips = np.flatnonzero(np.abs(middle[-1] - 1.5) < 1e-9)
    lips = np.intersect1d(lips, opened.boundary_facets())
    up = opened.p[-1, opened.t[:, opened.f2t[0, lips]]].mean(axis=0) > 1.5
    ends = {
        name: opened.facets_satisfying(lambda x, end=end: np.abs(x[-1] - end) < 1e-9, True)
        for name, end in (("bottom", 0.0), ("top", 3.0))
    }
    return opened.with_boundaries(ends | {"upper lip": lips[up], "lower lip": lips[~up]})


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("low", "high"), [(-1.0, 0.6), (0.05, 0.9)], ids=["open", "inner"])
@lagrange
def test_a_slit_that_sticks(element, low, high, make):
    sides, heights = ticks(element)
    mesh = with_slit(make.box(element, *sides, heights), low, high)
    body = ElasticBody.from_mesh(mesh, element(), **MATERIAL).fix("bottom")
    press(body)
    problem = ContactProblem(body, "upper lip", body.surface("lower lip"), friction=5.0)
    result = problem.solve()
    assert result.contact_force > 0
    same(result, whole(element, make), mesh)


elements = pytest.mark.parametrize("element", PLANE, ids=lambda e: e.__name__)


@quiet
@elements
def test_the_peer_agrees_at_the_tip(element):
    problem = slit(element, tip=True, load=(0.004, -0.05), friction=0.05)
    assert cross_check(problem, problem.solve()).verdict == "agrees"


@quiet
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_a_closed_slit_carries_a_uniform_pressure(element):
    """Under pressure normal to it; the faces share the tip, which bears no condition."""
    supports = (("bottom", "y"), ("right", "x"))
    problem = slit(element, tip=True, load=(0.0, -0.7), friction=0.2, supports=supports)
    result = problem.solve()
    apart = problem.body.unconstrained(problem.rows.G)
    assert 3 <= apart.sum() < apart.size
    assert np.abs(result.pressure[apart] - 0.7).max() <= 1e-10
    assert np.isfinite(result.pressure).all()
    assert np.abs(result.stress() - np.diag([0.0, -0.7])[:, :, None, None]).max() <= 1e-10


@quiet
@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("kinds", [(Tie, Pair), (Pair, Pair), (Tie, Tie)], ids=str)
def test_two_interfaces_share_an_end(element, kinds):
    """One boundary, tied on its left half and free to slip on its right: forces and a peer."""
    upper, lower = facing(element, 4, 6)
    lower.fix("bottom", "xy")
    upper.fix("top", "x").load("top", (0.0, -0.05))
    facets = upper.facets("bottom")
    left = upper.mesh.p[0, upper.mesh.facets[:, facets]].mean(axis=0) < 0.5
    halves = facets[left], facets[~left]
    pairs = [kind(upper, own, lower, "top") for kind, own in zip(kinds, halves, strict=True)]
    problem = ContactProblem([upper, lower], pairs)
    result = problem.solve()
    assert cross_check(problem, result).verdict == "agrees"
    transmitted = result[upper].resultant + result[upper].tie_resultant
    assert abs(transmitted[1] - 0.05) <= 1e-12
    # No point at the common end carries more than the load with the edges of the block.
    normal = result.pressure + result.tie_pressure
    assert normal.max() < 0.06
    assert normal.min() > 0.035


def meeting(element, kinds, cells, friction=0.3):
    """Two blocks pushed down on a third and against each other."""
    base = block(element, np.linspace(0, 2, cells[0] + 1), [-1.0, -0.5, 0.0])
    left = block(element, np.linspace(0, 1, cells[1] + 1), np.linspace(0, 1, 4))
    right = block(element, np.linspace(1, 2, cells[2] + 1), [0.0, 0.5, 1.0])
    base.fix("bottom", "xy").named("base")
    left.load("top", (0.0, -0.05)).load("left", (0.03, 0.0)).named("left")
    right.load("top", (0.0, -0.08)).load("right", (-0.03, 0.0)).named("right")
    facing = (left, "bottom", base, "top"), (right, "bottom", base, "top")
    facing = (*facing, (left, "right", right, "left"))
    pairs = [
        kind(*sides, **({} if kind is Tie else {"friction": friction}))
        for kind, sides in zip(kinds, facing, strict=True)
    ]
    return ContactProblem([base, left, right], pairs)


@quiet
@pytest.mark.sampled(7)
@pytest.mark.parametrize("cells", [(4, 2, 2), (4, 6, 5)], ids=str)  # of the base, left and right
@pytest.mark.parametrize("kinds", list(product((Pair, Tie), repeat=3)))
@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad1, ElementQuadAdini])
def test_the_displacement_is_right_where_forces_may_not_be_unique(element, kinds, cells):
    problem = meeting(element, kinds, cells)
    result = problem.solve()
    assert max(result.kkt.values()) <= 1e-10
    check = cross_check(problem, result)
    # The other solver is given unknowns that satisfy the ties, which nearly determine other rows.
    assert check.verdict != "disagrees", check
    assert check.displacement <= 1e-7, check
    assert check.effect <= 1e-7, check
    assert check.objective <= 1e-8, check
    # The forces at the corners are not unique, but what all pairs transmit to a body is.
    for body, load in (("left", [0.03, -0.05]), ("right", [-0.03, -0.08])):
        transmitted = result[body].resultant + result[body].tie_resultant
        assert np.abs(transmitted + load).max() <= 1e-10, body


@quiet
def test_forces_that_are_not_unique_are_said_to_be_so():
    problem = meeting(ElementQuad1, (Pair, Pair, Pair), (4, 2, 2))
    result = problem.solve()
    check = cross_check(problem, result)
    assert check.verdict == "agrees, forces not unique"
    assert check.multipliers > 1e-3
    # Forces that do act are told apart from these.
    spoiled = dataclasses.replace(result, t=1.001 * result.t)
    assert cross_check(problem, spoiled).verdict == "disagrees"
