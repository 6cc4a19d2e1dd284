"""Bodies with inertia: closed forms, balances that hold for any dt, files, and bad input."""

import pickle

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)

from contact import (
    ContactProblem,
    DynamicHistory,
    DynamicStepper,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadHistory,
    Moved,
    NotConverged,
    Pair,
    Plane,
    Rigid,
    Sphere,
    Tie,
)
from contact.arrays.dense_arrays import HostArrays
from skfem_adini import ElementQuadAdini

SI, MILLIMETRES = (1.0, 1.0, 1.0), (1e3, 1e-6, 1e-12)  # units of length, E and density: m, Pa, kg
SPEED = 0.01


def strip(cells, x=0.0, high=None, units=SI, element=ElementQuad1, layers=1, **material):
    """A bar of length one on a line of cells, from x on."""
    high = 1.0 / cells if high is None else high
    axes = np.linspace(x, x + 1.0, cells + 1), np.linspace(0.0, high, layers + 1)
    mesh = MeshQuad.init_tensor(*(units[0] * a for a in axes)).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=units[1], nu=0.0, **material)


def mean_velocity(stepper, body=0):
    """Momentum of a body over its mass, by the mass of the steps."""
    M, own = stepper._of.M, stepper.problem.body.slices[body]
    dim = stepper.problem.body.dim
    found = []
    for c in range(dim):
        e = np.zeros(stepper._now.u.size)
        values = stepper.problem.body.bodies[body].are_values
        e[own] = values * (np.arange(values.size) % dim == c)
        found.append(e @ (M @ stepper._now.v) / (e @ (M @ e)))
    return np.array(found)


def closed(history, tol=1e-10):
    """Whether the ledger closes in each step, and nothing but work adds energy."""
    size = np.abs(history.table[:, :3]).sum(axis=1).max()
    grown = np.diff(history.total) - history.work[1:]
    losses = np.array([history.friction, history.damping, history.impact])
    return (
        np.abs(history.residual).max() <= tol * size
        and grown.max() <= tol * size
        and losses.min() >= -tol * size
        and np.allclose(grown, -losses.sum(axis=0)[1:], atol=tol * size)
    )


@pytest.mark.parametrize(
    ("courant", "cells", "mass", "rebound"),
    [(0.5, 100, "lumped", 0.015), (1.0, 100, "consistent", 0.015), (5.0, 300, "consistent", 0.03)],
)
def test_a_bar_leaves_the_wall_when_the_wave_comes_back(courant, cells, mass, rebound):
    """Contact lasts 2 L / c under the pressure rho c v; the speed is reversed."""
    problem = ContactProblem(strip(cells), "left", 0.0)
    dt = courant / cells
    stepper = DynamicStepper(problem, 1.0, dt, velocity=(-SPEED, 0.0), mass=mass, keep=9**9)
    history = stepper.run(int(2.3 / dt))
    middle, pressure = history.times[1:] - 0.5 * dt, history.force[1:, 0] * cells / SPEED
    assert closed(history)
    assert middle[pressure > 0.5][-1] == pytest.approx(2.0, abs=0.015 + dt)
    inside = (middle > 0.2) & (middle < 1.8)
    assert np.sqrt(np.mean((pressure[inside] - 1.0) ** 2)) < 0.01
    assert mean_velocity(stepper)[0] == pytest.approx(SPEED, rel=rebound)


@pytest.mark.parametrize("scheme", ["midpoint", "stabilised"])
@pytest.mark.parametrize("units", [SI, MILLIMETRES], ids=["SI", "mm"])
def test_equal_bars_exchange_their_velocities(scheme, units):
    n, length = 50, units[0]
    speed = SPEED * np.sqrt(units[1] / units[2])
    first, second = strip(n, units=units).named("a"), strip(n, 1.0, units=units).named("b")
    problem = ContactProblem([first, second], [Pair(first, "right", second.surface("left"))])
    dt = 0.5 / n * SPEED * length / speed
    start = [(speed, 0.0), None]
    stepper = DynamicStepper(problem, units[2], dt, velocity=start, scheme=scheme, keep=9**9)
    history = stepper.run(5 * n)
    assert closed(history)
    assert mean_velocity(stepper, 0)[0] == pytest.approx(0.0, abs=0.015 * speed)
    assert mean_velocity(stepper, 1)[0] == pytest.approx(speed, rel=0.015)


