"""What a run leaves: snapshots on time, diagnostics, samples, files, pictures, interruptions."""

import itertools
import os
import sys
import types
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import pyvista
from full_disk import errors_without_space
from PIL import Image
from schemes import form_of

from cip import Grid, InputError, MissingDependency, Solver, State, Velocity
from cip.output.sample import sample


def wave(x):
    return np.sin(2 * np.pi * x) + 2


def run_of(profile="cubic", **more):
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0, form_of(profile), profile)
    return solver.run(solver.state(wave), 0.5, dt=0.03, **more)


def plane():
    grid = Grid([(0, 1), (0, 2)], (8, 10), periodic=[True, False])
    solver = Solver(grid, Velocity.from_expression("0.3", "0"), profile="adini")
    return solver.run(
        solver.state(lambda x, y: np.sin(2 * np.pi * x) + y), 0.3, dt=0.1, snapshots=3
    )


def test_lands_on_the_output_times():
    times = [0.0, 0.1, 0.123, 0.5]
    run = run_of(snapshots=times)
    np.testing.assert_array_equal(run.times, times)
    exact = wave(run.solver.grid.coordinates[0] - 0.123)
    np.testing.assert_allclose(run[2]["u"], exact, atol=2e-4)
    assert len(run_of(snapshots=4)) == 5


@pytest.mark.parametrize("start", [1.7e9, -1e6, 0.1])
def test_output_times_far_from_zero(start):
    """Their rounding, a millionth of dt in seconds since 1970, makes no steps of its own."""
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    steps = []
    run = solver.run(
        solver.state(wave, t=start), start + 1, dt=0.1, snapshots=10,
        callback=lambda state: steps.append(state.t),
    )  # fmt: skip
    assert len(steps) == 10
    assert run.times.tolist() == [start, *steps]
    np.testing.assert_allclose(run.final["u"], wave(solver.grid.coordinates[0]), atol=2e-3)


def test_starts_from_values_at_the_nodes():
    """Their derivatives and means are those of the quintic spline through them."""

    def field(x, y):
        return np.sin(2 * x) * np.cos(y)

    for profile in ("bicubic", "csl4"):
        grid = Grid((0, 1), (24, 20))
        solver = Solver(grid, [1.0, 0.5], form_of(profile), profile, boundary=0.0)
        found, expected = solver.state(field(*grid.mesh())), solver.state(field)
        np.testing.assert_allclose(found.data, expected.data, rtol=0, atol=5e-6)
        np.testing.assert_allclose(found["u"], expected["u"], rtol=0, atol=1e-14)


def test_lines_and_diagnostics():
    run = run_of(snapshots=3)
    assert repr(run.final) == (
        "State('cubic': u, u_x on Grid([0, 1], cells=(20,), periodic=(True,)) at t = 0.5)"
    )
    assert repr(run).startswith("Trajectory(4 snapshots of 'cubic' on Grid(")
    assert "interrupted" not in repr(run)
    found = run.diagnostics
    np.testing.assert_allclose(found.mass, 2.0, rtol=1e-12)
    np.testing.assert_allclose(found.total_variation, 4, rtol=0.02)
    np.testing.assert_allclose(found.l1, 2.0, rtol=1e-3)
    np.testing.assert_allclose(found.l2, np.sqrt(4.5), rtol=1e-3)
    assert found.maximum[0] == pytest.approx(3)
    assert found.minimum[0] == pytest.approx(1)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "profile", ["linear", "piecewise_linear", "cubic", "quintic", "csl2", "csl4"]
)
def test_samples_interpolate(profile):
    """At the nodes, between them, and in the mean over each cell."""
    run = run_of(profile)
    (x,) = run.solver.grid.coordinates
    np.testing.assert_allclose(run.sample(x), run.final["u"], atol=1e-13)
    between = np.random.default_rng(0).uniform(-1, 2, 50)
    largest = {"linear": 0.3, "piecewise_linear": 0.06}.get(profile, 2e-3)
    np.testing.assert_allclose(run.sample(between), wave(between - 0.5), atol=largest)
    if profile.startswith("csl"):
        places, weights = np.polynomial.legendre.leggauss(5)
        means = run.sample(x[:, None] + (1 + places) / 2 / 20) @ weights / 2
        np.testing.assert_allclose(means, run.final["mean"], atol=1e-13)


