"""Sources, decay, diffusion and reactions on the sphere, gauges and budgets, by exact solutions."""

import pickle
from functools import partial

import numpy as np
import pytest
from convergence import order
from globe import FORMS, rotation, turned
from scipy.special import sph_harm_y

import cip
from cip import Grid, NotSupported, Source, Sphere, SphereSolver, Trajectory

BOTH = ("quintic_spline", "csl4_spline")
LEAN = 0.7  # of the axis of rotation


def rest(lon, lat):
    return 0.0 * lon, 0.0 * lat


def turning(lon, lat):
    return rotation(LEAN, 1.0)(lon, lat)


def rotated(f, by):
    """A field that the rotation has carried for a time."""
    return lambda lon, lat: f(*turned(lon, lat, LEAN, by))


def harmonic(n, m):
    return lambda lon, lat: sph_harm_y(n, m, 0.5 * np.pi - lat, lon).real


def worst(state, exact, solver):
    return float(np.abs(state.data - solver.state(exact).data).max())


@pytest.mark.parametrize(("profile", "least", "most"), [
    ("csl2_spline", 2.4, 4.5), ("csl4_spline", 4.2, 6.5), ("quintic_spline", 6.0, 99.0),
])  # fmt: skip
def test_harmonics_decay_exactly(profile, least, most):
    """As exp(-n (n + 1) k t), turned by an angle, on a sphere of radius 3; values spectrally."""
    parts = {(2, 1): 0.5, (4, 2): 1.0, (5, 5): 0.7, (3, 0): 0.4}
    cells, errors = [12, 18, 27], []
    for n in cells:
        sphere = Sphere(2 * n, n, radius=3.0)
        solver = SphereSolver(sphere, rest, FORMS[profile], profile, diffusion=1.8)

        def field(lon, lat, t):
            return 1.0 + sum(
                size * np.exp(-k * (k + 1) * 0.2 * t) * rotated(harmonic(k, m), 0.9)(lon, lat)
                for (k, m), size in parts.items()
            )

        start = solver.state(partial(field, t=0.0))
        end = solver.run(start, 0.3, dt=0.1).final
        errors.append(worst(end, partial(field, t=0.3), solver))
        if profile != "quintic_spline":
            assert end.mass == pytest.approx(start.mass, rel=1e-13)
    assert least < order(cells, errors) < most
    assert errors[-1] < {"csl2_spline": 1e-3, "csl4_spline": 2e-5, "quintic_spline": 1e-10}[profile]


@pytest.mark.parametrize("profile", FORMS)
@pytest.mark.parametrize("number", [1e-4, 0.5, 1e4])
def test_noise_diffuses_to_its_mean(profile, number):
    """No diffusion number limits it, poles included: no norm grows, and all decays in the end."""
    solver = SphereSolver(Sphere(24, 14), rest, FORMS[profile], profile, diffusion=number)
    start = solver.state(np.random.default_rng(3).standard_normal((24, 14)))
    end = solver.step(start, 1.0)
    w, mean = start.grid.weights, start.mass / (4 * np.pi)
    before, after = ((w * (one.data[0] - mean) ** 2).sum() for one in (start, end))
    assert after < before
    if number > 1.0:
        assert np.ptp(end.data) < 1e-10
    if FORMS[profile] == "advection":
        assert end.mass == pytest.approx(start.mass, rel=1e-12)


@pytest.mark.parametrize("profile", BOTH)
def test_with_a_limiter_no_value_leaves_the_range(profile):
    solver = SphereSolver(
        Sphere(32, 16), rest, FORMS[profile], profile, "bounds", (0, 1), diffusion=1e-3
    )
    start = solver.state((np.random.default_rng(2).random((32, 16)) > 0.5) * 1.0)
    end = solver.run(start, 1.0, dt=0.25).final
    assert end.data.min() >= 0.0
    assert end.data.max() <= 1.0 + 1e-15
    if profile == "csl4_spline":
        assert end.mass == pytest.approx(start.mass, rel=1e-13)


@pytest.mark.parametrize("profile", BOTH)
def test_the_order_in_time_is_two(profile):
    """A turning harmonic that grows and is fed, decays at a varying rate and diffuses."""
    f, lost = harmonic(3, 2), "0.5 + 0.4*sin(lat)"

    def exact(lon, lat, t):
        return 2.0 + (1.0 + t) * rotated(f, t)(lon, lat)

    def source(lon, lat, t):
        rate = 0.5 + 0.4 * np.sin(lat)
        turned = rotated(f, t)(lon, lat)
        return (1.0 + 12 * 0.05 * (1.0 + t)) * turned + rate * (2.0 + (1.0 + t) * turned)

    solver = SphereSolver(
        Sphere(48, 24), turning, FORMS[profile], profile,
        source=Source(source), decay=lost, diffusion=0.05,
    )  # fmt: skip
    steps, errors = [4, 6, 9], []
    for count in steps:
        end = solver.run(solver.state(partial(exact, t=0.0)), 1.2, dt=1.2 / count).final
        errors.append(worst(end, partial(exact, t=1.2), solver))
    assert 1.7 < order(steps, errors) < 2.4
    assert errors[-1] < 1e-2


