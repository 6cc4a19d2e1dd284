"""Characteristics of all kinds of velocities against closed forms and independent integrators."""

import gc
import pickle
from unittest import mock

import numpy as np
import pytest
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st
from schemes import made
from scipy.integrate import solve_ivp

from cip import Grid, LeftDomain, Solver, Velocity
from cip.characteristics.feet import integrate
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, System, foot
from cip.stages.stage import Stage

SLOW = pytest.mark.slow
formula = Velocity.from_expression
KINDS = ["traced", pytest.param("values", marks=SLOW), "jacobian", "arrays", "expression"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_velocity_gives_the_same_step(kind):
    grid = Grid([(0, 2 * np.pi)] * 2, (24, 24), periodic=True)

    def c(x, y):
        return np.sin(y) + 0.3, 0.4 * np.cos(x)

    def branched(x, y):
        return np.where(x > 1e9, x, np.sin(y) + 0.3), 0.4 * np.cos(x)

    def jacobian(x, y):
        return [[0 * x, np.cos(y)], [-0.4 * np.sin(x), 0 * x]]

    velocity = {
        "traced": lambda: Velocity(c),
        "values": lambda: Velocity(branched),
        "jacobian": lambda: Velocity(branched, jacobian=jacobian),
        "arrays": lambda: Velocity(np.array(c(*grid.mesh()))),
        "expression": lambda: formula("sin(x2) + 0.3", "0.4*cos(x1)"),
    }[kind]()
    assert all(f.exact for f in velocity.on(grid)) == (kind in ("traced", "expression"))
    solver = Solver(grid, velocity, profile="bicubic")
    after = solver.step(solver.state("sin(x1)*cos(2*x2)"), 0.4)
    reference = Solver(grid, formula("sin(x2)+0.3", "0.4*cos(x1)"), profile="bicubic")
    expected = reference.step(reference.state("sin(x1)*cos(2*x2)"), 0.4)
    # Quintic splines and sixth-order differences on 24 nodes a period.
    tolerance = {"arrays": 2e-5, "values": 1e-6, "jacobian": 1e-6}.get(kind, 1e-12)
    np.testing.assert_allclose(after.data, expected.data, atol=tolerance)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stored", [True, False])
def test_unsteady_velocity_has_order_three(stored):
    """u_t + cos(t) u_x = 0: the exact shift is sin t."""
    errors, sizes = [], (20, 40, 80)
    for n in sizes:
        grid = Grid((0, 1), n, periodic=True)
        solver = Solver(grid, formula("cos(t)"), store_feet=stored)
        run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.7 / n)
        exact = np.sin(2 * np.pi * (grid.coordinates[0] - np.sin(1.0)))
        errors.append(np.abs(run.final["u"] - exact).max())
    assert 2.9 <= order(sizes, errors) <= 3.2


PULSE, LATE = "20*exp(-((t-0.5)/0.02)**2)", pytest.mark.turns(4)
SHIFTS = [
    # The cache is keyed by dt: a short last step must not use the feet of a long one.
    pytest.param(lambda x: 1 + 0 * x, 0.25, 0.25, 0.1, 1e-8, id="partial steps"),
    # A pulse between two of the times at which sub-steps are counted anew.
    pytest.param(formula(PULSE), 1.0, 0.4 * np.sqrt(np.pi), 0.05, 1e-7, id="pulse", marks=SLOW),
    pytest.param(formula("t**7"), 1.0, 0.125, 0.05, 1e-7, id="late", marks=SLOW),
    # Sub-steps of half a step, or of a quarter, would see its crests only; its integral is 0.
    pytest.param(formula("cos(2*pi*40*t)"), 0.1, 0.0, 0.1, 1e-7, id="fast", marks=LATE),
]


@pytest.mark.parametrize(("velocity", "end", "shift", "dt", "tolerance"), SHIFTS)
def test_velocities_of_the_time_alone(velocity, end, shift, dt, tolerance):
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, velocity, profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), end, dt=dt)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - shift))
    np.testing.assert_allclose(run.final["u"], exact, rtol=0, atol=tolerance)


