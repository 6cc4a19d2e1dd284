"""Malformed input gets a typed error that names the argument, the node and the time."""

import math
from datetime import date, datetime
from functools import cache, partial

import numpy as np
import pytest
import skfem

import cip
from cip import Covariance, Grid, InputError, NotFinite, Sensors, Solver, State, Velocity, flow_map

LINE, OPEN, PLANE = Grid((0, 1), 8, periodic=True), Grid((0, 1), 8), Grid([(0, 1)] * 2, (8, 8))
HIDDEN = np.ma.masked_greater(np.linspace(0.1, 0.8, 8), 0.5)
COMPLEX = np.complex128(1.0)  # float() would drop its imaginary part with a warning
TWO, OBJECTS = np.array([0.1, 0.2]), np.array([None] * 8)
NAN8 = np.where(np.arange(8) == 7, np.nan, 1.0)
text = Velocity.from_expression
line = partial(Solver, LINE, 1.0)
bent = Grid.from_coordinates


def wave(x):
    return np.sin(2 * np.pi * x)


def state(f=wave, **more):
    return line().state(f, **more)


def of_data(data, t=0.0):
    return line().step(State(LINE, "cubic", data, t), 0.1)


def stepped(dt):
    return line().step(state(), dt)


def moved(velocity, grid=LINE, boundary=None):
    solver = Solver(grid, velocity, boundary=boundary)
    return solver.step(solver.state(wave), 0.1)


def ran(t_end=1.0, **more):
    return line().run(state(), t_end, **more)


def seen_at(snapshots):
    return ran(dt=0.1, snapshots=snapshots)


def sampled(points):
    return ran(dt=0.5).sample(points)


def meant(name):
    return text("sin(pi*x1)", parameters={name: 2})


def with_nan():
    damaged = state()
    damaged.data[1, 3] = np.nan
    return line().step(damaged, 0.1)


def rows(words, call, *values):
    return [(words, partial(call, value)) for value in values]


GRIDS = [
    ("shape: expected at least 4", lambda: Grid((0, 1), 3)),
    *rows("shape", lambda cells: Grid((0, 1), cells), 8.0, [], None, -8, 10**15),
    *rows("bounds", lambda ends: Grid(ends, 8), (1, 0), (0, np.nan), (0, 1j)),
    ("bounds", lambda: Grid([(0, 1), (0,)], (8, 8))),
    ("bounds: expected 2 pairs", lambda: Grid([(0, 1)], (8, 8))),
    *rows("cannot be divided", lambda ends: Grid(ends, 8), (1, 1 + 1e-15), (-1e308, 1e308)),
    *rows("periodic", lambda v: Grid((0, 1), 8, periodic=v), 1, [[True], [True, False]]),
    ("spacing after node 1 is -0.5", lambda: bent([0, 1, 0.5, 2, 3, 4])),
    ("x: expected at least 5", lambda: bent([0, 1, 2])),
    ("z: given", lambda: bent(np.arange(6), z=np.arange(6))),
    *rows("x", bent, np.arange(6) * 1j, [0, 1, np.nan, 3, 4, 5], None, []),
]
BALL = cip.Sphere(16, 8)


def ball(velocity=lambda lon, lat: (np.cos(lat), 0 * lon), **more):
    return cip.SphereSolver(BALL, velocity, **more)


def stirred(velocity, dt=0.1, **more):
    solver = ball(velocity, **more)
    return solver.step(solver.state(1.0), dt)


def round_ball(t_end=1.0, **more):
    return ball().run(ball().state(1.0), t_end, **more)


def other_ball(sphere, form="transport"):
    return ball().step(cip.SphereSolver(sphere, np.zeros((2, *sphere.cells)), form).state(1.0), 0.1)


