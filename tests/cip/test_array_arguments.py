"""Arrays that come in, of every public argument: masks are seen, later changes change nothing."""

import inspect
import re
from functools import partial

import numpy as np
import pytest
import skfem
from hypothesis import given
from hypothesis import strategies as st

import cip
from cip import Covariance, Grid, Sensors, Solver, Source, State, Velocity, identify_velocity

LINE, PLANE = Grid((0, 1), 8, periodic=True), Grid([(0, 1), (0, 2)], (8, 6), periodic=True)
RNG = np.random.default_rng(5)
NODAL, FIELD = 1.0 + RNG.random(8), 1.0 + RNG.random((8, 6))
WINDS = 1.0 + RNG.random((3, 2, 8, 6))
TIMES = np.array([0.0, 0.5, 1.0])
POINTS = RNG.random((2, 4))
REPORTS = RNG.random((3, 4))


def values(thing, grid=PLANE):
    """What a velocity or a source is at some points and a time, asked for later."""

    def found():
        made = thing.on(grid)
        point = [*POINTS[: grid.dim], *([np.zeros(())] * (3 - grid.dim)), 0.3]
        of = made if isinstance(made, tuple) else (made,)
        return np.stack([one.derivative((0, 0, 0, 0), (1.0,) * 4)(*point) for one in of])

    return found


def of_solver(name, value):
    more = {"velocity": (1.0, 0.5), name: value}
    return values(getattr(Solver(PLANE, **more), name))


def attributes(thing, *names):
    return lambda: np.concatenate([np.ravel(getattr(thing, name)) for name in names])


def sensors(**more):
    kinds = {"points": POINTS, "times": TIMES, "values": REPORTS, "deviations": 1.0} | more
    return attributes(Sensors(**kinds), "points", "times", "values", "deviations")


def identified(grid=LINE, texts=("a",), **more):
    velocity = Velocity.from_expression(*texts, parameters={"a": 1.0})
    solver = Solver(grid, velocity)
    start = solver.state("sin(2*pi*x1)")
    seen = Solver(grid, velocity.with_parameters(a=1.2)).run(start, 0.1, dt=0.05).final["u"]
    kinds = {"data": {0.1: seen}, "dt": 0.05, "noise": 0.01} | more
    return lambda: np.array([identify_velocity(solver, start, **kinds).parameters["a"]])


def observed(value):
    solver = Solver(LINE, 1.0)
    found = solver.run(solver.state("x1"), 0.1, dt=0.05).sample(value)
    return lambda: found


def placed(value):
    solver = Solver(LINE, 1.0)
    B = Covariance.diffusion(LINE, "cubic", deviation=1.0, length=0.15)
    plan = Sensors([0.1, 0.35, 0.6], [0.1], deviations=0.1)
    found = cip.place_sensors(solver, solver.state(0.0), B, plan, budget=1, dt=0.05, excluded=value)
    return lambda: np.array(found.chosen)


def ran(value):
    solver = Solver(LINE, 1.0)
    return lambda: solver.run(solver.state("x1"), 1.0, dt=0.25, snapshots=value).times


BALL, BREEZE = cip.Sphere(8, 4), 0.05 * RNG.random((2, 8, 4))


def ball_run(**more):
    solver = cip.SphereSolver(BALL, BREEZE, foot_tolerance=1e-3)
    return solver.run(solver.state(lambda lon, lat: np.sin(lat)), 1.0, dt=0.5, **more)


def round_ball(value):
    return lambda: ball_run(snapshots=value).times


def round_fed(**more):
    solver = cip.SphereSolver(BALL, BREEZE, foot_tolerance=1e-3, **more)
    return lambda: solver.step(solver.state(1.0), 0.5).data


def gauged(value):
    solver = Solver(LINE, 1.0)
    run = solver.run(solver.state("x1"), 0.1, dt=0.05, gauges=value)
    return attributes(run.gauges, "points", "values")


def tangent(value):
    solver = Solver(LINE, 1.0)
    run = solver.run(solver.state("x1"), 0.1, dt=0.05)
    return lambda: solver.tangent(run).matvec(value)


