"""Limits: loads that friction just holds, slip of rounding, motions beyond what the gap says."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from families import PLANE
from posed_pairs import rotation
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP2, MeshQuad

from contact import (
    ClosestPoint,
    ContactProblem,
    Cylinder,
    ElasticBody,
    GridContact,
    HalfSpace,
    InputError,
    LargeMotionWarning,
    LoadStepper,
    Pair,
    Plane,
    Rigid,
    Sphere,
    Status,
    Unbounded,
    cross_check,
    recheck,
)
from skfem_adini import ElementHexAdini, ElementQuadAdini

ELEMENTS = [ElementQuad1, ElementTriP2, ElementQuadAdini, ElementHex1]


def pushed(make, element, push, friction=0.5, length=1.0, E=2.0, law="coulomb"):
    """A block on a rough floor under its weight and a body force sideways."""
    dim = 3 if element is ElementHex1 else 2
    ticks = np.linspace(0, length, 5 if dim == 2 else 4)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=E, nu=0.3)
    down, aside = np.eye(dim)[-1], np.eye(dim)[0]
    body.body_force(0.1 * E / length * (push * aside - down))
    bound = friction if law == "coulomb" else 0.1 * E * friction
    return ContactProblem(body, "bottom", 0.0, bound, law)


@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (1e-3, 2e11)])
@pytest.mark.parametrize("element", ELEMENTS)
def test_load_at_the_friction_limit(element, length, E, make):
    with pytest.raises(Unbounded, match=r"slip is undetermined.*a translation along"):
        pushed(make, element, 0.5, length=length, E=E).solve()
    below = pushed(make, element, 0.49, length=length, E=E).solve()
    assert element is ElementHex1 or Status.STICK in below.status
    assert below.system.body.largest_displacement(below.u) < length
    with pytest.raises(Unbounded, match="not held"):
        pushed(make, element, 0.51, length=length, E=E).solve()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("element", [ElementQuad1, ElementHex1])
def test_loads_beside_the_friction_limit(element, law, make):
    """Solved below, refused above; within 1e-6 a slip without digits may be refused as well."""
    near = 2e-6 if element is ElementQuad1 else 1e-3  # nearer, the slip exceeds the body's size
    below = pushed(make, element, 0.5 * (1 - near), law=law).solve()
    # In the plane the last point still sticks; in space friction turns, and the slip that it needs
    # to point the right way grows like the root of what is left.
    further = pushed(make, element, 0.5 * (1 - 2e-2), law=law).solve()
    reach = [one.system.body.largest_displacement(one.u) for one in (below, further)]
    assert reach[0] < (1.1 if element is ElementQuad1 else 200) * reach[1]
    for share in (1 - 1e-8, 1 - 1e-12, 1.0, 1 + 1e-12, 1 + 1e-8):
        result, refusal = None, "not held"
        try:
            result = pushed(make, element, 0.5 * share, law=law).solve()
        except Unbounded as error:
            refusal = str(error)
        assert "slip is undetermined" in refusal or "not held" in refusal
        if result is not None:
            assert share < 1 - 1e-9
            assert result.system.body.largest_displacement(result.u) < 1.01 * reach[0]
    for share in (1 + 2e-6, 1.01):
        with pytest.raises(Unbounded, match="not held"):
            pushed(make, element, 0.5 * share, law=law).solve()


def test_no_load_is_spoken_of_where_there_is_none(make):
    ticks = np.linspace(0, 1, 4)
    body = ElasticBody.from_mesh(make.box(ElementQuad1, ticks, ticks), E=2.0, nu=0.3)
    with pytest.raises(Unbounded, match="no load says how far") as caught:
        ContactProblem(body.load("top", (0.0, -0.1)), "bottom", 0.0).solve()
    assert "balance the loads" not in str(caught.value)


def test_displacement_beyond_the_body(make):
    """The modulus in the wrong unit: a thousand times too soft."""
    body = make.block(4, E=2e-3)
    with pytest.raises(InputError, match="times the size of the body"):
        ContactProblem(body, "bottom", lambda x: 0.0 * x[0] + 2.0, 0.4).solve()


def test_rounding_of_a_displacement_is_no_slip(make):
    """All points stick; noise of 1e-14 on the displacement changes no status."""
    _, result = make.solved(friction=0.9, n=8)
    rng = np.random.default_rng(0)
    noise = (
        1e-14
        * result.system.body.largest_displacement(result.u)
        * rng.standard_normal(result.u.size)
    )
    again = replace(result, u=result.u + noise)
    assert np.array_equal(again.status, result.status)
    at_the_bound = replace(result, t=np.sign(result.t) * result.system.bound(result.mu)[:, None])
    at_rest = replace(at_the_bound, u=noise)
    moved = replace(at_the_bound, u=np.where(np.abs(result.u) > 0, 1e-3, 0.0) + noise)
    assert Status.SLIP not in replace(at_rest, u=0 * noise).status
    assert Status.SLIP in moved.status


F = 0.3


def slab(n, low, high, element=None, **given):
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(low, high, 4))
    return ElasticBody.from_mesh(mesh.with_defaults(), element, E=1.0, nu=0.3, **given)


@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", [ElementQuad1(), ElementQuad2(), ElementQuadAdini()])
@pytest.mark.parametrize("held", ["upper", "lower", "both"])
def test_two_slabs(held, element, multipliers) -> None:
    """One pushed over the other at its end; held at the whole interface on one side or both."""
    upper, lower = slab(5, 0, 1, element), slab(4, -1, 0, element)
    upper.fix("top", "y", -0.05).fix("left", "x", 0.1)
    lower.fix("bottom", "xy").fix("left", "x")
    if held in ("upper", "both"):
        upper.fix("bottom", "x", 0.1)
    if held in ("lower", "both"):
        lower.fix("top", "x")
    pair = Pair(upper, "bottom", lower, "top", friction=F, multipliers=multipliers)
    problem = ContactProblem([upper, lower], [pair])
    result = problem.solve()
    assert np.all(result.status == Status.SLIP)
    total = result.contact_force
    for body, sign in ((upper, 1.0), (lower, -1.0)):
        part = result[body]
        np.testing.assert_allclose(part.resultant, [-sign * F * total, sign * total], rtol=1e-9)
        np.testing.assert_allclose(body.total(part.reactions), -part.resultant, atol=1e-12)
    assert max(result.kkt.values()) < 1e-10
    assert max(recheck(result).values()) < 1e-10
    assert cross_check(problem, result).verdict == "agrees"


def test_two_slabs_held_at_rest_are_undetermined_at_their_ends() -> None:
    upper, lower = slab(4, 0, 1), slab(4, -1, 0)
    upper.fix("top", "y", -0.05).fix("left", "x", 0.1)
    lower.fix("bottom", "y").fix("left", "x", 0.1)
    result = ContactProblem(
        [upper, lower], [Pair(upper, "bottom", lower, "top", friction=F)]
    ).solve()
    corner = result.x_nominal[0] < 1e-9
    assert np.all(result.status[corner] == Status.UNDETERMINED)
    assert not np.any(result.shear[corner])


@pytest.mark.parametrize("element", [ElementQuad1(), ElementQuad2(), ElementQuadAdini()])
@pytest.mark.parametrize("n", [4, 8])
def test_a_shaft_pressed_into_a_hub(element, n) -> None:
    """The force that presses is F times the normal force, all along the hub."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 2, n + 1)).with_defaults()
    shaft = ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3, plane="axisymmetric")
    shaft.fix("bottom", "y", 0.1)
    result = ContactProblem(shaft, "right", -0.01, F).solve()
    assert np.all(result.status == Status.SLIP)
    assert result.resultant[1] == pytest.approx(-F * result.contact_force, rel=1e-10)
    np.testing.assert_allclose(shaft.total(result.reactions)[1], -result.resultant[1], atol=1e-12)