SPHERES = [
    ("nlon=15: expected an even number", lambda: cip.Sphere(15, 8)),
    *rows("nlon", lambda n: cip.Sphere(n, 8), 6, 16.0, None, "many"),
    *rows("nlat", lambda n: cip.Sphere(16, n), 3, 8.5, True),
    *rows("radius", lambda r: cip.Sphere(16, 8, r), 0.0, -1.0, np.nan, np.inf, 1j, "big"),
    ("sphere: expected a Sphere", lambda: cip.SphereSolver(PLANE, np.zeros((2, 8, 8)))),
    ("grid: expected a Grid", lambda: Solver(BALL, 1.0)),
    ("grid: expected a Grid", lambda: State.from_function(1.0, BALL)),
    *rows("form", lambda v: ball(form=v), "diffusion", None),
    *rows("profile", lambda v: ball(profile=v), "bicubic", "csl4_spline", 3),
    *rows("limiter", lambda v: ball(limiter=v), "clamp", 1),
    *rows("bounds", lambda v: ball(bounds=v), (1, 0), (0, np.nan), 1.0),
    *rows("foot_tolerance", lambda v: ball(foot_tolerance=v), 0.0, np.nan, 2.0),
    *rows("velocity: expected", ball, 1.0, np.zeros((2, 8, 16)), "lon"),
    ("velocity: some of its values are not finite", lambda: ball(np.full((2, 16, 8), np.nan))),
    ("velocity: expected two arrays", lambda: stirred(lambda lon, lat: lon)),
    ("velocity: expected two arrays", lambda: stirred(lambda lon, lat, t: (lon, lat, t))),
    ("velocity: expected two arrays", lambda: stirred(lambda lon, lat: (lon[:3], lat))),
    ("velocity: expected two arrays", lambda: stirred(lambda lon, lat: (1j * lon, lat))),
    ("stretches an edge", lambda: stirred(lambda lon, lat: (300 * np.sin(2 * lat), 0 * lat),
                                        0.01, form="conservative")),
    *rows("f: ", lambda f: ball().state(f), np.ones(8), np.full((16, 8), np.nan), None, "lon"),
    ("f: it gives shape", lambda: ball().state(lambda lon, lat: lat[:3])),
    ("f: expected at least one field", lambda: ball().state({})),
    ("fields: 'lon' is no name", lambda: ball().state({"lon": 1.0})),
    ("^t: ", lambda: ball().state(1.0, t="noon")),
    ("it lives on", lambda: other_ball(cip.Sphere(18, 8))),
    ("it lives on", lambda: other_ball(cip.Sphere(16, 8, radius=2.0))),
    ("it carries the moments of 'csl4_spline'", lambda: other_ball(BALL, "advection")),
    ("cfl: the velocity at the start is zero", lambda: ball(lambda lon, lat: (0 * lon, 0 * lat))
     .run(ball().state(1.0), 1.0, cfl=1.0)),
    *rows("points", lambda v: round_ball(dt=0.5, gauges=v), [0.1], [0.1, 2.0], [np.nan, 0.1], "a"),
    *rows("^diffusion", lambda v: ball(diffusion=v), -1.0, np.nan, (0.1, 0.2), "lat", 1j),
    *rows("^diffusion", lambda v: line(diffusion=v), -1.0, [1.0, 1.0]),
    *rows("source", lambda v: ball(source=v), "1 + z", "q*lon", np.ones((8, 16)), np.nan, 1j),
    ("decay: expected a rate >= 0", lambda: ball(decay=-0.1)),
    ("decay: expected a rate >= 0", lambda: stirred(lambda lon, lat: (lat, lat), decay="lat")),
    *rows("reactions", lambda v: ball(reactions=v).state(1.0), {"a": "-a"}, "-a", {}),
    ("source: 'dust' is no field", lambda: ball(source={"dust": 1.0}).state({"ash": 1.0})),
    ("velocity: expected a function .* of one level", lambda: ball(np.zeros((2, 5, 16, 8)))),
    ("f: .*a sphere has one level", lambda: ball().state(np.zeros((16, 8, 5)))),
    *rows("points", lambda p: round_ball(dt=0.5).sample(p), [0.1], [0.1, 2.0], [0.1, np.nan], 3),
]  # fmt: skip
VELOCITIES = [
    ("is not a formula", lambda: text("x1 +")),
    ("'foo'", lambda: text("foo")),
    ("'gamma'", lambda: text("gamma(x1)")),
    ("is not arithmetic", lambda: text("x1.real")),
    *rows("is not arithmetic", text, "np.float16(1.0)*x1", "np.float64()", "np.float64(1, 2)*x1"),
    ("too large", lambda: text("1" + "0" * 400)),
    *rows("not finite", text, "10**400*x1", "x1**1e999", "(-8)**(1/3)", "x1/(2 - 2)"),
    ("3002 characters", lambda: text("-" * 3000 + "x1")),
    ("component 1", lambda: text(1j)),
    ("from_expression", lambda: Velocity("x1")),
    (r"shape \(9,\)", lambda: Solver(OPEN, np.ones(5))),
    ("node", lambda: Solver(OPEN, np.full(9, np.nan))),
    ("complex128", lambda: Solver(OPEN, np.ones(9) * 1j)),
    ("1 components", lambda: Solver(PLANE, 1.0)),
    *rows(r"^c1?: ", partial(Solver, LINE), COMPLEX, [1j], np.nan, np.inf, [None], [], OBJECTS),
    ("^c2: ", lambda: Solver(PLANE, [np.ones((9, 9)), np.ones(4)])),
    (r"c1: called with the arrays x1 it raised TypeError.*steady=False",
     lambda: moved(lambda x, t: np.cos(t) + 0 * x)),
    ("c1: .*real values .*complex128", lambda: moved(lambda x: 1j * x)),
    ("c1: .*TypeError", lambda: moved(math.sin)),
    ("returned 2 components", lambda: moved(lambda x: (x, x))),
    ("parameters: 'a' must be finite", lambda: text("a*x1", parameters={"a": np.nan})),
    *rows("parameters: 'a'", lambda a: text("a*x1", parameters={"a": a}), "1", [1.0]),
    ("parameters: no formula holds 'b'", lambda: text("a*x1", parameters={"a": 1, "b": 2})),
    ("component 1: 'a' in .* is none of x1, .*, b", lambda: text("a*x1", parameters={"b": 2})),
    *rows("parameters: '.*' has a meaning", meant, "x1", "pi", "sin"),
    ("parameters: 'two words' is no name", lambda: meant("two words")),
    ("parameters: expected numbers by names", lambda: text("x1", parameters=[1.0])),
    ("b: no parameter of this velocity; known: a", lambda: speed().with_parameters(b=1.0)),
    ("parameters: 'a' must be finite", lambda: speed().with_parameters(a=np.inf)),
    ("a: no parameter .*; known: it has none", lambda: Velocity(1.0).with_parameters(a=1.0)),
]  # fmt: skip
SOLVERS = [
    ("profile: expected one of", lambda: line(profile="septic")),
    ("profile", lambda: line(profile=["cubic"])),
    ("two-dimensional", lambda: line(profile="adini")),
    *rows("form.*conservative", lambda v: line(form=v), "diffusion", None, ["transport"], 3),
    ("advection", lambda: line(profile="csl2")),
    ("limiter: expected", lambda: line(limiter="minmod")),
    ("limiter: expected one of", lambda: line(limiter=["clamp"])),
    ("does not fit 'cubic'", lambda: line(limiter="bounds")),
    ("splitting", lambda: line(splitting=["strang"])),
    *rows("backend", lambda v: line(backend=v), "tpu", ["cpu"]),
    ("dtype", lambda: line(dtype=np.int32)),
    ("dtype: expected", lambda: line(dtype="single-ish")),
    ("store_feet", lambda: line(store_feet="no")),
    ("low must be below high", lambda: line(bounds=(1, 0))),
    *rows("bounds", lambda v: line(bounds=v), (0, COMPLEX), (0, np.nan), (0, 1, 2)),
    *rows("bounds_tolerance", lambda v: line(bounds_tolerance=v), "a", np.nan),
    ("grid: expected a Grid", lambda: Solver(np.linspace(0, 1), 1.0)),
    ("'left' is no wall", lambda: Solver(OPEN, 1.0, boundary={"left": 0}).state(0.0)),
    ("periodic there", lambda: line(boundary={"x-": 0})),
    *rows("boundary", lambda v: Solver(OPEN, 1.0, boundary=v), COMPLEX, np.nan, np.ones(3)),
    ("boundary 'x-': called with the arrays x1, t", lambda: moved(1.0, OPEN, {"x-": lambda t: t})),
]
STATES = [
    ("f: .*real values", lambda: state(lambda x: 1j * x)),
    (r"f: .*of shape \(8,\), got float64 of shape \(7,\)", lambda: state(lambda x: np.ones(7))),
    (r"f: .*shape \(8,\)", lambda: state(np.ones(7))),
    (r"f: NaN .*node \(0,\)", lambda: state(np.full(8, np.nan))),
    ("f: moment 'u' is nan", lambda: state(lambda x: np.sqrt(x - 0.5))),
    *rows("f: ", state, COMPLEX, None),
    *rows("f: expected a finite time|^t: ", lambda t: state(t=t), np.nan, 1j, "noon"),
    ("u_y", lambda: state(wave, derivatives={"u_y": wave})),
    ("derivatives", lambda: state(derivatives=[1])),
    ("f: ", lambda: line(dtype=np.float32).state(1e300)),
    ("grid", lambda: State.from_function(wave, None)),
    (r"moment 'u_x' is nan at node \(3,\) at \(0.375\) at t = 0", with_nan),
    ("linear", lambda: line().step(line(profile="linear").state(wave), 0.1)),
    ("it lives on", lambda: line().step(State.from_function(wave, Grid((0, 1), 9, True)), 0.1)),
    ("expected a State", lambda: line().step(np.ones(8), 0.1)),
    ("expected a Grid", lambda: line().step(State(None, "cubic", np.zeros((2, 8))), 0.1)),
    *rows("state", of_data, np.zeros((2, 8), complex), np.zeros((2, 8), int), [[0.0] * 8] * 2),
    *rows("state", lambda t: of_data(np.zeros((2, 8)), t), None, np.nan),
    ("'v' is none of u, u_x", lambda: state()["v"]),
]
TWO_FIELDS = {"smoke": wave, "dust": 1.0}