@pytest.mark.parametrize("steepness", [0.1, 3.0, 10.0])
def test_substeps_follow_the_steepness(steepness):
    """dx/dt = k sin(2 pi x) has tan(pi x(t)) = tan(pi x) exp(2 pi k t); |c'| dt is `steepness`."""
    grid, dt = Grid((0.01, 1.01), 40, periodic=True), 0.5  # no node where c = 0
    k = steepness / (2 * np.pi * dt)
    formulas = formula(f"{k!r}*sin(2*pi*x1)").on(grid)
    system = System([f.expression for f in formulas], [0], [foot(0, 0)])
    x = grid.coordinates[0]
    found = integrate(grid, formulas, system, [x], 0.0, dt)
    shrink = np.exp(-steepness)
    exact = np.arctan2(shrink * np.sin(np.pi * x), np.cos(np.pi * x)) / np.pi
    miss = x + found.jets[foot(0)] - exact
    np.testing.assert_allclose(miss - np.round(miss), 0, atol=3e-11)
    slope = shrink / (np.cos(np.pi * x) ** 2 + (shrink * np.sin(np.pi * x)) ** 2)
    np.testing.assert_allclose(found.jets[foot(0, 0)], slope, rtol=3e-9)
    assert steepness / 2 <= found.substeps <= 512 * (1 + steepness)


@pytest.mark.parametrize(
    ("profile", "dim"),
    [
        ("adini", 2),
        pytest.param("bicubic", 2, marks=SLOW),
        pytest.param("quintic", 1, marks=SLOW),
        pytest.param("csl4", 1, marks=SLOW),
        pytest.param("cubic", 3, marks=SLOW),
    ],
)
def test_single_precision_follows_double(profile, dim):
    grid = Grid([(0, 1)] * dim, (32,) * dim, periodic=True)
    field = ("0.3 + 0.1*sin(2*pi*x1)",) if dim == 1 else ("sin(2*pi*x2)", "cos(2*pi*x1)", "0.4")
    ends = []
    for dtype in (np.float64, np.float32):
        solver = made(grid, field[:dim], profile, dtype=dtype)
        final = solver.run(solver.state("sin(2*pi*x1)"), 0.3, dt=0.05).final
        assert final["u"].dtype == dtype
        ends.append(final["u"])
    np.testing.assert_allclose(ends[1], ends[0], atol=5e-6)


# Random velocities, grids and steps.


PI = np.pi


def traced_back(c, divergence, points, t, dt):
    """Feet and logarithm of the determinant by DOP853 at rtol 1e-12."""
    shape = (len(points) + 1, points[0].size)

    def rates(tau, q):
        q = q.reshape(shape)
        parts = [*c(*q[:-1], t - tau), divergence(*q[:-1], t - tau)]
        return -np.concatenate([np.broadcast_to(part, shape[1:]) for part in parts])

    start = np.concatenate([*points, np.zeros(shape[1])])
    end = solve_ivp(rates, (0, dt), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return end.reshape(shape)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10**6), dt=st.floats(1e-3, 6.0))
def test_feet_of_steep_velocities_and_long_steps(seed, dt):
    """|c'| dt up to 40: as many sub-steps as that needs, a third of which would not do."""
    a, b, phase = np.random.default_rng(seed).uniform(-1, 1, 3)
    grid = Grid([(0, 1), (0, 3)], (7, 9), periodic=True)
    texts = [f"{a}*sin(2*pi*x1 + {phase})", f"{b}*cos(2*pi*x2/3) + {a}*sin(2*pi*x1)*cos(t)"]

    def c(x, y, t):
        second = b * np.cos(2 * PI * y / 3) + a * np.sin(2 * PI * x) * np.cos(t)
        return a * np.sin(2 * PI * x + phase), second

    def divergence(x, y, t):
        return 2 * PI * (a * np.cos(2 * PI * x + phase) - b / 3 * np.sin(2 * PI * y / 3))

    solver = Solver(grid, formula(*texts), "advection", "adini")
    stage, t = solver._stages[0], 0.4
    feet = stage.feet(t, dt).data.reshape(9, -1)
    points = [x.ravel() for x in grid.mesh()]
    expected = traced_back(c, divergence, points, t + dt, dt)
    moved = np.stack([expected[q] - points[q] for q in (0, 1)]) * np.array([[7], [3]])
    # The tolerance of the feet grows with the flow's own sensitivity.
    worst = max(1.0, np.abs(feet[2:6]).max())
    np.testing.assert_allclose(feet[:2], moved, rtol=0, atol=1e-8 * worst)
    np.testing.assert_allclose(np.log(feet[6]), expected[2], rtol=0, atol=1e-7 * worst)
    assert LOG_DETERMINANT in stage.jets


