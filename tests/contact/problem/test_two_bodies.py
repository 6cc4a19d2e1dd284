"""Several elastic bodies in one problem: patch states, forces, the result of each, errors."""

import copy
import pickle
import warnings

import numpy as np
import pytest
from families import PLANE_AND_BFS
from hypothesis import given
from hypothesis import strategies as st
from skfem import ElementQuad1, ElementQuad2, MeshQuad
from two_blocks import block, facing, ring

from contact import (
    ContactProblem,
    ContactWarning,
    CutBody,
    ElasticBody,
    InputError,
    LayeredBlock,
    Pair,
    Plane,
    Rigid,
    Unbounded,
)
from skfem_adini import ElementQuadAdini

PRESSURE = 0.7
elements = pytest.mark.parametrize("element", PLANE_AND_BFS, ids=lambda e: e.__name__)


def pressed(element, n, m, **more):
    """A block on a block of the same material, under a uniform pressure from above."""
    upper, lower = facing(element, n, m, **more)
    lower.fix("bottom", "y").fix("left", "x")
    return upper.fix("left", "x").load("top", (0.0, -PRESSURE)), lower


@pytest.mark.sampled(3)
@elements
@pytest.mark.parametrize(("n", "m"), [(10, 1), (1, 10), (4, 7), (7, 4)])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("multipliers", ["first", "second"])
def test_a_uniform_pressure_is_carried_across_meshes_that_do_not_match(
    element, n, m, friction, multipliers
):
    upper, lower = pressed(element, n, m)
    pair = Pair(upper, "bottom", lower, "top", friction=friction, multipliers=multipliers)
    result = ContactProblem([upper, lower], [pair]).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-11
    assert np.abs(result.t).max() <= 1e-11
    for body in (upper, lower):
        exact = np.zeros((2, 2, 1, 1))
        exact[1, 1] = -PRESSURE
        assert np.abs(result[body].stress() - exact).max() <= 1e-11
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.sampled(3)
@elements
def test_stack_of_three_on_a_rigid_plane(element):
    def layer(n, y):
        return block(element, np.linspace(0, 1, n + 1), [y, y + 0.4, y + 1.0]).fix("left", "x")

    a, b, c = layer(4, 2.0).load("top", (0.0, -0.2)), layer(7, 1.0), layer(5, 0.0)
    pairs = [
        Pair(a, "bottom", b, "top", friction=0.3),
        Pair(b, "bottom", c, "top"),
        Pair(c, "bottom", Plane((0, 0), (0, 1))),
    ]
    result = ContactProblem([a, b, c], pairs).solve()
    assert np.abs(result.pressure - 0.2).max() <= 1e-11
    np.testing.assert_allclose(result.resultants, [[0.0, 0.2]] * 3, atol=1e-12)
    np.testing.assert_array_equal(np.unique(result.part), [0, 1, 2])
    for body in (a, b, c):
        assert np.abs(result[body].balance()["residual"]).max() <= 1e-12


@pytest.mark.turns(4)
@pytest.mark.filterwarnings("ignore:facets in contact are up to")
@given(
    n=st.integers(1, 9),
    m=st.integers(1, 9),
    shift=st.floats(-0.7, 0.7),
    seed=st.integers(0, 2**32 - 1),
    which=st.sampled_from(PLANE_AND_BFS),
)
def test_forces_on_both_bodies_are_equal_and_opposite(n, m, shift, seed, which):
    rng = np.random.default_rng(seed)
    upper, lower = facing(which, n, m, shift=shift, gap=rng.uniform(-0.02, 0.02))
    lower.fix("bottom", "xy")
    upper.fix("top", "xy", lambda x: -0.05 + 0.02 * x[0])
    friction = float(rng.uniform(0, 1.2))
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=friction).solve()
    one, two = result[upper], result[lower]
    size = result.contact_force
    assert size > 0
    assert np.abs(one.resultant + two.resultant).max() <= 1e-12 * size
    assert np.abs(one.resultant - result.resultant).max() <= 1e-11 * size
    for inside in (one, two):
        assert np.abs(inside.balance()["residual"]).max() <= 1e-10
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
@pytest.mark.parametrize("unit", [1e-6, 1e5])
def test_unit_of_length(element, unit):
    found = []
    for size in (1.0, unit):
        upper, lower = facing(element, 5, 7, shift=0.2, size=size)
        lower.fix("bottom", "xy")
        upper.fix("top", "x", 0.01 * size).fix("top", "y", -0.03 * size)
        problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.4)
        found.append(problem.solve())
    one, other = found
    np.testing.assert_allclose(other.pressure, one.pressure, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(other[0].u[:2] / unit, one[0].u[:2], rtol=1e-8, atol=1e-12)
    np.testing.assert_array_equal(other.status, one.status)


def test_a_stiff_body_is_a_rigid_obstacle():
    """E times a million below: the pressure is that on a rigid plane."""
    upper, lower = facing(ElementQuad2, 8, 8)
    lower.E = 1e7 * np.max(upper.E)
    lower.fix("bottom", "xy")
    upper.fix("top", "y", lambda x: -0.03 - 0.02 * x[0]).fix("top", "x", 0.01)
    rigid = ContactProblem(upper, "bottom", Plane((0, 0), (0, 1)), friction=0.3).solve()
    two = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    size = rigid.pressure.max()
    size = rigid.contact_force
    np.testing.assert_allclose(two.resultant, rigid.resultant, atol=1e-6 * size)
    assert np.abs(two.pressure - rigid.pressure).max() <= 1e-4 * size


def test_a_layered_block_on_an_elastic_one():
    layers = [(1.0, 6, 2.0, 0.3)]
    upper = LayeredBlock(1.0, layers, columns=6, top="x").load("top", (0.0, -0.1))
    lower = block(ElementQuadAdini, np.linspace(0, 1, 9), [-1.0, -0.5, 0.0]).fix("bottom", "xy")
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.4).solve()
    again = ContactProblem(upper.elastic(), "bottom", lower.surface("top"), friction=0.4).solve()
    assert np.abs(result.pressure - again.pressure).max() <= 1e-9 * again.pressure.max()
    np.testing.assert_allclose(result[upper].u, again[0].u, atol=1e-9)


