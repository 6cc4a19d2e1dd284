"""Orders of convergence at fixed dt / h, by a fit over three grids."""

import numpy as np
import pytest
from convergence import order

from cip import Grid, Solver, Velocity

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


def swirl(x, y):
    """Divergent periodic flow."""
    return 0.3 + 0.2 * np.sin(x) * np.cos(y), 0.2 - 0.1 * np.cos(x + y)


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_direct_advection_in_two_dimensions(profile):
    """p+ = det(dX/dx) p0(X) with X and the determinant from an independent integrator."""
    from scipy.integrate import solve_ivp

    def start(x, y):
        return 2 + np.sin(x) * np.cos(2 * y)

    t, errors, sizes = 1.0, [], (32, 64, 128)
    for n in sizes:
        grid = Grid((0, 2 * np.pi), (n, n), periodic=True)
        solver = Solver(grid, Velocity(swirl), "advection", profile)
        run = solver.run(solver.state(start), t, dt=1.5 * 2 * np.pi / n)
        coarse = slice(None, None, n // 16)
        x, y = (line[coarse, coarse].ravel() for line in grid.mesh())

        def rates(_, q):
            a, b, _ = q.reshape(3, -1)
            u, v = swirl(a, b)
            divergence = 0.2 * np.cos(a) * np.cos(b) + 0.1 * np.sin(a + b)
            return -np.concatenate([u, v, divergence])

        end = solve_ivp(rates, (0, t), np.concatenate([x, y, 0 * x]), rtol=1e-11, atol=1e-12).y[
            :, -1
        ]
        a, b, log_det = end.reshape(3, -1)
        exact = np.exp(log_det) * start(a, b)
        errors.append(np.sqrt(np.mean((run.final["u"][coarse, coarse].ravel() - exact) ** 2)))
    assert 2.9 <= order(sizes, errors) <= 4.2
