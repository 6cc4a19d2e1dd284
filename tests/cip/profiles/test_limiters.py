"""Profiles of one cell; bounds, oscillation, conservation: Jiang-Shu's profile, Zalesak's disk."""

import pickle
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from example_scripts import load
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cip import Grid, InputError, Solver, State, Velocity
from cip.profiles import line_profiles
from cip.profiles.catalogue import Limits
from cip.profiles.conservative_profiles import csl2


@pytest.mark.parametrize(
    ("profile", "limiter", "error", "low", "high"),
    [
        ("csl4", "bounds", 0.016, -1e-12, 1 + 1e-12),
        ("cubic", "eno", 0.027, -1e-2, 1 + 1e-2),
        # With constant velocity every tangent is carried exactly: no diffusion at all.
        ("piecewise_linear", None, 1e-3, -1e-12, np.inf),
    ],
)
def test_jiang_shu(profile, limiter, error, low, high):
    example, n = load("cip_jiang_shu"), 200
    solver = example.solver(example.grid(n), profile, limiter)
    start = example.start(solver)
    run = solver.run(start, 8.0, dt=0.8 / n, snapshots=8)
    u, found = run.final["u"], run.diagnostics
    assert 2 / n * np.abs(u - start["u"]).sum() <= error
    assert low <= u.min()
    assert u.max() <= high
    if profile == "csl4":
        np.testing.assert_allclose(found.mass, found.mass[0], atol=1e-13)
    else:
        assert found.total_variation[-1] <= found.total_variation[0] * (1 + 1e-9)


@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_bounds_leave_fine_profiles_alone(profile):
    """Bit for bit: where no bound is near, and where one is passed by less than the tolerance."""
    ends = {}
    for name, lift, limiter, tolerance in (
        ("away", 0.1, "bounds", 1e-14), ("away", 0.1, None, 1e-14),
        ("touching", 0.0, "bounds", 1e-2), ("touching", 0.0, None, 1e-14),
        ("strict", 0.0, "bounds", 1e-14),
    ):  # fmt: skip
        solver = Solver(
            Grid((0, 1), 20, periodic=True), lambda x: 1 + 0.2 * np.sin(2 * np.pi * x),
            "advection", profile, limiter, bounds=(0.0, np.inf), bounds_tolerance=tolerance,
        )  # fmt: skip
        start = solver.state(lambda x, lift=lift: lift + np.sin(np.pi * x) ** 20)
        ends.setdefault(name, []).append(solver.run(start, 0.5, dt=0.03).final.data)
    assert ends["touching"][1][0].min() < -1e-9  # it does pass the bound
    np.testing.assert_array_equal(*ends["away"])
    np.testing.assert_array_equal(*ends["touching"])
    assert np.any(ends["strict"][0] != ends["touching"][1])
    assert ends["strict"][0][0].min() >= -1e-14


SHEAR = Velocity.from_expression("1 + sin(2*pi*x2)", "0.3*cos(2*pi*x1)")
SQUEEZE = Velocity.from_expression("sin(2*pi*x1)*cos(2*pi*x2)/3", "0.5*sin(2*pi*x2)")


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), dt=st.floats(0.001, 0.49))
def test_bounds_and_mass_for_random_data(seed, dt):
    """Divergence-free sweeps keep both bounds, any flow keeps zero and the integral."""
    for shape, velocity, high in (
        ((16,), 1.0, 1.0), ((9, 8), SHEAR, 1.0), ((9, 8), SQUEEZE, np.inf),
    ):  # fmt: skip
        grid = Grid((0, 1), shape, periodic=True)
        for profile in ("csl2", "csl4"):
            solver = Solver(grid, velocity, "advection", profile, "bounds", bounds=(0.0, high))
            state = solver.state(0.0)
            state.data[...] = np.random.default_rng(seed).uniform(0, 1, state.data.shape)
            mass = state.mass
            for _ in range(4):
                state = solver.step(state, dt)
            for name in set(state.names) - {"u_x"}:
                assert state[name].min() >= -1e-12
                assert state[name].max() <= high + 1e-12
            assert abs(state.mass - mass) <= 1e-13


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_an_upper_bound_does_not_cut_what_a_sweep_compresses(profile):
    """A swirl there and back: between the sweeps of a step the field truly passes the bound."""
    grid = Grid((0, 1), (40, 40), periodic=True)
    swirl = Velocity.from_expression(
        "sin(2*pi*x1)*cos(2*pi*x2)*cos(pi*t)", "-cos(2*pi*x1)*sin(2*pi*x2)*cos(pi*t)"
    )
    errors = []
    for high in (1.0, np.inf):
        solver = Solver(grid, swirl, "advection", profile, "bounds", bounds=(0.0, high))
        start = solver.state("sin(pi*x1)**4*sin(pi*x2)**4")
        final = solver.run(start, 1.0, dt=0.0125).final
        errors.append(np.abs(final["u"] - start["u"]).max())
        assert final["u"].min() >= 0.0
        assert final["u"].max() <= 1.0 + 1e-8
        assert abs(final.mass / start.mass - 1) <= 1e-12
    # Cut in every sweep it was 2 (csl2) and 30 times (csl4) that without an upper bound.
    assert errors[0] <= 1.5 * errors[1]


