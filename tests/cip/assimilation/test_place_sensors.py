"""Placement beside all choices, tried one by one, with variances from dense matrices."""

from itertools import combinations

import numpy as np
import pytest

from cip import Covariance, Grid, InputError, Sensors, Solver, State, Velocity, place_sensors

GRID = Grid((0, 1), 24, periodic=True)


def problem(seed=0, count=8, text="1 + 0.4*sin(2*pi*x1)", times=(0.1, 0.25)):
    rng = np.random.default_rng(seed)
    solver = Solver(GRID, Velocity.from_expression(text))
    points = np.sort(rng.random(count))
    candidates = Sensors(points, times, deviations=0.1 + 0.3 * rng.random((len(times), count)))
    B = Covariance.diffusion(GRID, "cubic", 0.5 + rng.random(24), 0.15)
    return solver, solver.state("sin(2*pi*x1)"), B, candidates


def rows_of(solver, start, B, candidates):
    """Reports of all candidates over deviations, for unit errors: by runs, without adjoints."""
    found, S, rows = [], B.root @ np.eye(24), candidates.rows(GRID, "cubic")
    for t, deviations in zip(candidates.times, candidates.deviations, strict=True):
        states = [State(GRID, "cubic", x.reshape(start.data.shape), 0.0) for x in S.T]
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
    solver = Solver(GRID, 1.0)
    candidates = Sensors(GRID.coordinates[0][::4], [0.25], deviations=0.2)  # a multiple of h
    B = Covariance.diffusion(GRID, "cubic", 1.0, 0.1)
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
