"""Obstacles that move: prescribed, driven by forces and moments, seen from the body."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTriP2

from contact import ContactProblem, ElasticBody, LoadStepper, Plane, Rigid, Sphere, Unbounded
from skfem_adini import ElementQuadAdini

PLANAR = [ElementQuadAdini, ElementTriP2, ElementQuad1]
ELEMENTS = [*PLANAR, ElementHex1]


def held(make, element=ElementQuadAdini, n=6, components=None):
    """Unit square or cube, its top held along some axes or all."""
    dim = element().dim
    ticks = np.linspace(0, 1, (n if dim == 2 else 3) + 1)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=2.0, nu=0.3)
    return body if components == () else body.fix("top", components)


@pytest.mark.parametrize("element", ELEMENTS)
def test_uniform_squeeze_by_a_force(element, make):
    """A foundation pushed up by a force on a bar: its way is that of the uniform strain."""
    dim = element().dim
    body = held(make, element, components="xyz"[dim - 1]).fix("left", "x")
    if dim == 3:
        body.fix("front", "y")
    push = 0.3
    force = [None] * (dim - 1) + [push]
    result = ContactProblem(body, "bottom", Rigid(0.05, force=force)).solve()
    strain = push / 2.0 * (1 - 0.3**2 if dim == 2 else 1.0)
    # Rounding times the condition of the body.
    assert result.motion[dim - 1] == pytest.approx(0.05 + strain, rel=1e-11)
    assert result.resultant[-1] == pytest.approx(push, rel=1e-11)
    assert np.abs(result.pressure - push).max() < 1e-11
    assert result.kkt["obstacle"] < 1e-12


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("element", ELEMENTS)
def test_force_and_displacement_control_agree(element, friction, make):
    body = held(make, element)
    dim = body.dim
    ball = Sphere((*(0.45,) * (dim - 1), -2.0), 1.99)
    push = [None] * (dim - 1) + [0.05]
    first = ContactProblem(body, "bottom", Rigid(ball, force=push), friction).solve()
    assert first.resultant[-1] == pytest.approx(0.05, rel=1e-10)
    assert first.motion[dim - 1] > 0
    again = Rigid(ball, displacement=first.motion[:dim], rotation=first.motion[dim:])
    second = ContactProblem(body, "bottom", again, friction).solve()
    # Newton's tolerance of 1e-12 times the condition of the body.
    assert np.abs(first.u - second.u).max() < 1e-9 * np.abs(first.u).max()
    assert "obstacle" not in second.kkt


@pytest.mark.parametrize("offset", [0.0, 0.1, -0.2])
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementHex1])
def test_moment(element, offset, make):
    """A stamp that may tilt: the pressure's centre is where its force and its moment put it."""
    body, dim = held(make, element), element().dim
    place = np.array([0.45, 0.6, 0.0])[[0, 2] if dim == 2 else [0, 1, 2]]
    moment = 0.2 * offset if dim == 2 else (0.0, -0.2 * offset, None)
    stamp = Rigid(0.0, force=[None] * (dim - 1) + [0.2], moment=moment, centre=place)
    result = ContactProblem(body, "bottom", stamp).solve()
    assert result.mu.sum() == pytest.approx(0.2, rel=1e-10)
    wanted = place + offset * np.eye(dim)[0]
    np.testing.assert_allclose(result.centre_of_pressure[0], wanted, atol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("element", ELEMENTS)
def test_relativity(element, friction, make):
    """Moving the obstacle by w or everything else by -w is the same."""
    dim = element().dim
    plane = Plane(np.zeros(dim), np.eye(dim)[-1])
    shift = np.array([0.02, 0.05]) if dim == 2 else np.array([0.02, -0.01, 0.05])
    turn = np.array([0.03]) if dim == 2 else np.array([0.02, -0.03, 0.06])
    centre = np.full(dim, 0.4)

    def motion(x):
        r = x - centre.reshape(-1, *(1,) * (x.ndim - 1))
        if dim == 2:
            spin = turn[0] * np.array([-r[1], r[0]])
        else:
            spin = np.cross(turn, r, axisb=0, axisc=0)
        return shift.reshape(-1, *(1,) * (x.ndim - 1)) + spin

    rotation = turn[0] if dim == 2 else turn
    moving = Rigid(plane, displacement=shift, rotation=rotation, centre=centre)
    ours = ContactProblem(held(make, element), "bottom", moving, friction).solve()
    body = held(make, element, components=())
    for c in range(dim):
        body.fix("top", c, lambda x, c=c: -motion(x)[c])
    theirs = ContactProblem(body, "bottom", plane, friction).solve()
    assert np.count_nonzero(theirs.mu) >= 2
    scale = np.abs(theirs.mu).max()
    # Newton's tolerance of 1e-12 times the condition of the body.
    assert np.abs(ours.mu - theirs.mu).max() < 1e-9 * scale
    assert np.abs(ours.t - theirs.t).max() < 1e-9 * scale
    assert np.abs(ours.slip - theirs.slip).max() < 1e-9 * np.abs(theirs.u).max()


def test_drag_by_a_force_below_sliding(make):
    """A stamp with weight N and a tangential force below F N sticks or creeps, but is held."""
    body = held(make, n=8)
    stamp = Rigid(0.0, force=(0.05, 0.2))
    result = ContactProblem(body, "bottom", stamp, 0.5).solve()
    # The obstacle gets (.05, .2) from outside and gives it to the body.
    np.testing.assert_allclose(result.resultant, [0.05, 0.2], rtol=1e-9)
    assert result.motion[0] > 0


@pytest.mark.parametrize(
    ("force", "friction"),
    [((0.1, 0.2), 0.0), ((None, -0.2), 0.0), ((0.2, 0.2), 0.5), ((0.0, 0.2), 0.0)],
)
def test_forces_that_nothing_resists(force, friction, make):
    problem = ContactProblem(held(make), "bottom", Rigid(0.0, force=force), friction)
    with pytest.raises(Unbounded, match="obstacle is not held"):
        problem.solve()


def test_floating_body_between_a_fixed_and_a_driven_plane(make):
    """Two planes, one driven: what goes in below comes out above."""
    body = held(make, components=()).fix("left", "x")
    obstacles = [Rigid(0.01, force=(None, 0.3)), 0.02]
    result = ContactProblem(body, ["bottom", "top"], obstacles).solve()
    np.testing.assert_allclose(result.resultants[:, 1], [0.3, -0.3], rtol=1e-10)
    assert result.motion[1] == pytest.approx(0.03 + 0.3 * (1 - 0.09) / 2.0, rel=1e-10)


def test_history_of_forces(make):
    """A stamp pressed and dragged by forces in time: friction sees the obstacle move."""
    problem = ContactProblem(held(make, n=8), "bottom", Rigid(0.0, force=(0.0, 0.2)), 0.5)
    stepper = LoadStepper(problem)
    stepper.obstacle(lambda t: Rigid(0.0, force=(0.08 * np.sin(t), 0.2)))
    history = stepper.run(np.linspace(0.5, 6.0, 12))
    np.testing.assert_allclose(
        history.resultant[:, 0], 0.08 * np.sin(history.times), rtol=1e-8, atol=1e-12
    )
    assert max(max(r.kkt.values()) for r in history.results) < 1e-10
    # Hysteresis: at t = pi the force is zero again, the stamp is not where it was.
    at_rest = ContactProblem(held(make, n=8), "bottom", Rigid(0.0, force=(0.0, 0.2)), 0.5).solve()
    back = stepper.history.results[5]
    assert abs(back.motion[0] - at_rest.motion[0]) > 1e-4