SEEN = np.sin(2 * np.pi * (LINE.coordinates[0] - 0.12))
TIMES6 = np.linspace(0.0, 1.0, 6) ** 2
ROOT = Covariance.diffusion(LINE, "cubic", deviation=1.0, length=0.15).root @ np.eye(8)


def along(k):
    """The k-th coordinates of a grid of uneven lines."""
    return lambda v: (lambda g: lambda: g.coordinates[k])(Grid.from_coordinates(*[TIMES6] * k, v))


def held(make, name="deviations"):
    return lambda v: attributes(make(v), name)


def waves(v):
    return Covariance.patterns([State.from_function(f, LINE) for f in "xt"], v)


def rooted(v):
    covariance = Covariance(LINE, "cubic", v, NODAL)
    return lambda: covariance.root @ np.eye(8)


def numbers(v):
    velocity = cip.SplineVelocity(LINE, 6, v)
    return lambda: list(velocity.parameters.values())


def winds(times, arrays):
    return values(Velocity.from_snapshots(times, arrays, PLANE, 3))


MESHED = skfem.Basis(
    skfem.MeshQuad().refined(1).scaled([1, 2]), skfem.ElementVector(skfem.ElementQuad1())
)  # of 18 coefficients


def flowing(u, times=None):
    return values(Velocity.from_basis(MESHED, u, PLANE, times=times))


def emitted(times, arrays):
    return values(Source.from_snapshots(times, arrays, PLANE, 3))


