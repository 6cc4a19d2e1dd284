"""Velocities from snapshots and of B-splines against polynomials, SciPy and closed forms."""

import pickle
import tracemalloc
from itertools import product

import numpy as np
import pytest
from compilations import compilations
from convergence import order
from schemes import form_of, sampled
from scipy.integrate import solve_ivp
from scipy.interpolate import RectBivariateSpline, make_interp_spline

from cip import Grid, InputError, NotSupported, Solver, SplineVelocity, Velocity

SLOW = pytest.mark.slow
UNEVEN = [0.0, 0.07, 0.2, 0.31, 0.45, 0.5, 0.62]
# Cubic in time and in space, so the splines of either degree are exact where nothing is periodic.
POLYNOMIALS = [
    "0.3 + 0.2*x1*{y}*(1 - 2*t) + 0.5*x1**3*t**3 - 0.1*{y}**2*t",
    "0.1*x1**2 - 0.3*{y}*t**2 + 0.2*x1*{y}**3",
    "0.2*{y}**3*t - 0.1*x1*x3",
]


def polynomials(dim):
    return [text.format(y="x2" if dim > 1 else "1") for text in POLYNOMIALS[:dim]]


def jittered(dim, n=9):
    lines = [np.linspace(0, 1 + 0.2 * q, n) for q in range(dim)]
    return Grid.from_coordinates(
        *(line + 0.01 * np.sin(9 * line * (line[-1] - line)) for line in lines)
    )


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_polynomials_and_all_their_derivatives_are_exact(dim, degree):
    grid = jittered(dim)
    exact = Velocity.from_expression(*polynomials(dim))
    found = Velocity.from_snapshots(UNEVEN, sampled(exact, UNEVEN, grid), grid, degree)
    rng = np.random.default_rng(3)
    point = [rng.uniform(0, 1, 20) if q < dim else np.zeros(20) for q in range(3)]
    time = rng.uniform(0, 0.62, 20)
    steps = (1.0,) * 4
    for one, other in zip(found.on(grid), exact.on(grid), strict=True):
        for orders in product(
            range(3), range(3 if dim > 1 else 1), range(2 if dim > 2 else 1), (0, 1)
        ):
            value = one.derivative(orders, steps)(*point, time)
            expected = other.derivative(orders, steps)(*point, time)
            # Rounding of second derivatives in both directions: h^-4 epsilon.
            np.testing.assert_allclose(value, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "degree", "slope"),
    [*[(0, d, k) for d in (3, 5) for k in (0, 1, 2)], (3, 3, 0), (3, 3, 1)],
)
def test_orders_in_space_and_time(axis, degree, slope):
    sizes, errors = (20, 40, 80), []
    places = np.random.default_rng(0).uniform(0.2, 0.8, 400)
    for n in sizes:
        grid = Grid((0, 1), n if axis == 0 else 8, periodic=True)
        times = np.linspace(0, 1, 2 if axis == 0 else n + 1)
        x, t = (grid.coordinates[0], 0.0) if axis == 0 else (0.0, times[:, None])
        values = np.sin(2 * np.pi * (x + t)) * np.ones((times.size, grid.size))
        (c,) = Velocity.from_snapshots(times, values, grid, degree).on(grid)
        orders, point = [0, 0, 0, 0], [0.3, 0.0, 0.0, 0.4]
        orders[axis], point[axis] = slope, places
        found = c.derivative(tuple(orders), (1.0,) * 4)(*point)
        exact = (2 * np.pi) ** slope * np.sin(2 * np.pi * places + slope * np.pi / 2)
        errors.append(np.abs(found - exact).max())
    assert degree + 1 - slope - 0.2 <= order(sizes, errors) <= degree + 1 - slope + 0.4


@pytest.mark.parametrize(("count", "power"), [(2, 1), (3, 2), (4, 3)])
def test_few_snapshots_are_one_polynomial_in_time(count, power):
    grid, times = Grid((0, 1), 8), np.linspace(0, 2, count)
    values = [np.full(9, t**power - t) for t in times]
    (c,) = Velocity.from_snapshots(times, values, grid).on(grid)
    t = np.linspace(0, 2, 17)
    np.testing.assert_allclose(
        c.derivative((0,) * 4, (1.0,) * 4)(0.3, 0, 0, t), t**power - t, atol=1e-13
    )


