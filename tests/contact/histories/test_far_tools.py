"""Rigid tools that move and turn by any amount, on boundaries of small strain."""

import itertools
import pickle

import numpy as np
import pytest
from far_blocks import AXLE, BALL, LAWS, PLANE, ROLLER, F, R, block, run
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP2,
    MeshHex,
    MeshQuad,
)

from contact import (
    ClosestPoint,
    Cone,
    ContactProblem,
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
    Status,
    SurfaceMesh,
)
from contact.errors import Unbounded
from contact.obstacles.rigid_motion import RigidMotion, matrix_of
from contact.obstacles.tool import Pose, Tool
from contact.rows.tool_rows import ToolRows
from skfem_adini import ElementQuadAdini


def disk(n=300):
    """A polygon inscribed in the circle of the tools."""
    a = 2 * np.pi * (np.arange(n) + 0.5) / n
    points = R * np.array([np.cos(a), 1 + np.sin(a)])
    return SurfaceMesh(points, np.array([np.arange(n), np.roll(np.arange(n), -1)]))


def meshed_ball(rings=24):
    """A sphere of triangles that touches z = 0."""
    polar, around = np.pi * np.arange(1, rings) / rings, np.pi * np.arange(2 * rings) / rings
    x = [np.outer(np.sin(polar), f(around)).ravel() for f in (np.cos, np.sin)]
    x.append(np.repeat(np.cos(polar), 2 * rings))
    points = BALL * np.hstack((np.array(x), [[0, 0], [0, 0], [1, -1]])) + [[0], [0], [BALL]]
    i, k = np.divmod(np.arange((rings - 2) * 2 * rings), 2 * rings)
    next_k = (k + 1) % (2 * rings)
    a, b = 2 * rings * i, 2 * rings * (i + 1)
    sides = np.hstack(([a + k, b + k, b + next_k], [a + k, b + next_k, a + next_k]))
    ring, last = np.arange(2 * rings), (rings - 2) * 2 * rings
    top, bottom = points.shape[1] - 2, points.shape[1] - 1
    up = [np.full(ring.size, top), ring, np.roll(ring, -1)]
    low = [np.full(ring.size, bottom), last + np.roll(ring, -1), last + ring]
    return SurfaceMesh(points, np.hstack((sides, up, low)))


WAVES = 2e-3 * (np.cos(2 * np.pi * np.arange(32) / 16) - 1)
# The tools touch zero from above; the second entry is how far they may turn.
IN_PLANE = {
    "Cylinder": (Cylinder((0, R), R), 7.0),
    "Plane": (Plane((0, 0), (0, -1)), 0.03),
    "Cone": (Cone((0, 0), (0, 1), 1.45), 0.02),
    "SurfaceMesh": (disk(), 7.0),
    "Rough": (Rough(WAVES, 2.0, normal=(0, -1)), 0.02),
    "SignedDistance": (SignedDistance(lambda x: np.hypot(x[0], x[1] - R) - R), 7.0),
    "half a distance": (SignedDistance(lambda x: 0.5 * (np.hypot(x[0], x[1] - R) - R)), 7.0),
    "ClosestPoint": (ClosestPoint(Cylinder((0, R), R)), 7.0),
    "Moved": (Moved(Cylinder((0.3, R), R), (-0.3, 0.0)), 7.0),
    "Parabola": (Parabola((0, 0), R), 0.0),
}
HEIGHTS = 2e-3 * (np.add.outer(*2 * (np.cos(2 * np.pi * np.arange(16) / 8),)) - 2)
IN_SPACE = {
    "Sphere": (Sphere((0, 0, BALL), BALL), 7.0),
    "Cylinder": (Cylinder((0, 0, BALL), BALL, (0, 1, 0)), 7.0),
    "Plane": (Plane((0, 0, 0), (0, 0, -1)), 0.03),
    "Cone": (Cone((0, 0, 0), (0, 0, 1), 1.45), 0.02),
    "SurfaceMesh": (meshed_ball(), 7.0),
    "Rough": (Rough(HEIGHTS, (2.0, 2.0), normal=(0, 0, -1)), 0.02),
    "ClosestPoint": (ClosestPoint(Moved(Sphere((0, 0, BALL), BALL), (0, 0, 0))), 7.0),
    "Parabola": (Parabola((0, 0, 0), BALL), 0.0),
}