@pytest.mark.turns(4)
@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), dt=st.floats(0.001, 0.3))
def test_clamp_keeps_the_range_in_two_dimensions(seed, dt):
    rng = np.random.default_rng(seed)
    grid = Grid([(0, 1)] * 2, (8, 8), periodic=True)
    for profile in ("adini", "bicubic"):
        flow = Velocity.from_expression("sin(2*pi*x2)", "cos(2*pi*x1)")
        solver = Solver(grid, flow, profile=profile, limiter="clamp")
        state = solver.state(0.0)
        state.data[...] = rng.uniform(-1, 1, state.data.shape) * 10
        low, high = state["u"].min(), state["u"].max()
        after = solver.step(state, dt)["u"]
        assert low <= after.min()
        assert after.max() <= high


@pytest.mark.parametrize(
    ("profile", "limiter", "limit"),
    [
        ("adini", "eno", 0.317),
        pytest.param("bicubic", "eno", 0.22, marks=pytest.mark.slow),
        pytest.param("bicubic", None, 0.25, marks=pytest.mark.slow),
    ],
)
def test_zalesak(profile, limiter, limit):
    """Below Adini's profile with the clamp, .317; the bicubic one below itself without, .246."""
    example = load("cip_zalesak")
    solver = example.solver(100, profile, limiter)
    start = example.start(solver)["u"]
    final = solver.run(example.start(solver), 1.0, dt=1 / 628).final["u"]
    assert np.abs(final - start).sum() < limit * start.sum()
    assert limiter is None or (final.min() >= -0.01 and final.max() <= 1.01)


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_eno_on_a_jump_in_two_dimensions(profile):
    """A square turned by a quarter: no over- or undershoot above 1 % of the jump."""
    grid = Grid([(-1, 1)] * 2, (32, 32))
    solver = Solver(
        grid, Velocity.from_expression("-x2", "x1"), profile=profile, limiter="eno", boundary=0.0
    )
    names = [name for name in solver.state(0.0).names if name != "u"]
    square = solver.state(
        lambda x, y: (np.maximum(np.abs(x - 0.1), np.abs(y)) < 0.45).astype(float),
        {name: lambda x, y: 0 * x for name in names},
    )
    final = solver.run(square, np.pi / 2, dt=np.pi / 80).final["u"]
    assert final.min() >= -0.01
    assert final.max() <= 1.01
    assert final.max() >= 0.99


def passed(limiter, n=200):
    """How far Jiang and Shu's profile leaves its range at a speed that varies by a factor 19."""
    example = load("cip_jiang_shu")
    speed = Velocity.from_expression(f"1 + 0.9*sin({np.pi}*x1)")
    solver = Solver(example.grid(n), speed, profile="cubic", limiter=limiter)
    found = solver.run(example.start(solver), 8.0, cfl=0.4, snapshots=16).diagnostics
    return max(found.maximum.max() - 1.0, -found.minimum.min())


def test_new_extrema_at_varying_speed():
    """The piecewise linear profile follows tangents beyond both ends where slopes are steep."""
    eno, none, clamp = passed("eno"), passed(None), passed("clamp")
    assert 0.2 < eno < 0.3
    assert 0.06 < none < 0.08
    assert clamp < 1e-12


def lost(profile, limiter):
    """The share of the integral of a bell, two cells wide, that a swirl draws out."""
    grid = Grid([(0, 1)] * 2, (48, 48))
    swirl = Velocity.from_expression(
        "sin(pi*x1)**2*sin(2*pi*x2)".replace("pi", repr(np.pi)),
        "-sin(pi*x2)**2*sin(2*pi*x1)".replace("pi", repr(np.pi)),
    )
    solver = Solver(grid, swirl, profile=profile, limiter=limiter, boundary=0.0)
    start = solver.state(lambda x, y: np.exp(-((x - 0.5) ** 2 + (y - 0.75) ** 2) / 0.05**2))
    return 1 - solver.run(start, 1.0, dt=1 / 48).final.mass / start.mass