CASES = [
    (1, "cubic", "transport", 5),
    pytest.param(1, "csl4", "advection", 5, marks=SLOW),
    pytest.param(1, "quintic", "advection", 5, marks=SLOW),
    (2, "bicubic", "transport", 5),
    pytest.param(2, "adini", "advection", 3, marks=SLOW),
    pytest.param(2, "bicubic", "advection", 5, marks=SLOW),
    pytest.param(3, "cubic", "transport", 5, marks=SLOW),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("dim", "profile", "form", "degree"), CASES)
def test_the_run_is_that_of_the_polynomials_formula(dim, profile, form, degree):
    """Inflow and outflow, compiled and not; the steps cross the times of the snapshots."""
    data = jittered(dim)
    exact = Velocity.from_expression(*polynomials(dim))
    found = Velocity.from_snapshots(UNEVEN, sampled(exact, UNEVEN, data), data, degree)
    # A part of the box that the snapshots cover.
    grid = Grid([(0.1, 0.9)] * dim, (10,) * dim)
    ends = []
    for velocity in (found, exact):
        solver = Solver(grid, velocity, form, profile, boundary=0.0, foot_tolerance=1e-8)
        run = solver.run(solver.state("exp(-9*(x1-0.5)**2)"), 0.6, dt=0.15)
        ends.append(run.final.data)
    # Both feet have errors up to 1e-8 cells, their second derivatives more.
    scale = np.abs(ends[1]).max(axis=tuple(range(1, dim + 1)), keepdims=True)
    assert np.max(np.abs(ends[0] - ends[1]) / scale) < 1e-6


@pytest.mark.sampled(4)
@pytest.mark.parametrize("store", [True, False])
@pytest.mark.parametrize("degree", [5, pytest.param(3, marks=SLOW)])
def test_steps_across_snapshots_against_an_ode_solver(store, degree):
    """A step over two snapshots: the new values are those at feet that DOP853 finds."""
    data, times = Grid((-1, 2), 40), np.linspace(0, 1, 6)
    wind = np.array([0.5 + 0.3 * np.sin(2 * data.coordinates[0] + 4 * t) for t in times])
    spline = RectBivariateSpline(times, data.coordinates[0], wind, kx=3, ky=degree)
    grid = Grid((0, 1), 32)
    velocity = Velocity.from_snapshots(times, wind, data, degree)
    solver = Solver(
        grid, velocity, boundary=0.0, store_feet=store, profile="quintic", foot_tolerance=1e-8
    )
    start = solver.state("sin(x1)")
    after = solver.step(start.__class__(grid, "quintic", start.data, 0.1), 0.45)
    x = grid.coordinates[0]
    back = solve_ivp(
        lambda t, y: spline.ev(t, y), (0.55, 0.1), x, method="DOP853", rtol=1e-11, atol=1e-12
    ).y[:, -1]
    inside = back > 0.0
    assert 15 < inside.sum() < 33
    # Feet to 1e-8 cells; the quintic's interpolation of the sine is far below.
    np.testing.assert_allclose(after["u"][inside], np.sin(back[inside]), rtol=0, atol=1e-9)


def test_new_data_compile_nothing():
    rng = np.random.default_rng(5)

    def end(velocity):
        solver = Solver(Grid((0, 1), 16, periodic=True), velocity)
        return solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.1).final.data

    def winds(n, times):
        grid = Grid((0, 1), n, periodic=True)
        return Velocity.from_snapshots(times, 0.1 * rng.uniform(size=(len(times), n)), grid)

    expected = end(winds(8, np.linspace(0, 1, 5)))
    with compilations() as names:
        other = end(winds(8, np.linspace(0, 1, 5)))
        end(winds(12, [0.0, 0.3, 0.4, 0.7, 0.8, 0.9]))
    assert names == []
    assert np.abs(other - expected).max() > 1e-3


