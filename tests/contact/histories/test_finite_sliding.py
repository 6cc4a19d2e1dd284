"""Bodies in the plane that slide by more than a facet and turn, on the factors of their rest."""

import itertools
import re

import numpy as np
import pytest
from families import PLANE, turn
from posed_pairs import SOFT, STIFF, Pose, body, traction
from skfem import ElementQuad1, ElementQuad2, MeshHex, MeshQuad, MeshTet, MeshTri

from contact import ContactProblem, ElasticBody, InputError, LayeredBlock, LoadStepper, Pair
from contact.condensation import sparse
from contact.histories.finite_sliding import rotation as rotation_of
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore:the cells are not parallelograms")

FRICTION = 0.3


def indenter(element, n=9, bend=1.5, **more):
    """A block with a curved lower side, of length one, above the origin."""
    mesh = MeshQuad.init_tensor(np.linspace(-0.5, 0.5, n + 1), np.linspace(0, 0.5, 5))
    names = dict(mesh.with_defaults().boundaries)
    rise = bend - np.sqrt(bend**2 - mesh.p[0] ** 2)
    p = np.array([mesh.p[0], mesh.p[1] + rise * (1 - 2 * mesh.p[1])])
    body = ElasticBody.from_mesh(
        MeshQuad(p, mesh.t, sort_t=False).with_boundaries(names), element(), E=10.0, nu=0.3
    )
    return body.fix("top", "xy")


def slab(element, n=48):
    mesh = MeshQuad.init_tensor(np.linspace(-1.2, 2.0, n + 1), np.linspace(-1, 0, 7))
    return ElasticBody.from_mesh(mesh.with_defaults(), element(), E=1.0, nu=0.3).fix("bottom", "xy")


def ironing(element, times, friction=FRICTION, **more):
    upper, lower = indenter(element), slab(element)
    problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=friction)
    stepper = LoadStepper(problem, sliding="finite", **more)
    stepper.move("top", "y", -0.03, lambda t: min(t, 1.0), body=upper)
    stepper.move("top", "x", 0.1, lambda t: max(t - 1.0, 0.0), body=upper)
    return stepper.run(times), upper, lower


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_ironing(element, monkeypatch):
    made = []
    whole = sparse.schur_factor
    monkeypatch.setattr(
        sparse, "schur_factor", lambda *args, **more: made.append(1) or whole(*args, **more)
    )
    history, upper, lower = ironing(element, [0.5, 1.0, 1.7, 2.4, 3.1, 5.0, 7.0])
    assert len(made) == 2  # one for each body, once
    for k, result in enumerate(history.results):
        assert max(result.kkt.values()) <= 1e-10
        # In full slip four projections are enough: errors are squared, up to a part of 1e-3.
        changes = [line.residual for line in result.history if line.phase == "projection"]
        assert len(changes) <= 5
        pairs = itertools.pairwise(changes[1:])
        assert all(after <= 20 * before**2 + 2e-3 * before for before, after in pairs), k
        one, two = result[upper].resultant, result[lower].resultant
        assert np.abs(one + two).max() <= 1e-11 * np.abs(one).max()
    for result in history.results[2:]:  # full slip: the whole friction force is F times the normal
        assert abs(result.t.sum() - FRICTION * result.mu.sum()) <= 1e-10 * result.mu.sum()
    forces = np.array([result.resultant for result in history.results[3:]])
    assert np.ptp(forces[:, 1]) <= 5e-3 * forces[0, 1]  # a long slab looks the same everywhere
    assert history.results[-1].x[0, history.results[-1].mu > 0].min() > -0.5


def test_the_gap_of_a_result_is_that_of_the_displaced_bodies():
    history, upper, lower = ironing(ElementQuad2, [1.0, 3.3])
    result = history.results[-1]
    touching = result.mu > 1e-3 * result.mu.max()
    assert np.abs(result.gap[touching]).max() <= 1e-10
    # Independent of the rows: vertices of the slab under the indenter, by the bodies' own fields.
    mesh, u = lower.mesh, result[lower].u
    top = np.unique(mesh.facets[:, mesh.boundaries["top"]])
    y = mesh.p[:, top] + u.reshape(-1, 2)[: mesh.nvertices].T[:, top]
    side = np.linspace(-0.5, 0.5, 4001)
    facet_ends = np.linspace(-0.5, 0.5, 10)
    height = np.interp(side, facet_ends, 1.5 - np.sqrt(1.5**2 - facet_ends**2))
    X = np.array([side, height])
    x = X + result[upper].sample(X)
    surface = np.interp(y[0], x[0], x[1], left=np.inf, right=np.inf)
    inside = np.isfinite(surface)
    depth = surface[inside] - y[1, inside]
    # Conditions hold in the mean over facets: vertices may be off by the facets' own sagitta.
    assert depth.min() > -2e-3
    assert np.sort(np.abs(depth))[:4].max() < 1e-3


def test_what_has_no_finite_sliding_is_refused():
    upper, lower = indenter(ElementQuad1), slab(ElementQuad1)
    rigid = ContactProblem(upper, "bottom", 0.01)
    given = ContactProblem(upper, "bottom", lower.surface("top", clearance=0.0))
    for problem, message in ((rigid, "has no shape to slide on"), (given, "clearance")):
        with pytest.raises(InputError, match=message):
            LoadStepper(problem, sliding="finite").run([1.0])
    layers = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], top="xy").named("layers")
    of_layers = ContactProblem(layers, "bottom", lower.surface("top"))
    with pytest.raises(InputError, match="sliding: 'layers' is a LayeredBlock"):
        LoadStepper(of_layers, sliding="finite")
    with pytest.raises(InputError, match="sliding='large'"):
        LoadStepper(given, sliding="large")