def test_a_wall_that_comes_pushes_with_twice_its_speed():
    """By Galilei: in the frame of the wall the bar is reversed. The work is the energy."""
    n = 80
    stepper = DynamicStepper(ContactProblem(strip(n), "left", 0.0), 1.0, 1.0 / n, keep=9**9)
    stepper.obstacle(lambda t: Rigid(0.0, displacement=(SPEED * t, 0.0)))
    history = stepper.run(int(2.3 * n))
    assert closed(history)
    assert mean_velocity(stepper)[0] == pytest.approx(2 * SPEED, rel=0.015)
    assert history.work.sum() == pytest.approx(history.total[-1] + history.impact.sum(), rel=1e-9)
    moved = DynamicStepper(ContactProblem(strip(n), "left", Plane((0, 0), (1, 0))), 1.0, 1.0 / n)
    moved.obstacle(lambda t: Moved(Plane((0, 0), (1, 0)), (SPEED * t, 0.0)))
    assert np.allclose(moved.run(60).force, history.force[:61], atol=1e-8 * history.force.max())


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_a_block_slides_to_rest_where_friction_says(dt):
    """The way is v^2 / (2 F g)."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 21), np.linspace(0, 0.3, 7)).with_defaults()

    def block():
        return ElasticBody.from_mesh(mesh, ElementQuad1(), E=100.0, nu=0.3).body_force((0, -1.0))

    held = block().constrain(np.eye(1, mesh.nvertices * 2))
    rest = ContactProblem(held, "bottom", 0.0).solve()
    problem = ContactProblem(block(), "bottom", 0.0, friction=0.3)
    stepper = DynamicStepper(problem, 1.0, dt, velocity=(0.5, 0.0), displacement=rest, keep=9**9)
    history = stepper.run(int(2.2 / dt))
    M, e = stepper._of.M, np.arange(rest.u.size) % 2 == 0.0
    way = e @ (M @ (stepper._now.u - rest.u)) / (e @ (M @ e))
    assert closed(history)
    assert way == pytest.approx(0.5**2 / (2 * 0.3), rel=0.005)


FAMILIES = {
    ElementTriP1: MeshTri,
    ElementTriP2: MeshTri,
    ElementQuad1: MeshQuad,
    ElementQuad2: MeshQuad,
    ElementQuadAdini: MeshQuad,
    ElementTetP1: MeshTet,
    ElementHex1: MeshHex,
    ElementHex2: MeshHex,
}


def bottom_of(mesh):
    return mesh.facets_satisfying(lambda x: np.isclose(x[-1], mesh.p[-1].min()))


@pytest.mark.parametrize("element", FAMILIES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("law", [None, "coulomb", "tresca"])
@pytest.mark.parametrize("scheme", ["midpoint", "stabilised"])
@pytest.mark.parametrize("several", [False, True], ids=["wall", "bodies"])
@pytest.mark.sampled(12)
def test_impulse_and_energy_balance_for_every_element(element, law, scheme, several):
    """Thrown askew: the momentum changes by weight and contact alone, the ledger closes."""
    mesh = FAMILIES[element]().refined(2)
    dim = mesh.dim()
    weight, speed = np.eye(dim)[-1] * -0.002, np.eye(dim)[0] * 0.03 - np.eye(dim)[-1] * 0.02
    upper = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3).body_force(weight)
    friction = {None: 0.0, "coulomb": 0.3, "tresca": 0.01}[law]
    if several:
        below = mesh.translated(-1.003 * np.eye(dim)[-1])
        lower = ElasticBody.from_mesh(below, element(), E=2.0, nu=0.2)
        top = below.facets_satisfying(lambda x: np.isclose(x[-1], -0.003))
        touch = Pair(upper, bottom_of(mesh), lower.surface(top), friction=friction)
        problem = ContactProblem([upper, lower], [touch], law=law)
        density, velocity = [1.0, 3.0], [speed, None]
    else:
        problem = ContactProblem(upper, bottom_of(mesh), 0.003, friction=friction, law=law)
        density, velocity = 1.0, speed
    dt, steps = 0.05, 12
    stepper = DynamicStepper(problem, density, dt, velocity=velocity, scheme=scheme)
    history = stepper.run(steps)
    force = np.array([step.result[upper].resultant for step in history])
    change = mean_velocity(stepper) - speed
    assert closed(history)
    assert np.abs(force).max() > 1e-3
    assert np.allclose(change, dt * (force.sum(axis=0) + steps * weight), atol=1e-10)
    if several:
        other = np.array([step.result[lower].resultant for step in history])
        assert np.allclose(force, -other, atol=1e-12)
        assert np.allclose(3 * mean_velocity(stepper, 1), dt * other.sum(axis=0), atol=1e-10)
    gap = [step.result.system.body.at_points(problem.rows.G, step.u) for step in history]
    assert np.max(np.array(gap) - problem.rows.gap) < 1e-10


def test_rings_and_blocks_in_space_hit_the_wall_as_the_strip_does():
    """Without Poisson's ratio a cylinder, a prism and a strip have the same pressure."""
    n, dt = 24, 1.0 / 24
    flat = DynamicStepper(ContactProblem(strip(n), "left", 0.0), 1.0, dt, velocity=(-SPEED, 0.0))
    force = flat.run(60).force[:, 0] * n
    axes = np.linspace(0.0, 0.1, 3), np.linspace(0.0, 1.0, n + 1)
    mesh = MeshQuad.init_tensor(*axes).with_defaults()
    ring = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.0, plane="axisymmetric")
    ring = DynamicStepper(ContactProblem(ring, "bottom", 0.0), 1.0, dt, velocity=(0.0, -SPEED))
    found = ring.run(60).force[:, 1] / (np.pi * 0.1**2)
    assert np.allclose(found, force, atol=1e-9 * force.max())
    mesh = MeshHex.init_tensor(axes[0], axes[0], axes[1])
    bar = ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.0)
    bar = ContactProblem(bar, bottom_of(mesh), 0.0)
    found = DynamicStepper(bar, 1.0, dt, velocity=(0.0, 0.0, -SPEED)).run(60).force[:, 2] / 0.01
    assert np.allclose(found, force, atol=1e-9 * force.max())


