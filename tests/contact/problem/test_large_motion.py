"""Loaded points that move along an obstacle to where the gap is another one."""

import warnings

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP2

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
)
from skfem_adini import ElementQuadAdini

ELEMENTS = [ElementQuad1, ElementTriP2, ElementQuadAdini]


def block(make, element, n=16):
    """2 x 1, its upper side at 0, held at its lower one."""
    mesh = make.box(element, np.linspace(-1, 1, 2 * n + 1), np.linspace(-1, 0, n + 1))
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).fix("bottom", "xy")


def pressed(make, element, obstacle, friction=0.0):
    return ContactProblem(block(make, element), "top", obstacle, friction).solve()


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", ELEMENTS)
def test_a_roller_that_has_moved_on(make, element, friction):
    """Its contact stayed where it was at rest."""
    with pytest.raises(InputError, match="more than the penetration"):
        pressed(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.8, -0.02)), friction)
    with pytest.warns(LargeMotionWarning, match="its gap changes"):
        pressed(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.08, -0.02)), friction)
    # What the remedy says; and motions that the facets do not resolve.
    there = pressed(make, element, Rigid(Cylinder((0.8, 1.0), 1.0), (0.0, -0.02)), friction)
    assert there.zone[0].mean() == pytest.approx(0.8, abs=0.07)
    pressed(make, element, Rigid(Cylinder((0.0, 1.0), 1.0), (0.01, -0.02)), friction)


@pytest.mark.parametrize("element", ELEMENTS)
def test_a_plane_may_go_as_far_as_it_likes(make, element):
    for obstacle in (Plane((0.0, 0.0), (0.0, -1.0)), ClosestPoint(Plane((0.0, 0.0), (0.0, -1.0)))):
        near, far = (
            pressed(make, element, Rigid(obstacle, (s, -0.02)), 0.3).contact_force
            for s in (0.5, 50.0)
        )
        assert far == pytest.approx(near, rel=1e-9)


def test_steps_of_a_history(make):
    roller = Cylinder((0.0, 1.0), 1.0)
    problem = ContactProblem(block(make, ElementQuad1), "top", roller, 0.3)
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
        lower = block(make, element, 8)
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
            pressed(make, ElementQuad1, roller, friction)


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
