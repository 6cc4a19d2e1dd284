"""Identified velocities beside the truth, which DOP853 computed: errors, forms, units, optimum."""

from types import SimpleNamespace

import numpy as np
import pytest
from truths import FIELD, feet, field, snapshots, waves

from cip import Grid, IdentifiedVelocity, InputError, Sensors, Solver, SplineVelocity, Velocity
from cip import identify_velocity as identify

TIMES = (0.1, 0.17, 0.26)
LINE = Grid((0, 1), 200, periodic=True)
SHORT = Grid((0, 1), 80, periodic=True)
SPEED = Velocity.from_expression(
    "a + b*sin(2*pi*x1 + d)", parameters={"a": 1.0, "b": 0.1, "d": 0.0}
)


def slow(x):
    return 1 + 0.2 * np.sin(2 * np.pi * x)


def relative(found, c):
    exact = np.stack([np.broadcast_to(part, found.grid.nodes) for part in np.atleast_2d(c)])
    return np.linalg.norm(found.values - exact) / np.linalg.norm(exact)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("noise", "bound", "kind"),
    [
        (0, 1e-4, "H2"),
        (1e-3, 2e-3, "H2"),
        (1e-2, 1e-2, "H2"),
        pytest.param(1e-3, 2e-3, "H1", marks=pytest.mark.slow),
        pytest.param(1e-2, 1e-2, "H1", marks=pytest.mark.slow),
    ],
)
def test_three_snapshots(noise, bound, kind):
    """The weight of the seminorm is chosen without the truth."""
    solver = Solver(LINE, SplineVelocity(LINE, 24, 1.0))
    found = identify(
        solver, solver.state(FIELD), snapshots(waves, TIMES, LINE, noise), dt=0.01, noise=noise,
        bounds=(0.05, np.inf), regularization=kind,
    )  # fmt: skip
    exact = waves(LINE.coordinates[0])
    assert relative(found, exact) <= bound
    assert found.identifiability.unseen == ()
    assert np.max(np.abs(found.values[0] - exact) / found.value_deviations[0]) < 4.0
    if noise:
        assert 0.7 <= found.reduced_chi_square <= 1.3
        assert found.root_mean_square == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("form", ["transport", "advection"])
@pytest.mark.parametrize("profile", ["cubic", "quintic"])
def test_parameters_of_a_formula(form, profile):
    truth = {"a": 1.2, "b": 0.3, "d": 0.4}

    def c(x):
        return truth["a"] + truth["b"] * np.sin(2 * np.pi * x + truth["d"])

    solver = Solver(SHORT, SPEED, form, profile)
    data = snapshots(c, (0.2, 0.31), SHORT, 1e-3)
    if form == "advection":  # p = u dX/dx, and for steady c dX/dx = c(X) / c(x)
        (x,) = SHORT.mesh()
        noise = {t: u - exact for (t, u), exact in zip(
            data.items(), snapshots(c, (0.2, 0.31), SHORT).values(), strict=True)}  # fmt: skip
        ends = feet(c, (0.2, 0.31), x)[:, 0]
        data = {t: field(X) * c(X) / c(x) + noise[t] for t, X in zip(data, ends, strict=True)}
    found = identify(solver, solver.state(FIELD), data, dt=0.02, noise=1e-3)
    assert found.regularization is None
    for name, value in truth.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name]
        assert found.deviations[name] <= 0.01
    assert found.explained


def test_deviations_are_those_of_the_normal_equations():
    """For a shift u(x - a t) the deviation of a is noise / (t |u'|) over the nodes."""
    solver = Solver(SHORT, Velocity.from_expression("a", parameters={"a": 1.0}))
    data = snapshots(lambda x: 1.25 + 0 * x, [0.2], SHORT, 0.01)
    found = identify(solver, solver.state(FIELD), data, dt=0.02, noise=0.01)
    slope = 2 * np.pi * np.cos(2 * np.pi * SHORT.coordinates[0]) - 3 * np.pi * np.sin(
        6 * np.pi * SHORT.coordinates[0]
    )
    expected = 0.01 / (0.2 * np.linalg.norm(slope)) * max(1.0, found.reduced_chi_square) ** 0.5
    assert found.deviations["a"] == pytest.approx(expected, rel=2e-3)  # error of the cubic