def rows_of(rigid, pose, before, u, last, side):
    flat = side.points.x[:, 0], side.points.normals
    tool = Tool.of(rigid, pose, before, RigidMotion.at_rest(), flat)
    return ToolRows.of(side.points, side.rows, tool, u, last)


SHAPES = [(dim, name) for dim, tools in ((2, IN_PLANE), (3, IN_SPACE)) for name in tools]


@pytest.mark.parametrize(("dim", "name"), [tool for tool in SHAPES if tool[1] != "SurfaceMesh"])
def test_derivatives_of_rows(dim, name):
    """Of gap, slip, forces on body and tool, by displacement and pose: central differences."""
    rng, k = np.random.default_rng(3), dim * (dim + 1) // 2
    body = block(ElementQuad2 if dim == 2 else ElementHex1, 4)
    shape = (IN_PLANE if dim == 2 else IN_SPACE)[name][0]
    rigid = Rigid(shape, centre=(0.1,) * dim)
    side = ContactProblem(body, "top", rigid).boundaries.alone[0]
    rest = Pose.at_rest(dim)
    pose = rest.moved(1e-2 * rng.standard_normal(k))
    last = 1e-3 * rng.standard_normal(body.ndofs)
    u = last + 1e-3 * rng.standard_normal(body.ndofs)
    here = rows_of(rigid, pose, rest, u, last, side)
    m = here.rows.gap.size
    mu, t = rng.random(m), rng.standard_normal((m, dim - 1))
    d = here.derivative(mu, t)

    def values(found):
        on_body = found.rows.G.T @ mu + found.rows.T.T @ t.ravel()
        on_tool = found.normal.T @ mu + found.tangent.T @ t.ravel()
        return found.distance, found.slip.ravel(), on_body, on_tool

    smooth = name not in ("Rough", "half a distance", "Parabola")  # distances to first order
    tolerance = 2e-4 if "istance" in name or name in ("Cone", "Rough", "Parabola") else 1e-7
    h = 1e-5
    for of_u in (True, False):
        du = rng.standard_normal(body.ndofs) * of_u
        da = rng.standard_normal(k) * (not of_u)
        ends = [
            values(rows_of(rigid, pose.moved(s * h * da), rest, u + s * h * du, last, side))
            for s in (1, -1)
        ]
        slip = here.rows.T @ du + d.tangential @ du + d.swing @ (d.turning @ du)
        known = (
            here.normal @ da - here.rows.G @ du,
            slip + (d.slip - here.tangent) @ da,
            d.force @ du + d.push @ da,
            d.pull @ du + d.lean @ da,
        )
        for i, (ahead, behind, expected) in enumerate(zip(*ends, known, strict=True)):
            size = np.abs(expected).max() + np.abs(mu).max() * np.abs(du).max() * 1e-3
            if smooth or i:
                assert np.abs((ahead - behind) / (2 * h) - expected).max() <= tolerance * size, i


def moved(name, shape, c, a):
    """The tool after a displacement and a turn about its axle."""
    dim = len(c)
    if name == "Parabola":
        return Parabola((*c[:-1], 0.0), shape.radius, offset=c[-1])
    centre = np.zeros(dim)
    if name not in ("Plane", "Cone", "Rough"):
        centre[-1] = R if dim == 2 else BALL
    return Rigid(shape, tuple(c), rotation=a if dim == 2 else (0.0, a, 0.0), centre=tuple(centre))