def half_ball(fine):
    """Half of a disc of radius one, P2 in shape, with cells of a quarter of the distance to the
    pole (0, -1), but not below `fine`."""
    mesh = MeshTri(np.array([[0, 0, 1, 0], [0, -1, 0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3]]).T)

    def round_off(mesh):
        p, rim = mesh.p.copy(), np.unique(mesh.facets[:, mesh.boundary_facets()])
        rim = rim[p[0, rim] > 1e-12]
        p[:, rim] /= np.linalg.norm(p[:, rim], axis=0)
        return MeshTri(p, mesh.t)

    mesh = round_off(round_off(mesh.refined()).refined())
    while True:
        far = np.linalg.norm(mesh.p[:, mesh.t].mean(axis=1) - [[0.0], [-1.0]], axis=0)
        large = np.sqrt(2 * np.abs(mesh.mapping().detA)) > np.maximum(fine, 0.25 * far)
        if not large.any():
            break
        mesh = round_off(mesh.refined(np.flatnonzero(large)))
    from skfem import MeshTri2

    place, rim = MeshTri2.from_mesh(mesh).doflocs.copy(), mesh.boundary_facets()
    rim = rim[mesh.p[0, mesh.facets[:, rim]].max(axis=0) > 1e-9] + mesh.nvertices
    place[:, rim] /= np.linalg.norm(place[:, rim], axis=0)
    return MeshTri2(place, MeshTri2.from_mesh(mesh).t)


STIFF, BALL = 4 / 3 / (1 - 0.3**2), 4 * np.pi / 3  # force over depth^1.5, and mass


def ball_over_plane(reach, off):
    mesh = half_ball(reach / 16)
    rim = mesh.facets_satisfying(
        lambda x: (np.hypot(*x) > 0.99) & (x[0] > 1e-9) & (np.hypot(x[0], x[1] + 1) < 2.5 * reach),
        boundaries_only=True,
    )
    body = ElasticBody.from_mesh(mesh, ElementTriP2(), E=1.0, nu=0.3, plane="axisymmetric")
    return ContactProblem(body, rim, Plane((0.0, -1.0 - off), (0.0, 1.0)))


def hertz_speed(reach):
    """Of the impact with a / R = reach, and its duration and peak force."""
    v = np.sqrt(reach**5 * 4 * STIFF / (5 * BALL))
    return v, 2.943 * reach**2 / v, STIFF * reach**3