@pytest.mark.turns(4)
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), dt=st.floats(1e-3, 50.0), single=st.booleans())
def test_constants_and_reversal_on_uneven_grids(seed, dt, single):
    """Any uniform flow over any grid keeps constants; a step of one period is the identity."""
    rng = np.random.default_rng(seed)
    lines = [np.cumsum(rng.uniform(0.1, 3.0, n)) for n in (7, 9)]
    grid = Grid.from_coordinates(*lines, periodic=True)
    kind = np.float32 if single else np.float64
    u, v = rng.uniform(-2, 2, 2)
    solver = Solver(grid, formula(u, v), profile="adini", dtype=kind)
    after = solver.step(solver.state(3.25), dt)
    tolerance = 64 * np.finfo(kind).eps
    np.testing.assert_allclose(after["u"], 3.25, rtol=tolerance)
    # One whole period in each direction, whatever their lengths: the identity.
    lengths = [line[-1] - line[0] for line in lines]
    turn = Solver(
        grid, formula(*(length / dt for length in lengths)), profile="adini",
        dtype=kind,
    )  # fmt: skip
    state = turn.state(0.0)
    state.data[...] = rng.uniform(-1, 1, state.data.shape)
    back = turn.step(state, dt)
    # Rounding of the feet, times slopes over the narrowest cell.
    np.testing.assert_allclose(back["u"], state["u"], rtol=0, atol=1e3 * np.finfo(kind).eps * 300)


def test_grids_far_from_the_origin_keep_their_widths():
    """Jitter of a third of a cell, 1e-13 of the coordinates, whose digits hold it exactly."""
    rng = np.random.default_rng(12)
    x = np.arange(25) + np.concatenate([[0], rng.integers(-70, 70, 23) / 256, [0]])
    ends = []
    for start, h in ((0.0, 1.0), (2.0**20, 2.0**-22)):
        grid = Grid.from_coordinates(start + h * x, periodic=True)
        assert grid.uniform == (False,)
        solver = Solver(grid, 0.7 * h)
        state = solver.state(lambda q, s=start, h=h: np.sin(PI * (q - s) / (12 * h)))
        ends.append(solver.run(state, 3.0, dt=1.0).final["u"])
    # The places of the feet are known to 2^-33 there, .0005 cells.
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-3)
    assert Grid((1e6, 1e6 + 1e-3), 1000).uniform == (True,)
    assert Grid.from_coordinates(np.cumsum(np.full(2000, 0.1))).uniform == (True,)


FLOWS = {
    "swirl": (
        ("-2*sin(pi*x1)**2*sin(pi*x2)*cos(pi*x2)*cos(t)", "sin(pi*x2)**2*sin(2*pi*x1)*cos(t)"),
        lambda x, y, t: (
            -2 * np.sin(PI * x) ** 2 * np.sin(PI * y) * np.cos(PI * y) * np.cos(t),
            np.sin(PI * y) ** 2 * np.sin(2 * PI * x) * np.cos(t),
        ),
        lambda x, y, t: 0 * x,
    ),
    "compression": (
        ("0.4 + 0.2*sin(2*pi*x1)*cos(2*pi*x2)*cos(3*t)", "0.1*sin(2*pi*(x1 + x2))"),
        lambda x, y, t: (
            0.4 + 0.2 * np.sin(2 * PI * x) * np.cos(2 * PI * y) * np.cos(3 * t),
            0.1 * np.sin(2 * PI * (x + y)),
        ),
        lambda x, y, t: (
            0.4 * PI * np.cos(2 * PI * x) * np.cos(2 * PI * y) * np.cos(3 * t)
            + 0.2 * PI * np.cos(2 * PI * (x + y))
        ),
    ),
}