# For each argument a value and what is made of it, as a function that is called later.
TWO, SIDES = np.array([0.2, 0.3]), np.array([True, False])
THREE, diffusion = np.array([True, False, True, True]), Covariance.diffusion
bent = partial(Grid.from_coordinates, TIMES6, TIMES6)
sea = partial(Solver, LINE, 1.0, "advection", "csl2")
splines = partial(cip.SplineVelocity, degree=3)
TAKE = {
    "Covariance root": (ROOT, rooted),
    "Covariance deviations": (NODAL, held(lambda v: Covariance(LINE, "cubic", ROOT, v))),
    "Covariance.diffusion deviation": (NODAL, held(lambda v: diffusion(LINE, "cubic", v, 0.2))),
    "Covariance.diffusion length": (TWO, held(lambda v: diffusion(PLANE, "bicubic", 1.0, v))),
    "Covariance.patterns deviations": (TWO, held(waves)),
    "Grid bounds": (np.array([0.0, 1.0]), held(lambda v: Grid(v, 8), "bounds")),
    "Grid shape": (np.array([8, 6]), held(lambda v: Grid((0, 1), v), "cells")),
    "Grid periodic": (SIDES, held(lambda v: Grid((0, 1), (8, 6), v), "periodic")),
    "Grid.from_coordinates x": (TIMES6, along(0)),
    "Grid.from_coordinates y": (TIMES6, along(1)),
    "Grid.from_coordinates z": (TIMES6, along(2)),
    "Grid.from_coordinates periodic": (SIDES, held(lambda v: bent(periodic=v), "periodic")),
    "Sensors points": (POINTS, lambda v: sensors(points=v)),
    "Sensors times": (TIMES, lambda v: sensors(times=v)),
    "Sensors values": (REPORTS, lambda v: sensors(values=v)),
    "Sensors deviations": (1.0 + REPORTS, lambda v: sensors(deviations=v)),
    "Sensors.with_values values": (REPORTS, held(Sensors(POINTS, TIMES).with_values, "values")),
    "Sensors.at chosen": (THREE, held(Sensors(POINTS, TIMES).at, "points")),
    "Solver velocity": (FIELD, lambda v: of_solver("velocity", [v, 1.0])),
    "Solver source": (FIELD, lambda v: of_solver("source", v)),
    "Solver decay": (FIELD, lambda v: of_solver("decay", v)),
    "Solver land": (NODAL.mean() < NODAL, held(lambda v: sea(land=v), "land")),
    "Solver diffusion": (TWO, held(lambda v: Solver(PLANE, (1.0, 0.5), diffusion=v), "diffusion")),
    "Solver bounds": (np.array([0.0, 2.0]), held(lambda v: Solver(LINE, 1.0, bounds=v), "bounds")),
    "Solver.run snapshots": (np.array([0.3, 0.6]), ran),
    "Solver.run gauges": (POINTS[0], gauged),
    "Solver.state f": (NODAL, held(lambda v: Solver(LINE, 1.0).state(v), "data")),
    "Source s": (FIELD, lambda v: values(Source(v))),
    "Source.from_snapshots times": (TIMES, lambda v: emitted(v, WINDS[:, 0])),
    "Source.from_snapshots arrays": (WINDS[:, 0], lambda v: emitted(TIMES, v)),
    "SplineVelocity pieces": (np.array([4, 5]), held(lambda v: splines(PLANE, v), "names")),
    "SplineVelocity start": (NODAL, numbers),
    "SphereSolver velocity": (BREEZE, held(lambda v: cip.SphereSolver(BALL, v), "velocity")),
    "SphereSolver bounds": (
        np.array([0.0, 2.0]), held(lambda v: cip.SphereSolver(BALL, BREEZE, bounds=v), "bounds"),
    ),
    "SphereSolver.state f": (BREEZE[0], held(cip.SphereSolver(BALL, BREEZE).state, "data")),
    "SphereSolver.run snapshots": (np.array([0.3, 0.6]), round_ball),
    "SphereSolver.run gauges": (POINTS[:, :2], lambda v: attributes(
        ball_run(gauges=v).gauges, "points", "values")),
    "SphereSolver source": (BREEZE[0], lambda v: round_fed(source=v)),
    "SphereSolver decay": (np.abs(BREEZE[0]), lambda v: round_fed(decay=v)),
    "SphereSolver diffusion": (
        np.array([0.2]), held(lambda v: cip.SphereSolver(BALL, BREEZE, diffusion=v), "diffusion"),
    ),
    "State data": (ROOT[:, 0].reshape(2, 8), held(lambda v: State(LINE, "cubic", v), "data")),
    "State.from_function f": (NODAL, held(lambda v: State.from_function(v, LINE), "data")),
    "Trajectory.sample points": (POINTS[0], observed),
    "Velocity c": (FIELD, lambda v: values(Velocity([v, 1.0]))),
    "Velocity c of all": (WINDS[0], lambda v: values(Velocity(v))),
    "Velocity c on a line": (NODAL, lambda v: values(Velocity(v), LINE)),
    "Velocity.from_snapshots times": (TIMES, lambda v: winds(v, WINDS)),
    "Velocity.from_snapshots arrays": (WINDS, lambda v: winds(TIMES, v)),
    "Velocity.from_basis u": (MESHED.project(lambda x: 1 + 0 * x), flowing),
    "Velocity.from_basis times": (TIMES, lambda v: flowing(np.zeros((TIMES.size, 18)), v)),
    "identify_velocity data": (SEEN, lambda v: identified(data={0.1: v})),
    "identify_velocity data in the plane": (
        np.tile(SEEN[:, None], 6), lambda v: identified(PLANE, ("a", "0"), data={0.1: v}),
    ),
    "identify_velocity noise": (np.array([0.02]), lambda v: identified(noise=v)),
    "identify_velocity bounds": (np.array([0.5, 2.0]), lambda v: identified(bounds=v)),
    "place_sensors excluded": (np.array([True, False, False]), placed),
    "a vector of the tangent": (ROOT[:, 0], tangent),
}  # fmt: skip
# Only arrays of NumPy are taken: a list is none, or a mask in it is lost before it is ours.
ARRAYS_ONLY = {"Solver.state f", "State.from_function f", "State data", "a vector of the tangent"}
ARRAYS_ONLY |= {"SplineVelocity start"}  # a list has one entry for each component
READ_ONCE = {
    "a vector of the tangent",
    "Solver.run snapshots",
    "SphereSolver.run snapshots",
}  # during the call alone
READ_ONCE |= {name for name in TAKE if name.startswith("identify_velocity")}
MISSING = {"Sensors values", "Sensors.with_values values"}
MISSING |= {name for name in TAKE if name.startswith("identify_velocity data")}
# They take no arrays of numbers, or hold what functions of the package have computed.
NONE = """
    Covariance.patterns states | Grid.index_displacement .* | IdentifiedVelocity.plot ax
    | (Analysis|Budget|Diagnostics|Identifiability|IdentifiedVelocity|Placement) [a-z0-9_]+
    | FlowMap [a-z0-9_]+ | FlowMap.plot ax | flow_map velocity
    | Sensors.from_xarray .* | Solver boundary | Solver.run (callback|save)
    | Solver.state derivatives
    | (Sphere)?Solver reactions | SphereSolver.run (callback|save) | State grid
    | Source.of value | SplineVelocity.from_.* | State.from_function derivatives
    | Trajectory(.plot .*|.load .*|.to_xarray start| gauges) | Trajectory _budget
    | Velocity.from_basis basis
    | Velocity (jacobian|hessian) | Velocity.from_xarray .*
    | (four_d_var|place_sensors) model_error | identify_velocity start
"""