def both(**more):
    return line(**more).state(TWO_FIELDS)


def of_fields(shape, fields):
    return line().step(State(LINE, "cubic", np.zeros(shape), 0.0, fields), 0.1)


def shown(**more):
    pytest.importorskip("xarray")
    return line().run(both(), 0.1, dt=0.1).to_xarray(**more)


def kept(call):
    run = line().run(both(), 0.1, dt=0.1)
    return call(line(), run)


NAMED = [
    *rows("fields: .* is no name", lambda name: line().state({name: 1.0}), "a b", "u", "x", 3),
    ("fields: two moments would be called 'a_x'", lambda: line().state({"a": 0.0, "a_x": 1.0})),
    ("f: expected at least one field", lambda: line().state({})),
    ("dust: f: NaN", lambda: line().state({"dust": np.full(8, np.nan)})),
    ("derivatives: 'ash' is no field", lambda: line().state(TWO_FIELDS, {"ash": {}})),
    ("dust: derivatives", lambda: line().state(TWO_FIELDS, {"dust": {"u_y": wave}})),
    ("field: 'ash' is no field of the state: smoke, dust", lambda: both().field("ash")),
    ("field: .* one without a name", lambda: state().field("u")),
    ("'u' is none of smoke, smoke_x", lambda: both()["u"]),
    ("state: the moments .* shape", lambda: of_fields((2, 8), ("a", "b"))),
    ("state: the moments .* shape", lambda: of_fields((2, 2, 8), ("a",))),
    ("fields: expected a tuple", lambda: of_fields((2, 2, 8), ["a", "b"])),
    ("source: 'ash' is no field of the state, which has smoke, dust",
     lambda: both(source={"ash": 1.0})),
    ("decay: 'dust' .* which has one without", lambda: line(decay={"dust": 1.0}).state(wave)),
    ("decay: expected a rate >= 0", lambda: line(decay={"dust": -1.0})),
    ("low must be below high", lambda: line(bounds={"dust": (1, 0)})),
    ("'dust' is no wall", lambda: Solver(OPEN, 1.0, boundary={"x-": 0.0, "dust": 1.0})),
    ("run: readings are of one field",
     lambda: kept(lambda s, run: Sensors([0.3], [0.1]).sample(run))),
    ("derivatives are of one field", lambda: kept(lambda s, run: s.tangent(run))),
    ("start: derivatives are of one field",
     lambda: cip.identify_velocity(
         Solver(LINE, speed()), both(), {0.1: np.ones(8)}, dt=0.1, noise=0.1)),
    *rows("points", lambda v: ran(dt=0.5, gauges=v), [np.nan], "here", [2j]),
    ("resume='yes': expected True or False", lambda: ran(dt=0.5, resume="yes")),
    ("ax: expected one for each of 2", lambda: kept(lambda s, run: run.plot(ax=[None]))),
    *rows("start: expected a date", lambda v: shown(start=v), "soon", [1]),
    ("units: 'q' is none of dust, smoke, t, x", lambda: shown(units={"q": "m"})),
    ("units: expected units by names", lambda: shown(units=3)),
    ("units: t of dates", lambda: shown(start="2026-01-01", units={"t": "weeks"})),
    *rows("path", lambda v: cip.Trajectory.load(v), 3, "run.png", "none.npz"),
    *rows("path", lambda v: State.load(v), 3, "run.png", "none.npz"),
]  # fmt: skip
RUNS = [
    *rows("dt: expected a", stepped, 0.0, np.nan, np.inf, "fast", COMPLEX, TWO, None),
    ("cfl: expected a positive", lambda: ran(cfl=-1.0)),
    *rows("dt: steps of", lambda dt: ran(-dt, dt=dt), 0.1, -0.1),
    ("snapshots: expected decreasing", lambda: ran(-1.0, dt=-0.1, snapshots=[-0.5, -0.2])),
    ("grid: expected a Grid", lambda: flow_map(1.0, 3, 0.0, 1.0)),
    *rows("t_end: expected finite", lambda end: flow_map(1.0, LINE, 0.0, end), 0.0, np.inf),
    *rows("tolerance", lambda size: flow_map(1.0, LINE, 0.0, 1.0, size), 0.0, np.nan),
    ("plot: 1 dimensions", lambda: flow_map(1.0, LINE, 0.0, 1.0).plot()),
    ("either dt or cfl", lambda: ran(dt=0.1, cfl=1)),
    ("either dt or cfl", ran),
    *rows("cfl", lambda cfl: ran(cfl=cfl), np.nan, -1.0),
    *rows("t_end", lambda t_end: ran(t_end, dt=0.1), 0.0, COMPLEX, np.nan),
    ("increasing", lambda: seen_at([0.5, 0.2])),
    *rows("snapshots", seen_at, [2.0], [0.5j], [0.1, np.nan], HIDDEN, 0, 2.5, [-1.0]),
    ("callback: expected a callable", lambda: ran(dt=0.1, callback=3)),
    ("dt: 0.1 is lost in the rounding of t = 1e.17",
     lambda: line().run(state(t=1e17), 1e17 + 64, dt=0.1)),
    ("points: .*complex", lambda: sampled([1j])),
    ("points: expected real", lambda: sampled("here")),
    *rows("points", sampled, [np.nan], HIDDEN, None),
]  # fmt: skip


