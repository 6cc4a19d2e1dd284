"""Bodies of small strain that turn: small angles are taken, larger ones refused by name."""

import re

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, MeshHex, MeshQuad, MeshTet, MeshTri

from contact import ContactProblem, ElasticBody, InputError, LoadStepper
from contact.histories.finite_sliding import rotation

BEND = 1.5  # radius of the roller


def block(element, x, y, cells):
    ticks = [np.linspace(*ends, n + 1) for ends, n in zip((x, y), cells, strict=True)]
    mesh = MeshQuad.init_tensor(*ticks).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)


def roller(unit):
    """A sector whose lower side is an arc about (0, BEND), held at its straight upper side."""
    mesh = MeshQuad.init_tensor(np.linspace(-0.6, 0.6, 13), np.linspace(0, 0.5, 5))
    names = dict(mesh.with_defaults().boundaries)
    rise = BEND - np.sqrt(BEND**2 - mesh.p[0] ** 2)
    p = unit * np.array([mesh.p[0], mesh.p[1] + rise * (1 - 2 * mesh.p[1])])
    mesh = MeshQuad(p, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=10.0, nu=0.3)
    return body.fix("top", "xy").named("roller")


def rolling(unit, **more):
    """The upper side turns by the angle t about the centre, which moves on by BEND * t."""
    upper = roller(unit)
    lower = block(ElementQuad2, (-unit, 1.2 * unit), (-0.7 * unit, 0), (22, 5))
    lower.fix("bottom", "xy")
    problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.5)
    stepper = LoadStepper(problem, sliding="finite", **more)
    radius = BEND * unit
    stepper.move("top", "x", lambda x: radius - x[1], np.sin, body=upper)
    stepper.move("top", "x", lambda x: x[0], lambda t: np.cos(t) - 1, body=upper)
    stepper.move("top", "x", -radius, np.sin, body=upper)  # the centre goes the other way
    stepper.move("top", "y", lambda x: x[0], np.sin, body=upper)
    stepper.move("top", "y", lambda x: x[1] - radius, lambda t: np.cos(t) - 1, body=upper)
    stepper.move("top", "y", -0.01 * unit, body=upper)
    return stepper


@pytest.mark.sampled(2)
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_roller_is_refused_by_the_angle_that_it_was_turned_by(unit):
    stepper = rolling(unit)
    stepper.run([0.03, 0.06, 0.09])
    with pytest.raises(InputError, match=r"sliding: .*'roller' turns by") as caught:
        stepper.step(0.12)
    degrees = float(re.search(r"turns by ([\d.]+) degrees", str(caught.value))[1])
    assert abs(np.radians(degrees) - 0.12) <= 2e-3  # the lower side lags behind by its strain
    assert stepper.history.times.tolist() == [0.03, 0.06, 0.09]  # what was finished stays


@pytest.mark.turns(4)
def test_the_angle_may_be_chosen():
    with pytest.raises(InputError, match=r"largest_rotation"):
        rolling(1.0, largest_rotation=0.04).run([0.03, 0.06])
    assert len(rolling(1.0, largest_rotation=0.2).run([0.04, 0.08, 0.12])) == 3
    for angle in (0.0, -1.0, 2.0, np.nan, "much", [0.1, 0.2]):
        with pytest.raises(InputError, match=r"^largest_rotation"):
            rolling(1.0, largest_rotation=angle)
    with pytest.raises(InputError, match=r"largest_rotation: it belongs"):
        LoadStepper(rolling(1.0).problem, largest_rotation=0.1)


def test_a_rocking_tower_is_refused_and_its_ground_is_not():
    """Pushed at its upper side it rises from the ground, until it leans by a tenth."""
    tower = block(ElementQuad1, (0, 1), (0, 3), (4, 12)).fix("top", "x").named("tower")
    ground = block(ElementQuad1, (-1, 2), (-1, 0), (9, 3)).fix("bottom", "xy").named("ground")
    problem = ContactProblem(tower, "bottom", ground.surface("top"), friction=0.8)
    stepper = LoadStepper(problem, sliding="finite")
    stepper.load("top", (0.0, -0.01), lambda t: 1.0, body=tower)
    stepper.move("top", "x", 1.0, lambda t: t, body=tower)
    with pytest.raises(InputError, match=r"sliding: .*'tower' turns by 5"):
        stepper.run([0.1, 0.2, 0.3, 0.4])
    assert stepper.history.times.tolist() == [0.1, 0.2]
    assert np.any(stepper.history.results[-1].gap > 1e-3)  # it has risen at one edge


def test_small_sliding_is_not_asked():
    """The same tower under small displacements: the theory is linear, and it says nothing."""
    tower = block(ElementQuad1, (0, 1), (0, 3), (4, 12)).fix("top", "x")
    ground = block(ElementQuad1, (-1, 2), (-1, 0), (9, 3)).fix("bottom", "xy")
    problem = ContactProblem(tower, "bottom", ground.surface("top"), friction=0.8)
    stepper = LoadStepper(problem)
    stepper.load("top", (0.0, -0.01), lambda t: 1.0, body=tower)
    stepper.move("top", "x", 1.0, lambda t: t, body=tower)
    assert len(stepper.run([0.2, 0.4])) == 2


@pytest.mark.parametrize("angle", [1e-9, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("mesh", [MeshTri, MeshQuad, MeshTet, MeshHex])
def test_the_angle_is_that_of_a_rotation(mesh, angle):
    """Of places in a plane as well, and beside a strain and a translation."""
    X = mesh().refined(2).p - 0.5
    dim = len(X)
    c, s = np.cos(angle), np.sin(angle)
    R, axes = np.eye(dim), np.linalg.qr(np.random.default_rng(3).normal(size=(dim, dim)))[0]
    R[:2, :2] = [[c, -s], [s, c]]
    R = axes @ R @ axes.T
    flat = np.where(X[-1] == X[-1].min(), 1.0, 0.0)
    for weight in (np.ones(X.shape[1]), flat):
        for stretch in (0.0, 0.05):
            x = R @ (X * (1.0 + stretch)) + 7.0
            assert abs(rotation(X, x - X, weight) - angle) <= 1e-12


def test_slopes_of_an_indented_surface_are_no_rotation():
    X = np.array([np.linspace(-1, 1, 41), np.zeros(41)])
    u = np.array([0 * X[0], -0.2 * np.exp(-((X[0] / 0.2) ** 2))])  # slopes of up to 40 degrees
    assert rotation(X, u, np.ones(41)) <= 1e-12


def test_in_space_the_angle_is_that_of_all_axes():
    X = MeshHex().refined(1).p
    turn = np.array([0.01, -0.02, 0.03])
    u = np.cross(turn, X, axisb=0, axisc=0)
    angle = np.arctan(np.linalg.norm(turn))
    assert abs(rotation(X, u, np.ones(X.shape[1])) - angle) <= 1e-12