def random_motion(seed):
    """One long step and sixteen short ones, from one place to another, turning."""
    rng = np.random.default_rng(seed)
    dim = 3 if seed % 4 == 3 else 2
    name, (shape, reach) = list((IN_PLANE if dim == 2 else IN_SPACE).items())[
        seed // 4 % (len(IN_PLANE) if dim == 2 else len(IN_SPACE))
    ]
    element = rng.choice(PLANE) if dim == 2 else rng.choice([ElementHex1, ElementTetP1])
    law = list(LAWS)[rng.integers(3)]
    E, size = 10.0 ** rng.uniform(-2, 6), 1.0
    deep, start, end = rng.uniform(0.012, 0.03), rng.uniform(-0.5, -0.1), rng.uniform(0.1, 0.5)
    start, end = (start, end) if rng.random() < 0.5 else (end, start)
    angle = rng.uniform(-reach, reach)
    given = dict(LAWS[law])
    if law == "tresca":
        given["friction"] *= E
    body = block(element, int(rng.integers(20, 28)) if dim == 2 else 8, E=E, size=size)
    rigid_side = rng.random() < 0.3

    def tool(t):
        c = np.zeros(dim)
        c[0], c[-1] = start + (end - start) * max(t - 1, 0), -deep * min(t, 1)
        return moved(name, shape, c, angle * max(t - 1, 0))

    def history(times):
        first = tool(0.0) if name == "Parabola" else shape
        problem = ContactProblem(body, "top", first, **given)
        if rigid_side:  # given as a pair
            pair = Pair(body, "top", first, friction=given.get("friction", 0.0))
            problem = ContactProblem([body], [pair], law=given.get("law", "coulomb"))
        stepper = LoadStepper(problem, sliding="finite")
        stepper.obstacle(tool, **({"pair": 0} if rigid_side else {}))
        return stepper.run(times)

    far = history([1.0, 2.0])
    near = history([0.5, 1.0, *(1 + np.arange(1, 17) / 16)])
    return name, dim, law, far, near


def check_motion_of(seed):
    """Certify a far motion; returns whether it must equal, or be near to, many short steps."""
    name, dim, law, far, near = random_motion(seed)
    results = [*far.results, *near.results]
    assert max(max(r.kkt.values()) for r in results) <= 1e-10
    one, other = far.results[-1], near.results[-1]
    assert one.mu.max() > 0
    for result in results:  # the true distance of the places, without the rows' linearisation
        loaded = result.mu > 1e-6 * result.mu.max()
        size = result.system.body.largest_displacement(result.u)
        assert np.abs(result.gap[loaded]).max(initial=0.0) <= 1e-9 * size
    off = np.abs(one.u - other.u).max() / np.abs(one.u).max()
    same = all((r.status != Status.STICK).all() for r in (one, other))
    same = same and np.array_equal(np.sign(one.t), np.sign(other.t))
    on = [r.system.rows.normals[:, r.mu == r.mu.max()].mean(axis=1) for r in (one, other)]
    if name == "Cone" and np.abs(on[0] - on[1]).max() > 0.05:  # two equilibria at its tip
        assert abs(one.contact_force / other.contact_force - 1) <= 0.1
        return "other flank"
    if law == "none" or (dim == 2 and same):
        # A point near an edge of a mesh may rest on either facet.
        assert off <= (3e-2 if name == "SurfaceMesh" else 1e-8), off
        return "equal"
    # Where points stick, and in space, friction depends on the path.
    assert abs(one.contact_force / other.contact_force - 1) <= 0.1
    return "near"


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.sampled(4)
def test_a_long_step_is_many_short_ones(seed):
    check_motion_of(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 300))
def test_many_long_steps_are_many_short_ones(seed):
    check_motion_of(seed)


