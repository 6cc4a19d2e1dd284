"""Identified velocities beside the truth, which DOP853 computed: errors, deviations, limits."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from schemes import form_of
from scipy.stats import binom
from truths import FIELD, feet, field, snapshots, waves

import cip
from cip import Grid, IdentifiabilityWarning, Sensors, Solver, SplineVelocity, Velocity
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
    again = cip.IdentifiedVelocity.load(path, SPEED)
    assert again.parameters == found.parameters
    assert again.summary() == found.summary()
    np.testing.assert_array_equal(again.covariance, found.covariance)
    np.testing.assert_array_equal(again.value_deviations, found.value_deviations)
    assert again.identifiability.condition == found.identifiability.condition
    with pytest.raises(cip.InputError, match="velocity: expected one with the parameters a, b, d"):
        cip.IdentifiedVelocity.load(path, Velocity.from_expression("a", parameters={"a": 1}))
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


# Planes, by formulas and by splines of a stream function.


TAU = 2 * np.pi


def swirl(strength, drift=0.0):
    """Vortices of the stream function -strength cos(2 pi y) ... and a drift along x."""

    def c(x, y):
        first = drift + strength * np.sin(TAU * x + 0.3) * np.cos(TAU * y)
        return np.stack([first, -strength * np.cos(TAU * x + 0.3) * np.sin(TAU * y)])

    return c


FLOW = Velocity.from_expression(
    "d + s*sin(2*pi*x1 + .3)*cos(2*pi*x2)", "-s*cos(2*pi*x1 + .3)*sin(2*pi*x2)",
    parameters={"s": 0.2, "d": 0.0},
)  # fmt: skip


def tracer(x, y):
    return np.sin(TAU * x) + np.cos(TAU * (x + y)) + np.sin(2 * TAU * y)


@pytest.mark.parametrize(
    "profile", ["adini", "bicubic", pytest.param("csl4", marks=pytest.mark.slow)]
)
def test_parameters_of_a_plane_flow(profile):
    """It keeps areas, so a conservative splitting moves the same field."""
    grid = Grid([(0, 1), (0, 1)], (32, 32), periodic=True)
    solver = Solver(grid, FLOW, form_of(profile), profile)
    data = snapshots(swirl(0.5, 0.1), (0.12, 0.2), grid, 0.02, u=tracer)
    found = identify(solver, solver.state(tracer), data, dt=0.04, noise=0.02)
    for name, value in {"s": 0.5, "d": 0.1}.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name] <= 0.02
    assert found.explained
    exact = swirl(0.5, 0.1)(*grid.mesh())
    # Some nodes lie where the velocity is 0 whatever its parameters are.
    assert np.all(np.abs(found.values - exact) <= 4.0 * found.value_deviations + 1e-15)
    assert found.plot().get_aspect() == 1.0


def guess(x, y):
    return 0.05 * np.sin(TAU * x + 0.3) * np.sin(TAU * y)


@pytest.mark.slow
@pytest.mark.parametrize("stream", [True, False])
def test_splines_of_a_plane_flow(stream):
    """A constant in the stream function moves nothing; or each component by splines of its own."""
    n, drift, dt = (20, 0.0, 0.15) if stream else (16, 0.2, 0.1)
    grid, c = Grid([(0, 1), (0, 1)], (n, n), periodic=True), swirl(0.5, drift)
    noise, bound, times = (0.02, 0.1, (0.15,)) if stream else (0.01, 0.05, (0.1, 0.2))
    data = snapshots(c, times, grid, noise, u=tracer)
    velocity = SplineVelocity(grid, 6, guess if stream else [0.1, 0.0], stream=stream)
    solver = Solver(grid, velocity, profile=None if stream else "adini")
    options = {} if stream else {"regularization": "H1"}
    unseen = pytest.warns(IdentifiabilityWarning, match="do not determine")
    with unseen if stream else nullcontext():
        found = identify(solver, solver.state(tracer), data, dt=dt, noise=noise, **options)
    exact = c(*grid.mesh())
    error = found.values - exact
    assert np.linalg.norm(error) <= bound * np.linalg.norm(exact)
    assert np.mean(np.abs(error) <= 2.0 * found.value_deviations) >= 0.9


def test_sensors_in_a_plane():
    """Reports at points between the nodes, at many times: as well as their deviations say."""
    grid = Grid([(0, 1), (0, 1)], (32, 32), periodic=True)
    places, times = np.random.default_rng(3).random((2, 6)), np.arange(1, 7) * 0.04
    ends = feet(swirl(0.5, 0.1), times, *places)
    values = np.stack([tracer(*at) for at in ends])
    data = Sensors(places, times, values, 0.02).perturbed(seed=4, dropouts=0.1)
    solver = Solver(grid, FLOW, profile="adini")
    found = identify(solver, solver.state(tracer), data, dt=0.04)
    for name, value in {"s": 0.5, "d": 0.1}.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name] <= 0.05
    assert found.explained


# What data cannot tell: waves that came back, and parameters that act alike.


RING = Grid((0, 1), 100, periodic=True)


@pytest.mark.parametrize("noise", [0, 1e-3, None])
def test_a_period_of_the_flow_tells_the_mean_alone(noise):
    """c = 1 and T = 1: every node is back, and changes of c of mean 0 move it by nothing."""
    solver = Solver(RING, SplineVelocity(RING, 12, 1.0))
    data = snapshots(lambda x: 1 + 0 * x, [1.0], RING, noise or 0.0)
    with pytest.warns(IdentifiabilityWarning, match="do not determine 11 of 12 directions: waves"):
        found = identify(solver, solver.state(FIELD), data, dt=0.05, noise=noise)
    seen = found.identifiability
    assert seen.seen.tolist() == [True] + 11 * [False]
    assert np.ptp(seen.patterns[0]) < 0.05 * np.abs(seen.patterns[0]).max()
    assert np.min(found.value_deviations) > 0.9
    assert "do not determine" in found.summary()


def test_a_quarter_of_a_period_hides_four_waves():
    """c = 1 / (1 + .3 sin 8 pi x) from t = .25: the travel time over .25 is that of c = 1."""
    solver = Solver(RING, SplineVelocity(RING, 24, 1.0))

    def c(x):
        return 1 / (1 + 0.3 * np.sin(8 * np.pi * x))

    data = snapshots(c, [0.25], RING, 1e-3)
    with pytest.warns(IdentifiabilityWarning, match="length 0.25"):
        found = identify(
            solver, solver.state(FIELD), data, dt=0.025, noise=1e-3, bounds=(0.05, np.inf)
        )
    error = found.values[0] - c(RING.coordinates[0])
    assert found.explained  # the misfit is that of the noise
    assert np.linalg.norm(error) > 0.1 * np.linalg.norm(c(RING.coordinates[0]))  # the answer is not
    assert np.all(np.abs(error) <= found.value_deviations[0])  # which the deviations say


def test_parameters_that_act_alike_are_named():
    speed = Velocity.from_expression("a + b", parameters={"a": 0.5, "b": 0.5})
    solver = Solver(RING, speed)
    data = snapshots(lambda x: 1.1 + 0 * x, [0.3], RING, 1e-3)
    with pytest.warns(IdentifiabilityWarning, match=r"1 of 2 directions: .0\.71 [ab] .0\.71 [ab]"):
        found = identify(solver, solver.state(FIELD), data, dt=0.03, noise=1e-3)
    assert found.parameters["a"] + found.parameters["b"] == pytest.approx(1.1, abs=1e-3)
    assert min(found.deviations.values()) > 0.5  # each alone is unknown
    assert found.value_deviations.max() < 1e-3  # their sum is not


# Deviations against errors: no more answers outside than there may be.
#
# Speed, field, noise and times are drawn; the weight of the seminorm comes from the discrepancy
# principle. Of each problem one error is taken, over its stated deviation.


GRID = Grid((0, 1), 64, periodic=True)
WAVES = Velocity.from_expression(
    "a + b*sin(2*pi*x1) + d*cos(2*pi*x1)", parameters={"a": 1.0, "b": 0.0, "d": 0.0}
)


def random_waves(rng, sizes):
    """A function with random random_waves of these sizes."""
    numbers = rng.standard_normal((2, len(sizes))) * sizes

    def f(x):
        angle = 2 * np.pi * np.multiply.outer(np.arange(1, len(sizes) + 1), x)
        return np.tensordot(numbers[0], np.sin(angle), 1) + np.tensordot(
            numbers[1], np.cos(angle), 1
        )

    return f, numbers


def deviation(seed):
    """The error of one random problem in stated deviations: of a parameter or of c at a node."""
    rng = np.random.default_rng(seed)
    u, _ = random_waves(rng, [1.0, 0.7, 0.5])
    bump, numbers = random_waves(rng, [0.15] if seed % 2 else [0.15, 0.05])
    mean = rng.uniform(0.8, 1.3)
    noise, times = 10 ** rng.uniform(-2.5, -1.5), np.sort(rng.uniform(0.08, 0.3, 3))

    def c(x):
        return mean + bump(x)

    data = snapshots(c, times, GRID, noise, seed, u)
    solver = Solver(GRID, WAVES if seed % 2 else SplineVelocity(GRID, 10, 1.0))
    found = identify(solver, solver.state(u), data, dt=0.05, noise=noise)
    if seed % 2:
        name, value = [("a", mean), ("b", numbers[0, 0]), ("d", numbers[1, 0])][rng.integers(3)]
        return (found.parameters[name] - value) / found.deviations[name]
    node = rng.integers(GRID.size)
    error = found.values[0, node] - c(GRID.coordinates[0])[node]
    return error / found.value_deviations[0, node]


@pytest.mark.slow
@pytest.mark.filterwarnings("default::UserWarning")
def test_three_hundred_problems():
    errors = [deviation(seed) for seed in range(300)]
    # As many lie outside so many deviations with a chance below 1 : 1000 if these are right.
    for size, chance in ((1, 0.3173), (2, 0.0455), (3, 0.0027)):
        assert np.sum(np.abs(errors) > size) <= binom.ppf(0.999, len(errors), chance), errors
    # Nor are they far too large: then the errors would be small beside them.
    assert np.sqrt(np.mean(np.square(errors))) > 0.5
