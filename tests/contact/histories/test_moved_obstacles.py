"""Histories of tools given at another place in every step: friction sees them move and turn."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from families import turn
from scipy.spatial.transform import Rotation
from skfem import ElementHex1, ElementQuad1, MeshHex, MeshQuad

from contact import (
    ClosestPoint,
    Cone,
    ContactProblem,
    ContactResult,
    Cylinder,
    ElasticBody,
    InputError,
    LoadHistory,
    LoadStepper,
    Moved,
    NotConverged,
    Pair,
    Parabola,
    Plane,
    Rigid,
    Rough,
    SignedDistance,
    Sphere,
    SurfaceMesh,
)

F, G = 0.3, 2e-3  # Coulomb's coefficient, Tresca's bound
WAVES = 4e-3 * (np.cos(2 * np.pi * np.arange(32) / 16) - 1.0)


def block(dim=2, n=12, **kwargs):
    """A block below y = 0, or z = 0, held at its bottom."""
    across, down = np.linspace(-1, 1, n + 1), np.linspace(-0.5, 0, n // 3 + 1)
    sides = (across,) * (dim - 1)
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*sides, down)
    mesh = mesh.with_boundaries(
        {"bottom": lambda x: x[-1] == -0.5, "contact": lambda x: x[-1] == 0.0}
    )
    element = ElementQuad1() if dim == 2 else ElementHex1()
    return ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3, **kwargs).fix("bottom")


def disk(n=96, centre=(0.0, 1.0)):
    angle = 2 * np.pi * np.arange(n) / n
    points = np.array([np.sin(angle), np.cos(angle)]) + np.array(centre)[:, None]
    return points, np.array([np.arange(n), np.roll(np.arange(n), -1)])


def at(v, c, a):
    """Where a turn by a about (0, 1) and a shift by c take a place."""
    pole = np.array([0.0, 1.0])
    return turn(a) @ (np.asarray(v) - pole) + pole + c


WHEEL, MESH = Cylinder((0.0, 1.0), 1.0), SurfaceMesh(*disk())
BALL = SignedDistance(lambda x: np.hypot(x[0], x[1] - 1.0) - 1.0)
FLOOR, WEDGE = Plane((0.0, 0.0), (0.0, -1.0)), Cone((0.0, 0.0), (0.0, 1.0), 1.4)
ROUGH = Rough(WAVES, 2.0, normal=(0.0, -1.0))


# From displacement and angle about (0, 1): the tool, and by how much it may turn.
TOOLS = {
    "Plane": (lambda c, a: Plane(at((0, 0), c, a), turn(a) @ (0.0, -1.0)), 0.02),
    "Cylinder": (lambda c, a: Cylinder(at((0, 1), c, a), 1.0), 0.0),
    "Cone": (lambda c, a: Cone(at((0, 0), c, a), turn(a) @ (0.0, 1.0), 1.4), 0.05),
    "Parabola": (lambda c, a: Parabola((c[0], 0.0), 1.0, offset=c[1]), 0.0),
    "Rough": (lambda c, a: Rough(WAVES, 2.0, at((0, 0), c, a), turn(a) @ (0.0, -1.0)), 0.0),
    "SurfaceMesh": (
        lambda c, a: SurfaceMesh(np.transpose([at(p, c, a) for p in MESH.points.T]), MESH.facets),
        2.0,
    ),
    "translated": (lambda c, a: MESH.translated(c), 0.0),
    "ClosestPoint": (lambda c, a: ClosestPoint(Plane(c, (0.0, -1.0))), 0.0),
    "Moved Cylinder": (lambda c, a: Moved(WHEEL, c, a, (0, 1)), 9.0),
    "Moved SurfaceMesh": (lambda c, a: Moved(MESH, c, a, (0, 1)), 2.0),
    "Moved SignedDistance": (lambda c, a: Moved(BALL, c, a, (0, 1)), 2.0),
    "Moved Plane": (lambda c, a: Moved(FLOOR, c, a, (0, 1)), 0.02),
    "Moved Rough": (lambda c, a: Moved(ROUGH, c, a, (0, 1)), 0.01),
    "Moved Cone": (lambda c, a: Moved(WEDGE, c, a, (0, 1)), 0.05),
    "Rigid Moved": (lambda c, a: Rigid(Moved(WHEEL, (c[0], 0.0), a, (0, 1)), (0.0, c[1])), 2.0),
}


def opposes(result, velocity, law):
    """Every point that touches slips, with all the friction there is, along with the obstacle."""
    points = result.mu > 1e-9 * result.mu.max()
    assert points.sum() >= 2
    v = velocity(result.x_nominal)
    v_t = np.einsum("dm,djm->mj", v, result.system.rows.tangents)
    fast = points & (np.linalg.norm(v_t, axis=1) > 0.05)
    bound = F * result.pressure if law == "coulomb" else G + 0 * result.pressure
    np.testing.assert_allclose(
        np.linalg.norm(result.shear, axis=1)[fast], bound[fast], rtol=1e-6, atol=1e-12
    )
    along = np.sum(result.shear * v_t, axis=1)[fast]
    # In the plane there are two directions; in space the body's own motion turns them a little.
    least = bound * np.linalg.norm(v_t, axis=1) * (1 - 1e-6 if v_t.shape[1] == 1 else 0.9)
    assert np.all(along >= least[fast] - 1e-12)
    return fast.sum()


@pytest.mark.sampled(15)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", TOOLS)
def test_a_random_history_slips_against_its_motion(kind, seed):
    """After any path, once everything slips, the shear is that of the velocity in the end."""
    rng = np.random.default_rng([seed, len(kind)])
    tool, most = TOOLS[kind]
    law = ("coulomb", "tresca")[seed % 2]
    press = 0.02 if "Cone" not in kind else 0.05
    start = [0.0, 0.0, 0.0]
    path = [start, [*rng.uniform(-0.1, 0.1, 1), -press, rng.uniform(-1, 1) * most]]
    for _ in range(rng.integers(0, 3)):
        path.append([rng.uniform(-0.2, 0.2), -press * rng.uniform(0.8, 1.2), path[-1][2]])
        path[-1][2] = rng.uniform(-1, 1) * most
    far = path[-1][0] + rng.choice([-1, 1]) * rng.uniform(0.15, 0.3)
    path.append([far, -press, path[-1][2] + rng.uniform(-1, 1) * min(most, 1.0)])

    def way(t):
        x, y, a = (np.interp(t, np.arange(len(path)), column) for column in np.transpose(path))
        return tool(np.array([x, y]), a)

    problem = ContactProblem(block(), "contact", way(0.0), F if law == "coulomb" else G, law)
    last = LoadStepper(problem).obstacle(way).run(np.arange(1.0, len(path))).results[-1]
    assert max(last.kkt.values()) <= 1e-10
    shift, turn = np.subtract(path[-1], path[-2])[:2], path[-1][2] - path[-2][2]
    # The pole of the turn is (0, 1) and moves along.
    pole = np.array([0.0, 1.0]) + 0.5 * (np.array(path[-1][:2]) + path[-2][:2])

    def velocity(x):
        away = x - pole[:, None]
        return shift[:, None] + turn * np.array([-away[1], away[0]])

    opposes(last, velocity, law)


def balls(c, R):
    """Tools in space, turned by R about (0, 0, 1) and shifted by c."""
    rotvec = Rotation.from_matrix(R).as_rotvec()
    pole = (0.0, 0.0, 1.0)
    at = R @ (0.0, 0.0, -1.0) + pole + c
    heights = WAVES[:, None] + 0 * WAVES
    yield "Sphere", Sphere(np.array(pole) + c, 1.0), False
    yield "Moved Sphere", Moved(Sphere(pole, 1.0), c, rotvec, pole), True
    yield "Moved Plane", Moved(Plane((0, 0, 0), (0, 0, -1)), c, rotvec, pole), True
    yield "Cylinder", Cylinder(np.array(pole) + c, 1.0, R @ (0.0, 1.0, 0.0)), True
    yield "Rough", Moved(Rough(heights, (2.0, 2.0), normal=(0, 0, -1)), c, rotvec, pole), True
    yield "Cone", Cone(at, R @ (0.0, 0.0, 1.0), 1.52), False


@pytest.mark.sampled(6)
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("k", range(6))
def test_space(k, law):
    """Pressed, dragged and turned about the normal in one step."""
    rng = np.random.default_rng(k)

    def tool(t):
        c = np.array([*(drag * max(t - 1.0, 0.0)), -0.04 * min(t, 1.0)])
        R = Rotation.from_rotvec((0.0, 0.0, spin * max(t - 1.0, 0.0))).as_matrix()
        return list(balls(c, R))[k]

    drag, spin = rng.uniform(0.1, 0.2, 2), 0.0
    spin = rng.uniform(0.2, 0.4) if tool(0.0)[2] else 0.0
    body = block(3, 6)
    problem = ContactProblem(body, "contact", tool(0.0)[1], F if law == "coulomb" else G, law)
    last = LoadStepper(problem).obstacle(lambda t: tool(t)[1]).run([1.0, 2.0]).results[-1]
    pole = 0.5 * np.array([*drag, 0.0])

    def velocity(x):
        away = x - pole[:, None]
        turn = spin * np.array([-away[1], away[0], 0 * away[0]])
        return np.array([*drag, 0.0])[:, None] + turn

    assert opposes(last, velocity, law) >= 2


def dragged(way, friction=F, law="coulomb", times=(1.0, 1.5, 2.0), **kwargs):
    """Pressed until 1, then dragged by .1 a unit of time; the problem has the first obstacle."""
    problem = ContactProblem(block(), "contact", way(0.0, 0.0), friction, law, **kwargs)

    def of_time(t):
        return way(0.1 * max(t - 1.0, 0.0), 0.02 * min(t, 1.0))

    return LoadStepper(problem).obstacle(of_time), list(times)


def same(one, other, rel=1e-9):
    scale = np.abs(other.resultant).max()
    assert np.abs(one.resultant - other.resultant).max() <= rel * scale
    assert np.abs(one.u - other.u).max() <= rel * np.abs(other.u).max()
    assert np.abs(one.slip - other.slip).max() <= rel * np.abs(other.slip).max()


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("laws", [None, 30.0], ids=["hard", "compliant"])
def test_a_plane_moves_as_in_a_rigid(law, laws):
    """On a flat boundary the small motion of a `Rigid` is exact: the same step for step."""
    friction = F if law == "coulomb" else G
    moved, times = dragged(lambda s, d: Plane((s, -d), (0, -1)), friction, law, overclosure=laws)
    rigid, _ = dragged(
        lambda s, d: Rigid(FLOOR, displacement=(s, -d)), friction, law, overclosure=laws
    )
    within, _ = dragged(
        lambda s, d: Rigid(Plane((0.5 * s, -d), (0, -1)), displacement=(0.5 * s, 0.0)),
        friction,
        law,
        overclosure=laws,
    )
    expected = rigid.run(times)
    for history in (moved.run(times), within.run(times)):
        for one, other in zip(history, expected, strict=True):
            same(one, other)
    assert abs(expected[-1].resultant[0]) > 1e-4


def test_the_contact_goes_along():
    """A roller drawn over a block in ten steps: all slips, below it."""
    for way in (
        lambda s, d: Cylinder((s, 1 - d), 1.0),
        lambda s, d: Moved(WHEEL, (s, -d)),
        lambda s, d: Rigid(Cylinder((s, 1.0), 1.0), displacement=(0.0, -d)),
    ):
        stepper, _ = dragged(way)
        last = stepper.run([1.0, *np.linspace(1.0, 4.0, 11)[1:]])[-1]
        assert last.resultant[0] == pytest.approx(-F * last.resultant[1], rel=1e-9)
        centre = last.mu @ last.x_nominal[0] / last.mu.sum()
        assert centre == pytest.approx(0.3, abs=0.05)


def test_a_rolling_wheel_carries_no_load_along():
    """It slips by what the strains are, a spinning one by the arc; both end where it is."""
    rolls, times = dragged(lambda s, d: Moved(WHEEL, (s, -d), -s, (0, 1)), times=(1.0, 2.0, 3.0))
    spins, _ = dragged(lambda s, d: Moved(WHEEL, (0.0, -d), 100.0 * s, (0, 1)))
    slides, _ = dragged(lambda s, d: Moved(WHEEL, (s, -d)))
    rolling, spinning, sliding = (stepper.run(times)[-1] for stepper in (rolls, spins, slides))
    full = F * abs(rolling.resultant[1])
    assert abs(rolling.resultant[0]) < 0.5 * full
    assert np.abs(rolling.slip[rolling.mu > 0]).max() < 0.1 * 0.2
    assert spinning.resultant[0] == pytest.approx(-F * spinning.resultant[1], rel=1e-9)
    assert sliding.resultant[0] == pytest.approx(-F * sliding.resultant[1], rel=1e-9)
    # Counter-clockwise, its lower side moves to the right, by the arc.
    touching = spinning.mu > 0
    assert np.abs(spinning.slip[touching]).max() == pytest.approx(20.0, rel=0.03)


SHIFTED = {
    "function": lambda s, d: lambda x: 0.5 * (x[0] - s) ** 2 - d,
    "array": lambda s, d: 0.5 * (np.linspace(-1, 1, 13) - s) ** 2 - d,
    "SignedDistance": lambda s, d: SignedDistance(lambda x: np.hypot(x[0] - s, x[1] + d - 1) - 1),
    "radius": lambda s, d: Cylinder((s, 1.0 + 0.1 * d), 1.0 + d),
    "shape": lambda s, d: Sphere((s, 1.0 - d), 1.0) if d else Cylinder((s, 1.0), 1.0),
    "wedge": lambda s, d: lambda x: 0.1 * (x[0] - s) - d,
}


STILL = {
    "number": lambda s, d: 0.01 - d,
    "NumPy's number": lambda s, d: np.float64(0.01 - d),
    "shape after a number": lambda s, d: Plane((0.0, 0.01 - d), (0, -1)) if d else 0.01,
    "still": lambda s, d: lambda x: 0.01 * x[0] - 0.01,
}


@pytest.mark.parametrize("kind", [*SHIFTED, *STILL])
def test_a_motion_that_no_shape_tells_is_asked_for(kind):
    """Nothing is asked where nothing moves along, or nothing rubs."""
    if kind in STILL:
        stepper, times = dragged(STILL[kind])
        last = stepper.run(times)[-1]
        assert last.resultant[1] < 0
        assert abs(last.resultant[0]) < 0.1 * abs(last.resultant[1])
        return
    stepper, times = dragged(SHIFTED[kind])
    with pytest.raises(InputError, match=r"^motion: .*motion=lambda t"):
        stepper.run(times)
    stepper, _ = dragged(SHIFTED[kind], 0.0)
    assert not np.any(stepper.run(times)[-1].t)


def test_what_is_said_is_what_slips():
    """A gap that is a function, with its motion said, against the same shape that tells it."""
    told, times = dragged(lambda s, d: Parabola((s, 0.0), 1.0, offset=-d))
    silent, _ = dragged(SHIFTED["function"])
    way = silent._obstacle[0][1]
    silent.obstacle(way, motion=lambda t: (0.1 * max(t - 1.0, 0.0), 0.0))
    for one, other in zip(silent.run(times), told.run(times), strict=True):
        same(one, other)
    straight = LoadStepper(silent.problem).obstacle(way, motion=0).run(times)[-1]
    assert abs(straight.resultant[0]) < 0.9 * abs(one.resultant[0])
    for wrong in (1.0, "x", (0.1, 0.2), [0]):
        with pytest.raises(InputError, match="motion"):
            silent.obstacle(way, motion=wrong)
    for wrong in (lambda t: 0.1, lambda t: (1.0, 2.0, 3.0), lambda t: (np.nan, 0.0)):
        with pytest.raises(InputError, match="motion"):
            LoadStepper(silent.problem).obstacle(way, motion=wrong).run([1.0])


def test_by_hand_as_by_the_stepper(tmp_path):
    """`solve(after=)` asks the obstacle of the step before; one from a file may not know it."""
    stepper, times = dragged(lambda s, d: Cylinder((s, 1 - d), 1.0))
    history = stepper.run(times)
    way = stepper._obstacle[0][1]
    problem = ContactProblem(block(), "contact", way(1.0), F)
    first = problem.solve(after=None)
    loaded = ContactResult.load(first.save(tmp_path / "first.npz"))
    problem.solve(after=loaded)
    problem.obstacle = way(2.0)
    second = problem.solve(after=first)
    assert second.resultant[0] == pytest.approx(-F * second.resultant[1], rel=1e-9)
    with pytest.raises(InputError, match=r"^motion: "):
        problem.solve(after=loaded)
    same(problem.solve(after=loaded, motion=(0.1, 0.0)), second)
    same(problem.solve(after=pickle.loads(pickle.dumps(first))), second)
    with pytest.raises(InputError, match="motion"):
        problem.solve(motion=(0.1, 0.0))
    again = ContactResult.load(history[-1].save(tmp_path / "last.npz"))
    np.testing.assert_array_equal(again.slip, history[-1].slip)
    assert again.kkt == history[-1].kkt
    problem = ContactProblem(block(), "contact", Plane((0.0, -0.01), (0, -1)), F)
    loaded = ContactResult.load(problem.solve().save(tmp_path / "plane.npz"))
    with pytest.raises(InputError, match=r"^motion: .* file"):
        problem.solve(after=loaded)
    assert problem.solve(after=loaded, motion=0).resultant[1] < 0


@pytest.fixture
def halving(monkeypatch):
    """Steps longer than .3 fail."""
    small = LoadStepper._small_step

    def reluctant(self, last, begin, end):
        if last is not None and end - begin > 0.3:
            raise NotConverged("too long", ())
        return small(self, last, begin, end)

    monkeypatch.setattr(LoadStepper, "_small_step", reluctant)
    return monkeypatch


def test_halved_steps_know_where_the_obstacle_was(halving, tmp_path):
    def stepper(turn):
        return dragged(lambda s, d: Moved(MESH, (np.sin(s), -d), turn * s, (0, 1)))[0]

    halved = stepper(5).run([1.0, 2.0], path=tmp_path / "run")[-1]
    halving.undo()
    same(halved, stepper(5).run([1.0, 1.25, 1.5, 1.75, 2.0])[-1])
    np.testing.assert_array_equal(LoadHistory.load(tmp_path / "run")[-1].slip, halved.slip)
    assert len(stepper(5).resume(tmp_path / "run")) == 2
    with pytest.raises(InputError, match="another problem"):
        stepper(4).resume(tmp_path / "run")


def test_several_boundaries():
    """Two tools on two sides, one of which tells its motion and one of which is asked."""
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 9), np.linspace(-0.5, 0.5, 5))
    mesh = mesh.with_boundaries(
        {
            "up": lambda x: (x[1] == 0.5) & (x[0] > -0.6),
            "low": lambda x: (x[1] == -0.5) & (x[0] > -0.6),
            "left": lambda x: x[0] == -1,
        }
    )
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left")

    def way(t):
        return [
            Plane((0.2 * t, 0.5 - 0.01 * t), (0, -1)),
            lambda x: -0.01 * t + 0.1 * (x[0] + 0.1 * t) ** 2 - 0.1 * x[0] ** 2,
        ]

    problem = ContactProblem(body, ["up", "low"], way(0.0), F)
    with pytest.raises(InputError, match="motion"):
        LoadStepper(problem).obstacle(way).run([1.0])
    stepper = LoadStepper(problem).obstacle(way, motion=lambda t: [None, (-0.1 * t, 0.0)])
    result = stepper.run([1.0])[0]
    for part, sign in ((0, 1.0), (1, -1.0)):
        own = result.system.rows.part == part
        shear = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)[0]
        touching = own & (result.mu > 0)
        np.testing.assert_allclose(shear[touching], sign * F * result.pressure[touching], rtol=1e-6)


def test_rings():
    """A tool moves along the axis of an axisymmetric body; what its section does else is asked."""
    mesh = MeshQuad.init_tensor(np.linspace(1, 2, 6), np.linspace(0, 1, 6)).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3, plane="axisymmetric")
    body = body.fix("right", "xy")

    def pushed(way, **kwargs):
        problem = ContactProblem(body, "left", way(0.0), F)
        return LoadStepper(problem).obstacle(way, **kwargs).run([1.0])[0]

    shaft = pushed(lambda t: Plane((1.01, 0.3 * t), (1, 0)))
    assert shaft.resultant[1] == pytest.approx(F * shaft.mu.sum(), rel=1e-9)
    same(shaft, pushed(lambda t: Rigid(Plane((1.01, 0.0), (1, 0)), displacement=(None, 0.3 * t))))
    with pytest.raises(InputError, match="motion"):
        pushed(lambda t: Plane((1.01 + 0.01 * t, 0.3 * t), (1, 0)))
    tube = np.array([[0.5, 1.01, 1.01, 0.5], [-2.0, -2.0, 2.0, 2.0]])
    mesh = SurfaceMesh(tube, [[0, 1, 2, 3], [1, 2, 3, 0]])
    for drawn in (lambda t: Moved(mesh, (0.0, 0.3 * t)), lambda t: mesh.translated((0, 0.3 * t))):
        assert pushed(drawn).resultant[1] == pytest.approx(shaft.resultant[1], rel=1e-9)
    along = np.array([[0.0], [0.3]])
    made = pushed(lambda t: SurfaceMesh(tube + t * along, mesh.facets))
    assert made.resultant[1] == pytest.approx(shaft.resultant[1], rel=1e-9)
    grown = pushed(lambda t: Plane((1.0 + 0.01 * t, 0.0), (1, 0)), motion=lambda t: (0.0, 0.3 * t))
    assert grown.resultant[1] == pytest.approx(F * grown.mu.sum(), rel=1e-9)


@pytest.mark.parametrize("sliding", ["small", "finite"])
def test_a_rigid_tool_among_pairs(sliding):
    """Pairs of one tool and two bodies: it is moved as in a problem of one body."""
    low = block()
    mesh = MeshQuad.init_tensor(np.linspace(2, 3, 4), np.linspace(0, 1, 4)).with_defaults()
    one, two = (
        ElasticBody.from_mesh(m, ElementQuad1(), E=1.0, nu=0.3)
        for m in (mesh, mesh.translated((0.0, 1.0)))
    )
    one, two = one.fix("bottom"), two.fix("top")

    def tool(t):
        return Moved(WHEEL, (0.1 * max(t - 1.0, 0.0), -0.02 * min(t, 1.0)))

    touching = Pair(two, "bottom", one, "top", friction=0.1)
    rubbed = Pair(low, "contact", tool(0.0), friction=F)
    problem = ContactProblem([low, one, two], [touching, rubbed])
    alone = LoadStepper(ContactProblem(low, "contact", tool(0.0), F), sliding=sliding)
    alone.obstacle(tool)
    expected = alone.run([1.0, 2.0, 3.0])
    for pair in (rubbed, 1):
        stepper = LoadStepper(problem, sliding=sliding).obstacle(tool, pair=pair)
        stepper.move("top", "y", -0.01, lambda t: t, body=two)
        history = stepper.run([1.0, 2.0, 3.0])
        for result, wanted in zip(history, expected, strict=True):
            u = result[low].u if hasattr(result[low], "u") else result.u[problem.body.slices[0]]
            assert np.abs(u - wanted.u).max() <= 1e-8 * np.abs(wanted.u).max()
    for wrong in (None, 0, 2, touching, Pair(low, "contact", tool(0.0))):
        with pytest.raises(InputError, match=r"pair.*pair=1"):
            LoadStepper(problem).obstacle(tool, pair=wrong)
    with pytest.raises(InputError, match="pair"):
        LoadStepper(alone.problem).obstacle(tool, pair=0)


def test_a_moved_shape_is_that_shape_there():
    """Gaps, distances and directions against the same shape made at its new place."""
    rng = np.random.default_rng(2)
    c, angle = np.array([0.3, -0.2]), 0.4
    x = rng.uniform(-0.3, 0.3, (2, 20)) + np.array([[0.0], [-0.5]])
    n = np.array([0 * x[0], 1 + 0 * x[0]])
    for kind in ("Cylinder", "SurfaceMesh", "Plane", "Cone"):
        made, moved = (TOOLS[name][0](c, angle) for name in (kind, f"Moved {kind}"))
        if kind == "Cylinder":
            made = Cylinder(np.array((0.0, 1.0)) + c, 1.0)
        np.testing.assert_allclose(moved(x, n), made(x, n), rtol=1e-9)
        if kind != "Cone":
            for one, other in zip(moved.distance(x), made.distance(x), strict=True):
                np.testing.assert_allclose(one, other, atol=1e-9)
    assert all(a == b for a, b in pairwise([moved, pickle.loads(pickle.dumps(moved))]))


@pytest.mark.parametrize("sliding", ["small", "finite"])
def test_resume_refuses_another_way_along(sliding, tmp_path):
    """The gaps of a plane are the same wherever it slides, and the stored steps slid by 0.1."""

    def stepper(reach):
        def way(t):
            return Plane((reach * t, -0.02 * min(t, 1.0)), (0, -1))

        body, more = block(), {} if sliding == "small" else {"pair": 0}
        problem = ContactProblem(body, "contact", way(0.0), F)
        if more:
            problem = ContactProblem([body], [Pair(body, "contact", way(0.0), friction=F)])
        return LoadStepper(problem, sliding=sliding).obstacle(way, **more)

    whole = stepper(0.1).run([1.0, 2.0, 3.0], path=tmp_path / "run")
    (tmp_path / "run" / "step_00003.npz").unlink()
    with pytest.raises(InputError, match="another problem"):
        stepper(-0.1).resume(tmp_path / "run")
    resumed = stepper(0.1).resume(tmp_path / "run")
    assert len(resumed) == 3
    same(resumed[-1], whole[-1])