@pytest.mark.parametrize(("dim", "profile"), [(2, "adini"), (2, "bicubic"), (3, "cubic")])
def test_samples_in_two_and_three_dimensions(dim, profile):
    def field(x, y, z=0.0):
        return x**2 * y - y**3 + x * y * (1 + z)

    state = State.from_function(field, Grid([(0, 1)] * dim, (5,) * dim), profile)
    points = np.random.default_rng(2).uniform(0, 1, (dim, 30))
    np.testing.assert_allclose(sample(state, points), field(*points), atol=1e-12)
    with pytest.raises(InputError, match="outside"):
        sample(state, [[2.0], *[[0.5]] * (dim - 1)])


def test_series_opens_in_pyvista(tmp_path):
    run = plane()
    series, *files = run.save(tmp_path / "run.pvd")
    assert len(files) == 4
    reader = pyvista.get_reader(series)
    np.testing.assert_allclose(reader.time_values, run.times)
    reader.set_active_time_value(run.times[-1])
    mesh = reader.read()[0]
    assert mesh.dimensions == (9, 11, 1)
    values = mesh.point_data["u"].reshape(11, 9).T
    np.testing.assert_array_equal(values[:8], run.final["u"])
    np.testing.assert_array_equal(values[8], run.final["u"][0])
    blocks = run.to_pyvista(None)
    assert blocks.keys() == [f"t = {t!r}" for t in run.times.tolist()]
    np.testing.assert_array_equal(blocks[1]["u"], run.to_pyvista(1)["u"])
    for path, words in ((tmp_path / "run.vtk", r"\.pvd"), (None, "path=None")):
        with pytest.raises(InputError, match=words):
            run.save(path)


def test_series_of_two_runs_under_one_name(tmp_path, monkeypatch):
    """Every file is whole, with one process number as in two containers, and long names do."""
    monkeypatch.setattr(os, "getpid", lambda: 1)
    run, name = run_of(snapshots=4), tmp_path / ("x" * 241 + ".pvd")
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: run.save(name), range(2))
    assert first == second
    assert sorted(tmp_path.iterdir()) == sorted(first)
    assert all(path.read_text().rstrip().endswith("</VTKFile>") for path in first)


def channel():
    """Means beside walls: the last node of a direction begins no cell."""
    grid = Grid.from_coordinates(
        np.linspace(0, 1, 7) ** 2, np.linspace(0, 2, 6), periodic=[False, True]
    )
    solver = Solver(grid, [0.3, 0.0], "advection", "csl2", boundary=0.0)
    return solver.run(solver.state(lambda x, y: 1 + x + np.sin(np.pi * y)), 0.1, dt=0.1)


def test_means_are_data_of_the_cells(tmp_path):
    run = channel()
    mesh = pyvista.read(run.save(tmp_path / "run.pvd")[-1])
    np.testing.assert_array_equal(mesh.cell_data["mean"].reshape(5, 6).T, run.final["mean"])
    areas = mesh.compute_cell_sizes()["Area"]
    assert areas @ mesh.cell_data["mean"] == pytest.approx(run.final.mass, rel=1e-12)
    assert set(mesh.point_data) == {"u", "mean_x", "mean_y"}
    lines = mesh.point_data["mean_x"].reshape(6, 7).T
    np.testing.assert_array_equal(lines[:-1, :-1], run.final["mean_x"])
    assert np.isnan(lines[-1]).all()


def test_xarray():
    try:
        import xarray  # noqa: F401
    except ImportError:
        with pytest.raises(MissingDependency, match=r"pip install 'skfem-adini\[io\]'"):
            plane().to_xarray()
        return
    run = plane()
    data = run.to_xarray()
    assert data["u"].dims == ("t", "x", "y")
    np.testing.assert_array_equal(data["u"].isel(t=-1), run.final["u"])
    run = channel()
    data = run.to_xarray()
    assert data["mean"].dims == ("t", "x_cell", "y_cell")
    assert data["mean_x"].dims == ("t", "x_cell", "y")
    x, y = run.solver.grid.widths
    np.testing.assert_allclose(data["mean"].values @ y @ x, data["mass"], rtol=1e-12)
    np.testing.assert_allclose(data.x_cell.diff("x_cell"), (x[1:] + x[:-1]) / 2)