def block(element, x, y, cells):
    ticks = [np.linspace(*ends, n + 1) for ends, n in zip((x, y), cells, strict=True)]
    mesh = MeshQuad.init_tensor(*ticks).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)


def tower(**more):
    """Pushed at its upper side it rises from the ground and leans."""
    tower = block(ElementQuad1, (0, 1), (0, 3), (4, 12)).fix("top", "x").named("tower")
    ground = block(ElementQuad1, (-1, 2), (-1, 0), (9, 3)).fix("bottom", "xy").named("ground")
    problem = ContactProblem(tower, "bottom", ground.surface("top"), friction=0.8)
    stepper = LoadStepper(problem, **more)
    stepper.load("top", (0.0, -0.01), lambda t: 1.0, body=tower)
    return stepper.move("top", "x", 1.0, lambda t: t, body=tower)


def test_a_rocking_tower_is_refused_and_its_ground_is_not():
    """Until it leans by a tenth; linear theory says nothing."""
    stepper = tower(sliding="finite")
    with pytest.raises(InputError, match=r"sliding: .*'tower' turns by 5") as caught:
        stepper.run([0.1, 0.2, 0.3, 0.4])
    degrees = float(re.search(r"turns by ([\d.]+) degrees", str(caught.value))[1])
    assert abs(np.radians(degrees) - 0.1) <= 0.01  # of .3 on a height of three
    assert stepper.history.times.tolist() == [0.1, 0.2]
    assert np.any(stepper.history.results[-1].gap > 1e-3)  # it has risen at one edge
    assert len(tower().run([0.2, 0.4])) == 2
    with pytest.raises(InputError, match=r"largest_rotation"):
        tower(sliding="finite", largest_rotation=0.04).run([0.1, 0.2])
    assert len(tower(sliding="finite", largest_rotation=0.2).run([0.1, 0.2, 0.3])) == 3
    for angle in (0.0, -1.0, 2.0, np.nan, "much", [0.1, 0.2]):
        with pytest.raises(InputError, match=r"^largest_rotation"):
            tower(sliding="finite", largest_rotation=angle)
    with pytest.raises(InputError, match=r"largest_rotation: it belongs"):
        tower(largest_rotation=0.1)


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
            assert abs(rotation_of(X, x - X, weight) - angle) <= 1e-12


def test_slopes_of_an_indented_surface_are_no_rotation():
    X = np.array([np.linspace(-1, 1, 41), np.zeros(41)])
    u = np.array([0 * X[0], -0.2 * np.exp(-((X[0] / 0.2) ** 2))])  # slopes of up to 40 degrees
    assert rotation_of(X, u, np.ones(41)) <= 1e-12


def dragged(element, pose, swap=False):
    """Pressed down, then dragged over several facets and pressed further."""
    upper = body(element, (np.linspace(0.2, 0.8, 6), [0.0, 0.2, 0.4]), STIFF, pose).fix("top")
    lower = body(element, (np.linspace(0, 2, 12), [-0.8, -0.4, 0.0]), SOFT, pose).fix("bottom")
    if swap:
        pair = Pair(lower, "top", upper, "bottom", friction=0.3, multipliers="second")
    else:
        pair = Pair(upper, "bottom", lower, "top", friction=0.3)
    problem = ContactProblem([lower, upper] if swap else [upper, lower], [pair])
    stepper = LoadStepper(problem, sliding="finite")

    def path(t):
        u = np.array([0.3 * max(t - 1, 0.0), -0.02 * min(t, 1.0) - 0.004 * max(t - 1, 0.0)])
        return pose.size * pose.Q @ u

    for c in range(2):
        stepper.move("top", c, 1.0, lambda t, c=c: path(t)[c], body=upper)
    return stepper.run([1.0, 2.0, 3.0])


POSES = {
    "turned and moved, in millimetres": (Pose(turn(2.1), [0.7, -2.0], 1e3, 1e-6), False),
    "mirrored, in the other order": (Pose(np.diag([-1.0, 1.0]) @ turn(0.4)), True),
}


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.sampled(8)
@pytest.mark.parametrize("element", PLANE, ids=lambda e: e.__name__)
def test_every_step_is_the_same(element):
    expected = dragged(element, Pose(np.eye(2)))
    assert np.abs(expected[-1].shear).max() > 0.1 * expected[-1].pressure.max()
    for pose, swap in POSES.values():
        for found, reference in zip(dragged(element, pose, swap), expected, strict=True):
            at = pose.home(found.x_nominal)
            near = np.abs(at[:, :, None] - reference.x_nominal[:, None]).max(axis=0)
            match = near.argmin(axis=0)
            assert near.min(axis=0).max() <= 1e-9
            off = traction(found)[:, match] / pose.stress - pose.Q @ traction(reference)
            # Newton's tolerance is that of the forces as a whole.
            assert np.abs(off).max() <= 1e-8 * reference.pressure.max()
            np.testing.assert_array_equal(found.status[match], reference.status)
            assert max(found.kkt.values()) <= 1e-10