@pytest.mark.sampled(2)
@pytest.mark.parametrize("own", [False, True], ids=["Sensors", "matrices"])
def test_sensors_at_points(own):
    """Four sensors and 25 times tell the three parameters as well as their deviations say."""
    truth, noise = {"a": 1.1, "b": 0.25, "d": -0.3}, 2e-3
    places, times = np.array([0.11, 0.32, 0.58, 0.86]), np.arange(1, 26) * 0.02
    ends = feet(lambda x: 1.1 + 0.25 * np.sin(2 * np.pi * x - 0.3), times, places)[:, 0]
    values = field(ends) + noise * np.random.default_rng(5).standard_normal(ends.shape)
    values[3, 1] = np.nan  # a report that did not arrive
    data = Sensors(places, times, values, noise)
    if own:  # the same reports as an object of somebody else, without the deviations
        reports = data.reports(SHORT, "cubic")
        data = SimpleNamespace(
            times=reports.times, values=reports.values, operators=reports.operators
        )
    solver = Solver(SHORT, SPEED)
    found = identify(solver, solver.state(FIELD), data, dt=0.02, noise=noise if own else None)
    for name, value in truth.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name] <= 0.05
    assert found.misfit.shape == (99,)
    assert 0.6 <= found.reduced_chi_square <= 1.4


@pytest.fixture(scope="module")
def whole():
    """Data of the speed 1.2 + .3 sin(2 pi x), the start, and what is identified from them."""
    data = snapshots(lambda x: 1.2 + 0.3 * np.sin(2 * np.pi * x), (0.2, 0.31), SHORT, 1e-3)
    solver = Solver(SHORT, SPEED)
    start = solver.state(FIELD)
    return data, solver, start, identify(solver, start, data, dt=0.02, noise=1e-3)


def test_masked_values_are_missing(whole):
    data, solver, start, found = whole
    hidden = (np.arange(80) >= 20) & (np.arange(80) < 50)
    spoiled = {t: np.ma.array(np.where(hidden, np.nan, u), mask=hidden) for t, u in data.items()}
    part = identify(solver, start, spoiled, dt=0.02, noise=1e-3)
    assert part.misfit.size == 2 * 50
    assert part.deviations["b"] > found.deviations["b"]
    assert abs(part.parameters["b"] - 0.3) <= 4.0 * part.deviations["b"]


def test_bounds_hold(whole):
    """An upper bound below the amplitude of the truth."""
    data, solver, start, _ = whole
    with pytest.warns(UserWarning, match="reduced chi-square"):
        found = identify(solver, start, data, dt=0.02, noise=1e-3, bounds={"b": (0.0, 0.2)})
    assert found.parameters["b"] == pytest.approx(0.2, abs=1e-6)
    assert found.at_bounds == ("b",)
    assert not found.explained
    assert "b" in found.summary()


def test_results_are_stored_and_drawn(whole, tmp_path):
    found, path = whole[-1], tmp_path / "speed.json"
    found.save(path)
    again = IdentifiedVelocity.load(path, SPEED)
    assert again.parameters == found.parameters
    assert again.summary() == found.summary()
    np.testing.assert_array_equal(again.covariance, found.covariance)
    np.testing.assert_array_equal(again.value_deviations, found.value_deviations)
    assert again.identifiability.condition == found.identifiability.condition
    with pytest.raises(InputError, match="velocity: expected one with the parameters a, b, d"):
        IdentifiedVelocity.load(path, Velocity.from_expression("a", parameters={"a": 1}))
    (line,) = found.plot().lines
    np.testing.assert_array_equal(line.get_ydata(), found.values[0])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("unit", [1e-3, 1e4])
