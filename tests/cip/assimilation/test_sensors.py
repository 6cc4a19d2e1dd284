"""Sensors: rows beside the profile itself, transposes, files, dropouts, and what is refused."""

from datetime import datetime

import numpy as np
import pytest

from cip import Grid, InputError, Sensors, Solver, State
from cip.output.sample import sample, sample_rows
from cip.profiles.catalogue import moments

HALF_MINUTE = np.timedelta64(30, "s")
LINE = np.linspace(0, 1, 14)
UNEVEN = LINE + 0.02 * np.sin(2 * np.pi * LINE)
GRIDS = {
    "line": Grid((0, 1), 12),
    "uneven ring": Grid.from_coordinates(UNEVEN, periodic=True),
    "plane": Grid([(0, 1), (-1, 2)], (7, 9), periodic=(True, False)),
    "space": Grid([(0, 1)] * 3, (5, 6, 4), periodic=(False, True, False)),
}
PROFILES = {
    1: ("linear", "cubic", "quintic", "csl2", "csl4"),
    2: ("linear", "cubic", "quintic", "csl2", "adini", "bicubic"),
    3: ("linear", "cubic", "csl2"),
}
CASES = [(name, p) for name, grid in GRIDS.items() for p in PROFILES[grid.dim]]


def places(grid, count, seed=0):
    low, high = np.array(grid.bounds).T
    rng = np.random.default_rng(seed)
    return low[:, None] + (high - low)[:, None] * rng.random((grid.dim, count))


@pytest.mark.parametrize(("name", "profile"), CASES)
def test_rows_read_what_the_profile_says(name, profile):
    grid = GRIDS[name]
    points = np.concatenate([places(grid, 40), np.array(grid.bounds)], axis=1)  # corners too
    data = np.random.default_rng(3).standard_normal((len(moments(profile, grid.dim)), *grid.nodes))
    state = State(grid, profile, data)
    found = sample_rows(grid, profile, points) @ data.ravel()
    # Rounding of a sum of at most 64 products.
    np.testing.assert_allclose(found, sample(state, points), rtol=0, atol=1e-13)
    if grid is GRIDS["line"] and profile in ("cubic", "quintic"):
        state = State.from_function(lambda x: x**3 - 2 * x + 1, grid, profile)
        found, (x,) = sample_rows(grid, profile, points) @ state.data.ravel(), points
        np.testing.assert_allclose(found, x**3 - 2 * x + 1, rtol=0, atol=1e-13)


def test_operator_of_all_times_and_its_transpose():
    grid = GRIDS["plane"]
    solver = Solver(grid, ("1.0", "x1 - x1"), profile="adini")
    times = [0.1, 0.25, 0.4]
    plan = Sensors(places(grid, 6), times, deviations=0.01)
    start = solver.state("sin(2*pi*x1)*cos(x2)")
    run = solver.run(start, 0.4, dt=0.1, snapshots=times)
    sensors = plan.with_values(plan.sample(run)).perturbed(seed=4, dropouts=0.3)
    assert 0 < np.isnan(sensors.values).sum() < sensors.values.size
    operator = sensors.operator(grid, "adini")
    states = np.concatenate([state.data.ravel() for state in sensors.states(run)])
    assert operator.shape == (sensors.reported.sum(), states.size)
    expected = plan.sample(run)[sensors.reported]
    np.testing.assert_allclose(operator @ states, expected, rtol=0, atol=1e-13)
    y = np.random.default_rng(5).standard_normal(operator.shape[0])
    assert abs(y @ (operator @ states) - (operator.T @ y) @ states) < 1e-13
    reports = sensors.reports(grid, "adini")
    assert [len(v) for v in reports.values] == [m.shape[0] for m in reports.operators]
    # Residuals are standard normal numbers; 3.5 deviations among 18 of them are rare.
    residuals = sensors.residuals(run)
    assert np.isnan(residuals).sum() == np.isnan(sensors.values).sum()
    assert 0.3 < np.nanstd(residuals) < 2.0
    assert np.nanmax(np.abs(residuals)) < 3.5


def test_noise_has_the_deviations_and_dropouts_the_probability():
    plan = Sensors(np.linspace(0, 1, 200), np.arange(1, 51), deviations=np.full((50, 1), 0.3))
    seen = plan.perturbed(seed=1, dropouts=0.2)
    # Four deviations of the estimates from 10000 numbers.
    assert abs(np.isnan(seen.values).mean() - 0.2) < 0.016
    assert abs(np.nanstd(seen.values) / 0.3 - 1) < 0.032
    np.testing.assert_array_equal(plan.perturbed(1, 0.2).values, seen.values)


def test_files_and_xarray_lose_nothing(tmp_path):
    grid = GRIDS["plane"]
    sensors = Sensors(places(grid, 5), [0.1, 1 / 3], deviations=[[0.1], [0.2]]).perturbed(2, 0.4)
    sensors.save(tmp_path / "sensors.json")
    assert [path.name for path in tmp_path.iterdir()] == ["sensors.json"]
    pytest.importorskip("xarray")
    dataset = sensors.to_xarray()
    twice = dataset.transpose("sensor", "t")
    for found in (
        Sensors.load(tmp_path / "sensors.json"),
        *map(Sensors.from_xarray, (dataset, twice)),
    ):
        for name in ("points", "times", "values", "deviations"):
            np.testing.assert_array_equal(getattr(found, name), getattr(sensors, name))
    assert dict(dataset.sizes) == {"t": 2, "sensor": 5}
    one = dataset.assign(deviation=0.5)
    assert np.all(Sensors.from_xarray(one).deviations == 0.5)


def test_damage_of_a_file_is_seen_and_files_without_a_checksum_are_read(tmp_path):
    path = tmp_path / "sensors.json"
    Sensors([0.125, 0.75], [0.5], [[3.0, np.nan]], 0.25).save(path)
    text = path.read_text()
    path.write_text(text.replace("0.125", "0.135"))
    with pytest.raises(InputError, match="is damaged, it was changed"):
        Sensors.load(path)
    path.write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match="no file of sensors"):
        Sensors.load(path)
    path.write_text(text[: text.index(', "checksum"')] + "}")  # of an earlier version
    assert Sensors.load(path).points.tolist() == [[0.125, 0.75]]


def test_dates_of_a_dataset_become_seconds():
    pytest.importorskip("xarray")
    sensors = Sensors([0.2, 0.7], [0.0, 90.0], [[1.0, np.nan], [2.0, 3.0]], 0.1)
    dates = np.datetime64("2010-05-04T12:00", "ns") + np.array([0, 90], "timedelta64[s]")
    dated = sensors.to_xarray().assign_coords(t=dates)
    found = Sensors.from_xarray(dated)
    for name in ("points", "times", "values", "deviations"):
        np.testing.assert_array_equal(getattr(found, name), getattr(sensors, name))
    for since in ("2010-05-04T11:59:30", datetime(2010, 5, 4, 11, 59, 30), dates[0] - HALF_MINUTE):
        assert Sensors.from_xarray(dated, since).times.tolist() == [30.0, 120.0]
    lasting = sensors.to_xarray().assign_coords(t=dates - dates[0] + HALF_MINUTE)
    assert Sensors.from_xarray(lasting).times.tolist() == [30.0, 120.0]


def test_some_of_them():
    sensors = Sensors([0.1, 0.2, 0.3], [1.0], [[1.0, 2.0, 3.0]], 0.1)
    np.testing.assert_array_equal(sensors.at([2, 0]).values, [[3.0, 1.0]])
    np.testing.assert_array_equal(sensors.at([False, True, False]).points, [[0.2]])
