"""Regions: inflow in sweeps, budgets, land and closed walls."""

import copy
import pickle

import numpy as np
import pytest
from convergence import order
from derivative_checks import dot_test, equal_substeps, parameter_error
from schemes import made

from cip import Grid, NotSupported, Solver, Source, State, Velocity

MEANS = ("csl2", "csl4")
TURN = {2: np.array([[0, -1], [1, 0]]), 3: np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / 3**0.5}
CENTRE = (0.5, -0.3, 0.2)


def spiral(dim, growth, gusts):
    """The flow c = s'(t) (W + growth) (x - centre), which turns about an axis, and an exact field:
    the start at the place from which the exponential of -s (W + growth) brings a particle."""
    W, W2 = TURN[dim], TURN[dim] @ TURN[dim]

    def c(x, t):
        y = [a - b for a, b in zip(x, CENTRE, strict=False)]
        rate = 1 + gusts * 0.9 * np.cos(3 * t)
        return [rate * (sum(w * z for w, z in zip(row, y, strict=True)) + growth * own)
                for row, own in zip(W.tolist(), y, strict=True)]  # fmt: skip

    def field(x, t):
        y = [a - b for a, b in zip(x, CENTRE, strict=False)]
        s = t + gusts * 0.3 * np.sin(3 * t)
        shrink, sine, cosine = np.exp(-growth * s), np.sin(s), 1 - np.cos(s)
        back = [[(i == j) - sine * W[i, j] + cosine * W2[i, j] for j in range(dim)]
                for i in range(dim)]  # fmt: skip
        x = [shrink * sum(b * z for b, z in zip(row, y, strict=True)) for row in back]
        u = 1.5 + np.sin(2.3 * x[0] + 0.4) * np.cos(1.7 * x[1])
        return (u + 0.3 * np.sin(2 * x[2]) if dim == 3 else u) * shrink**dim

    if dim == 2:
        return Velocity(lambda x, y, t: c((x, y), t), steady=False), lambda x, y, t: field(
            (x, y), t
        )
    return (
        Velocity(lambda x, y, z, t: c((x, y, z), t), steady=False),
        lambda x, y, z, t: field((x, y, z), t),
    )