def speed():
    return text("a + 0*x1", parameters={"a": 1.0})


def source(**more):
    solver = line(**more)
    return solver.run(solver.state(0.0), 1.0, dt=0.1)


def emitted(formula, **parameters):
    return cip.Source.from_expression(formula, parameters)


def early(shape=(2, 8)):
    return cip.Source.from_snapshots([0, 1], np.ones(shape), LINE)


WEST = np.arange(8) < 3


def at_sea(land, **more):
    return Solver(LINE, 1.0, "advection", "csl2", land=land, **more)


SPLIT = {"profile": "cubic", "splitting": "strang", "boundary": 1.0}
SOURCES = [
    ("source: .*, got True", lambda: line(source=True)),
    ("source: expected a finite number", lambda: line(source=np.nan)),
    (r"source: NaN or infinity at node \(7,\)", lambda: line(source=NAN8)),
    (r"source: .*real values at the nodes, shape \(8,\)", lambda: line(source=np.ones(7))),
    ("source: 'q' in 'q\\*x1' is none of", lambda: line(source="q*x1")),
    (r"source: \['x2'\] occur, but the grid has 1", lambda: line(source="x1*x2")),
    ("source: it, or a derivative .* is NaN", lambda: source(source="log(x1)")),
    ("source: expected real values", lambda: line(source=[1j])),
    ("source: expected numbers, got", lambda: line(source=[[1.0], [1.0, 2.0]])),
    ("source: expected a number, a text", lambda: line(source={})),
    ("decay: .*, got False", lambda: line(decay=False)),
    ("decay: expected a rate >= 0, got -0.1", lambda: line(decay=-0.1)),
    ("decay: expected a finite number", lambda: line(decay=np.inf)),
    ("decay: expected a rate >= 0, got -.* at node ", lambda: source(decay="sin(2*pi*x1)")),
    ("decay: expected a rate >= 0, got -", lambda: source(decay="1 - 2*t")),
    ("decay: expected a rate >= 0, got -1 at node", lambda: source(decay=emitted("k", k=-1.0))),
    ("decay: expected real values at the nodes", lambda: line(decay=np.ones(3))),
    ("parameters: no formula holds 'q'", lambda: emitted("x1", q=1.0)),
    ("r: no parameter of this source; known: q",
     lambda: emitted("q", q=1.0).with_parameters(r=1.0)),
    (r"arrays: expected shape \(2, 1, 8\)", lambda: early((2, 7))),
    ("t: the snapshots of the source cover 0 to 1",
     lambda: line(source=early()).run(state(0.0), 1.5, dt=0.1)),
    ("source: snapshots in 1 directions on a grid of 2",
     lambda: Solver(PLANE, (0.0, 0.0), source=early())),
    *rows(r"land: expected one True or False for each cell, shape \(8,\)", at_sea,
          np.zeros(9, bool), np.zeros(8), True),
    *rows("land: ", at_sea, "sea", np.ma.masked_array(WEST, WEST)),
    ("land: every cell is land", lambda: at_sea(np.ones(8, bool))),
    ("state: it is not zero on land", lambda: at_sea(WEST).step(at_sea(None).state(1.0), 0.1)),
    *rows("land: .* take 'csl2' or 'csl4'", lambda name: line(profile=name, land=WEST),
          "cubic", "linear"),
    ("diffusion: it would cross land", lambda: at_sea(WEST, diffusion=0.1)),
    ("boundary: closed walls .* take 'csl2'", lambda: Solver(OPEN, 1.0, boundary="closed")),
    ("boundary: with splitting 'cubic' needs constant data on the wall x-",
     lambda: Solver(PLANE, (1.0, 1.0), **{**SPLIT, "boundary": "sin(t)"})),
    ("decay: with splitting the data of the wall x- must",
     lambda: Solver(PLANE, (1.0, 0.0), decay=1.0, **SPLIT)),
]  # fmt: skip

WIDE = Grid([(0, 1), (0, 2)], (8, 9))
ZERO = np.zeros((3, 2, 9, 10))
GAP = ZERO.copy()
GAP[1, 0, 4, 5] = np.nan
winds = Velocity.from_snapshots
STEPS = [0, 1, 2]
LONG = Grid((-1, 2), 48, periodic=True)
splines = cip.SplineVelocity


def at_times(times):
    return winds(times, ZERO, WIDE)


def on(grid, velocity):
    return partial(Solver, grid, velocity)


def ones(grid=LINE):
    return winds([0, 1], np.ones((2, *grid.nodes)), grid)


SPLINES = [
    *rows("times: expected finite, increasing", at_times, [0, 1, 1], [0, 1, np.inf]),
    ("times: expected at least 2", lambda: winds([0], ZERO[:1], WIDE)),
    ("times: expected at least 2 times in one row", lambda: at_times([STEPS])),
    (r"arrays: expected shape \(2, 2, 9, 10\)", lambda: at_times([0, 1])),
    ("arrays: expected shape", lambda: winds(STEPS, ZERO[:, :1], WIDE)),
    ("arrays: expected real values", lambda: winds(STEPS, ZERO + 1j, WIDE)),
    (r"arrays: NaN or infinity in snapshot 1, component 0, node \(4, 5\)",
     lambda: winds(STEPS, GAP, WIDE)),
    ("grid: expected a Grid", lambda: winds(STEPS, ZERO, (9, 10))),
    *rows("time: expected 'linear' or 'cubic'", lambda x: winds(STEPS, ZERO, WIDE, 3, x),
          "quadratic", None, ["linear"]),
    *rows("foot_tolerance: ", lambda x: Solver(LINE, 1.0, foot_tolerance=x),
          0.0, 2.0, np.nan, "1e-5", True),
    *rows("degree: expected 3 or 5", partial(winds, STEPS, ZERO, WIDE), 4, np.array([5, 3])),
    ("degree: splines of degree 5 need 6 cells",
     lambda: winds([0, 1], np.zeros((2, 5)), Grid((0, 1), 4), 5)),
    ("velocity: snapshots in 2 directions on a grid of 1", on(LINE, winds(STEPS, ZERO, WIDE))),
    *[
        (f"velocity: {words}", on(Grid(box, (8, 8), periodic), winds(STEPS, ZERO, WIDE)))
        for words, box, periodic in (
            ("the snapshots cover x from 0 to 1, the grid", [(0, 1.1), (0, 2)], False),
            ("the snapshots cover y from 0 to 2, the grid", [(0, 1), (-1, 2)], False),
            ("the grid is periodic in x", [(0, 1), (0, 2)], (True, False)),
        )
    ],
    (r"velocity: the period of the grid in x is 1.5 periods",
     on(Grid((0, 1.5), 8, periodic=True), ones())),
    (r"t: the snapshots of the velocity cover 0 to 1, not 0 to 1.2",
     lambda: Solver(LINE, ones()).run(state(), 1.2, dt=0.1)),
    *rows("t: the snapshots", lambda t: Solver(LINE, ones()).step(state(t=t), 1.1), 0.0, -0.5),
    ("grid: ", lambda: splines((0, 1), 4)),
    *rows("pieces: expected 6 to 48", partial(splines, LONG), 5, 49),
    *rows("pieces: ", partial(splines, LONG), 8.0, (8, 8)),
    ("pieces: expected 1 to 4 in direction x", lambda: splines(PLANE, (5, 4))),
    ("start: ", lambda: splines(LONG, 8, np.ones(5))),
    ("start: expected finite", lambda: splines(LONG, 8, np.nan)),
    ("start: expected 2 fields", lambda: splines(PLANE, 4, [1.0])),
    ("degree: ", lambda: splines(LONG, 8, 1.0, 4)),
    ("degree: .* take degree=5", lambda: splines(PLANE, 4, 1.0, 3, True)),
    ("stream: ", lambda: splines(LONG, 8, 1.0, 5, True)),
    *rows("velocity: its splines live on", lambda grid: Solver(grid, splines(LONG, 8, 1.0)),
          Grid((0, 3), 48, periodic=True), Grid((-1, 2), 48)),
]  # fmt: skip