@pytest.mark.turns(4)
def test_periods_of_the_data_repeat():
    """A solver over two periods of the snapshots, beginning elsewhere."""
    data = Grid((0, 1), 16, periodic=True)
    wind = [0.3 + 0.1 * np.sin(2 * np.pi * (data.coordinates[0] - t)) for t in (0, 0.5, 1)]
    velocity = Velocity.from_snapshots([0, 0.5, 1], wind, data)
    solver = Solver(Grid((-0.5, 1.5), 40, periodic=True), velocity)
    u = solver.run(solver.state("sin(2*pi*x1)"), 0.9, dt=0.1).final["u"]
    np.testing.assert_allclose(u[:20], u[20:], rtol=0, atol=1e-10)
    alone = Solver(Grid((-0.5, 0.5), 20, periodic=True), velocity)
    other = alone.run(alone.state("sin(2*pi*x1)"), 0.9, dt=0.1).final["u"]
    np.testing.assert_allclose(u[:20], other, rtol=0, atol=1e-8)


def test_winds_of_a_dataset_are_those_of_the_arrays():
    """With dates and falling latitudes."""
    xarray = pytest.importorskip("xarray")
    lon, lat, t = np.arange(16) / 16, np.linspace(1, 0, 13)[:, None], np.arange(4)
    first = 0.3 + 0 * lat * lon + 0.01 * t[:, None, None]
    second = 0.1 * lat * np.sin(2 * np.pi * lon) + 0 * first
    dims, dates = ("time", "lat", "lon"), t.astype("datetime64[s]").astype("datetime64[ns]")
    dataset = xarray.Dataset(
        {"u10": (dims, first), "v10": (dims, second)}, {"time": dates, "lat": lat[:, 0], "lon": lon}
    )
    found = Velocity.from_xarray(dataset, ("u10", "v10"), ("lon", "lat"), periodic=(True, False))
    grid = Grid([(0, 1), (0, 1)], (16, 12), periodic=(True, False))
    arrays = np.stack([first, second], axis=1)[:, :, ::-1].swapaxes(2, 3)
    expected = Velocity.from_snapshots(1.0 * t, arrays, grid)
    points = np.random.default_rng(0).random((2, 50))
    for component, same in zip(found.on(grid), expected.on(grid), strict=True):
        for orders in ((0, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)):
            one, other = (
                f.derivative(orders, (1.0,) * 4)(*points, 0.0, 1.3) for f in (component, same)
            )
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert np.abs(one).max() > 0.05


def file_of_winds(path, n=32, count=60):
    """Winds of a channel in a netCDF file, with falling latitudes; whose reading is lazy."""
    xarray = pytest.importorskip("xarray")
    lon, lat = np.arange(n) / n, np.linspace(1, 0, n + 1)[:, None]
    t = np.linspace(0, 6, count)[:, None, None]
    u = 0.3 + 0.1 * np.sin(2 * np.pi * lon + t) * np.cos(3 * lat)
    v = 0.1 * np.sin(np.pi * lat) * np.cos(2 * np.pi * lon - t)
    data = {"u": (("time", "lat", "lon"), u), "v": (("time", "lat", "lon"), v)}
    data = xarray.Dataset(data, {"time": t.ravel(), "lat": lat.ravel(), "lon": lon})
    data.to_netcdf(path, engine="scipy")
    return xarray.open_dataset(path, engine="scipy")


def blown(data, lazy, profile="bicubic", **more):
    wind = Velocity.from_xarray(
        data, ("u", "v"), ("lon", "lat"), periodic=(True, False), lazy=lazy, **more
    )
    n = data.sizes["lon"]
    grid = Grid([(0, 1), (0, 1)], (n, n), periodic=(True, False))
    return Solver(grid, wind, form_of(profile), profile, boundary=0.0)


