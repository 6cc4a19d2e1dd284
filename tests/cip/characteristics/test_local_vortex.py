"""What is steep on ten cells only is followed wherever it lies, however few nodes see it.

A linear field is kept by every profile, so that one step shows the feet themselves.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cip import Grid, Solver, Velocity

SLOW = pytest.mark.slow
DT = 0.02
TURN = 6.0  # radians at the centre in a step


def whirl(grid, place, clock):
    """A vortex of ten cells in x1, x2 that turns by `TURN` exp(-r^2) times the clock's mean."""
    xi, eta = (f"((x{q + 1} - {place[q]!r})/{2.5 * grid.spacing[q]!r})" for q in (0, 1))
    spin = f"{TURN / DT!r}*({clock})*exp(-{xi}**2 - {eta}**2)"
    parts = [f"-{spin}*{eta}*{2.5 * grid.spacing[0]!r}", f"{spin}*{xi}*{2.5 * grid.spacing[1]!r}"]
    return Velocity.from_expression(*parts, *["0"] * (grid.dim - 2))


def whirled(grid, place, turn):
    """The first coordinate of the feet."""
    x, y = grid.mesh()[:2]
    xi, eta = ((x - place[0]) / grid.spacing[0] / 2.5, (y - place[1]) / grid.spacing[1] / 2.5)
    angle = -turn * np.exp(-(xi**2) - eta**2)
    return place[0] + 2.5 * grid.spacing[0] * (np.cos(angle) * xi - np.sin(angle) * eta)


# Each formula is compiled: most stand in the slow lane.
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("place", "periodic", "unit", "t"),
    [
        ((0.503, 0.317), True, 1.0, 0.0),
        pytest.param((0.12, 0.9), True, 1.0, 0.0, marks=SLOW),
        pytest.param((0.7512, 0.5), False, 1e-6, 0.0, marks=SLOW),
        pytest.param((0.503, 0.317), False, 1e3, 3.0, marks=SLOW),
    ],
)
def test_plane(place, periodic, unit, t):
    grid = Grid([(0, unit), (0, 2 * unit)], (192, 160), periodic=periodic)
    where = (place[0] * unit, 2 * place[1] * unit)
    solver = Solver(grid, whirl(grid, where, f"1 + (t - {t!r})"), profile="adini", boundary=0.0)
    end = solver.step(solver.state("x1", t=t), DT)
    exact = whirled(grid, where, TURN * (1 + 0.5 * DT))
    # What `Stage.limit` lets a path err by, at most.
    np.testing.assert_allclose(end["u"], exact, rtol=0, atol=2e-7 * grid.spacing[0])


@pytest.mark.slow
def test_vortex_that_awakes_between_two_looks_at_the_sample():
    """It is still at first, for less time than until sub-steps are sought anew."""
    grid, where = Grid([(0, 1), (0, 1)], (160, 160), periodic=True), (0.503, 0.317)
    clock, late = "0.5 + 0.5*tanh(400*(t - 0.1))", 5
    solver = Solver(grid, whirl(grid, where, clock), profile="adini")
    for k in range(late):
        solver.step(solver.state("x1", t=k * DT), DT)
    end = solver.step(solver.state("x1", t=late * DT), DT)
    turn = TURN / DT * (0.5 * DT + np.log(np.cosh(400 * DT)) / 800)
    np.testing.assert_allclose(
        end["u"], whirled(grid, where, turn), rtol=0, atol=2e-7 * grid.spacing[0]
    )


def squeezed(grid, place):
    """A velocity on a line that changes sign five times within ten cells, and its feet."""
    h = grid.spacing[0]
    strong = 1.5 * h / DT

    def c(t, x):
        s = (x - place) / h
        return strong * (1 + t) * np.sin(s) * np.exp(-((s / 4) ** 2))

    s = f"((x1 - {place!r})/{h!r})"
    field = f"{strong!r}*(1 + t)*sin({s})*exp(-({s}/4)**2)"
    feet = grid.coordinates[0].copy()
    near = np.abs(feet - place) < 30 * h
    feet[near] = solve_ivp(
        lambda tau, x: -c(DT - tau, x), (0, DT), feet[near], "DOP853", rtol=1e-12, atol=1e-12 * h
    ).y[:, -1]
    return Velocity.from_expression(field), feet


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("place", "periodic", "unit"),
    [
        (0.50001, False, 1e-6),
        pytest.param(0.3000004, True, 1.0, marks=SLOW),
        pytest.param(0.83, True, 1e3, marks=SLOW),
    ],
)
def test_line(place, periodic, unit):
    """So many nodes that those of the sample are forty cells apart."""
    grid = Grid((0, unit), 40_000, periodic=periodic)
    velocity, feet = squeezed(grid, place * unit)
    solver = Solver(grid, velocity, boundary=0.0)
    end = solver.step(solver.state("x1"), DT)
    np.testing.assert_allclose(end["u"], feet, rtol=0, atol=3e-7 * grid.spacing[0])


@pytest.mark.parametrize(
    ("form", "profile"),
    [("advection", "csl2"), pytest.param("transport", "cubic", marks=SLOW)],
)
def test_stored_feet(form, profile):
    """Conservative profiles store them; those of many nodes are compiled."""
    grid, place = Grid((0, 1), 120_000, periodic=True), 0.50001
    velocity, feet = squeezed(grid, place)
    solver = Solver(grid, velocity, form, profile, store_feet=True)
    found = solver.feet(solver._stages[0], 0.0, DT).data[: grid.size]
    cells = (feet - grid.coordinates[0]) / grid.spacing[0]
    np.testing.assert_allclose(found, cells, rtol=0, atol=3e-7)


@pytest.mark.turns(4)
def test_velocity_whose_period_divides_the_step():
    """Sub-steps of half a step, or of a quarter, would see its crests only; its integral is 0."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, Velocity.from_expression("cos(2*pi*40*t)"), profile="quintic")
    start = solver.state("sin(2*pi*x1)")
    end = solver.step(start, 0.1)
    np.testing.assert_allclose(end["u"], start["u"], rtol=0, atol=1e-7)