def test_on_the_axis_symmetry_decides() -> None:
    """A point on the axis does not slip and bears no shear: nothing is left open there."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 4)).with_defaults()
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3, plane="axisymmetric").fix("top", "xy")
    result = ContactProblem(body, "bottom", Rigid(0.0, displacement=(0.0, 0.05)), F).solve()
    axis = result.x_nominal[0] < 1e-9
    assert np.all(result.status[axis] == Status.STICK)
    assert not np.any(result.shear[axis])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("element", [*PLANE[1:], ElementHex1, ElementHexAdini])
def test_gap_closed_exactly(element, friction, make):
    """Translated onto the obstacle by the gap itself, and turned onto it, in any units."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        dim = element().dim
        size, E, Q = 10.0 ** rng.uniform(-6, 3), 10.0 ** rng.uniform(-3, 12), rotation(dim, seed)
        box = make.box(element, *[np.linspace(0, 1, 4)] * dim)
        body = ElasticBody.from_mesh(make.remesh(box, size * Q @ box.p), element(), E=E, nu=0.3)
        shift = size * rng.uniform(0.01, 0.05) * Q[:, -1]
        W = np.zeros((dim, dim))
        W[0, 1], W[1, 0] = (-0.01, 0.01) if seed % 2 else (0.0, 0.0)

        def move(x, W=W, shift=shift):
            return np.tensordot(W, x, axes=1) - shift.reshape(-1, *[1] * (x.ndim - 1))

        for c in range(dim):
            body.fix("top", c, lambda x, c=c, move=move: move(x)[c])
        normal = -Q[:, -1]
        result = ContactProblem(
            body, "bottom", lambda x, move=move, n=normal: np.tensordot(n, move(x), 1), friction
        ).solve()
        assert np.abs(result.pressure).max() < 1e-11 * E
        assert np.abs(result.u).max() > 1e-3 * size
        assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("beyond", [1e-12, 1e-9, 1e-6])