@pytest.mark.parametrize(
    ("profile", "eno", "clamp"),
    [("adini", 0.25, 0.05), pytest.param("bicubic", 0.31, 0.11, marks=pytest.mark.slow)],
)
def test_the_integral_of_a_thinning_bell(profile, eno, clamp):
    assert abs(lost(profile, "eno") - eno) < 0.02
    assert abs(lost(profile, "clamp") - clamp) < 0.02
    assert abs(lost(profile, None)) < 1e-3


BOUNDED = {"form": "advection", "limiter": "bounds", "bounds": (0.0, 1.0)}
RING, OPEN = Grid((0, 1), 24, periodic=True), Grid((0, 1), 24)


@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_data_outside_the_bounds_are_refused(profile):
    """However they come in: as a state of this or another solver, from a callback, by a wall."""
    solver = Solver(RING, 1.0, profile=profile, **BOUNDED)
    other = Solver(RING, 1.0, "advection", profile)
    wide = "3*sin(2*pi*x1)"
    outside = r"state: moment '\w+' reaches -?[23].*outside the bounds \(0.0, 1.0\)"
    for make in (
        lambda: solver.state(wide),
        lambda: solver.run(State.from_function(wide, RING, profile), 0.1, dt=0.05),
        lambda: solver.step(other.state(wide), 0.05),
        lambda: solver.run(other.run(other.state(wide), 0.1, dt=0.1).final, 0.2, dt=0.1),
    ):
        with pytest.raises(InputError, match=outside):
            make()
    inside = solver.state("0.5 + 0.5*sin(2*pi*x1)")
    with pytest.raises(InputError, match=r"callback: .* outside the bounds"):
        solver.run(inside, 0.2, dt=0.1, callback=lambda s: State(RING, profile, s.data + 2, s.t))
    assert solver.run(inside, 0.2, dt=0.1).final["u"].max() <= 1 + 1e-12


def test_inflow_outside_the_bounds_is_refused():
    for data in (2.0, -0.1, "1 + x1 + 0.5"):
        with pytest.raises(InputError, match=r"boundary 'x-': the field there reaches"):
            Solver(OPEN, 1.0, profile="csl2", boundary={"x-": data}, **BOUNDED)
    solver = Solver(OPEN, 1.0, profile="csl2", boundary={"x-": "1.5*sin(t)"}, **BOUNDED)
    start = solver.state(0.0)
    assert solver.run(start, 0.5, dt=0.1).final["u"].max() <= 1.0  # it is inside until then
    with pytest.raises(InputError, match="boundary 'x-': the field there reaches 1"):
        solver.run(start, 1.5, dt=0.1)


def test_what_a_source_has_moved_goes_on():
    """A source may leave the bounds; the run is taken up again from there, also from a copy."""
    solver = Solver(RING, 1.0, profile="csl2", source=2.0, **BOUNDED)
    middle = solver.run(solver.state(0.5), 0.5, dt=0.1).final
    assert middle["u"].max() > 1.4
    for state in (middle, pickle.loads(pickle.dumps(middle))):
        end = solver.run(state, 0.6, dt=0.1).final
        np.testing.assert_allclose(end["u"], 1.7, rtol=0, atol=1e-12)


# Profiles of one cell, and the cell of a foot: exact arithmetic, bounds, ends, periods.


locate: Any = getattr(line_profiles.locate, "py_func", line_profiles.locate)
quintic, rational = line_profiles.quintic.py_func, line_profiles.rational.py_func
EPS = 2.0**-52
number = st.floats(-1, 1)
small = st.floats(0, 1e-3)


def exact(a, b, va, vb, wa, wb, s):
    """Value and three derivatives by powers of s, whose coefficients solve the six conditions."""
    d, p, q = b - a - va - wa, vb - va - 2 * wa, wb - wa
    powers = [a, va, wa, 10 * d - 4 * p + q, 7 * p - 15 * d - 2 * q, 6 * d - 3 * p + q]
    found = []
    for _ in range(4):
        found.append(sum(c * s**k for k, c in enumerate(powers)))
        powers = [k * c for k, c in enumerate(powers)][1:]
    return found