FAST = {("bicubic", "compression"), ("adini", "compression")}


@pytest.mark.parametrize(
    ("profile", "low", "flow"),
    [
        pytest.param(*case, flow, marks=[] if (case[0], flow) in FAST else pytest.mark.slow)
        for flow in FLOWS
        for case in (("bicubic", 2.7), ("adini", 2.7), ("cubic", 1.9), ("csl4", 1.9))
    ],
)
def test_order_in_unsteady_flows(profile, low, flow):
    """p_t + div(c p) = 0 to t = .5 at two cells a step; the splitting's own order is two."""
    texts, c, divergence = FLOWS[flow]

    def start(x, y):
        return 1.5 + np.sin(2 * PI * x) * np.cos(2 * PI * y)

    errors, sizes = [], (32, 64, 128)
    for n in sizes:
        grid = Grid((0, 1), (n, n), periodic=True)
        solver = Solver(grid, formula(*texts), "advection", profile)
        final = solver.run(solver.state(start), 0.5, dt=2 / n).final["u"]
        coarse = (slice(None, None, n // 8),) * 2
        x, y, log = traced_back(c, divergence, [m[coarse].ravel() for m in grid.mesh()], 0.5, 0.5)
        errors.append(np.sqrt(np.mean((final[coarse].ravel() - np.exp(log) * start(x, y)) ** 2)))
    assert low <= order(sizes, errors) <= 4.3


# What is steep on ten cells only is followed wherever it lies, however few nodes see it.
#
# A linear field is kept by every profile, so that one step shows the feet themselves.


DT = 0.02
TURN = 6.0  # radians at the centre in a step


def whirl(grid, place, clock):
    """A vortex of ten cells in x1, x2 that turns by `TURN` exp(-r^2) times the clock's mean."""
    xi, eta = (f"((x{q + 1} - {place[q]!r})/{2.5 * grid.spacing[q]!r})" for q in (0, 1))
    spin = f"{TURN / DT!r}*({clock})*exp(-{xi}**2 - {eta}**2)"
    parts = [f"-{spin}*{eta}*{2.5 * grid.spacing[0]!r}", f"{spin}*{xi}*{2.5 * grid.spacing[1]!r}"]
    return formula(*parts, *["0"] * (grid.dim - 2))


def whirled(grid, place, turn):
    """The first coordinate of the feet."""
    x, y = grid.mesh()[:2]
    xi, eta = ((x - place[0]) / grid.spacing[0] / 2.5, (y - place[1]) / grid.spacing[1] / 2.5)
    angle = -turn * np.exp(-(xi**2) - eta**2)
    return place[0] + 2.5 * grid.spacing[0] * (np.cos(angle) * xi - np.sin(angle) * eta)


# Each formula is compiled: most stand in the slow lane.
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("place", "periodic", "unit", "t"),
    [
        ((0.503, 0.317), True, 1.0, 0.0),
        pytest.param((0.12, 0.9), True, 1.0, 0.0, marks=SLOW),
        pytest.param((0.7512, 0.5), False, 1e-6, 0.0, marks=SLOW),
        pytest.param((0.503, 0.317), False, 1e3, 3.0, marks=SLOW),
    ],
)
def test_plane(place, periodic, unit, t):
    grid = Grid([(0, unit), (0, 2 * unit)], (192, 160), periodic=periodic)
    where = (place[0] * unit, 2 * place[1] * unit)
    solver = Solver(grid, whirl(grid, where, f"1 + (t - {t!r})"), profile="adini", boundary=0.0)
    end = solver.step(solver.state("x1", t=t), DT)
    exact = whirled(grid, where, TURN * (1 + 0.5 * DT))
    # What `Stage.limit` lets a path err by, at most.
    np.testing.assert_allclose(end["u"], exact, rtol=0, atol=2e-7 * grid.spacing[0])


@pytest.mark.slow
def test_vortex_that_awakes_between_two_looks_at_the_sample():
    """It is still at first, for less time than until sub-steps are sought anew."""
    grid, where = Grid([(0, 1), (0, 1)], (160, 160), periodic=True), (0.503, 0.317)
    clock, late = "0.5 + 0.5*tanh(400*(t - 0.1))", 5
    solver = Solver(grid, whirl(grid, where, clock), profile="adini")
    for k in range(late):
        solver.step(solver.state("x1", t=k * DT), DT)
    end = solver.step(solver.state("x1", t=late * DT), DT)
    turn = TURN / DT * (0.5 * DT + np.log(np.cosh(400 * DT)) / 800)
    np.testing.assert_allclose(
        end["u"], whirled(grid, where, turn), rtol=0, atol=2e-7 * grid.spacing[0]
    )


def squeezed(grid, place):
    """A velocity on a line that changes sign five times within ten cells, and its feet."""
    h = grid.spacing[0]
    strong = 1.5 * h / DT

    def c(t, x):
        s = (x - place) / h
        return strong * (1 + t) * np.sin(s) * np.exp(-((s / 4) ** 2))

    s = f"((x1 - {place!r})/{h!r})"
    field = f"{strong!r}*(1 + t)*sin({s})*exp(-({s}/4)**2)"
    feet = grid.coordinates[0].copy()
    near = np.abs(feet - place) < 30 * h
    feet[near] = solve_ivp(
        lambda tau, x: -c(DT - tau, x), (0, DT), feet[near], "DOP853", rtol=1e-12, atol=1e-12 * h
    ).y[:, -1]
    return formula(field), feet


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("place", "periodic", "unit"),
    [
        (0.50001, False, 1e-6),
        pytest.param(0.3000004, True, 1.0, marks=SLOW),
        pytest.param(0.83, True, 1e3, marks=SLOW),
    ],
)
def test_line(place, periodic, unit):
    """So many nodes that those of the sample are forty cells apart."""
    grid = Grid((0, unit), 40_000, periodic=periodic)
    velocity, feet = squeezed(grid, place * unit)
    solver = Solver(grid, velocity, boundary=0.0)
    end = solver.step(solver.state("x1"), DT)
    np.testing.assert_allclose(end["u"], feet, rtol=0, atol=3e-7 * grid.spacing[0])