def test_what_presses_is_balanced(beyond, make):
    """A push that is small beside the way there has the digits that are left of it."""
    box = make.box(ElementQuad1, *[np.linspace(0, 1, 4)] * 2)
    body = ElasticBody.from_mesh(box, ElementQuad1(), E=1.0, nu=0.0)
    body.fix("top", "x").fix("top", "y", -0.03 * (1 + beyond))
    result = ContactProblem(body, "bottom", 0.03).solve()
    left = 1e-14 / beyond
    assert result.contact_force == pytest.approx(0.03 * beyond, rel=left)
    assert np.abs(result.balance()["residual"]).max() < left
    wrong = result.system.kkt(result.u, (1 + 1e4 * left + 1e-3) * result.mu, result.t)
    assert max(wrong.values()) > 1e-10


IN_PLANE = [ElementQuad1, ElementTriP2, ElementQuadAdini]


def slab_below(make, element, n=16):
    """2 x 1, its upper side at 0, held at its lower one."""
    mesh = make.box(element, np.linspace(-1, 1, 2 * n + 1), np.linspace(-1, 0, n + 1))
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).fix("bottom", "xy")


def pressed_down(make, element, obstacle, friction=0.0):
    return ContactProblem(slab_below(make, element), "top", obstacle, friction).solve()


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", IN_PLANE)
def test_a_roller_that_has_moved_on(make, element, friction):
    """Its contact stayed where it was at rest."""
    with pytest.raises(InputError, match="more than the penetration"):
        pressed_down(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.8, -0.02)), friction)
    with pytest.warns(LargeMotionWarning, match="its gap changes"):
        pressed_down(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.08, -0.02)), friction)
    # What the remedy says; and motions that the facets do not resolve.
    there = pressed_down(make, element, Rigid(Cylinder((0.8, 1.0), 1.0), (0.0, -0.02)), friction)
    assert there.zone[0].mean() == pytest.approx(0.8, abs=0.07)
    pressed_down(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.01, -0.02)), friction)