@given(
    data=st.tuples(*[number] * 6), s=st.one_of(small, small.map(lambda r: 1 - r), st.floats(0, 1))
)
def test_derivatives_keep_their_digits_at_both_ends(data, s):
    """There they are those of the data, however large the profile's coefficients are."""
    found = quintic(*data, s)
    expected = exact(*map(Fraction, data), Fraction(s))
    for order in (1, 2):
        bound = EPS * (16 + 2400 * s * (1 - s))
        assert abs(Fraction(found[order]) - expected[order]) <= bound
    assert float(expected[0]) == pytest.approx(found[0], abs=400 * EPS)
    assert float(expected[3]) == pytest.approx(found[3], abs=10000 * EPS)


@given(seed=st.integers(0, 10**6))
def test_rational_profile_with_means(seed):
    """It takes both end values and the mean, monotone in monotone cells however steep."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1, 1, 2)
    inside = rng.uniform() < 0.7
    part = 10.0 ** rng.uniform(-14, 0)  # down to a jump at one end
    m = a + (b - a) * (part if rng.uniform() < 0.5 else 1 - part) if inside else a + b + 2.5

    def at(s):
        return csl2.py_func(a, b, m, s, Limits(3, 0.0, 0.0, 0.0))

    assert at(0.0)[0] == pytest.approx(a, abs=1e-14)
    assert at(0.0)[2] == 0.0
    assert at(1.0)[0] == pytest.approx(b, abs=1e-13)
    assert at(1.0)[2] == pytest.approx(m, abs=1e-14)
    if inside:
        s = np.sort(np.concatenate([rng.uniform(0, 1, 40), 1 - 10.0 ** rng.uniform(-12, 0, 40)]))
        values = np.array([at(x)[0] for x in s])
        assert np.all(np.diff(values) * np.sign(b - a) >= -1e-14)
    for s in rng.uniform(0.1, 0.9, 3) if part > 1e-3 else ():
        step = 1e-5
        value, slope, _ = at(s)
        assert (at(s + step)[2] - at(s - step)[2]) / (2 * step) == pytest.approx(value, abs=1e-4)
        assert (at(s + step)[0] - at(s - step)[0]) / (2 * step) == pytest.approx(
            slope, rel=1e-3, abs=1e-4
        )


def test_rational_profile_beside_a_jump():
    """Flat on one side, steep on the other: end values and slopes to rounding, no false extrema."""
    s = np.concatenate([[0.0], 10.0 ** np.arange(-16.0, -1), np.linspace(0.1, 0.9, 9)])
    s = np.sort(np.concatenate([s, 1 - s]))
    for flat in (1e-3, 1e-8, 1e-13):
        found = np.array([rational(1.0, 1.0, -flat, 1.0, x) for x in s])
        np.testing.assert_allclose(found[[0, -1], 0], 1.0, rtol=1e-15)
        np.testing.assert_allclose(found[[0, -1], 1], [-flat, 1.0], rtol=1e-12)
        # Convex: slopes increase, and no value lies below both end tangents.
        assert np.all(np.diff(found[:, 1]) >= -1e-13)
        assert np.all(found[:, 0] >= np.maximum(1 - flat * s, s) - 1e-15)
        mirrored = np.array([rational(1.0, 1.0, -1.0, flat, 1 - x) for x in s])
        np.testing.assert_allclose(mirrored[:, 0], found[:, 0], rtol=1e-14)


@given(
    n=st.integers(4, 10**6), i=st.floats(0, 1, exclude_max=True),
    cells=st.integers(-(10**9), 10**9), s=st.floats(0, 1, exclude_max=True),
)  # fmt: skip
@example(n=49, i=0.0, cells=-49, s=0.0)
@example(n=4, i=0.9, cells=1, s=0.0)
def test_feet_wrap_into_the_period(n, i, cells, s):
    """Whole periods, however many, do not change the cell."""
    node, d = int(i * n), cells + s
    k, r, place = locate(node, d, n, 1)
    assert k == (node + int(np.floor(d))) % n
    assert r == (k + 1) % n
    assert place == d - np.floor(d)


@given(n=st.integers(4, 100), d=st.floats(-300, 300))
@settings(max_examples=50)
def test_feet_stay_on_a_line_with_ends(n, d):
    k, r, place = locate(n // 2, d, n, 0)
    assert 0 <= k == r - 1 <= n - 2
    assert k + place == pytest.approx(min(max(n // 2 + d, 0), n - 1), abs=1e-9)