@pytest.mark.parametrize(
    ("form", "profile"), [("advection", "csl2"), pytest.param("transport", "cubic", marks=SLOW)]
)
def test_stored_feet(form, profile):
    """Conservative profiles store them; those of many nodes are compiled."""
    grid, place = Grid((0, 1), 120_000, periodic=True), 0.50001
    velocity, feet = squeezed(grid, place)
    solver = Solver(grid, velocity, form, profile, store_feet=True)
    found = solver.feet(solver._stages[0], 0.0, DT).data[: grid.size]
    cells = (feet - grid.coordinates[0]) / grid.spacing[0]
    np.testing.assert_allclose(found, cells, rtol=0, atol=3e-7)


def test_solvers_of_one_velocity_share_their_feet():
    """Of the same grid and profile, and only while one of them is there; walls are their own."""
    grid, wind = Grid([(0, 1)] * 2, (12, 10)), formula("a", "0.3*x1", parameters={"a": 0.5})

    def step(velocity, boundary=0.0, profile="bicubic", **more):
        solver = Solver(grid, velocity, profile=profile, boundary=boundary, **more)
        return solver, solver.step(solver.state("x1 + x2**2"), 0.1).data

    with mock.patch.object(Stage, "feet", autospec=True, side_effect=Stage.feet) as computed:
        first, expected = step(wind)
        count = computed.call_count
        other, found = step(wind, {"x-": 0.0, "y-": 0.0}, limiter="clamp")
        assert computed.call_count == count == 1
        step(pickle.loads(pickle.dumps(wind)))
        moved = step(wind.with_parameters(a=0.7))[1]
        third = step(wind, profile="adini")[1]
        assert computed.call_count == count + 3
        with pytest.raises(LeftDomain):
            step(wind, {"x-": 0.0})
    again = pickle.loads(pickle.dumps(wind))
    np.testing.assert_array_equal(found, step(again, limiter="clamp")[1])
    kept = [one.feet(one._stages[0], 0.0, 0.1).data for one in (first, other)]
    assert kept[0] is kept[1]
    assert np.abs(moved - expected).max() > 0.01
    assert third.shape[0] == 3
    del first, other, kept
    gc.collect()
    assert len(wind._feet) == 0