@pytest.mark.turns(4)
@pytest.mark.parametrize("profile", ["bicubic", "csl4"])
@pytest.mark.parametrize("in_time", ["linear", "cubic"])
def test_lazy_winds_are_those_of_all_times(tmp_path, profile, in_time):
    ends = []
    with file_of_winds(tmp_path / "winds.nc") as data:
        for lazy in (False, True):
            solver = blown(data, lazy, profile, in_time=in_time)
            solver = pickle.loads(pickle.dumps(solver)) if lazy else solver
            start = solver.state("sin(2*pi*x1)*x2**2", t=2.0)
            ends.append(solver.run(start, 4.0, dt=0.25).final.data)
    assert np.abs(ends[1] - ends[0]).max() < 1e-7  # what the neglected snapshots weigh
    assert np.abs(ends[0] - start.data).max() > 0.1


@pytest.mark.parametrize("backing", ["dask", "zarr"])
def test_lazy_winds_of_other_libraries(tmp_path, backing):
    """Chunks of dask, of which few are computed, and stores of Zarr, pickled with their solver."""
    library = pytest.importorskip(backing)
    xarray, computed = pytest.importorskip("xarray"), []
    with file_of_winds(tmp_path / "winds.nc") as data:
        eager = blown(data, False, in_time="linear")
        if backing == "zarr":
            data.to_zarr(tmp_path / "winds.zarr", consolidated=False)
            lazy = xarray.open_zarr(tmp_path / "winds.zarr", chunks=None, consolidated=False)
            solver = blown(lazy, True, in_time="linear")
            solver = pickle.loads(pickle.dumps(solver))
        else:
            blocks = data.u.chunk({"time": 1}).data.map_blocks(
                lambda block: computed.append(block.shape) or block, meta=np.empty((0, 0, 0))
            )
            lazy = data.chunk({"time": 1}).assign(u=(data.u.dims, blocks))
            solver = blown(lazy, True, in_time="linear")
        start = solver.state("sin(2*pi*x1)*x2**2", t=2.0)
        ends = [one.run(start, 2.5, dt=0.25).final.data for one in (eager, solver)]
    assert library.__version__
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-10)
    assert len(computed) < 30  # of 60 times; the run is over five intervals of them


@pytest.mark.turns(4)
def test_lazy_winds_keep_few_times_in_memory(tmp_path):
    """Beside what a run needs for itself; all times at once are there twice, with coefficients."""
    peaks = {}
    with file_of_winds(tmp_path / "winds.nc", 32, 150) as data:
        for in_time, lazy, traced in product(("linear", "cubic"), (False, True), (False, True)):
            if traced:  # after a run that compiles
                tracemalloc.start()
            solver = blown(data, lazy, in_time=in_time)
            solver.run(solver.state("x2", t=3.0), 3.3, dt=0.1)
            if traced:
                peaks[lazy, in_time] = tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
    size = data.u.nbytes + data.v.nbytes
    assert peaks[False, "linear"] > 2 * size
    assert peaks[True, "linear"] < 0.5 * size
    assert peaks[True, "cubic"] < 0.9 * size


def test_gaps_of_lazy_winds_are_found_when_they_are_read(tmp_path):
    with file_of_winds(tmp_path / "winds.nc") as data:
        late = data.where(data.time < 4.95)  # the first NaN is in snapshot 49
        solver = blown(late.sel(time=slice(0, 5.05)), True, in_time="linear")
        start = solver.state(0.0)
        assert solver.step(start, 0.1).t == 0.1
        with pytest.raises(InputError, match="NaN or infinity in snapshot 49"):
            solver.run(start, 4.98, dt=0.5)
        cubic = Solver(solver.grid, solver.velocity, profile="cubic", boundary=0.0)
        with pytest.raises(NotSupported, match="needs all times in memory; pass lazy=False"):
            cubic.step(cubic.state(1.0), 0.1)


# Velocities of B-splines.


PERIODIC = Grid((-1, 2), 48, periodic=True)
BOX = Grid([(0, 2), (-1, 1)], (20, 16))
SQUARE = Grid([(0, 1), (0, 1)], (12, 12), periodic=True)
ONE = (1.0,) * 4


def bump(x):
    return 1 + 0.3 * np.sin(2 * x)


def vortices(x, y):
    return 0.1 * np.sin(2 * np.pi * x + 0.3) * np.cos(2 * np.pi * y + 0.4)