def test_dates_and_units():
    pytest.importorskip("xarray")
    run = channel()
    units = {"t": "h", "x": "m", "u": "kg m-3"}
    data = run.to_xarray("2026-01-31T12:00", units)
    hours = (data.t.values - np.datetime64("2026-01-31T12:00")) / np.timedelta64(1, "h")
    np.testing.assert_allclose(hours, run.times, rtol=0, atol=1e-9)
    assert (data.t.attrs["axis"], data.x_cell.attrs["axis"], data.y.attrs["axis"]) == tuple("TXY")
    assert data.x_cell.attrs["units"] == "m"
    assert data["u"].attrs["units"] == data["mean_x"].attrs["units"] == "kg m-3"
    assert "units" not in data.t.attrs  # xarray writes its own for dates
    assert run.to_xarray(units=units).t.attrs["units"] == "h"


def test_gauges_see_every_step():
    """A wave that passes two points: what is read there is the wave at these times."""
    run = run_of("quintic", snapshots=[0.2], gauges=[0.1, 0.72])
    assert run.gauges.t.size == 18
    exact = wave(np.array([0.1, 0.72]) - run.gauges.t[:, None])
    np.testing.assert_allclose(run.gauges.values, exact, atol=2e-4)
    np.testing.assert_array_equal(run.gauges.values[-1], run.sample([0.1, 0.72]))


def test_progress_shows_a_bar_on_a_terminal(monkeypatch, capsys):
    counted = []

    class Bar:
        def __init__(self, total, initial, unit):
            counted.append(total)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def update(self):
            counted[0] -= 1

    monkeypatch.setitem(sys.modules, "tqdm", types.SimpleNamespace(tqdm=Bar, __spec__=object()))
    run_of(snapshots=3, progress=True)
    assert counted == []  # no terminal
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    run_of(snapshots=3, progress=True)
    run_of(snapshots=3)
    assert counted == [0]


WITHOUT_SPACE = """
    import sys
    from pathlib import Path
    import numpy as np
    import pyvista
    from cip import Grid, Solver

    solver = Solver(Grid((0, 1), 2000, periodic=True), 1.0)
    run = solver.run(solver.state(np.sin), 0.1, dt=0.1)
    calls = [lambda: run.save(Path(sys.argv[1]) / "run.pvd")]
"""


@pytest.mark.turns(4)
def test_no_space_left(tmp_path):
    """An OSError, where VTK's own writer ends the process; nothing half written stays."""
    (error,) = errors_without_space(WITHOUT_SPACE, tmp_path, 4000)
    assert "too large" in error
    assert not list(tmp_path.iterdir())


@pytest.mark.turns(4)
def test_pictures(tmp_path):
    import matplotlib.pyplot as plt
    from matplotlib.animation import writers

    lines = run_of(snapshots=2).plot().get_lines()
    assert len(lines) == 3
    assert plane().plot().get_title() == "t = 0.3"
    run_of(snapshots=1).animate(tmp_path / "run.gif")
    assert (tmp_path / "run.gif").stat().st_size > 1000
    plane().animate(tmp_path / "plane.gif")
    with pytest.raises(InputError, match=r"\.gif"):
        run_of().animate(tmp_path / "run.avi")
    if writers.is_available("ffmpeg"):
        plane().animate(tmp_path / "plane.mp4")
        assert (tmp_path / "plane.mp4").stat().st_size > 1000
    else:
        with pytest.raises(MissingDependency, match=r"ffmpeg.*\.gif"):
            run_of().animate(tmp_path / "run.mp4")
    plt.close("all")


def test_panels_of_a_continent_can_be_read():
    """In metres: labels of ticks apart from each other, colour bars as high as their maps."""
    import matplotlib.pyplot as plt

    grid = Grid([(6e5, 6.8e5), (5.3e6, 5.38e6)], (8, 8))
    solver = Solver(grid, [0.0, 0.0], "advection", "csl2", splitting="strang", boundary=0.0)
    state = solver.state({"smoke": 1.0, "dust": 2.0, "ozone": 0.0})
    panels = solver.run(state, 1.0, dt=1.0).plot()
    panels[0].figure.canvas.draw()
    for ax in panels:
        found = [label.get_window_extent() for label in ax.get_xticklabels() if label.get_text()]
        inside = [box for box in found if ax.bbox.x0 <= 0.5 * (box.x0 + box.x1) <= ax.bbox.x1]
        assert len(inside) > 2
        assert all(a.x1 < b.x0 for a, b in itertools.pairwise(inside))
        (bar,) = ax.child_axes
        assert abs(bar.bbox.height / ax.bbox.height - 1) < 1e-6
    plt.close("all")