def sensors(points=(0.5,), times=(0.3,), *more):
    return Sensors(points, times, *more)


def still():
    solver = Solver(OPEN, lambda x: 0.0 * x)
    return solver.run(solver.state("x1"), 0.3, dt=0.1)


SENSORS = [
    ("points: expected shape", lambda: sensors([[[0.1]]])),
    ("points: expected finite", lambda: sensors([np.nan])),
    ("times: expected finite, increasing", lambda: sensors([0.1], [1.0, 1.0])),
    ("times: expected finite", lambda: sensors([0.1], [np.inf])),
    ("values: expected one for each of 1 times and 1 points", lambda: sensors([0.1], [1.0], [1.0])),
    ("values: infinity", lambda: sensors([0.1], [1.0], [[np.inf]])),
    ("values: expected real", lambda: sensors([0.1], [1.0], [[1j]])),
    ("deviations: expected positive", lambda: sensors([0.1], [1.0], None, 0.0)),
    ("deviations: expected shape", lambda: sensors([0.1], [1.0], None, [0.1, 0.2])),
    ("chosen: expected numbers", lambda: sensors().at([3])),
    ("chosen: expected at least one", lambda: sensors().at([])),
    (r"run: it has no snapshot at t = 0\.2", lambda: sensors([0.5], [0.2, 0.3]).sample(still())),
    (r"points: x = 1\.5 lies outside", lambda: sensors([1.5]).sample(still())),
    (r"run: expected what solver\.run returned", lambda: sensors().states(None)),
    ("grid: it has 2 dimensions", lambda: sensors().rows(PLANE, "adini")),
    ("not linear in its moments", lambda: sensors().rows(OPEN, "piecewise_linear")),
    ("dropouts: expected a probability", lambda: sensors().perturbed(0, 1.0)),
    ("dataset: expected", lambda: Sensors.from_xarray({})),
    *rows("seed=", sensors().perturbed, "a", -1, 1.5, None),
]


@cache
def assimilation():
    solver = Solver(LINE, 1.0)
    B = Covariance.diffusion(LINE, "cubic", 1.0, 0.2)
    seen = Sensors(np.linspace(0, 0.9, 8), [0.1, 0.2], np.ones((2, 8)), 0.1)
    return {"solver": solver, "start": solver.state(0.0), "B": B, "sensors": seen, "dt": 0.05}


def called(function, **more):
    given = assimilation() | more
    first = [given.pop(name) for name in ("solver", "start", "B", "sensors")]
    return function(*first, **given)


analysed, placed = partial(called, cip.four_d_var), partial(called, cip.place_sensors, budget=2)


diffusion = Covariance.diffusion
ASSIMILATION = [
    ("deviation: expected positive", lambda: diffusion(OPEN, "cubic", 0.0, 0.1)),
    ("deviation: expected one number or", lambda: diffusion(OPEN, "cubic", np.ones(7), 0.1)),
    ("length: expected positive", lambda: diffusion(OPEN, "cubic", 1.0, -0.1)),
    ("length: expected one number or shape", lambda: diffusion(OPEN, "cubic", 1.0, [0.1, 0.1])),
    ("order: expected more than 1.5", lambda: diffusion(OPEN, "cubic", 1.0, 0.1, 1.5)),
    ("grid: expected a Grid", lambda: diffusion(None, "cubic", 1.0, 0.1)),
    ("root: expected 18 rows", lambda: Covariance(OPEN, "cubic", np.ones((5, 2)), np.ones(9))),
    ("states: expected at least one", lambda: Covariance.patterns([])),
    ("states: expected states of one profile",
     lambda: Covariance.patterns([State.from_function("x1", g) for g in (OPEN, LONG)])),
    ("solver: expected a Solver", lambda: analysed(solver=None)),
    ("covariance: it is of", lambda: analysed(B=diffusion(LONG, "cubic", 1.0, 0.2))),
    ("covariance: expected a Covariance", lambda: analysed(B=1.0)),
    ("sensors: expected Sensors", lambda: analysed(sensors=None)),
    ("sensors: their first time is 0.1, before",
     lambda: analysed(start=line().state(0.0, t=0.15))),
    ("sensors: no report has arrived",
     lambda: analysed(sensors=assimilation()["sensors"].with_values(np.full((2, 8), np.nan)))),
    ("parameters: the solver has no parameter 'a'", lambda: analysed(parameters={"a": 1.0})),
    ("model_error: expected a Covariance, or one or None for each",
     lambda: analysed(model_error=[None])),
    ("model_error: interval 1: it is of",
     lambda: analysed(model_error=[None, diffusion(LONG, "cubic", 1.0, 0.2)])),
    ("tol: expected", lambda: analysed(tol=0.0)),
    ("vectors=-1: expected", lambda: analysed(vectors=-1)),
    ("max_outer=True: expected", lambda: analysed(max_outer=True)),
    ("max_iterations: after 2 combinations", lambda: analysed(max_iterations=2)),
    *rows("budget: expected 1 to 8", lambda v: placed(budget=v), 0, True),
    ("criterion='E': expected", lambda: placed(criterion="E")),
    ("goal: expected one of", lambda: placed(goal="end")),
    ("goal: 'parameters' needs parameters=", lambda: placed(goal="parameters")),
    ("goal: 'amplitudes' needs model_error=", lambda: placed(goal="amplitudes")),
    ("excluded: expected True or False for each of 8", lambda: placed(excluded=[True])),
    ("apart: expected a distance", lambda: placed(apart=-1.0)),
]  # fmt: skip