def values(formula, orders, *point):
    point = [*point, *([np.zeros(())] * (4 - len(point)))]
    return formula.derivative((*orders, *([0] * (4 - len(orders)))), ONE)(*point)


@pytest.mark.parametrize("degree", [3, 5])
def test_periodic_splines_are_those_of_scipy(degree):
    """With as many pieces as nodes both interpolate, so they are the same spline."""
    grid = Grid((-1, 2), 12, periodic=True)
    data = np.random.default_rng(1).standard_normal(12)
    (formula,) = SplineVelocity(grid, 12, data, degree).on(grid)
    spline = make_interp_spline(
        grid.edges[0], np.append(data, data[0]), k=degree, bc_type="periodic"
    )
    x = np.linspace(-1, 2, 100)[:-1]
    for slope in range(3):
        expected = spline(x, nu=slope)
        scale = np.abs(expected).max()
        for shift in (0.0, 3.0, -6.0):
            found = values(formula, (slope,), x + shift)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize(("degree", "stream"), [(3, False), (5, False), (5, True)])
def test_polynomials_are_reproduced(degree, stream):
    """Cubic splines contain x^a y^b with a, b <= 3; the curl of the stream function is exact."""

    def psi(x, y):
        return x**3 * y - 2 * x * y**2 + y**3

    start = psi if stream else [psi, lambda x, y: 1 + x * y]
    first, second = SplineVelocity(BOX, (4, 3), start, degree, stream).on(BOX)
    x, y = np.random.default_rng(2).uniform([[0], [-1]], [[2], [1]], (2, 50))
    if stream:
        np.testing.assert_allclose(values(first, (), x, y), x**3 - 4 * x * y + 3 * y**2, atol=1e-10)
        np.testing.assert_allclose(values(second, (), x, y), -(3 * x**2 * y - 2 * y**2), atol=1e-10)
        divergence = values(first, (1, 0), x, y) + values(second, (0, 1), x, y)
        np.testing.assert_allclose(divergence, 0, atol=1e-10)
    else:
        np.testing.assert_allclose(values(first, (), x, y), psi(x, y), atol=1e-10)
        np.testing.assert_allclose(values(first, (1, 1), x, y), 3 * x**2 - 4 * y, atol=1e-10)
        np.testing.assert_allclose(values(second, (0, 1), x, y), x, atol=1e-10)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("grid", "pieces", "start", "stream"),
    [(PERIODIC, 7, bump, False), (SQUARE, 6, vortices, True)],
    ids=["line", "stream"],
)
def test_the_tangent_against_differences(grid, pieces, start, stream):
    velocity = SplineVelocity(grid, pieces, start, stream=stream)
    field = "sin(2*pi*x1/3)" if grid.dim == 1 else "sin(2*pi*x1)*cos(2*pi*x2)"

    def end(**changed):
        solver = Solver(grid, velocity.with_parameters(**changed))
        return solver, solver.run(solver.state(field), 0.2, dt=0.05)

    solver, run = end()
    tangent, size = solver.tangent(run), run.final.data.size
    for q in (0, 3, 6):
        name, e = velocity.names[q], 1e-5
        here = velocity.parameters[name]
        ahead, behind = (end(**{name: here + s * e})[1].final["u"] for s in (1, -1))
        found = (tangent @ np.eye(1, size + len(velocity.names), size + q)[0]).reshape(
            run.final.data.shape
        )[0]
        quotient = ((ahead - behind) / (2 * e)).reshape(found.shape)
        # The error of the feet over e; no foot passes a node, where derivatives jump.
        np.testing.assert_allclose(found, quotient, rtol=0, atol=2e-6 * np.abs(quotient).max())


def test_the_largest_number_of_pieces():
    velocity = SplineVelocity(BOX, (16, 4), [1.0, 2.0])  # 21 functions on 21 nodes
    assert len(velocity.names) == 2 * 21 * 9
    np.testing.assert_allclose(values(velocity.on(BOX)[1], (), *BOX.mesh()), 2, rtol=1e-9)