def hertz_impact(reach):
    """Duration and peak force of the impact of a ball, over those of Hertz, for a / R = reach."""
    (v, lasts, peak), off, steps = hertz_speed(reach), 4e-4 * reach**2, 100
    problem = ball_over_plane(reach, off)
    stepper = DynamicStepper(problem, 1.0, lasts / steps, velocity=(0.0, -v), keep=9**9)
    history = stepper.run(int(1.1 * steps))
    assert closed(history)
    force, middle = history.force[1:, 1], history.times[1:] - 0.5 * history.dt
    a, b = np.flatnonzero(force > 0)[-2:]
    f = force[[a, b]] ** (2 / 3)  # linear in time where contact ends
    end = middle[a] + f[0] * (middle[b] - middle[a]) / (f[0] - f[1]) - off / v
    return end / lasts, force.max() / peak


def test_impact_of_a_ball_is_that_of_a_mass_on_its_static_compliance():
    """At a / R = .05 the ball is no half space: its own weight tells how stiff it is."""
    reach = 0.05
    v, lasts, peak = hertz_speed(reach)
    problem = ball_over_plane(reach, 0.0)
    weight = problem.body.body_force((0.0, -1.0)).f.copy()
    size, lost = [], []
    for part in (0.1, 0.25, 0.5, 0.75, 1.0, 1.15):
        problem.body.f = weight * (part * peak / BALL)
        size.append((part * peak / STIFF) ** (1 / 3))
        lost.append(1.0 - weight @ problem.solve().u / BALL / size[-1] ** 2)
    c = (np.array(size) @ lost) / (np.array(size) @ size)
    s = np.linspace(0.0, 1.3 * reach, 2000)
    way, force = s**2 * (1.0 - c * s), STIFF * s**3

    def moves(t, y):
        return y[1], -np.interp(y[0], way, force) / BALL

    def leaves(t, y):
        return y[0] + 1e-12 * (t < 0.1 * lasts)

    leaves.terminal, leaves.direction = True, -1
    path = scipy.integrate.solve_ivp(
        moves,
        (0.0, 2 * lasts),
        (0.0, v),
        events=leaves,
        max_step=lasts / 400,
        rtol=1e-8,
        atol=1e-12,
    )
    expected = path.t_events[0][0] / lasts, np.interp(path.y[0].max(), way, force) / peak
    assert abs(expected[1] - 1.0) > 0.012  # not Hertz'
    assert np.allclose(hertz_impact(reach), expected, atol=0.004)


def test_impact_of_a_ball_is_that_of_hertz():
    """The difference is that of a ball from a half space, of first order in a / R."""
    found = np.array([hertz_impact(reach) for reach in (0.05, 0.025, 0.0125)])
    assert np.allclose(found[1:], 1.0, atol=0.016)
    assert np.allclose(found[2], 1.0, atol=0.01)
    order = np.log2((1.0 - found[:-1, 0]) / (1.0 - found[1:, 0]))
    assert np.all((order > 0.7) & (order < 1.3))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_steps_in_the_zones_of_the_last_one_use_its_factors(friction, monkeypatch):
    """They are those that each step would compute anew, bit for bit."""
    made = []
    whole = HostArrays.factored

    def counted(arrays, A, overwrite=True):
        made.append(A.shape)
        return whole(arrays, A, overwrite)

    monkeypatch.setattr(HostArrays, "factored", counted)
    tables, counts = [], []
    for kept in (True, False):
        body = strip(8, high=0.5, layers=4).body_force((0.0, -0.01)).fix("left", "x")
        problem = ContactProblem(body, "bottom", 0.0, friction=friction)
        still = problem.solve()
        stepper = DynamicStepper(problem, 1.0, 0.05, displacement=still)
        stepper.load("right", (-0.001, 0.0), np.sin)
        if not kept:
            stepper._of.condensed._systems = None
        made.clear()
        tables.append(stepper.run(30).table)
        counts.append(len(made))
    assert np.array_equal(*tables)
    assert counts[0] <= 6 < 25 <= counts[1]