def rolled(force, times, element=ElementQuad1, n=24, moment=0.0, friction=F, unit=1.0):
    """Pressed by a depth, or a force, then moved along, free to turn."""
    body = block(element, n, size=unit, E=3.0)
    wheel = Cylinder((0.0, unit * R), unit * R)

    def tool(t):
        along, down = unit * max(t - 1, 0.0), min(t, 1.0)
        if force is None:
            given = {"displacement": (along - 0.4 * unit, -0.02 * unit * down)}
        else:
            given = {"displacement": (along - 0.4 * unit, None), "force": (None, force * down)}
        return Rigid(wheel, **given, moment=moment, centre=(0.0, unit * R))

    return run(ContactProblem(body, "top", wheel, friction=friction), tool, times), tool


@pytest.mark.parametrize("force", [None, -0.03])
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini])
def test_a_wheel_that_rolls_freely_rubs_without_force(force, element):
    history, _ = rolled(force, [1.0, 1.2, 1.5, 1.9], element)
    for result in history:
        normal = np.abs(result.mu).sum()
        assert abs(result.t.sum()) <= 1e-10 * normal  # along the wheel: no force to roll it
        assert np.abs(result.t).max() > 1e-4 * normal  # but stuck points are sheared
        assert result.kkt["obstacle"] <= 1e-10
        if force is not None:
            assert abs(result.resultant[1] - force * min(1, result.resultant[1] / force)) <= 1e-12
    turned = np.diff([result.motion[2] for result in history])
    # One turn for one circumference; the soft block lets it creep by a strain.
    assert np.allclose(-turned * R, [0.2, 0.3, 0.4], rtol=5e-2)


def test_units():
    """Lengths in another unit: the same turn, displacements and forces in that unit."""
    metres, _ = rolled(None, [1.0, 1.6])
    other, _ = rolled(None, [1.0, 1.6], unit=1e-3)
    for one, two in zip(metres, other, strict=True):
        assert np.abs(1e-3 * one.u - two.u).max() <= 1e-9 * np.abs(two.u).max()
        assert abs(one.motion[2] - two.motion[2]) <= 1e-9
        assert np.abs(one.pressure - two.pressure).max() <= 1e-9 * one.pressure.max()


@pytest.mark.parametrize("moment", [0.0, 2e-3])
def test_driven_by_forces_as_by_the_motions_they_cause(moment):
    times = [0.5, 1.0, 1.3, 1.8]
    driven, _ = rolled(-0.03, times, moment=moment)
    w = np.vstack((np.zeros(3), [result.motion for result in driven]))

    def tool(t):
        c = [float(np.interp(t, [0.0, *times], w[:, i])) for i in range(3)]
        return Rigid(ROLLER, c[:2], rotation=c[2], centre=AXLE)

    led = run(ContactProblem(block(n=24, E=3.0), "top", ROLLER, friction=F), tool, times)
    for one, other in zip(driven, led, strict=True):
        assert np.abs(one.u - other.u).max() <= 1e-10 * np.abs(one.u).max()
        assert abs(other.resultant[1] + 0.03 * min(1, one.resultant[1] / -0.03)) <= 1e-10
        assert abs(abs(R * other.t.sum()) - moment) <= 1e-10  # normals meet the axle


