"""Orders of convergence at fixed dt / h, by a fit over three grids, and exact polynomials."""

import numpy as np
import pytest
from convergence import order

from cip import Grid, Solver, Velocity
from cip.output.sample import sample

SIZES = (40, 80, 160)


def periodic_error(n, profile, form, grid=None, cfl=0.4):
    grid = grid or Grid((0, 1), n, periodic=True)
    solver = Solver(grid, 1.0, form, profile)
    run = solver.run(solver.state(lambda x: np.sin(np.pi * x) ** 4), 2.0, dt=cfl / n)
    return np.abs(run.final["u"] - run[0]["u"]).mean()


@pytest.mark.parametrize(
    ("profile", "form", "low", "high"),
    [
        ("cubic", "transport", 2.95, 3.15),
        ("cubic", "advection", 2.95, 3.15),
        ("csl2", "advection", 2.95, 3.15),
        ("quintic", "transport", 4.9, 5.15),
        ("quintic", "advection", 4.9, 5.15),
        ("csl4", "advection", 4.9, 5.15),
    ],
)
def test_smooth_periodic(profile, form, low, high):
    errors = [periodic_error(n, profile, form) for n in SIZES]
    assert low <= order(SIZES, errors) <= high


def test_jittered_grid():
    """35 % random displacement of every node, seed 5."""
    errors = []
    for n in SIZES:
        shift = 0.35 * np.random.default_rng(5).uniform(-1, 1, n + 1)
        shift[[0, n]] = 0
        grid = Grid.from_coordinates((np.arange(n + 1) + shift) / n, periodic=True)
        errors.append(periodic_error(n, "cubic", "transport", grid))
    assert 2.9 <= order(SIZES, errors) <= 3.3


@pytest.mark.parametrize("cfl", [0.7, 3.0])
@pytest.mark.parametrize("form", ["transport", "advection"])
def test_inflow(form, cfl):
    """c = 1 + x/2 on [0, 1]; the exact solution is constant (or decays) along characteristics."""

    def start(x):
        return np.sin(3 * x) + np.cos(2 * x)

    def exact(x, t):
        decay = np.exp(-t / 2)
        # x + 2 grows as exp(t/2); the field is continued smoothly beyond the wall.
        back = (x + 2) * decay - 2
        return start(back) * (decay if form == "advection" else 1)

    errors = []
    for n in SIZES:
        grid = Grid((0, 1), n)
        solver = Solver(grid, lambda x: 1 + x / 2, form, "cubic", boundary={"x-": exact})
        run = solver.run(solver.state(start), 1.0, dt=cfl / n)
        errors.append(np.abs(run.final["u"] - exact(grid.coordinates[0], 1.0)).max())
    assert 2.9 <= order(SIZES, errors) <= 3.4


@pytest.mark.parametrize(("profile", "low"), [("quintic", 4.7), ("csl4", 4.7), ("csl2", 2.9)])
def test_inflow_of_the_other_profiles(profile, low):
    """A time-dependent inflow at 2.7 cells a step; conservative profiles also keep the balance."""

    def exact(x, t):
        return np.sin(3 * (x - t)) + 2

    errors, sizes = [], (20, 40, 80)
    for n in sizes:
        grid = Grid((0, 1), n)
        solver = Solver(grid, 1.0, "advection", profile, boundary={"x-": exact})
        run = solver.run(solver.state(lambda x: exact(x, 0.0)), 0.9, dt=2.7 / n)
        errors.append(np.abs(run.final["u"] - exact(grid.coordinates[0], 0.9)).max())
        if profile.startswith("csl"):
            expected = 2.0 + (np.cos(-2.7) - np.cos(0.3)) / 3
            assert run.final.mass == pytest.approx(expected, abs=20 * errors[-1] + 1e-12)
    assert low <= order(sizes, errors) <= low + 1.5


def swept(profile, grid, velocity, **more):
    return Solver(grid, velocity, "advection", profile, splitting="strang", **more)


@pytest.mark.parametrize(("profile", "low", "high"), [("csl2", 2.9, 3.3), ("csl4", 4.8, 5.3)])
def test_order_of_uniform_flow(profile, low, high):
    sizes, errors = (12, 24, 48), []
    for n in sizes:
        solver = swept(profile, Grid((0, 1), (n, n), periodic=True), [1.0, 0.5])
        start = solver.state(lambda x, y: 2 + np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y))
        final = solver.run(start, 2.0, dt=0.4 / n).final
        errors.append(np.abs(final["u"] - start["u"]).mean())
        assert abs(final.mass / start.mass - 1) <= 1e-13
    assert low <= order(sizes, errors) <= high


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_order_of_the_splitting(profile):
    """Rotation of a smooth bell by half a turn: the sweeps add an error of order two."""
    sizes, errors = (20, 30, 45), []
    for n in sizes:
        grid = Grid((-1, 1), (n, n))
        field = Velocity.from_expression("-x2", "x1")
        solver = swept(profile, grid, field, boundary=0.0)
        start = solver.state(lambda x, y: np.exp(-20 * ((x - 0.3) ** 2 + y**2)))
        final = solver.run(start, np.pi, dt=np.pi / n).final
        errors.append(np.abs(final["u"] - start["u"][::-1]).mean())
    assert 1.9 <= order(sizes, errors) <= 3.3


def quartic(x, y):
    return (1 + x - 2 * x**2 + x**3 - x**4) * (2 - y + y**2 + 0.5 * y**4)


def test_quartics_are_exact():
    """Between nodes, by slopes that csl4 finds at walls too; moved, as far as no inflow comes."""
    line = np.cumsum([0, 0.2, 0.15, 0.25, 0.1, 0.2, 0.15])
    grid = Grid.from_coordinates(line, 2 * line[-1] - 2 * line[::-1])
    solver, dt = swept("csl4", grid, [0.4, -0.7], boundary=0.0), 0.17
    start = solver.state(quartic)
    points = np.random.default_rng(7).uniform(0, 1, (2, 40)) * [[1.05], [2.1]]
    np.testing.assert_allclose(sample(start, points), quartic(*points), rtol=1e-11)
    after = solver.step(start, dt)
    expected = solver.state(lambda x, y: quartic(x - 0.4 * dt, y + 0.7 * dt))
    for name in start.names:
        np.testing.assert_allclose(after[name][3:, :-1], expected[name][3:, :-1], rtol=1e-11)