@pytest.mark.parametrize("signal", [KeyboardInterrupt, StopIteration])
def test_interrupted_runs_keep_their_snapshots(signal):
    def stop(state):
        if state.t > 0.25:
            raise signal

    run = run_of(snapshots=[0.1, 0.2, 0.4], callback=stop)
    assert run.interrupted
    np.testing.assert_allclose(run.times, [0, 0.1, 0.2, 0.26])
    assert not run_of().interrupted


def test_callback_sees_every_step(caplog):
    seen = []
    with caplog.at_level("INFO", logger="cip.solver.time_loop"):
        run_of(callback=lambda state: seen.append(state.t), progress=True)
    assert len(seen) == 17
    assert seen[-1] == 0.5
    assert "mass" in caplog.text


def test_a_state_from_the_callback_goes_on():
    """A field that is halved after each step; other results of a callback are ignored."""
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    start = solver.state(wave)

    def halved(state):
        return State(state.grid, state.profile, 0.5 * state.data, state.t)

    run = solver.run(start, 0.4, dt=0.1, snapshots=4, callback=halved)
    plain = solver.run(start, 0.4, dt=0.1, snapshots=4, callback=lambda state: state.mass)
    for q, (one, other) in enumerate(zip(run, plain, strict=True)):
        np.testing.assert_allclose(one.data, 0.5**q * other.data, rtol=0, atol=1e-13)
    with pytest.raises(InputError, match="or its callback has changed states"):
        solver.tangent(run)
    assert solver.tangent(plain).shape == (40, 40)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: State(s.grid, s.profile, s.data, s.t + 1), "a state at t = 1.1"),
        (lambda s: State(s.grid, "linear", s.data[:1], s.t), "what does not fit: state: it car"),
        (lambda s: State(s.grid, s.profile, s.data * np.nan, s.t), "what does not fit: .* is nan"),
    ],
)
def test_a_state_from_the_callback_has_to_fit(change, message):
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    with pytest.raises(InputError, match=f"callback: it returned {message}"):
        solver.run(solver.state(wave), 0.2, dt=0.1, callback=change)


@pytest.mark.parametrize("lazy", [False, True])
def test_dates_and_units_of_winds_are_carried_on(lazy, tmp_path):
    """From an xarray.Dataset to that of the run and to titles; numbers stay numbers."""
    xarray = pytest.importorskip("xarray")
    first, hours = np.datetime64("2026-03-01T06:00", "ns"), np.arange(4) * np.timedelta64(6, "h")
    lines = {"lon": np.arange(8.0), "lat": np.arange(8.0)}
    titles = {}
    for time in (first + hours, 21600.0 * np.arange(4)):
        axes = {"time": time, **lines}
        parts = {name: (("time", "lon", "lat"), np.full((4, 8, 8), 1e-5)) for name in "uv"}
        winds = xarray.Dataset(parts, axes)
        winds.lon.attrs["units"] = "km"
        wind = Velocity.from_xarray(winds, ["u", "v"], ["lon", "lat"], periodic=True, lazy=lazy)
        assert wind.grid.cells == (8, 8)
        solver = Solver(wind.grid, wind, "conservative", "csl4")
        run = solver.run(solver.state({"smoke": 1.0, "dust": 2.0}), 43200.0, dt=21600.0)
        found = run.to_xarray(units={"dust": "g"})
        assert (found.x.attrs["units"], "units" in found.y.attrs) == ("km", False)
        assert found.dust.attrs["units"] == "g"
        titles[time.dtype.kind] = run["dust"].plot().get_title()
        np.testing.assert_array_equal(found.t, first + hours[[0, 2]] if time[0] else run.times)
    assert titles == {"M": "2026-03-01 18:00", "f": "t = 4.32e+04"}
    assert Velocity(1.0).grid is None
    run.animate(tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as film:  # of two snapshots, one a second
        assert film.info["duration"] == 1000