@pytest.mark.parametrize("element", IN_PLANE)
def test_a_plane_may_go_as_far_as_it_likes(make, element):
    for obstacle in (Plane((0.0, 0.0), (0.0, -1.0)), ClosestPoint(Plane((0.0, 0.0), (0.0, -1.0)))):
        near, far = (
            pressed_down(make, element, Rigid(obstacle, (s, -0.02)), 0.3).contact_force
            for s in (0.5, 50.0)
        )
        assert far == pytest.approx(near, rel=1e-9)


def test_steps_of_a_history(make):
    roller = Cylinder((0.0, 1.0), 1.0)
    problem = ContactProblem(slab_below(make, ElementQuad1), "top", roller, 0.3)
    stepper = LoadStepper(problem).obstacle(lambda t: Rigid(roller, (t, -0.02)))
    stepper.step(0.01)
    with pytest.raises(InputError, match="more than the penetration"):
        stepper.step(0.5)
    assert len(stepper.history) == 1


def test_a_plane_that_comes_from_afar_meets_the_side_of_a_roller(make):
    """Linearised, its gaps along slanted normals do not close although it goes through them."""
    angles = np.linspace(-0.6, 0.6, 41)
    mesh = make.box(ElementQuad1, np.linspace(0.5, 1.0, 6), angles)
    r, angle = mesh.p
    names = dict(mesh.boundaries)
    place = np.array([r * np.sin(angle), -r * np.cos(angle)])
    mesh = type(mesh)(place, mesh.t).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left", "xy")
    low = Plane((0.0, -5.0), (0.0, 1.0))
    with pytest.warns(LargeMotionWarning, match="its gap changes"):
        ContactProblem(body, "right", Rigid(low, (0.0, 4.02))).solve()


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_a_body_dragged_over_another(make, element):
    def dragged(s):
        lower = slab_below(make, element, 8)
        ticks = np.linspace(-0.5, 0.5, 13), np.linspace(0.0, 0.5, 7)
        upper = ElasticBody.from_mesh(make.box(element, *ticks), element(), E=1.0, nu=0.3)
        upper.fix("top", "y", -0.01).fix("top", "x", s)
        return ContactProblem([upper, lower], [Pair(upper, "bottom", lower, "top")])

    for s in (10.0, 1.0):  # off its support, and half of it
        with pytest.raises(InputError, match="nothing lies opposite"):
            dragged(s).solve()
    with pytest.warns(LargeMotionWarning, match="sliding='finite'"):
        dragged(0.2).solve()
    dragged(0.01).solve()
    LoadStepper(dragged(0.2), sliding="finite").step(1.0)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_roller_driven_through_the_block(make, friction):
    roller = Rigid(Cylinder((0.0, 1.0), 1.0), (0.0, -1.5))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises((LargeMotionWarning, InputError)):
            pressed_down(make, ElementQuad1, roller, friction)


def test_in_space(make):
    ticks = np.linspace(-1, 1, 11), np.linspace(-1, 1, 11), np.linspace(-1, 0, 5)
    body = ElasticBody.from_mesh(make.box(ElementHex1, *ticks), E=1.0, nu=0.3).fix("bottom", "xyz")
    ball = Sphere((0.0, 0.0, 1.0), 1.0)
    ContactProblem(body, "top", Rigid(ball, (0.0, 0.0, -0.1))).solve()
    with pytest.raises(InputError, match="more than the penetration"):
        ContactProblem(body, "top", Rigid(ball, (0.5, 0.5, -0.1))).solve()


def test_on_a_grid():
    x = np.arange(128) / 128
    wavy = 1e-3 * (1 - np.cos(2 * np.pi * x))
    body = HalfSpace(1.0, 128, E=1.0, nu=0.3)
    GridContact(body, Rigid(wavy, (1e-3, 1e-3)), friction=0.3).solve()
    flat = Rigid(0.0, (0.2, None), force=(None, 1e-3))
    GridContact(body, flat, friction=0.3).solve()
    with pytest.warns(LargeMotionWarning, match="spacings"):
        GridContact(body, Rigid(wavy, (0.1, 1e-3)), friction=0.3).solve()