def test_free_vibration_is_of_second_order_in_dt():
    """Against a mode of the dense eigenvalue problem, released at rest."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 7), np.linspace(0, 0.4, 4)).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left", "xy")
    problem = ContactProblem(body, "top", 1.0)
    P, whole = body.constraint[0].toarray(), stepper_of_full_mass(body, 1.0, "consistent")
    M = P.T @ np.column_stack([whole @ column for column in P.T])
    omega2, modes = scipy.linalg.eigh(P.T @ body.stiffness.toarray() @ P, M)
    start, omega = 0.01 * P @ modes[:, 2], np.sqrt(omega2[2])
    errors = []
    for dt in (0.2, 0.1, 0.05):
        stepper = DynamicStepper(problem, 1.0, dt, displacement=start, scheme="stabilised")
        exact = start * np.cos(2.0 * omega)
        errors.append(np.abs(stepper.run(round(2.0 / dt))[-1].u - exact).max())
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((order > 1.7) & (order < 2.3))


def test_damping_of_mass_slows_and_that_of_stiffness_stops_vibration():
    a, dt = 0.4, 0.02
    problem = ContactProblem(strip(10, layers=2, high=0.2), "left", 1.0)
    slow = DynamicStepper(problem, 1.0, dt, velocity=(SPEED, 0.0), damping=(a, 0.0))
    history = slow.run(100)
    assert closed(history)
    # The midpoint rule for v' = -a v.
    exact = SPEED * ((1 - a * dt / 2) / (1 + a * dt / 2)) ** 100
    assert mean_velocity(slow)[0] == pytest.approx(exact, rel=1e-10)
    ringing = DynamicStepper(
        problem, 1.0, dt, velocity=lambda x: np.array([x[0] - 0.5, 0 * x[0]]), damping=(0.0, 0.2)
    )
    history = ringing.run(300)
    assert closed(history)
    assert history.damping.sum() == pytest.approx(history.total[0], rel=1e-3)


def test_mass_keeps_the_moments_of_a_rigid_body():
    """Total mass, centre and inertia are exact, although contact nodes have no mass."""
    rho = 2.0
    for element, form in ((ElementTriP2, "consistent"), (ElementTriP1, "lumped")):
        mesh = MeshTri().refined(3).with_defaults()
        body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
        stepper = DynamicStepper(ContactProblem(body, "bottom", 0.0), rho, 0.1, mass=form)
        M, x = stepper._of.M, body.basis.doflocs
        touched = np.isclose(x[1], 0.0)
        assert np.array_equal(stepper._of.M.massless, touched)
        exact = stepper_of_full_mass(body, rho, form)
        fields = [np.ones(body.ndofs), x[0], x[1]]
        for c in range(2):
            along = [f * (np.arange(body.ndofs) % 2 == c) for f in fields]
            for one in along:
                for other in along:
                    assert one @ (M @ other) == pytest.approx(one @ (exact @ other), rel=1e-10)


def stepper_of_full_mass(body, rho, form):
    problem = ContactProblem(body, "bottom", 0.0)
    return DynamicStepper(problem, rho, 0.1, mass=form, scheme="stabilised")._of.M


def test_supports_loads_and_ties_do_work_that_the_ledger_counts():
    """A tied pair that is shaken, and pressed by a load that varies."""
    lower = strip(8, 0.0, 0.4, layers=3).fix("left", "xy").named("lower")
    upper = strip(8, 1.0, 0.4, layers=4).named("upper")
    wall = Pair(upper, "right", Plane((2.02, 0.0), (-1.0, 0.0)), friction=0.2)
    problem = ContactProblem([lower, upper], [Tie(lower, "right", upper.surface("left")), wall])
    stepper = DynamicStepper(problem, [1.0, 2.0], 0.05, damping=(0.01, 0.01))
    stepper.move("left", "x", 0.05, lambda t: np.sin(t) ** 2, body=lower)
    stepper.load("top", (0.0, -0.01), np.sin, body=upper)
    history = stepper.run(80)
    assert closed(history)
    assert history.force[:, 0].min() < -1e-3
    assert np.abs(history.work).max() > 1e-5
    assert max(step.result.kkt["tie"] for step in history) < 1e-10


def test_a_ball_driven_by_a_force_rests_on_the_body():
    """A massless obstacle under a force: what it does is work."""
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 17), np.linspace(-1, 0, 9)).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("bottom", "xy")
    tool = Rigid(Sphere((0.0, 1.0), 1.0), force=(None, -0.01))
    stepper = DynamicStepper(ContactProblem(body, "top", tool), 1.0, 0.1, damping=(0.0, 0.3))
    history = stepper.run(200)
    assert closed(history)
    assert np.allclose(history.force[1:, 1], -0.01, rtol=1e-9)
    still = ContactProblem(body, "top", tool).solve()
    assert np.allclose(history[-1].u, still.u, atol=2e-4 * np.abs(still.u).max())


def shaken(path=None, **changed):
    """A block that is thrown on a floor that moves, for files."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 7), np.linspace(0, 0.5, 4)).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).body_force((0.0, -0.003))
    options = {"density": 1.0, "dt": 0.1, "velocity": (0.02, -0.02), "keep": 3} | changed
    factor = options.pop("factor", np.sin)
    stepper = DynamicStepper(
        ContactProblem(body, "bottom", Plane((0, -0.001), (0, 1)), 0.3), **options
    )
    stepper.load("top", (0.0, -0.01), factor)
    floor = Plane((0, -0.001), (0, 1))
    return stepper.obstacle(lambda t: Moved(floor, (0.01 * t, 0.002 * np.sin(t))))