def test_every_argument_of_the_package_is_here():
    pattern = re.compile("|".join(one.strip() for one in NONE.split("| ")))
    unknown = []
    for name in cip.__all__:
        thing = getattr(cip, name)
        calls = {name: thing}
        if inspect.isclass(thing):
            if issubclass(thing, Exception):
                continue
            public = inspect.getmembers(thing, callable)
            calls |= {f"{name}.{k}": v for k, v in public if k[0] != "_"}
        for call, function in calls.items():
            for one in inspect.signature(function).parameters.values():
                kinds = r"ArrayLike|Array\b|Any\b|Sequence|ndarray"
                label = f"{call} {one.name}"
                known = label in TAKE or pattern.fullmatch(label)
                if re.search(kinds, str(one.annotation)) and not known:
                    unknown.append(label)
    assert unknown == []


def nested(array, kind, masked):
    """The array with one entry masked, as lists of arrays, of lists, or as one array."""
    if kind == "array":
        return masked
    if kind == "objects":
        found = np.array(array.tolist(), dtype=object)
        found[np.unravel_index(np.argmax(np.ma.getmaskarray(masked)), array.shape)] = np.ma.masked
        return found
    outer = list if kind != "tuples" else tuple
    if array.ndim == 1:
        hidden = np.ma.getmaskarray(masked)
        return outer(np.ma.masked if h else v for v, h in zip(array.tolist(), hidden, strict=True))
    if kind == "arrays":
        return list(masked)
    return outer(nested(a, kind, m) for a, m in zip(array, masked, strict=True))


FILL = 9.96921e36  # netCDF's


def with_a_mask(array, at, kind):
    filled = np.array(array)
    filled.flat[at] = True if filled.dtype == bool else FILL if filled.dtype == float else 4
    mask = np.zeros(array.shape, dtype=bool)
    mask.flat[at] = True
    return nested(filled, kind, np.ma.array(filled, mask=mask))


@pytest.mark.filterwarnings("ignore::cip.MisfitWarning", "ignore::cip.IdentifiabilityWarning")
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (name, kind)
        for name in TAKE
        for kind in ("array", "arrays", "lists", "tuples", "objects")
        if kind == "array" or name not in ARRAYS_ONLY
    ],
)
def test_no_mask_is_dropped(name, kind):
    array, take = TAKE[name]
    for at in (0, array.size - 1):
        value = with_a_mask(array, at, kind)
        if name not in MISSING:
            with pytest.raises(cip.InputError, match="mask"):
                take(value)()
            continue
        found = take(value)()
        if "Sensors" in name:
            gap = np.array(array)
            gap.flat[at] = np.nan
            np.testing.assert_array_equal(found, take(gap)())
            continue
        other = np.array(array)
        other.flat[at] = -7.0  # what lies below a mask tells nothing
        mask = np.arange(array.size).reshape(array.shape) == at
        np.testing.assert_array_equal(found, take(np.ma.array(other, mask=mask))())