def differentiated(how, **options):
    """What has no derivatives, for both operators."""
    grid = Grid([(0, 1)] * 2, (8, 8), True) if options.get("profile") == "adini" else LINE
    solver = Solver(grid, (1.0, 0.0)[: grid.dim], **options)
    run = solver.run(solver.state(0.5), 0.1, dt=0.1)
    return getattr(solver, how)(run)


@cache
def solved(velocity=1.0, **options):
    solver = line(**options) if velocity == 1.0 else Solver(LINE, velocity, **options)
    return solver, solver.run(solver.state(wave), 0.1, dt=0.1)


def operated(how, solver, run, **more):
    return getattr(solver, how)(run, **more)


NO_DERIVATIVES = [
    ("profile: 'piecewise_linear' is not differen", {"profile": "piecewise_linear"}),
    ("profile: 'linear' is not differentiable", {"profile": "linear"}),
    ("limiter: 'clamp' is not differentiable", {"limiter": "clamp"}),
    ("limiter: 'rational' is not differentiable", {"limiter": "rational"}),
    ("limiter: 'bounds' is not differentiable",
     {"profile": "csl2", "form": "advection", "limiter": "bounds", "bounds": (-2, 2)}),
    ("limiter: 'eno' is not differentiable", {"profile": "adini", "limiter": "eno"}),
]  # fmt: skip
DERIVATIVES = [
    *[(words, partial(differentiated, how, **options))
      for words, options in NO_DERIVATIVES for how in ("tangent", "adjoint")],
    (r"run: expected what solver\.run returned", lambda: solved()[0].tangent(solved()[1].final)),
    ("run: it is not a run of this solver", lambda: solved()[0].tangent(solved(0.5)[1])),
    ("state: it carries the moments of 'cubic'",
     lambda: solved(profile="quintic")[0].adjoint(solved()[1])),
    ("dtype: derivatives need", lambda: operated("tangent", *solved(dtype=np.float32))),
    *rows("checkpoints=.*: expected a whole number",
          lambda k: operated("adjoint", *solved(), checkpoints=k), 0, -1, 1.5, True),
    *rows("x: expected real values instead of complex128",
          lambda how: operated(how, *solved()) @ (1j * np.ones(16)), "tangent", "adjoint"),
]  # fmt: skip

RING = Grid((0, 1), 40, periodic=True)
SPEED = text("a + b*sin(2*pi*x1)", parameters={"a": 1.0, "b": 0.1})
SEEN = np.sin(2 * np.pi * RING.coordinates[0]) + 0.5 * np.cos(6 * np.pi * RING.coordinates[0])
ROWS = np.eye(3, 80)


class Wrong:
    """Observations with a wrong operator, by default of a wrong shape."""

    times = (0.1,)
    values = (np.zeros(3),)

    def __init__(self, *operators, **others):
        self.operators = operators or (np.zeros((3, 40)),)
        self.__dict__.update(others)


def identified(velocity=SPEED, limiter=None, **more):
    solver = Solver(RING, velocity, limiter=limiter)
    start = solver.state("sin(2*pi*x1) + 0.5*cos(6*pi*x1)")
    return cip.identify_velocity(
        **({"solver": solver, "start": start, "data": {0.1: SEEN}, "dt": 0.05} | more)
    )


SILENT = Sensors([0.2, 0.5, 0.7], [0.1], np.full((1, 3), np.nan), 0.1)
# The words of the message, and what is changed in a good call.
IDENTIFICATION = [
    ("solver: ", {"solver": SPEED}),
    ("solver: its velocity has no parameters", {"velocity": 1.0}),
    ("state: ", {"start": SEEN}),
    ("start: the data do not change", {"start": State.from_function(2.0, RING)}),
    *[("data: ", {"data": data}) for data in ({}, SEEN, {np.nan: SEEN})],
    ("data: the first time is 0", {"data": {0.0: SEEN}}),
    ("data: snapshot at t = 0.1: ", {"data": {0.1: SEEN[:-1]}}),
    ("data: snapshot at t = 0.1: NaN", {"data": {0.1: np.where(SEEN > 0, np.nan, 1)}}),
    ("data: every value is masked", {"data": {0.1: np.ma.array(SEEN, mask=True)}}),
    ("data: expected values of shape", {"data": Wrong()}),
    (r"data: expected values of shape .* and list", {"data": Wrong([0.0, 1.0])}),
    ("data: entries of the operators: NaN", {"data": Wrong(np.nan * ROWS)}),
    ("data: entries of the operators: expected real values", {"data": Wrong(1j * ROWS)}),
    ("data: expected values and an operator", {"data": Wrong(ROWS, values=None)}),
    ("data: expected deviations for each of 1 times", {"data": Wrong(ROWS, deviations=0.1)}),
    ("data: every value is masked or missing", {"data": SILENT}),
    ("data: every value is masked or missing", {"data": SILENT, "regularization": "H2"}),
    ("noise: with one for each time", {"data": {0.2: SEEN, 0.1: SEEN}, "noise": [0.1, 0.2]}),
    ("noise: the data have", {"data": Sensors([0.5], [0.1], [[0.1]], 0.1), "noise": 0.1}),
    *[("noise: ", {"noise": noise}) for noise in (-1.0, np.nan, [0.1, 0.1])],
    ("dt: ", {"dt": 0.0}),
    ("bounds: ", {"bounds": (2.0, 1.0)}),
    ("bounds: the first guess of 'a'", {"bounds": (2.0, 3.0)}),
    ("bounds: 'c' is no parameter", {"bounds": {"c": (0, 1)}}),
    ("regularization: ", {"regularization": "L2"}),
    ("regularization: ", {"velocity": speed(), "regularization": "H1"}),
    ("weight: there is no seminorm", {"weight": 1.0}),
    ("weight: ", {"weight": "gcv", "regularization": "H1"}),
    ("weight: ", {"weight": -1.0, "regularization": "H1"}),
    ("max_runs: ", {"max_runs": 0}),
    ("max_runs: expected a positive number, got inf", {"max_runs": np.inf}),
    ("limiter: ", {"limiter": "clamp"}),
    ("max_runs: the est", {"data": {0.2: np.roll(SEEN, 10)}, "noise": 1e-3, "max_runs": 2}),
]
LON, LAT = np.arange(16) / 16, np.linspace(1, 0, 13)
SECONDS = np.arange(4).astype("datetime64[s]").astype("datetime64[ns]")
PLACES, NO_TIME = np.ones((13, 16)), np.datetime64("NaT", "s")