def test_units_do_not_matter(unit):
    """Lengths in another unit, times too, and a field too: the same velocity in these units."""
    found = []
    for length, time, size in ((1.0, 1.0, 1.0), (unit, unit**0.5, 1 / unit)):
        grid = Grid((0, length), 60, periodic=True)
        seen = snapshots(slow, (0.1, 0.17), Grid((0, 1), 60, periodic=True), 3e-3)
        data = {t * time: size * u for t, u in seen.items()}
        solver = Solver(grid, SplineVelocity(grid, 8, length / time))
        start = solver.state(lambda x: size * field(x / length))  # noqa: B023
        one = identify(solver, start, data, dt=0.02 * time, noise=3e-3 * size)
        found.append(np.stack([one.values[0], one.value_deviations[0]]) * time / length)
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=2e-4)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=2e-2)  # as far as weights settle


@pytest.mark.sampled(2)
@pytest.mark.parametrize("weight", ["l-curve", "discrepancy"])
def test_without_knowledge_of_the_noise(weight):
    solver = Solver(SHORT, SplineVelocity(SHORT, 10, 1.0))
    data = snapshots(slow, TIMES, SHORT, 5e-3)
    found = identify(solver, solver.state(FIELD), data, dt=0.02, weight=weight)
    assert relative(found, slow(SHORT.coordinates[0])) <= 1e-2
    assert found.reduced_chi_square is None
    assert found.root_mean_square == pytest.approx(5e-3, rel=0.2)


def test_a_line_that_the_flow_leaves():
    """Not periodic: the start at the feet is known everywhere, and so is every later field."""
    grid = Grid((-1, 1), 80)

    def c(x):
        return 0.6 * x + 0.2 * np.sin(3 * x)

    def u(x):
        return np.sin(5 * x) + np.cos(8 * x)

    solver = Solver(grid, SplineVelocity(grid, 8, lambda x: 0.3 * x))
    data = snapshots(c, (0.2, 0.4), grid, 5e-3, u=u)
    found = identify(solver, solver.state(u), data, dt=0.05, noise=5e-3)
    exact = c(grid.coordinates[0])
    assert relative(found, exact) <= 1e-2
    assert np.max(np.abs(found.values[0] - exact) / found.value_deviations[0]) < 4.0


def test_the_gradient_vanishes_at_the_estimate():
    """The sum of squares and the seminorm, recomputed by runs: no parameter lowers it."""
    solver = Solver(SHORT, SplineVelocity(SHORT, 8, 1.0))
    data = snapshots(slow, (0.1, 0.17), SHORT, 5e-3)
    start = solver.state(FIELD)
    found = identify(solver, start, data, dt=0.02, noise=5e-3)
    x = np.linspace(0, 1, 4001)[:-1]

    def cost(**changed):
        velocity = found.velocity.with_parameters(**changed)
        run = Solver(SHORT, velocity).run(start, 0.17, dt=0.02, snapshots=[0.1])
        chi = sum(np.sum((run[k + 1]["u"] - u) ** 2) for k, u in enumerate(data.values()))
        c = velocity.on(SHORT)[0].derivative((2, 0, 0, 0), (1.0,) * 4)(x, 0.0, 0.0, 0.0)
        return chi / 5e-3**2 + found.weight * np.mean(c**2)

    least = cost()
    for name, value in found.parameters.items():
        e = 0.5 * found.deviations[name]
        ahead, behind = cost(**{name: value + e}), cost(**{name: value - e})
        assert min(ahead, behind) > least
        # The parabola's vertex lies within a hundredth of a deviation of the estimate.
        vertex = 0.5 * e * (behind - ahead) / (ahead - 2 * least + behind)
        assert abs(vertex) <= 0.02 * found.deviations[name]


@pytest.mark.slow
def test_on_a_device_it_is_that_of_the_host(cupy):
    found = []
    for backend in ("cpu", "cupy"):
        solver = Solver(SHORT, SPEED, backend=backend)
        data = snapshots(lambda x: 1.1 + 0.2 * np.sin(2 * np.pi * x), (0.2, 0.31), SHORT, 1e-3)
        found.append(identify(solver, solver.state(FIELD), data, dt=0.02, noise=1e-3))
    expected, of_device = found
    for name, value in expected.parameters.items():
        assert of_device.parameters[name] == pytest.approx(value, abs=1e-8)
    np.testing.assert_allclose(of_device.value_deviations, expected.value_deviations, rtol=1e-7)
