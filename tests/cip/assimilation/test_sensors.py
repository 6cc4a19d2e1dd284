"""Sensors: rows beside the profile itself, files, dropouts; places beside all choices."""

from datetime import datetime
from itertools import combinations

import numpy as np
import pytest

from cip import Covariance, Grid, InputError, Sensors, Solver, State, Velocity, place_sensors
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
    2: ("linear", "cubic", "quintic", "csl2", "csl4", "adini", "bicubic"),
    3: ("linear", "cubic", "csl2", "csl4"),
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


# Placement beside all choices, tried one by one, with variances from dense matrices.


RING = Grid((0, 1), 24, periodic=True)


def problem(seed=0, count=8, text="1 + 0.4*sin(2*pi*x1)", times=(0.1, 0.25)):
    rng = np.random.default_rng(seed)
    solver = Solver(RING, Velocity.from_expression(text))
    points = np.sort(rng.random(count))
    candidates = Sensors(points, times, deviations=0.1 + 0.3 * rng.random((len(times), count)))
    B = Covariance.diffusion(RING, "cubic", 0.5 + rng.random(24), 0.15)
    return solver, solver.state("sin(2*pi*x1)"), B, candidates


def rows_of(solver, start, B, candidates):
    """Reports of all candidates over deviations, for unit errors: by runs, without adjoints."""
    found, S, rows = [], B.root @ np.eye(24), candidates.rows(RING, "cubic")
    for t, deviations in zip(candidates.times, candidates.deviations, strict=True):
        states = [State(RING, "cubic", x.reshape(start.data.shape), 0.0) for x in S.T]
        ends = [solver.run(state, t, dt=0.05).final.data.ravel() for state in states]
        found.append((rows @ np.stack(ends, axis=1)) / deviations[:, None])
    return np.stack(found), S


def value(criterion, found, S, chosen):
    A = np.concatenate([found[:, j] for j in chosen])
    posterior = np.linalg.inv(np.eye(24) + A.T @ A)
    if criterion == "D":
        return -0.5 * np.linalg.slogdet(posterior)[1]
    values = S[:24]
    return np.mean(np.sum(values**2, axis=1) - np.diag(values @ posterior @ values.T))


@pytest.mark.parametrize("criterion", ["A", "D"])
@pytest.mark.parametrize("seed", range(3))
def test_no_choice_is_above_the_bound(criterion, seed):
    solver, start, B, candidates = problem(seed)
    budget = 3
    found = place_sensors(solver, start, B, candidates, budget=budget, dt=0.05, criterion=criterion)
    rows, S = rows_of(solver, start, B, candidates)
    values = {c: value(criterion, rows, S, c) for c in combinations(range(8), budget)}
    best = max(values.values())
    assert found.value == pytest.approx(values[tuple(sorted(found.chosen))], rel=1e-9)
    assert best <= found.bound * (1 + 1e-12)
    assert found.value >= (1 - 1 / np.e) * best
    assert found.efficiency > 0.8
    # Each choice is the best next one.
    for k in range(budget):
        before = found.chosen[:k]
        others = [value(criterion, rows, S, [*before, j]) for j in range(8) if j not in before]
        assert value(criterion, rows, S, found.chosen[: k + 1]) >= max(others) * (1 - 1e-12)
    np.testing.assert_array_equal(found.sensors.points[0], candidates.points[0, [*found.chosen]])
    if criterion == "A":
        assert found.prior == pytest.approx(np.mean(np.sum(S[:24] ** 2, axis=1)), rel=1e-12)


@pytest.mark.parametrize("criterion", ["A", "D"])
def test_all_of_them_are_their_own_bound(criterion):
    solver, start, B, candidates = problem(4, 5)
    found = place_sensors(solver, start, B, candidates, budget=5, dt=0.05, criterion=criterion)
    assert found.bound == pytest.approx(found.value, rel=1e-9)
    assert sorted(found.chosen) == list(range(5))


def test_ties_are_told_and_the_first_is_taken():
    """A steady flow on a ring with equal nodes: candidates at nodes differ by a shift alone."""
    solver = Solver(RING, 1.0)
    candidates = Sensors(RING.coordinates[0][::4], [0.25], deviations=0.2)  # a multiple of h
    B = Covariance.diffusion(RING, "cubic", 1.0, 0.1)
    found = place_sensors(solver, solver.state(0.0), B, candidates, budget=2, dt=0.25)
    assert found.chosen == (0, 3)  # the opposite one is farthest
    assert found.ties[0] == (1, 2, 3, 4, 5)
    assert found.ties[1] == ()


def test_zones_and_distances():
    solver, start, B, candidates = problem(1, 12)
    free = place_sensors(solver, start, B, candidates, budget=4, dt=0.05)
    x = candidates.points[0]
    some = place_sensors(
        solver, start, B, candidates, budget=3, dt=0.05, excluded=lambda x1: x1 < 0.5, apart=0.08
    )
    places = np.sort(some.sensors.points[0])
    assert np.all(places >= 0.5)
    assert np.all(np.diff([*places, places[0] + 1]) >= 0.08)
    assert some.value < free.value
    mask = np.isin(np.arange(12), free.chosen)
    other = place_sensors(solver, start, B, candidates, budget=4, dt=0.05, excluded=mask)
    assert not set(other.chosen) & set(free.chosen)
    assert other.bound <= free.bound * (1 + 1e-9)
    with pytest.raises(InputError, match="apart: only"):
        place_sensors(solver, start, B, candidates, budget=4, dt=0.05, apart=0.4)
    with pytest.raises(InputError, match=r"budget: expected 1 to \d+ sensors"):
        place_sensors(solver, start, B, candidates, budget=12, dt=0.05, excluded=x < 0.5)


def test_sources():
    """Sensors for the strength of sources stand where the flow carries them, not upstream."""
    grid = Grid((0, 1), 60, periodic=True)
    solver = Solver(grid, 1.0)
    B = Covariance.diffusion(grid, "cubic", 0.01, 0.2)
    puff = solver.state(lambda x: np.exp(-200 * (x - 0.2) ** 2))
    Q = Covariance.patterns([puff], 1.0)
    candidates = Sensors(np.linspace(0, 0.95, 20), [0.1, 0.4], deviations=0.1)
    late = np.zeros((2, 20))
    late[0] = np.nan  # nothing is read when the source emits
    candidates = candidates.with_values(late)
    found = place_sensors(
        solver, solver.state(0.0), B, candidates, budget=1, dt=0.05,
        goal="amplitudes", model_error=[Q, None],
    )  # fmt: skip
    assert found.sensors.points[0, 0] == pytest.approx(0.5)  # emitted at t = .1, seen at .4
    # A number of prior variance 1, seen with strength 1, noise .1 and the background's .01.
    assert found.prior == 1.0
    assert found.value == pytest.approx(1 / (1 + 0.1**2 + 0.01**2), rel=1e-3)