def blown(change=lambda d: d, **more):
    """A velocity from a changed dataset, or by changed arguments."""
    xarray = pytest.importorskip("xarray")
    u, dims = 0.3 + 0 * LAT[:, None] * LON + np.zeros((4, 1, 1)), ("time", "lat", "lon")
    data = {"u10": (dims, u), "v10": (dims, 0.1 * u)}
    data = xarray.Dataset(data, {"time": SECONDS, "lat": LAT, "lon": LON})
    names = {"components": ("u10", "v10"), "axes": ("lon", "lat")}
    return Velocity.from_xarray(change(data), **(names | more))


def dated(times=SECONDS[:2], since=None):
    """Sensors from a dataset, whose times are seconds where None is given."""
    pytest.importorskip("xarray")
    data = Sensors([0.2, 0.7], [0.0, 90.0], np.ones((2, 2)), 0.1).to_xarray()
    return Sensors.from_xarray(data if times is None else data.assign_coords(t=times), since)


DATASETS = [
    ("winds: expected an xarray.Dataset, got DataArray", lambda: blown(lambda d: d["u10"])),
    ("winds: the dataset has no 'u10'; it has", lambda: blown(lambda d: d.rename(u10="u"))),
    (r"winds: 'u10' has the dimensions \('level'", lambda: blown(lambda d: d.expand_dims("level"))),
    ("arrays: NaN or infinity in snapshot 0, component 0",
     lambda: blown(lambda d: d.where(d.lat < 1))),
    ("winds: 'u10': expected real values instead of complex128", lambda: blown(lambda d: d * 1j)),
    ("winds: 'u10': expected real values instead of <U", lambda: blown(lambda d: d.astype(str))),
    ("winds: 'lon': expected real values instead of <U1",
     lambda: blown(lambda d: d.assign_coords(lon=list("abcdefghijklmnop")))),
    (r"winds: the coordinate 'lat' has the dimensions \('lat', 'lon'\), expected lat alone",
     lambda: blown(lambda d: d.drop_vars("lat").assign_coords(lat=(("lat", "lon"), PLACES)))),
    ("winds: 'time' holds object, expected numbers, datetime64 or timedelta64",
     lambda: blown(lambda d: d.assign_coords(time=[date(2020, 1, n) for n in (1, 2, 3, 4)]))),
    ("winds: 'lat' is in degrees, 'u10' in m/s",
     lambda: blown(lambda d: d.assign(u10=d.u10.assign_attrs(units="m/s")).assign_coords(
         lat=d.lat.assign_attrs(units="degrees_north")))),
    ("winds: 'lat' is in degrees, 'u10' in no unit",
     lambda: blown(lambda d: d.assign_coords(lat=d.lat.assign_attrs(units="degrees_north")))),
    ("winds: 'lon' is in km, 'u10' in m s-1; convert",
     lambda: blown(lambda d: d.assign(u10=d.u10.assign_attrs(units="m s-1")).assign_coords(
         lon=d.lon.assign_attrs(units="km")))),
    ("periodic: expected True or False, or one for each of",
     lambda: blown(periodic=(True, True, False))),
    ("periodic: expected True or False, .* got 'no'", lambda: blown(periodic="no")),
    ("periodic: expected True or False", lambda: blown(periodic={"lon": True})),
    ("components: expected a sequence of names, got 'uv'", lambda: blown(components="uv")),
    ("components: expected a sequence of names, got None", lambda: blown(components=None)),
    ("axes: expected names", lambda: blown(axes=([1], "lat"))),
    *rows("since: expected a date", lambda v: dated(since=v), "noon", 12, NO_TIME),
    ("since: dataset: 't' holds float64, no dates", lambda: dated(None, "2010-05-04")),
    ("times: expected finite, increasing times", lambda: dated([SECONDS[0], NO_TIME])),
    ("'t' holds object.*convert dates of other calendars", lambda: dated(["noon", datetime.now])),
]  # fmt: skip
TRIANGLES, PIECES = skfem.MeshTri().refined(2), skfem.ElementTriP1()
FLOW, STREAM = (skfem.Basis(TRIANGLES, e) for e in (skfem.ElementVector(PIECES), PIECES))
UNIT = Grid([(0, 1)] * 2, (8, 8))


def meshed(basis=FLOW, u=None, grid=UNIT, **more):
    """A velocity at rest from a solution."""
    return Velocity.from_basis(basis, np.zeros(basis.N) if u is None else u, grid, **more)