@pytest.mark.parametrize("profile", FORMS)
def test_reactions(profile):
    """A logistic law at each place, and an exchange whose sum and integral stay."""
    solver = SphereSolver(
        Sphere(36, 18), rest, FORMS[profile], profile,
        reactions={"a": "a*(1 - a)", "b": "0.3*c*(1 + sin(lon)*cos(lat)) - b",
                   "c": "b - 0.3*c*(1 + sin(lon)*cos(lat))"},
    )  # fmt: skip

    def start(lon, lat):
        return 0.5 + 0.3 * np.cos(lat) * np.cos(lon)

    state = solver.state({"a": start, "b": start, "c": 1.0})
    run = solver.run(state, 1.0, dt=0.25)
    end = run.final

    def exact(lon, lat):
        u = start(lon, lat)
        return u * np.e / (1.0 - u + u * np.e)

    expected = solver.state({"a": exact, "b": 0.0, "c": 0.0}).data[0]
    np.testing.assert_allclose(end.data[0], expected, atol=4e-4 if "csl2" in profile else 2e-6)
    np.testing.assert_allclose(end.data[1] + end.data[2], state.data[1] + state.data[2], atol=1e-12)
    if FORMS[profile] == "advection":
        assert np.abs(run.budget["a"].residual).max() < 1e-12
        assert run.budget["a"].reacted[-1] > 1.0
        assert run.budget["a"].inflow == {}


def test_budgets_and_gauges(tmp_path):
    """What was added and decayed closes, through a restart too; gauges against a closed form."""
    make = partial(
        SphereSolver, Sphere(24, 12, 2.0), turning, "conservative", "csl4_spline",
        source={"ash": "1 + t*sin(lat)"}, decay={"ash": 0.3, "gas": "0.1*(1 + cos(lat))"},
    )  # fmt: skip
    solver, places = make(), [[0.3, 2.0], [1.1, -np.pi / 2]]
    start = solver.state({"ash": 0.0, "gas": lambda lon, lat: 1.0 + np.sin(lat)})
    how = {"dt": 0.1, "snapshots": 3, "gauges": places}
    whole = solver.run(start, 1.2, **how)
    for name in start.fields:
        assert np.abs(whole.budget[name].residual).max() < 1e-13 * whole.budget[name].mass.max()
    ash = whole.budget["ash"]
    area = 16 * np.pi  # of the odd part of the source nothing is left in the integral
    np.testing.assert_allclose(ash.added, area * whole.times, rtol=1e-12)
    np.testing.assert_allclose(ash.mass, area * (1 - np.exp(-0.3 * whole.times)) / 0.3, rtol=2e-4)
    assert whole.gauges.values["ash"].shape == (13, 2)
    np.testing.assert_allclose(whole.gauges.values["gas"][0], 1 + np.sin(places[1]), atol=1e-5)
    np.testing.assert_array_equal(whole.gauges.values["ash"][-1], whole["ash"].sample(places))

    def stop(state):
        if state.t > 0.5:
            raise StopIteration

    assert make().run(start, 1.2, save=tmp_path / "run", callback=stop, **how).interrupted
    again = make().run(start, 1.2, save=tmp_path / "run", resume=True, **how)
    np.testing.assert_array_equal(again.final.data, whole.final.data)
    np.testing.assert_array_equal(again.gauges.values["ash"], whole.gauges.values["ash"])
    np.testing.assert_array_equal(again.budget["gas"].decayed, whole.budget["gas"].decayed)
    loaded = Trajectory.load(tmp_path / "run", make())
    np.testing.assert_array_equal(loaded.gauges.t, whole.gauges.t)


@pytest.mark.parametrize("kind", ["text", "callable", "array", "parameter"])
def test_the_forms_of_a_source(kind):
    def f(lon, lat):
        return np.cos(lat) * np.cos(lon - 0.3)

    sphere = Sphere(48, 24)
    given = {
        "text": "cos(lat)*cos(lon - 0.3)",
        "callable": f,
        "array": f(*sphere.mesh()),
        "parameter": Source.from_expression("q*cos(lat)*cos(lon - 0.3)", parameters={"q": 3.0}),
    }[kind]
    for profile in BOTH:
        solver = SphereSolver(sphere, rest, FORMS[profile], profile, source=given)
        if kind == "parameter":
            solver = solver.with_parameters(q=1.0)
        end = solver.run(solver.state(0.0), 0.7, dt=0.35).final
        assert worst(end, lambda lon, lat: 0.7 * f(lon, lat), solver) < 1e-6


def test_copies_have_all_terms():
    solver = SphereSolver(
        Sphere(16, 8), turning, "conservative", source={"a": "sin(lat)"}, decay={"b": 0.2},
        diffusion={"a": 0.1}, reactions={"a": "-a*b"}, limiter="bounds", bounds={"b": (0.0, 9.0)},
    )  # fmt: skip
    again = pickle.loads(pickle.dumps(solver))
    start = solver.state({"a": 1.0, "b": 2.0})
    one, other = (each.run(start, 0.3, cfl=0.8) for each in (solver, again))
    np.testing.assert_array_equal(one.final.data, other.final.data)
    # cfl counts widths of a latitude at the fastest point.
    assert one.dt == pytest.approx(0.8 * np.pi / 8, rel=0.03)
    assert again.diffusion == {"a": (0.1,)}


def test_refused():
    times, grid = np.linspace(0, 1, 4), Grid([(0, 1), (0, 1)], (8, 8))
    wind = Source.from_snapshots(times, np.ones((4, 9, 9)), grid)
    with pytest.raises(NotSupported, match="source: snapshots live on a Grid"):
        SphereSolver(Sphere(16, 8), rest, source=wind)
    solver = SphereSolver(Sphere(16, 8), turning, diffusion=0.1)
    with pytest.raises(cip.InputError, match="diffusion cannot be undone"):
        solver.step(solver.state(1.0), -0.1)