@pytest.mark.parametrize("scheme", ["midpoint", "stabilised"])
def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path, scheme):
    class Interrupted(Exception):
        pass

    def stop(step):
        if step.number == 7:
            raise Interrupted

    whole = shaken(scheme=scheme).run(14)
    with pytest.raises(Interrupted):
        shaken(scheme=scheme).run(14, path=tmp_path / "run", callback=stop)
    assert len(DynamicHistory.load(tmp_path / "run").times) == 7
    resumed = shaken(scheme=scheme).resume(tmp_path / "run")
    loaded = DynamicHistory.load(tmp_path / "run")
    assert [step.number for step in whole] == [3, 6, 9, 12, 14]
    for other in (resumed, loaded):
        assert np.array_equal(other.table, whole.table)
        assert np.allclose(other.times, whole.times, rtol=1e-15)
        for one, same in zip(whole, other, strict=True):
            assert np.array_equal(one.u, same.u)
            assert np.array_equal(one.v, same.v)
            assert np.array_equal(one.result.mu, same.result.mu)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_two_rubbing_bodies_with_the_mass_of_contact_nodes_go_on(tmp_path, mass):
    """The second scheme with friction, two bodies, loads in time, and a run in two parts."""

    def made():
        top = np.linspace(0.2, 0.8, 6), np.linspace(0.505, 0.9, 5)
        mesh = MeshQuad.init_tensor(*top).with_defaults()
        upper = ElasticBody.from_mesh(mesh, ElementQuad1(), E=2.0, nu=0.3).named("upper")
        lower = strip(8, high=0.5, layers=4).fix("bottom", "xy").named("lower")
        problem = ContactProblem(
            [lower, upper], [Pair(upper, "bottom", lower.surface("top"), friction=0.3)]
        )
        options = {"velocity": [None, (0.02, -0.02)], "mass": mass, "damping": (0.0, 0.001)}
        stepper = DynamicStepper(problem, [1.0, 2.0], 0.05, scheme="stabilised", keep=4, **options)
        return stepper.load("top", (0.005, -0.01), np.sin, body=upper)

    whole = made().run(30)
    assert closed(whole)
    assert whole.friction.sum() > 1e-6
    assert whole.impact.sum() > 1e-10
    assert max(max(step.result.kkt.values()) for step in whole) < 1e-10

    def stop(step):
        if step.number == 17:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made().run(30, path=tmp_path / "run", callback=stop)
    resumed = made().resume(tmp_path / "run")
    assert np.array_equal(resumed.table, whole.table)
    assert np.array_equal(resumed[-1].v, whole[-1].v)