MESHES = [
    ("basis: expected a skfem.Basis of cells, got int", lambda: meshed(3, [0.0])),
    ("basis: expected a skfem.Basis of cells, got FacetBasis",
     lambda: meshed(skfem.FacetBasis(TRIANGLES, skfem.ElementVector(PIECES)))),
    ("basis: expected one of the whole mesh", lambda: meshed(FLOW.with_elements([0, 1]))),
    (r"basis: .* a vector of 2 .* shape \(\); a stream", lambda: meshed(STREAM)),
    (r"basis: .* a scalar, the stream .* \(2,\)$", lambda: meshed(stream=True)),
    ("u: expected the coefficients of the basis", lambda: meshed(u=np.zeros(3))),
    (r"u: .* shape \(times, 50\)", lambda: meshed(u=np.zeros(50), times=[0.0, 1.0])),
    ("u: expected finite coefficients", lambda: meshed(u=np.full(50, np.nan))),
    ("grid: expected a Grid", lambda: meshed(grid=8)),
    ("grid: it has 1 directions, the mesh 2", lambda: meshed(grid=Grid((0, 1), 8))),
    (r"grid: 9 of its nodes lie outside the mesh, the first at \(1.125, 0\).*outside='land'",
     lambda: meshed(grid=Grid([(0, 1.125), (0, 1)], (9, 8)))),
    ("grid: none of its nodes", lambda: meshed(grid=Grid([(2, 3)] * 2, (8, 8)), outside="land")),
    ("outside: expected None or 'land'", lambda: meshed(outside="sea")),
    ("stream=1: expected True or False", lambda: meshed(stream=1)),
    ("stream: expected a grid in the plane with 6 cells",
     lambda: meshed(STREAM, grid=Grid([(0, 1)] * 2, (4, 4)), stream=True)),
    ("times: a stream function is of one time",
     lambda: meshed(STREAM, np.zeros((2, 25)), times=[0, 1], stream=True)),
    ("velocity: it was sampled on", lambda: Solver(Grid([(0, 1)] * 2, (9, 9)), meshed())),
]  # fmt: skip
TABLES = {
    "mesh": MESHES,
    "grid": GRIDS, "sphere": SPHERES, "velocity": VELOCITIES, "solver": SOLVERS, "state": STATES,
    "run": RUNS, "source": SOURCES,
    "splines": SPLINES, "sensors": SENSORS, "assimilation": ASSIMILATION,
    "identification": [(words, partial(identified, **more)) for words, more in IDENTIFICATION],
    "dataset": DATASETS,
    "derivatives": DERIVATIVES, "fields": NAMED,
}  # fmt: skip
# What is no InputError, by the words of the message.
OTHERS = dict.fromkeys([words for words, _ in NO_DERIVATIVES], cip.NotSupported) | {
    "land: .* take 'csl2' or 'csl4'": cip.NotSupported,
    "boundary: closed walls .* take 'csl2'": cip.NotSupported,
    "diffusion: it would cross land": cip.NotSupported,
    "boundary: with splitting 'cubic' needs constant data on the wall x-": cip.NotSupported,
    "derivatives are of one field": cip.NotSupported,
    "start: derivatives are of one field": cip.NotSupported,
    "run: readings are of one field": cip.NotSupported,
    "decay: with splitting the data of the wall x- must": cip.NotSupported,
    "not linear in its moments": cip.NotSupported,
    "limiter: ": cip.NotSupported,
    "max_runs: the est": cip.NotConverged,
    "max_iterations: after 2 combinations": cip.NotConverged,
}


@pytest.mark.parametrize(
    ("words", "call"),
    [
        pytest.param(*row, id=f"{name} {q}: {row[0]}")
        for name, table in TABLES.items()
        for q, row in enumerate(table)
    ],
)
def test_errors_name_the_argument(words, call):
    with pytest.raises((InputError, OTHERS.get(words, InputError)), match=words):
        call()


def test_files_that_are_no_results(tmp_path):
    path = tmp_path / "found.json"
    for words in ('{"format": "identified velocity 1"}', "[]", "{}"):
        path.write_text(words)
        with pytest.raises(InputError, match="path: "):
            cip.IdentifiedVelocity.load(path, SPEED)
        with pytest.raises(InputError, match="no file of sensors"):
            Sensors.load(path)


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_other_real_numbers_are_taken(kind):
    values = np.array([0, 1, 1, 0, 1, 0, 0, 1], dtype=kind)
    found = State.from_function(values.astype(float), LINE)["u"]
    np.testing.assert_array_equal(State.from_function(values, LINE)["u"], found)
    (made,) = Solver(LINE, [values]).velocity.on(LINE)
    at_nodes = made.derivative((0, 0, 0, 0), (1.0,) * 4)(LINE.coordinates[0], 0.0, 0.0, 0.0)
    np.testing.assert_allclose(at_nodes, values, atol=1e-12)


FULL = Grid((0, 4), 10, periodic=True)
NOT_FINITE = [
    (r"node \(0,\) at \(0\) at t = 2.05 .*'x-' at \(0\)", cip.LeftDomain,
     lambda: Solver(OPEN, 1.0).step(Solver(OPEN, 1.0).state(wave, t=2.0), 0.05)),
    (r"velocity: it is \(nan, .*\) at lon = .*, lat = .* at t = 0.1", NotFinite,
     lambda: stirred(lambda lon, lat: (np.sqrt(lat - 1), lon))),
    ("boundary data", NotFinite, lambda: moved(1.0, OPEN, {"x-": lambda x, t: np.sqrt(t - 1)})),
    (r"node \(\d+,\) at \(.*\) is not finite at t = ", NotFinite,
     lambda: moved(Velocity(lambda x: np.exp(x**8)), FULL)),
    (r"node \(\d,\).* goes more than 1e.09 cells", NotFinite, lambda: moved(text("1e25"))),
    (r"node \(\d,\).* goes more than 1e.09 cells", NotFinite,
     lambda: moved(text("1e25*sin(2*pi*x1)"))),
    # Python would raise at 1 / t for its own number t = 0.
    ("at t = 0 ", NotFinite, lambda: moved(text("1/t"))),
    (r"boundary: .* wall 'x-'", cip.LeftDomain, lambda: moved(ones(OPEN), OPEN)),
]  # fmt: skip


@pytest.mark.parametrize(("words", "error", "call"), NOT_FINITE)
def test_what_happens_on_the_way_names_node_time_and_wall(words, error, call):
    with pytest.raises(error, match=words):
        call()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formula", "words"), [("sqrt(0.3 - t)", r"is not finite at t = "), ("1e25*t", "1e.09 cells")]
)
@pytest.mark.parametrize("dim", [1, 2])
def test_unsteady_velocity_that_overflows_later(formula, words, dim):
    """In the kernels that compute the feet too, and at the step where it happens."""
    grid = Grid((0, 1), (8,) * dim, periodic=True)
    solver = Solver(grid, text(*(formula, "0")[:dim]))
    with pytest.raises(NotFinite, match=words) as caught:
        solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.03, snapshots=10)
    assert caught.value.trajectory.final.t <= 0.3


def test_field_that_overflows_keeps_what_was_computed():
    """Compression by exp(10) a unit of time: float64 overflows before t = 100."""
    solver = Solver(Grid((-1, 1), 8), Velocity(lambda x: -10 * x), "advection", boundary=1.0)
    with pytest.raises(NotFinite, match="moment") as caught:
        solver.run(solver.state(1.0), 100.0, dt=1.0, snapshots=100)
    assert len(caught.value.trajectory) > 10