def test_a_rigid_stamp_presses_two_bodies():
    upper, lower = pressed(ElementQuad2, 5, 4)
    upper.f = np.zeros_like(upper.f)
    stamp = Rigid(0.0, force=(None, -PRESSURE))
    pairs = [Pair(upper, "bottom", lower, "top"), Pair(upper, "top", stamp)]
    result = ContactProblem([upper, lower], pairs).solve()
    assert np.abs(result.pressure - PRESSURE).max() <= 1e-10


def test_results_know_their_bodies():
    upper, lower = pressed(ElementQuad2, 3, 4)
    problem = ContactProblem(upper.named("upper"), "bottom", lower.named("lower").surface("top"))
    result = problem.solve()
    for key, body in ((0, upper), ("upper", upper), (1, lower), ("lower", lower)):
        np.testing.assert_array_equal(result[key].u, result[body].u)
    at = [[0.5], [0.0]]
    np.testing.assert_allclose(result[upper].sample(at), result[lower].sample(at), atol=1e-12)
    for call in (result.stress, result.von_mises, lambda: result.sample([[0.5], [0.5]])):
        with pytest.raises(InputError, match="choose one"):
            call()
    for wrong in (2, -1, "middle", block(ElementQuad2, [0, 1], [0, 1]), None, True):
        with pytest.raises(InputError, match="is not one of"):
            result[wrong]


def test_loads_and_supports_given_later_are_seen():
    upper, lower = pressed(ElementQuad2, 3, 4)
    problem = ContactProblem(upper, "bottom", lower.surface("top"))
    first = problem.solve()
    upper.load("top", (0.0, PRESSURE / 2))
    np.testing.assert_allclose(problem.solve().pressure, first.pressure / 2, rtol=1e-11)
    lower.E = 2 * lower.E
    softer, harder = first[lower].u / 2, problem.solve()[lower].u
    np.testing.assert_allclose(harder, softer / 2, atol=1e-11)
    np.testing.assert_allclose(first.pressure, PRESSURE, rtol=1e-11)