CASES = [
    ("csl2", 2, 0.4, 1, (12, 24, 48)),
    pytest.param("csl4", 2, 0.4, 1, (12, 24, 48), marks=pytest.mark.slow),
    pytest.param("csl2", 2, 0.0, 0, (24, 48, 96), marks=pytest.mark.slow),
    pytest.param("csl4", 2, 0.0, 1, (24, 48, 96), marks=pytest.mark.slow),
    pytest.param("csl2", 3, 0.4, 1, (8, 12, 18), marks=pytest.mark.slow),
    pytest.param("csl4", 3, 0.4, 1, (8, 12, 18), marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("profile", "dim", "growth", "gusts", "sizes"), CASES)
def test_order_two_up_to_walls_and_corners(profile, dim, growth, gusts, sizes):
    """Values, means and the integral; two or three walls with inflow meet, and flows turn round."""
    velocity, field = spiral(dim, growth, gusts)
    errors = []
    for n in sizes:
        grid = Grid([(0, 1)] * dim, (n,) * dim)
        solver = Solver(grid, velocity, "advection", profile, boundary=field)
        run = solver.run(solver.state(lambda *x: field(*x, 0.0)), 0.6, dt=0.6 / (3 * n // 8))
        exact = solver.state(lambda *x: field(*x, 0.6))
        worst = [np.abs(run.final[name] - exact[name]).max() for name in exact.names]
        errors.append([*worst, abs(run.final.mass - exact.mass)])
        assert np.abs(run.budget.residual).max() < 1e-14
    for q, name in enumerate([*exact.names, "mass"]):
        assert 1.6 < order(sizes, [one[q] for one in errors]) < 3.2, name
    assert errors[-1][0] < 0.02


# Solutions of p_t + div(c p) = s - k p for any p: s is what is left.
WINDS = ["1 + 0.3*sin(2*x2 + t)*cos(x1)", "0.7 + 0.4*cos(3*x1 - 2*t)*(1 + 0.3*x2)"]
WAVE, RATE = "1.5 + w*sin(2*x1 + 3*x2 - 2*t)*cos(x2)", "0.5 + 0.3*sin(x1 + t)"


def residual_of(field, winds, rate):
    """The source that makes `field` a solution, by central differences of order four."""

    def at(function, x, y, t, axis, step=1e-3):
        total = 0.0
        for k, weight in ((1, 8), (2, -1)):
            shift = np.zeros(3)
            shift[axis] = k * step
            total = total + weight * (
                function(x + shift[0], y + shift[1], t + shift[2])
                - function(x - shift[0], y - shift[1], t - shift[2])
            )
        return total / (12 * step)

    def source(x, y, t):
        flux = [lambda x, y, t, c=c: c(x, y, t) * field(x, y, t) for c in winds]
        divergence = at(flux[0], x, y, t, 0) + at(flux[1], x, y, t, 1)
        return at(field, x, y, t, 2) + divergence + rate(x, y, t) * field(x, y, t)

    return source


@pytest.mark.parametrize("profile", [pytest.param("csl4", marks=pytest.mark.slow), "csl2"])
def test_sources_and_decay_beside_inflow_have_order_two(profile):
    names = {name: getattr(np, name) for name in ("sin", "cos")}
    field, u, v, rate = (
        eval(f"lambda x1, x2, t: {text}", {**names, "w": 0.8}) for text in (WAVE, *WINDS, RATE)
    )
    wave, sizes, errors = Source.from_expression(WAVE, {"w": 0.8}), (8, 16, 32), []
    for n in sizes:
        solver = Solver(
            Grid([(0, 1)] * 2, (n, n)), Velocity.from_expression(*WINDS), "advection", profile,
            boundary=wave, source=residual_of(field, (u, v), rate), decay=RATE,
        )  # fmt: skip
        run = solver.run(solver.state(lambda x, y: field(x, y, 0.0)), 0.5, dt=1 / n)
        exact = solver.state(lambda x, y: field(x, y, 0.5))
        errors.append(np.abs(run.final.data - exact.data)[:, :-1, :-1].max())
        assert np.abs(run.budget.residual).max() < 1e-14
    assert 1.7 < order(sizes, errors) < 2.3
    assert errors[-1] < 4e-3


def test_kinds_of_data_agree():
    """A formula, a callable that is traced, one that cannot be, and a Source are one function."""
    text = "1 + 0.5*sin(3*x2 + t)"

    def hidden(x, y, t):
        return np.where(x > 9, x, 1 + 0.5 * np.sin(3 * y + t))

    kinds = [text, lambda x, y, t: 1 + 0.5 * np.sin(3 * y + t), hidden,
             Source.from_expression("1 + a*sin(3*x2 + t)", {"a": 0.5})]  # fmt: skip
    ends = []
    for data in kinds:
        solver = Solver(
            Grid([(0, 1)] * 2, (8, 9)), Velocity.from_expression("1 + x2", "0.4 - x1"),
            "advection", "csl2", boundary=data,
        )  # fmt: skip
        ends.append(solver.run(solver.state(1.0), 0.3, dt=0.1).final.data)
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-7)  # differences of the hidden one
    assert np.ptp(ends[0][0]) > 0.3


def test_bounds_hold_beside_steep_inflow():
    """Data near 0 beside a steep edge: the split flow's data are clipped, not negative."""
    solver = Solver(
        Grid([(0, 1)] * 2, (16, 16)), Velocity.from_expression("1 + 0*x2", "0.9 - x1"), "advection",
        "csl2", "bounds", "strang", boundary="exp(-400*(x2 - 0.5)**2)", bounds=(0, 1),
    )  # fmt: skip
    run = solver.run(solver.state(0.0), 1.0, dt=0.05, snapshots=20)
    for state in run.states:
        assert min(state[name].min() for name in state.names) >= -1e-14
        assert max(state[name].max() for name in state.names) <= 1 + 1e-14
    assert run.final.mass > 0.05


@pytest.mark.parametrize("profile", MEANS)
@pytest.mark.parametrize("dim", [2, 3])
def test_data_are_averaged_over_the_cells_of_the_wall(profile, dim):
    """Gauss's rule of three is exact for these powers, which a uniform flow carries through."""
    grid = Grid([(0, 1), (0, 1), (0, 2)][:dim], (5, 4, 4)[:dim])
    data = "x2**4" if dim == 2 else "x2**4*(1 + x3**5)"
    c = (1.0, 0.0, 0.0)[:dim]
    solver = Solver(grid, c, "advection", profile, boundary={"x-": data})
    start = solver.state(data)  # by a rule of four
    end = solver.run(start, 1.5, dt=0.13).final
    for name in end.names:
        np.testing.assert_allclose(end[name], start[name], atol=1e-12 * start.data.max())


# Budgets.


@pytest.mark.parametrize("profile", MEANS)
@pytest.mark.parametrize("dim", [1, 2])
def test_uniform_inflow_is_what_the_data_say(profile, dim):
    """c = 0.7 along x carries g(t) = 1 + t in: the integral of .7 g, and out after 1 / .7."""
    grid, c = Grid([(0, 1), (0, 2)][:dim], (8, 6)[:dim]), [0.7, 0.0][:dim]
    solver = Solver(grid, c, "advection", profile, boundary={"x-": "1 + t"})
    run = solver.run(solver.state(0.5), 3.0, dt=0.11, snapshots=3)
    area, t, budget = 2.0 ** (dim - 1), run.times, run.budget
    gone = np.maximum(0.7 * t - 1, 0)  # what came in before and left
    left = 0.5 * np.minimum(0.7 * t, 1) + gone + 0.5 * gone**2 / 0.7
    np.testing.assert_allclose(budget.inflow["x-"], 0.7 * area * (t + t**2 / 2), rtol=1e-13)
    # The end of the start, a jump, is smeared over the outflow wall only for a moment.
    np.testing.assert_allclose(budget.outflow["x+"], area * left, rtol=1e-3)
    assert all(not budget.outflow[wall].any() for wall in budget.outflow if wall != "x+")
    assert np.abs(budget.residual).max() < 1e-13


@pytest.mark.parametrize("steps", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_budget_of_a_region_with_land(steps):
    """All terms at once: the residual stays below 1e-13 of the integral."""
    land = np.zeros((14, 10), bool)
    land[4:7, 3:6] = land[10, 8:] = land[0, :2] = True
    solver = Solver(
        Grid([(0, 1.4), (0, 1)], (14, 10)),
        Velocity.from_expression("1 + 0.5*sin(3*x2 + t)", "0.6*cos(2*x1 - 3*t)"),
        "advection", "csl2", land=land,
        boundary={"x-": "1 + 0.5*sin(x2 + 2*t)", "x+": 0.3, "y-": "closed", "y+": "0.2 + x1"},
        source="0.3*sin(5*x1)**2", decay="0.2 + 0.1*x1",
    )  # fmt: skip
    run = solver.run(solver.state("1 + x1"), 0.02 * steps, dt=0.02, snapshots=4)
    budget = run.budget
    assert np.abs(budget.residual).max() <= 1e-13 * budget.mass[0]
    assert min(budget.inflow["x-"][-1], budget.outflow["x+"][-1], budget.decayed[-1]) > 0.3
    assert budget.inflow["y-"][-1] == budget.outflow["y-"][-1] == 0
    assert not run.final.data[-1][:-1, :-1][land].any()
    assert "inflow" in repr(budget)


def test_a_callback_that_changes_states_is_counted():
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0, "advection", "csl2")

    def halved(state):
        return State(state.grid, state.profile, 0.5 * state.data, state.t)

    budget = solver.run(solver.state(1.0), 0.5, dt=0.25, callback=halved).budget
    assert budget.replaced[-1] == pytest.approx(-0.75, abs=1e-14)
    assert np.abs(budget.residual).max() < 1e-14


def test_diffusion_and_runs_back_in_time_keep_the_budget():
    """Back in time the outflow is what comes in, and forward again all is as it was."""
    grid, texts = Grid([(0, 1)] * 2, (8, 9)), ("1 + 0.3*x2", "0.4 - 0.2*x1")
    data = "1 + 0.2*sin(x1 + 2*x2 - t)"
    solver = made(grid, texts, "csl2", boundary=data, diffusion=0.01)
    assert np.abs(solver.run(solver.state(1.0), 0.5, dt=0.05).budget.residual).max() < 1e-14
    solver = made(grid, texts, "csl2", boundary=data)
    budget = solver.run(solver.state(1.0), -0.5, dt=-0.05).budget
    assert np.abs(budget.residual).max() < 1e-14
    assert min(budget.inflow["x+"][-1], budget.outflow["x-"][-1]) > 0.3
    assert budget.inflow["x-"][-1] == budget.outflow["x+"][-1] == 0


def two_tracers():
    """Inflow, sources and decay of their own, and a reaction between them, past an island."""
    land = np.zeros((12, 8), bool)
    land[4:7, 3:6] = True
    return Solver(
        Grid([(0, 1.2), (0, 1)], (12, 8)),
        Velocity.from_expression("1 + 0.5*sin(3*x2 + t)", "0.6*cos(2*x1 - 3*t)"),
        "advection", "csl2", land=land,
        boundary={"a": {"x-": "1 + x2", "x+": 0.3, "y-": 0.5, "y+": 1.0}, "b": 0.2},
        source={"b": "0.3*sin(5*x1)**2"}, decay={"a": 0.2},
        reactions={"a": "-0.4*a*b", "b": "0.4*a*b"},
    )  # fmt: skip


def test_budgets_of_several_fields_and_of_a_resumed_run(tmp_path):
    solver, dates = two_tracers(), {"dt": 0.03, "snapshots": 3}
    start = solver.state({"a": "1 + x1", "b": "x2"})
    run = solver.run(start, 0.6, **dates)
    for name, budget in run.budget.items():
        assert np.abs(budget.residual).max() < 1e-13 * start.mass[name]
        assert run[name].budget is budget
    a, b = run.budget["a"], run.budget["b"]
    assert a.reacted[-1] < -0.05
    np.testing.assert_allclose(a.reacted, -b.reacted, rtol=0, atol=1e-13)
    assert min(a.inflow["x-"][-1], b.added[-1], a.decayed[-1], b.outflow["x+"][-1]) > 0.02
    assert max(np.abs(a.added).max(), np.abs(b.decayed).max()) < 1e-14  # rounding

    def killed(state):
        if state.t > 0.45:
            raise StopIteration

    folder = {"save": tmp_path / "run", "resume": True}
    solver.run(start, 0.6, **dates, **folder, callback=killed)
    again = two_tracers().run(start, 0.6, **dates, **folder)
    for name, budget in again.budget.items():
        for one in ("t", "mass", "added", "decayed", "reacted", "residual"):
            np.testing.assert_array_equal(getattr(budget, one), getattr(run.budget[name], one))
        for wall, amounts in budget.outflow.items():
            np.testing.assert_array_equal(amounts, run.budget[name].outflow[wall])


def test_profiles_that_keep_no_integral_have_no_budget():
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    run = solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.05)
    with pytest.raises(NotSupported, match=r"budget: .* for 'csl2' and 'csl4'"):
        _ = run.budget


# Land.


def clip(s):
    return 0.5 * (np.abs(s) - np.abs(s - 1) + 1)


def flow_round(x, y):
    """Velocity of the stream function (y - 1/2) (1 - B(x) B(y)), where B is 1 over the island
    |x - 1| < 1/4, |y - 1/2| < 1/8 and falls to 0 smoothly: at rest on the island and its coast."""

    def bump(x, middle, half, width):
        s = (half + width - np.abs(x - middle)) / width
        inside = clip(s)
        slope = 30 * inside**2 * (1 - inside) ** 2 * -np.sign(x - middle) / width
        return inside**3 * (10 - 15 * inside + 6 * inside**2), slope

    A, dA = bump(x, 1.0, 0.25, 0.3)
    B, dB = bump(y, 0.5, 0.125, 0.25)
    return 1 - A * B - (y - 0.5) * A * dB, (y - 0.5) * dA * B


def channel(n, profile, limiter=None, wind=0.0, gusts=0.0, inflow=1.0, gridded=False):
    grid = Grid([(0, 2), (0, 1)], (2 * n, n))
    x, y = np.meshgrid(*(0.5 * (c[1:] + c[:-1]) for c in grid.coordinates), indexing="ij")
    land = (np.abs(x - 1) < 0.25) & (np.abs(y - 0.5) < 0.125)

    def c(x, y, t):
        u, v = flow_round(x, y)
        return u * (1 + gusts * np.sin(5 * t)) + wind, v * (1 + gusts * np.sin(5 * t)) + 0 * x

    velocity = Velocity(c, steady=False) if gusts else Velocity(lambda x, y: c(x, y, 0.0))
    if gridded:
        velocity = Velocity(list(c(*grid.mesh(), 0.0)))
    boundary = {"x-": inflow, "y-": "closed", "y+": "closed"}
    return Solver(grid, velocity, "advection", profile, limiter, boundary=boundary, land=land)


def cells(mean, land, k):
    """Means over blocks of k x k cells of sea."""
    n, m = mean.shape
    return mean.reshape(n // k, k, m // k, k).mean((1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("profile", MEANS)
def test_channel_round_an_island_beside_a_finer_run(profile):
    ends, inflow = {}, "1 + 0.5*sin(4*pi*x2)*sin(3*t)"
    for n in (16, 32, 64):
        solver = channel(n, profile, inflow=inflow)
        run = solver.run(solver.state(1.0), 1.5, dt=0.8 / n)
        ends[n] = run.final["mean"]
        assert not ends[n][solver.land].any()
        assert np.abs(run.budget.residual).max() < 1e-13
    errors = [np.abs(cells(ends[64], solver.land, 64 // n) - ends[n]).mean() for n in (16, 32)]
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 0.005


@pytest.mark.slow
def test_constants_beside_a_coast_are_kept_to_second_order():
    """The flow is at rest on the coast and has no divergence; as without land, sweeps keep 1 up to
    their error of order two."""
    errors = []
    for n in (16, 32, 64):
        solver = channel(n, "csl2")
        end = solver.run(solver.state(1.0), 1.0, dt=0.8 / n).final
        errors.append(np.abs(end["mean"] - 1)[~solver.land].mean())
    assert 1.6 < order((16, 32, 64), errors) < 2.6


@pytest.mark.parametrize(("profile", "limiter"), [("csl2", "bounds"), ("csl4", None)])
@pytest.mark.parametrize("gusts", [0.0, pytest.param(0.9, marks=pytest.mark.slow)])
def test_wind_against_a_coast_keeps_the_integral(profile, limiter, gusts):
    """A thousand steps between closed walls: nothing on land, nothing lost, values finite; what
    gathers slides along the coasts that the wind does not meet head on, and ends in the corner."""
    land = np.zeros((8, 7), bool)
    land[3:5, 2:4] = land[6, 5] = True
    solver = Solver(
        Grid([(0, 1)] * 2, (8, 7)),
        Velocity.from_expression(f"0.5 + {gusts}*sin(t)", f"0.3*cos({gusts}*t)"),
        "advection", profile, limiter, boundary="closed", land=land,
    )  # fmt: skip
    run = solver.run(solver.state("1 + x1*x2"), 20.0, dt=0.02, snapshots=5)
    for state in run.states:
        assert abs(state.mass - run[0].mass) <= 1e-13 * run[0].mass
        assert not state["mean"][land].any()
        assert np.isfinite(state.data).all()
        assert limiter is None or state.data.min() >= -1e-12
    if not gusts:
        assert run.final["mean"][7, 6] / 56 == pytest.approx(run[0].mass, rel=1e-3)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("profile", MEANS)
def test_land_on_a_line(profile, periodic):
    """A wind to the right: empty behind the land, all before it in the coastal cell."""
    land = np.zeros(20, bool)
    land[8:11] = True
    solver = Solver(
        Grid((0, 1), 20, periodic=periodic), 1.0, "advection", profile, land=land,
        boundary=None if periodic else {"x-": 2.0},
    )  # fmt: skip
    run = solver.run(solver.state(1.0), 1.5, dt=0.013)
    mean = run.final["mean"]
    brought = 17 if periodic else 8 + 2 * 1.5 * 20  # in cells of 1
    assert mean[7] == pytest.approx(brought - (0 if periodic else 14), rel=1e-10)
    np.testing.assert_allclose(mean[8:], 0, atol=1e-10)
    assert np.abs(run.budget.residual).max() < 1e-13
    if not periodic:
        np.testing.assert_allclose(mean[:7], 2, rtol=1e-10)


@pytest.mark.parametrize("profile", MEANS)
def test_uniform_flow_along_a_coast_keeps_constants(profile):
    """Slopes of csl4 are not taken across the coast, and values at it not from the land."""
    land = np.zeros((8, 8), bool)
    land[:, :3] = land[:, 4] = True  # a channel one cell wide, and open sea
    for limiter in (None, "bounds"):
        solver = Solver(
            Grid([(0, 1)] * 2, (8, 8)), (1.0, 0.0), "advection", profile, limiter,
            boundary={"x-": 1.0}, land=land,
        )  # fmt: skip
        end = solver.run(solver.state(1.0), 0.5, dt=0.07).final
        np.testing.assert_allclose(end.data, solver.state(1.0).data, atol=1e-13)
        points = np.array([[0.3, 0.3, 0.3], [0.2, 0.45, 0.8]])
        run = solver.run(solver.state(1.0), 0.1, dt=0.05)
        np.testing.assert_allclose(run.sample(points), [0, 1, 1], atol=1e-13)


@pytest.mark.parametrize("profile", MEANS)
def test_a_little_wind_across_a_coast_changes_a_little(profile):
    """1 along a coast: the coastal cells gain or lose what the wind carries, .4 % of it."""
    land = np.zeros((8, 8), bool)
    land[:, :2] = land[:, 6:] = True
    solver = Solver(
        Grid([(0, 1)] * 2, (8, 8), periodic=(True, False)), (1.0, 1e-3), "advection", profile,
        land=land,
    )  # fmt: skip
    end = solver.run(solver.state(1.0), 0.5, dt=0.05).final
    np.testing.assert_allclose(end["mean"][:, 2], 0.996, rtol=1e-3)
    np.testing.assert_allclose(end["mean"][:, 5], 1.004, rtol=1e-3)
    np.testing.assert_allclose(end["u"][:, 2:7], 1.0, rtol=0.01)


def test_gridded_velocities_and_three_directions():
    """Means stay off a pillar in a gridded wind, and the budget closes."""
    solver = channel(8, "csl4", wind=0.3, gridded=True)
    run = solver.run(solver.state(1.0), 0.5, dt=0.05)
    assert np.abs(run.budget.residual).max() < 1e-13
    assert not run.final["mean"][solver.land].any()
    land = np.zeros((6, 5, 4), bool)
    land[2:4, 2:4, :3] = True
    solver = Solver(
        Grid([(0, 1)] * 3, (6, 5, 4), periodic=(False, True, False)),
        Velocity.from_expression("0.5 + x3", "0.3*sin(2*pi*x2 + t)", "0.2 - 0.3*x3"),
        "advection", "csl2", land=land,
        boundary={"x-": "1 + x3", "z-": "closed", "z+": 0.5},
    )  # fmt: skip
    run = solver.run(solver.state("1 + x3"), 1.0, dt=0.1)
    assert np.abs(run.budget.residual).max() < 1e-13
    assert not run.final["mean"][land].any()
    assert run.budget.inflow["x-"][-1] > 0.5


def test_copies_keep_land_and_closed_walls():
    land = np.zeros(16, bool)
    land[5:7] = True
    a = Velocity.from_expression("a + 0*x1", parameters={"a": 0.6})
    solver = Solver(Grid((0, 1), 16), a, "advection", "csl2", boundary={"x+": "closed", "x-": 1.0},
                    land=land)  # fmt: skip
    land[:] = False  # the caller's array is copied
    start = solver.state(1.0)
    end = solver.step(start, 0.2).data
    assert not end[-1][5:7].any()
    for other in (pickle.loads(pickle.dumps(solver)), copy.deepcopy(solver),
                  solver.with_parameters(a=0.6)):  # fmt: skip
        np.testing.assert_array_equal(other.step(start, 0.2).data, end)


LAND = np.zeros((11, 13), bool)
LAND[4:6, 5:8] = True


def flow(backend="cpu", profile="csl2", land=LAND, **more):
    winds = ["a + b*sin(x2 + 3*t)", "b*cos(2*x1) - a"]
    return Solver(
        Grid([(0, 1)] * 2, (11, 13)),
        Velocity.from_expression(*winds, parameters={"a": 0.8, "b": 0.25}), "advection", profile,
        boundary={"x-": "1 + sin(x2)", "y+": "1 + x1", "x+": "closed"},
        land=land, backend=backend, **more,
    )  # fmt: skip


def test_derivatives_stop_at_coasts():
    with equal_substeps():
        solver = flow()
        run = solver.run(solver.state("1 + x1"), 0.2, dt=0.083)
        assert max(dot_test(solver, run, np.random.default_rng(1))) <= 1e-13
        assert parameter_error(solver, run) < 1e-8
    solver = flow(profile="csl4")
    run = solver.run(solver.state(1.0), 0.1, dt=0.1)
    with pytest.raises(NotSupported, match=r"land: .* take 'csl2'"):
        solver.tangent(run)


@pytest.mark.parametrize("profile", MEANS)
def test_devices_agree(cupy, profile):
    runs = []
    for backend in ("cpu", "cupy"):
        solver = flow(backend, profile, source="x1", decay=0.3)
        runs.append(solver.run(solver.state("1 + x1"), 0.3, dt=0.1))
    np.testing.assert_allclose(runs[1].final.data, runs[0].final.data, atol=1e-13)
    for name in ("inflow", "outflow"):
        host, device = (getattr(run.budget, name) for run in runs)
        for wall in host:
            np.testing.assert_allclose(device[wall], host[wall], atol=1e-13)
    assert np.abs(runs[1].budget.residual).max() < 1e-13
    assert not runs[1].final["mean"][LAND].any()


def test_derivatives_on_devices_agree(cupy):
    host, device = (flow(backend) for backend in ("cpu", "cupy"))
    runs = [one.run(one.state("1 + x1"), 0.2, dt=0.1) for one in (host, device)]
    weight = np.random.default_rng(2).standard_normal(runs[0][0].data.size)
    expected = host.adjoint(runs[0]) @ weight
    found = device.adjoint(runs[1]) @ device._kernels.xp.asarray(weight)
    np.testing.assert_allclose(found.get(), expected, atol=1e-11)