def pressed(mesh, tool, sliding="finite", depth=0.06, element=None, plane=None):
    """A block under a tool; sides at zero are planes of symmetry, or the axis."""
    low, dim = mesh.p.min(axis=1), mesh.dim()
    ends = {"low": lambda x: x[-1] < 1e-9, "high": lambda x: x[-1] > 1 - 1e-9}
    sides = {"xy"[c]: (lambda x, c=c: x[c] < 1e-9) for c in range(dim - 1) if low[c] == 0}
    mesh = mesh.with_boundaries(ends | sides)
    body = ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3, plane=plane)
    body.fix("low", "xyz"[:dim])
    for name in sides:
        body.fix(name, name)
    stepper = LoadStepper(ContactProblem(body, "high", tool, friction=F), sliding=sliding)
    stepper.obstacle(lambda t: Moved(tool, (*[0.0] * (dim - 1), -depth * t)))
    return stepper.run([0.5, 1.0])[-1]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_part_of_a_symmetric_model_has_the_forces_of_the_whole(dim):
    """Its contact boundary leans as a whole, and yet slips by no turn."""
    mesh, n = (MeshQuad, 8) if dim == 2 else (MeshHex, 4)
    up, tool = np.linspace(0, 1, 4), (Cylinder((0, 1.8), 0.8), Sphere((0, 0, 2.5), 1.5))[dim - 2]
    part, whole = (
        pressed(mesh.init_tensor(*[np.linspace(low, 1, count + 1)] * (dim - 1), up), tool)
        for low, count in ((0, n), (-1, 2 * n))
    )
    tree = {tuple(x): k for k, x in enumerate(whole.x_nominal.T.round(9))}
    at = [tree[tuple(x)] for x in part.x_nominal.T.round(9)]
    one, two = (np.linalg.norm(r.shear, axis=-1).ravel() for r in (part, whole))
    assert np.abs(part.pressure - whole.pressure[at]).max() <= 1e-9 * whole.pressure.max()
    assert np.abs(one - two[at]).max() <= 1e-9 * two.max() > 0


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_a_ring_that_touches_its_axis(element):
    """In small steps pressed as in small sliding, in large ones without shear on the axis."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 5))
    ring = (mesh, Sphere((0, 4.0), 3.0)), {"element": element(), "plane": "axisymmetric"}
    near, small = (pressed(*ring[0], s, 1e-4, **ring[1]) for s in ("finite", "small"))
    assert np.abs(near.mu - small.mu).max() <= 1e-2 * small.mu.max()
    far = pressed(*ring[0], **ring[1])
    assert far.t[0, 0] == 0.0
    assert np.count_nonzero(far.t) > 2


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_tool_that_spins(dim, friction):
    """Several turns in one step: nothing without friction, the whole friction force with it."""
    shape = ROLLER if dim == 2 else Sphere((0, 0, BALL), BALL)
    radius = R if dim == 2 else BALL
    body = block(ElementQuad1 if dim == 2 else ElementHex1, 20 if dim == 2 else 8)
    centre = (0.0,) * (dim - 1) + (radius,)

    def tool(t, way=1.0):
        down = (0.05,) + (0.0,) * (dim - 2) + (-0.04 * min(t, 1),)
        angle = way * 2 * np.pi * max(t - 1.0, 0.0)
        return Rigid(shape, down, rotation=angle if dim == 2 else (0, angle, 0), centre=centre)

    pressed, once, more = run(
        ContactProblem(body, "top", shape, friction=friction), tool, [1.0, 2.0, 5.0]
    )
    if not friction:
        assert max(np.abs(r.u - pressed.u).max() for r in (once, more)) <= 1e-12
        return
    for result in (once, more):
        size = np.linalg.norm(result.t, axis=1)
        assert np.allclose(size, friction * result.mu, atol=1e-10 * result.mu.max())
        along = result.resultant[0] / np.abs(result.resultant[-1])
        assert 0.85 * friction < abs(along) < 1.15 * friction
    back = run(
        ContactProblem(body, "top", shape, friction=friction),
        lambda t: tool(t, -1.0),
        [1.0, 2.0],
    )
    assert np.sign(back.results[-1].resultant[0]) == -np.sign(once.resultant[0])


def test_far_away_and_back_without_friction():
    tool = lambda t: Moved(ROLLER, (min(t, 2 - t) - 0.5, -0.03), rotation=3 * t, centre=AXLE)  # noqa: E731
    there, far, back = run(ContactProblem(block(), "top", ROLLER), tool, [0.1, 1.0, 1.9])
    assert np.abs(there.u - back.u).max() <= 1e-12 * np.abs(there.u).max()
    assert np.abs(there.u - far.u).max() > 0.1 * np.abs(there.u).max()


@pytest.mark.parametrize("element", [ElementQuad1, ElementTriP2, ElementQuadAdini])
def test_a_far_tool_presses_as_one_at_home(element):
    """By many contact widths: as the tool at rest on the mesh moved back, in small sliding."""
    way = 0.3
    far = run(
        ContactProblem(block(element, 40), "top", ROLLER),
        lambda t: Moved(ROLLER, (way * max(t - 1, 0), -0.02)),
        [1.0, 2.0],
    ).results[-1]
    near = run(
        ContactProblem(block(element, 40, shift=-way), "top", ROLLER),
        lambda t: Moved(ROLLER, (0.0, -0.02)),
        [1.0],
    ).results[-1]
    assert np.abs(far.pressure - near.pressure).max() <= 1e-10 * near.pressure.max()
    small = ContactProblem(
        block(element, 40, shift=-way), "top", ClosestPoint(Moved(ROLLER, (0.0, -0.02)))
    ).solve()
    # Linearised at rest: second order in the indentation.
    assert np.abs(small.pressure - near.pressure).max() <= 0.1 * near.pressure.max()
    assert abs(small.contact_force / near.contact_force - 1) <= 0.03


@pytest.mark.parametrize("angle", [0.0, 0.06])
@pytest.mark.parametrize("dim", [2, 3])
def test_tool_and_body_moved_together(dim, angle):
    """As one rigid body by any distance, and a turn: stuck points do not slip."""
    body = block(ElementQuad1 if dim == 2 else ElementHex1, 12 if dim == 2 else 6)
    radius = R if dim == 2 else BALL
    shape = ROLLER if dim == 2 else Sphere((0, 0, BALL), BALL)
    far = np.r_[3.0, -2.0, 1.5][:dim]
    spin = np.r_[angle] if dim == 2 else angle * np.r_[0.6, 0.0, 0.8]
    R_all = matrix_of(spin)
    centre = (0.0,) * (dim - 1) + (radius,)
    problem = ContactProblem(body, "top", shape, friction=0.5)
    side = problem.boundaries.alone[0]
    press = Pose(np.r_[np.zeros(dim - 1), -0.02, 0.0 * spin], np.eye(dim))
    here = np.zeros((dim, body.mesh.p.shape[1])) + 0.01 * np.sin(7 * body.mesh.p)
    at = body.mesh.p + here
    after = R_all @ at + far[:, None] - body.mesh.p
    values = [np.zeros(body.ndofs), np.zeros(body.ndofs)]
    for u, v in zip(values, (here, after), strict=True):
        for c in range(dim):
            u[dim * body.scalar_dofs.nodal_dofs[0] + c] = v[c]
    place = np.asarray(centre) + press.motion[:dim]
    moved_pose = Pose(np.r_[R_all @ place + far - centre, spin], R_all)
    rigid = Rigid(shape, centre=centre)
    found = rows_of(rigid, moved_pose, press, values[1], values[0], side)
    assert np.abs(found.slip).max() <= 2e-15 * (1 + np.abs(far).sum())
    before = rows_of(rigid, press, press, values[0], values[0], side)
    assert np.abs(found.distance - before.distance).max() <= 1e-14
    if angle == 0.0:  # a linear body does not feel a shift at all
        stepper = LoadStepper(problem, sliding="finite")
        for c, name in enumerate("xyz"[:dim]):
            stepper.move("bottom", name, far[c], lambda t: max(t - 1, 0.0))

        def tool(t):
            c = far * max(t - 1, 0.0)
            c[-1] -= 0.02 * min(t, 1)
            return Moved(shape, tuple(c))

        one, other = stepper.obstacle(tool).run([1.0, 2.0])
        assert np.abs(one.pressure - other.pressure).max() <= 1e-9 * one.pressure.max()
        assert np.abs(one.t - other.t).max() <= 1e-9 * np.abs(one.mu).max()


def test_ironing_in_space_with_a_meshed_tool():
    body = block(ElementHex1, 10)
    tool = lambda t: Rigid(  # noqa: E731
        meshed,
        (0.5 * max(t - 1, 0) - 0.25, 0.1 * max(t - 1, 0), -0.04 * min(t, 1)),
        rotation=(0, 0, 2 * max(t - 1, 0)),
        centre=(0, 0, BALL),
    )
    meshed, smooth = meshed_ball(), Sphere((0, 0, BALL), BALL)
    history = run(ContactProblem(body, "top", meshed, friction=F), tool, [0.5, 1.0, 1.4, 1.8, 2.0])
    for result in history.results[2:]:
        x = result.resultant
        rub = np.hypot(*(x[:2]))
        assert 0.7 * F < -rub / x[2] < 1.3 * F
        assert x[0] > 0
        assert result.kkt["slip"] <= 1e-10
    # Beside the sphere that the triangles approximate.
    meshed_force = history.results[-1].contact_force
    meshed = smooth
    ball = run(ContactProblem(body, "top", smooth, friction=F), tool, [0.5, 1.0, 1.4, 1.8, 2.0])
    assert abs(meshed_force / ball.results[-1].contact_force - 1) < 0.2


def test_a_roller_over_an_edge():
    """It passes the end of the block, sinks beside it and touches nothing any more."""
    names = ["top", "right"]
    body = block(n=24).named("block")
    mesh = body.mesh.with_boundaries({"right": lambda x: x[0] == 1.0})
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("bottom")
    tool = lambda t: Moved(ROLLER, (t, -0.03))  # noqa: E731
    history = run(ContactProblem(body, names, ROLLER, friction=F), tool, np.arange(0.2, 2.2, 0.2))
    force = np.array([result.contact_force for result in history])
    assert np.all(np.diff(force[3:]) <= 0)
    assert force[0] > 0
    assert force[-1] == 0.0
    for result in history:
        assert (result.gap > -1e-10).all()


def test_a_tool_that_leaves_the_contact_boundary():
    mesh = block(n=24).mesh.with_boundaries({"left": lambda x: (x[1] == 0) & (x[0] < 0.05)})
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("bottom")
    tool = lambda t: Moved(ROLLER, (t - 0.5, -0.03))  # noqa: E731
    stepper = LoadStepper(ContactProblem(body, "left", ROLLER), sliding="finite").obstacle(tool)
    stepper.run([0.1, 0.3])
    with pytest.raises(InputError, match=r"left the contact boundary .* as far as the tool moves"):
        stepper.run([1.1])
    lost = LoadStepper(ContactProblem(block(), "top", ROLLER), sliding="finite")
    lost.obstacle(lambda t: Rigid(ROLLER, (4.0 * t, None), force=(None, -0.01), centre=AXLE))
    with pytest.raises(Unbounded, match="the obstacle is not held"):
        lost.run([0.1, 1.0])


def test_steps_beyond_the_closest_point():
    deep = LoadStepper(ContactProblem(block(), "top", ROLLER), sliding="finite", halvings=0)
    deep.obstacle(lambda t: Moved(ROLLER, (0.0, -R * (t > 1))))
    deep.run([1.0])
    with pytest.raises(NotConverged, match=r"no unique closest point|take smaller steps"):
        deep.run([2.0])
    turned = LoadStepper(
        ContactProblem(block(), "top", Plane((0, 0), (0, -1)), friction=F), sliding="finite"
    )
    turned.obstacle(lambda t: Plane((0, -0.01), (0, -1)) if t < 2 else Cylinder((0, R), R))
    turned.run([1.0])
    with pytest.raises(InputError, match=r"motion: .*Rigid"):
        turned.run([2.0])


def test_a_tool_among_sliding_bodies():
    """A block on a block, and a roller on the upper one: each slides, on one factorisation."""
    low, up = block(n=24), block(n=12)
    half = up.mesh.scaled((0.5, 0.5)).translated((0.0, 0.25))
    up = ElasticBody.from_mesh(half, ElementQuad1(), E=1.0, nu=0.3)
    pairs = [
        Pair(up, "bottom", low, "top", friction=0.1),
        Pair(up, "top", Cylinder((0, 0.25 + R), R), friction=0.4),
    ]
    up_free = up.fix("bottom", "x")
    assert up_free is up
    stepper = LoadStepper(ContactProblem([low, up], pairs), sliding="finite")
    stepper.move("bottom", "x", 0.2, lambda t: max(t - 1, 0.0), body=up)
    shape = Cylinder((0, 0.25 + R), R)
    stepper.obstacle(
        lambda t: Rigid(shape, (0.4 * max(t - 1, 0), None), force=(None, -0.02)), pair=1
    )
    for result in stepper.run([1.0, 1.5, 2.0]):
        assert max(result.kkt.values()) <= 1e-10
        assert abs(result.resultants[1, 1] + 0.02) <= 1e-10
        assert abs(result.resultants[0, 1] - 0.02) <= 1e-10


def test_bodies_held_by_contact_alone_converge_quadratically():
    """A block between a larger one and a roller, free in all its motions."""
    low = block(n=24)
    ticks = np.linspace(-0.25, 0.25, 13), np.linspace(0, 0.25, 7)
    up = ElasticBody.from_mesh(MeshQuad.init_tensor(*ticks).with_defaults(), E=1.0, nu=0.3)
    shape = Cylinder((0, 0.25 + R), R)
    pairs = [Pair(up, "bottom", low, "top", friction=0.3), Pair(up, "top", shape, friction=0.4)]
    stepper = LoadStepper(ContactProblem([low, up], pairs), sliding="finite")
    stepper.obstacle(lambda t: Rigid(shape, (0.2 * (t - 1), None), force=(None, -0.02)), pair=1)
    for result in stepper.run([1.0, 1.3, 1.6, 2.0]):
        changes = [line.residual for line in result.history if line.phase == "projection"]
        assert len(changes) <= 7
        steps = itertools.pairwise(changes[1:])
        assert all(after <= 20 * before**2 + 2e-3 * before for before, after in steps), changes
        assert max(result.kkt.values()) <= 1e-10


def test_stored_resumed_and_pickled(tmp_path):
    def stepper(way=0.5):
        body = block(ElementHex1, 6)
        ball = Sphere((0, 0, BALL), BALL)
        made = LoadStepper(ContactProblem(body, "top", ball, friction=F), sliding="finite")
        return made.obstacle(
            lambda t: Rigid(
                ball,
                (way * max(t - 1, 0) - 0.2, 0.0, None),
                force=(None, None, -0.02 * min(t, 1)),
                moment=(0.0, 0.0, 0.0),
                centre=(0, 0, BALL),
            )
        )

    times = [1.0, 1.3, 1.6, 2.0]
    whole = stepper().run(times, path=tmp_path / "run")
    (tmp_path / "run" / "step_00003.npz").unlink()
    (tmp_path / "run" / "step_00004.npz").unlink()
    again = stepper().resume(tmp_path / "run")
    assert len(LoadHistory.load(tmp_path / "run")) == 4
    for one, other in zip(whole, again, strict=True):
        assert np.abs(one.u - other.u).max() <= 1e-11 * np.abs(one.u).max()
        assert np.abs(one.motion - other.motion).max() <= 1e-10
    assert pickle.loads(pickle.dumps(again.results[-1])).kkt == again.results[-1].kkt
    with pytest.raises(InputError, match="another problem"):
        stepper(0.6).resume(tmp_path / "run")
    assert np.linalg.norm(whole.results[-1].motion[3:]) > 0.5  # it has rolled