@pytest.mark.parametrize("name", [name for name in TAKE if name not in READ_ONCE])
def test_what_the_caller_does_later_changes_nothing(name):
    array, take = TAKE[name]
    for make in (np.array, lambda a: np.array(a).view(np.ma.MaskedArray)):
        given = make(array)
        later = take(given)
        given[...] = True if given.dtype == bool else 3
        found, expected = later(), take(array)()
        if np.asarray(found).dtype.kind == "U":
            assert list(found) == list(expected)
        else:
            np.testing.assert_array_equal(found, expected)


def test_lists_of_arrays_and_boundaries_are_the_solvers_own():
    """The list itself, the arrays in it, and the walls of a dict."""
    parts = [np.array(FIELD), 1.0]
    velocity = Velocity(parts)
    expected = values(Velocity([FIELD, 1.0]))()
    parts[0][...], parts[1] = 7.0, 5.0
    np.testing.assert_array_equal(values(velocity)(), expected)
    walls = {"x-": 1.0}
    solver = Solver(
        Grid((0, 1), 8), Velocity.from_expression("a", parameters={"a": 1.0}), boundary=walls
    )
    walls["x-"] = 9.0
    end = solver.with_parameters(a=1.0).step(solver.state(1.0), 0.2)
    np.testing.assert_allclose(end["u"], 1.0, rtol=0, atol=1e-14)


def test_a_run_keeps_its_own_start():
    solver = Solver(LINE, 1.0)
    start = solver.state(NODAL)
    run = solver.run(start, 0.1, dt=0.05)
    before = run[0].data.copy()
    start.data[...] = 3.0
    np.testing.assert_array_equal(run[0].data, before)
    assert solver.tangent(run).shape == (16, 16)


NUMBERS = st.floats(-1e3, 1e3)


@given(st.data())
def test_the_door(data):
    """Nested lists, tuples and arrays in any mixture: the values and masks of each entry."""
    from skfem_adini.ground.arguments import masked_array

    shape = data.draw(st.lists(st.integers(1, 3), min_size=1, max_size=3))
    size = int(np.prod(shape))
    values = data.draw(st.lists(NUMBERS, min_size=size, max_size=size))
    hidden = data.draw(st.lists(st.booleans(), min_size=len(values), max_size=len(values)))
    values, hidden = np.reshape(values, shape), np.reshape(hidden, shape)

    def wrapped(array, mask):
        kind = data.draw(st.sampled_from(["array", "list", "tuple", "objects"]))
        if kind == "array":
            return np.ma.array(array, mask=mask) if mask.any() else array
        if array.ndim == 0:
            return np.ma.masked if mask else float(array)
        rows = [wrapped(a, m) for a, m in zip(array, mask, strict=True)]
        if kind == "objects" and array.ndim == 1:
            found = np.empty(len(rows), dtype=object)
            found[:] = [np.ma.masked if m else float(a) for a, m in zip(array, mask, strict=True)]
            return found
        return tuple(rows) if kind == "tuple" else rows

    found, where = masked_array("data", wrapped(values, hidden))
    assert found.shape == values.shape
    np.testing.assert_array_equal(found[~hidden], values[~hidden])
    np.testing.assert_array_equal(np.zeros(shape, bool) if where is None else where, hidden)


def test_missing_values_of_pandas():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(REPORTS).astype("Float64")
    frame.iloc[1, 2] = pandas.NA
    gap = np.array(REPORTS)
    gap[1, 2] = np.nan
    for value in (frame, [list(row) for row in frame.itertuples(index=False)]):
        np.testing.assert_array_equal(sensors(values=value)(), sensors(values=gap)())
    with pytest.raises(cip.InputError, match="points"):
        sensors(points=pandas.Series([0.5, pandas.NA, 0.1], dtype="Float64"))


def test_missing_values_of_xarray():
    xarray = pytest.importorskip("xarray")
    hidden = np.ma.masked_equal(np.where(FIELD[1, 2] == FIELD, FILL, FIELD), FILL)
    with pytest.raises(cip.InputError, match="node"):
        values(Velocity([xarray.DataArray(hidden), 1.0]))()
    with pytest.raises(cip.InputError, match="node"):
        values(Source(xarray.DataArray(hidden)))()