@pytest.mark.parametrize(
    "changed",
    [
        {"density": 1.1},
        {"velocity": (0.0, -0.02)},
        {"damping": (0.0, 1e-3)},
        {"dt": 0.11},
        {"keep": 4},
        {"factor": np.cos},
        {"scheme": "stabilised"},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_a_run_of_another_problem_is_not_resumed(tmp_path, changed):
    shaken().run(4, path=tmp_path / "run")
    with pytest.raises(InputError, match="another problem"):
        shaken(**changed).resume(tmp_path / "run")


def test_files_of_the_two_kinds_of_history_are_told_apart(tmp_path):
    shaken().run(3, path=tmp_path / "run")
    assert len(LoadHistory.load(tmp_path / "run")) == 1  # a state like that of a static step
    name = next((tmp_path / "run").glob("step*.npz"))
    name.write_bytes(name.read_bytes()[:-100])
    with pytest.raises(InputError, match="no finished step"):
        DynamicHistory.load(tmp_path / "run")


def test_runs_go_on_and_are_written_for_paraview(tmp_path):
    stepper = shaken(keep=1)
    first = stepper.run(2)
    history = stepper.run(2)
    assert np.array_equal(history.table[:3], first.table)
    assert all(step.result.history for step in history)
    assert np.array_equal(history.table, shaken(keep=1).run(4).table)
    pyvista = pytest.importorskip("pyvista")
    reader = pyvista.get_reader(history.to_pvd(tmp_path / "thrown.pvd"))
    assert np.allclose(reader.time_values, history.times[1:] - 0.05)
    import matplotlib as mpl

    mpl.use("Agg")
    labels = [line.get_label() for line in history.plot().lines]
    assert {"kinetic", "elastic", "total"} <= set(labels)
    assert "closes to" in history.summary()


def test_a_stepper_goes_to_another_process():
    """With its steps and its state, and factors made anew."""
    stepper = dynamic(strip(20), velocity=(-SPEED, 0.0), keep=2)
    stepper.run(5)
    other = pickle.loads(pickle.dumps(stepper))
    assert np.array_equal(other.run(5).table, stepper.run(5).table)
    assert len(other.history) == len(stepper.history)


def pressed_in():
    return DynamicStepper(ContactProblem(strip(4, layers=2), "left", -0.01), 1.0, 0.1).step()


def changed_body():
    body = strip(4, layers=2)
    stepper = DynamicStepper(ContactProblem(body, "left", 0.0), 1.0, 0.1)
    body.E = 2.0
    return stepper.step()


def dynamic(body=None, density=1.0, dt=0.1, **options):
    problem = ContactProblem(body or strip(4, layers=2), "left", 0.0)
    return DynamicStepper(problem, density, dt, **options)


def layered():
    block = LayeredBlock((1.0, 1.0), [(1.0, 4, 1.0, 0.3)], sides=None)
    return DynamicStepper(ContactProblem(block, "bottom", 0.0), 1.0, 0.1)


def driven():
    tool = Rigid(0.0, force=(1.0, None))
    problem = ContactProblem(strip(4, layers=2), "left", tool)
    return DynamicStepper(problem, 1.0, 0.1, scheme="stabilised").step()


def off_supports():
    body = strip(4, layers=2).fix("right", "xy", 0.1)
    return dynamic(body).step()


def second_run():
    stepper = dynamic()
    stepper.step()
    return stepper.run(2, path="somewhere")


REFUSED = [
    (lambda: dynamic(strip(1, layers=4)), "stabilised"),
    (layered, "elastic"),
    (driven, "midpoint"),
    (pressed_in, "feed energy"),
    (changed_body, "make a new one"),
    (off_supports, "supports"),
    (second_run, "first run"),
    (lambda: dynamic().run(10**30), "to 100000000"),
    (lambda: dynamic().run(1, callback=3), "callback"),
    (lambda: dynamic(dt=1e-300), "square"),
    (lambda: dynamic(start=1e16), "lost in the rounding"),
]


@pytest.mark.parametrize(("make", "named"), REFUSED, ids=[named for _, named in REFUSED])
def test_what_cannot_be_stepped_is_refused(make, named):
    with pytest.raises(InputError, match=named):
        make()


def test_a_ledger_that_does_not_close_is_an_error(monkeypatch):
    """Breaks the damping of the ledger alone: the certificate of the laws still holds."""
    stepper = dynamic(velocity=(-SPEED, 0.0), damping=(0.1, 0.0))
    right = stepper._of.resistance
    calls = []

    def wrong(w):
        calls.append(1)
        return right(w) * (1.0 if len(calls) % 2 else 1.001)

    monkeypatch.setattr(stepper._of, "resistance", wrong)
    with pytest.raises(NotConverged, match="ledger"):
        stepper.run(3)
    assert len(stepper.history.times) < 4


def test_a_wrong_velocity_fails_the_certificate(monkeypatch):
    stepper = dynamic(velocity=(-SPEED, 0.0))
    right = stepper._of.velocity
    monkeypatch.setattr(stepper._of, "velocity", lambda *given: 1.001 * right(*given))
    with pytest.raises(NotConverged, match="equilibrium"):
        stepper.run(3)