def test_copies_solve_the_same_problem():
    upper, lower = pressed(ElementQuad2, 3, 4)
    problem = ContactProblem(upper, "bottom", lower.surface("top", clearance=0.01), friction=0.2)
    expected = problem.solve()
    for other in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        np.testing.assert_allclose(other.solve().u, expected.u, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("load", [(0.1, -0.2), (0.0, 0.2)])
def test_a_body_that_is_not_held_is_named(load):
    upper, lower = facing(ElementQuad2, 3, 4)
    upper.named("upper").load("top", load)
    problem = ContactProblem(upper, "bottom", lower.fix("bottom", "xy").surface("top"))
    with pytest.raises(Unbounded, match=r"translation along .* of 'upper'"):
        problem.solve()


def test_bodies_and_pairs_that_do_not_fit():
    upper, lower = facing(ElementQuad2, 3, 4)
    other = block(ElementQuad2, [0, 1], [0, 1])
    pair = Pair(upper, "bottom", lower, "top")
    for call, message in (
        (lambda: ContactProblem([upper, lower], []), "no Pair"),
        (lambda: ContactProblem([upper, lower], "bottom", 0.0), "list of Pair"),
        (lambda: ContactProblem([upper, lower, other], [pair]), "belongs to no pair"),
        (lambda: ContactProblem([upper], [pair]), "is not one of"),
        (lambda: ContactProblem([upper, upper], [pair]), "given twice"),
        (lambda: ContactProblem([upper, lower], [pair, pair]), "two pairs"),
        (lambda: ContactProblem([upper, lower], [pair], 0.0), "obstacle: give it to the pairs"),
        (lambda: ContactProblem(upper, "bottom", upper.surface("bottom")), "both sides"),
        (lambda: Pair(upper, "bottom", lower), "name the boundary"),
        (lambda: Pair(upper, "bottom", Plane((0, 0), (0, 1)), clearance=0.1), "clearance"),
        (lambda: Pair(upper, "bottom", lower, "top", multipliers="both"), "multipliers"),
        (lambda: Pair("upper", "bottom", lower, "top"), "expected a body"),
        (lambda: ContactProblem(upper, "top", lower.surface("top")), "point the same way"),
        (lambda: ContactProblem(upper, "bottom", lower.surface("nowhere")), "nowhere"),
        (lambda: setattr(ContactProblem([upper, lower], [pair]), "obstacle", 0.0), "obstacle"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_two_foundations_may_be_one_surface():
    """Two blocks side by side on one body: each presses on its own part."""
    left = block(ElementQuad2, [0.0, 0.25, 0.5], [0.0, 0.5, 1.0]).fix("left", "x")
    right = block(ElementQuad2, [0.5, 0.75, 1.0], [0.0, 0.5, 1.0]).fix("right", "x")
    lower = block(ElementQuad2, np.linspace(0, 1, 6), [-1.0, -0.5, 0.0]).fix("bottom", "y")
    lower.fix("left", "x")
    for body in (left, right):
        body.load("top", (0.0, -PRESSURE))
    pairs = [Pair(left, "bottom", lower, "top"), Pair(right, "bottom", lower, "top")]
    result = ContactProblem([left, right, lower], pairs).solve()
    assert np.abs(result.pressure - PRESSURE).max() <= 1e-10


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_closed_slit_is_the_whole_body(element):
    """A body that touches itself along a slit, under pressure normal to it."""
    xs, ys = np.linspace(0, 2, 9), np.linspace(-1, 1, 9)
    mesh = MeshQuad.init_tensor(xs, ys)
    # Vertices on the slit x < 1, y = 0, get a twin above.
    on = np.flatnonzero((np.abs(mesh.p[1]) < 1e-9) & (mesh.p[0] < 1 - 1e-9))
    p, t = np.hstack((mesh.p, mesh.p[:, on])), mesh.t.copy()
    above = mesh.p[1, mesh.t].mean(axis=0) > 0
    for twin, vertex in enumerate(on):
        t[:, above] = np.where(t[:, above] == vertex, mesh.p.shape[1] + twin, t[:, above])
    cut = MeshQuad(p, t, sort_t=False)
    middle = cut.p[:, cut.facets].mean(axis=1)
    lips = [f for f in cut.boundary_facets() if abs(middle[1, f]) < 1e-9]
    upward = cut.p[1, cut.t[:, cut.f2t[0, lips]]].mean(axis=0) > 0
    names = {"upper lip": np.array(lips)[upward], "lower lip": np.array(lips)[~upward]}
    names |= {
        side: cut.facets_satisfying(lambda x, a=a, v=v: np.abs(x[a] - v) < 1e-9, True)
        for side, a, v in (("left", 0, 0), ("right", 0, 2), ("bottom", 1, -1), ("top", 1, 1))
    }
    body = ElasticBody.from_mesh(cut.with_boundaries(names), element(), E=2.0, nu=0.3)
    body.fix("bottom", "y").fix("right", "x").load("top", (0.0, -PRESSURE))
    problem = ContactProblem(body, "upper lip", body.surface("lower lip"), friction=0.2)
    result = problem.solve()
    apart = problem.body.live(problem.rows.G)  # the lips share the tip, which bears no condition
    assert 3 <= apart.sum() < apart.size
    assert np.abs(result.pressure[apart] - PRESSURE).max() <= 1e-10
    exact = np.zeros((2, 2, 1, 1))
    exact[1, 1] = -PRESSURE
    assert np.abs(result.stress() - exact).max() <= 1e-10


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
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    disk = CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)
    disk.fix("top", "x").fix("top", "y", -0.05)
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


@pytest.mark.parametrize("height", [2e-3, 1e-3])
def test_thin_bodies_on_each_other(height):
    """Plates a thousand times as long as high: what bends softly loses no digits."""

    def thin(x):
        return x * np.array([[1.0], [height]])

    upper = block(ElementQuad2, np.linspace(0, 1, 9), [0, 1], place=thin).fix("left", "x")
    lower = block(ElementQuad2, np.linspace(0, 1, 13), [-1, 0], place=thin).fix("left", "x")
    upper.load("top", (0.0, -1e-6))
    lower.fix("bottom", "y")
    result = ContactProblem(upper, "bottom", lower.surface("top")).solve()
    assert np.abs(result.pressure / 1e-6 - 1).max() <= 1e-6
