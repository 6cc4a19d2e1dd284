"""Flow maps and runs back in time against closed forms, DOP853 and the reversed velocity."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cip import Grid, NotSupported, Solver, Velocity, flow_map

text = Velocity.from_expression
BOX = Grid([(0, 2), (0, 1)], (24, 12))


def gyre(x, y, t=0.0):
    """The double gyre of Shadden, Lekien and Marsden (2005)."""
    a = 0.25 * np.sin(0.2 * np.pi * t)
    f, slope = a * x**2 + (1 - 2 * a) * x, 2 * a * x + 1 - 2 * a
    speed = 0.1 * np.pi
    return (
        -speed * np.sin(np.pi * f) * np.cos(np.pi * y),
        speed * np.cos(np.pi * f) * np.sin(np.pi * y) * slope,
    )


def carried(places, start, end):
    def rates(t, y):
        return np.ravel(gyre(*y.reshape(2, -1), t))

    times = (start, end)
    run = solve_ivp(rates, times, places.ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    return run.y[:, -1].reshape(places.shape)


@pytest.mark.parametrize(("start", "end"), [(0.0, 6.0), (6.0, 1.0)])
def test_double_gyre(start, end):
    found = flow_map(gyre, BOX, start, end, tolerance=1e-10)
    nodes = np.stack(BOX.mesh())
    np.testing.assert_allclose(found.positions, carried(nodes, start, end), rtol=0, atol=1e-9)
    inside = (slice(None), slice(1, -1), slice(1, -1))
    for k, step in enumerate(1e-5 * np.eye(2)[:, :, None, None]):
        sides = [carried((nodes + s * step)[inside], start, end) for s in (1, -1)]
        slope = (sides[0] - sides[1]) / 2e-5
        largest = np.abs(found.gradient).max()
        np.testing.assert_allclose(found.gradient[:, k][inside], slope, atol=1e-6 * largest)
    # The flow keeps areas, so the other singular value is the inverse.
    assert not found.left.any()
    assert found.lyapunov.min() > -1e-9


def test_exponents_of_linear_flows():
    turn = flow_map(text("-x2", "x1"), Grid([(-9, 9)] * 2, (12, 12)), 0.0, 0.05)
    kept = ~turn.left
    np.testing.assert_allclose(turn.lyapunov[kept], 0.0, atol=1e-7)
    assert np.isnan(turn.lyapunov[turn.left]).all()
    space = Grid([(-1, 1)] * 3, (6, 6, 6))
    for way in (1.0, -1.0):
        found = flow_map(text("-2*x1", "x2", "x3"), space, 1.0, 1.0 + 0.3 * way)
        kept = ~found.left
        np.testing.assert_allclose(found.lyapunov[kept], 1.0 if way > 0 else 2.0, atol=1e-7)


def test_points_that_leave_stop_at_the_wall():
    found = flow_map(text("1"), Grid((0, 1), 10), 0.0, 0.35)
    x = np.linspace(0, 1, 11)
    np.testing.assert_allclose(found.positions[0], np.minimum(x + 0.35, 1.0), atol=1e-9)
    assert (found.left == (x + 0.35 > 1.0)).all()


def test_winds_from_arrays_and_periodic_directions():
    """x(t) of dx/dt = sin(x - t) + 1 in closed form: s = x - t has s' = sin s."""
    grid, times = Grid((0, 2 * np.pi), 64, periodic=True), np.linspace(0, 2, 41)
    winds = [1 + np.sin(grid.coordinates[0] - t) for t in times]
    found = flow_map(Velocity.from_snapshots(times, winds, grid), grid, 0.0, 2.0, tolerance=1e-6)
    s = np.arctan2(np.exp(2.0) * np.sin(grid.coordinates[0] / 2), np.cos(grid.coordinates[0] / 2))
    np.testing.assert_allclose(found.positions[0], 2 * s + 2.0, atol=1e-5)


PERIODIC, OPEN = Grid([(0, 1)] * 2, (24, 20), periodic=True), Grid((0, 1), 40)
FLOW = ("sin(2*pi*x2)*cos(t) + 0.3", "0.4*cos(2*pi*x1)")
BACK = ("-(sin(2*pi*x2)*cos(0.5 - t) + 0.3)", "-0.4*cos(2*pi*x1)")
CASES = {
    "bicubic": (PERIODIC, FLOW, BACK, {}, {}),
    "csl4": (PERIODIC, FLOW, BACK, {"form": "advection", "profile": "csl4"}, {}),
    "walls": (OPEN, ("0.5 + 2*x1",), ("-0.5 - 2*x1",),
              {"form": "advection", "profile": "csl2", "boundary": "0.3 + sin(9*t)"},
              {"boundary": "0.3 + sin(9*(0.5 - t))"}),
    "source": (PERIODIC, FLOW, BACK, {"source": "sin(2*pi*x1)*cos(t)"},
               {"source": "-sin(2*pi*x1)*cos(0.5 - t)"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_run_back_in_time_is_one_of_the_reversed_velocity(case):
    grid, flow, back, options, reversed_options = CASES[case]
    solver = Solver(grid, text(*flow), **options)
    wave = "0.4 + 0.2*sin(2*pi*x1)" + ("*cos(2*pi*x2)" if grid.dim == 2 else "")
    start = solver.state(wave, t=0.5)
    run = solver.run(start, 0.0, dt=-0.05, snapshots=2)
    assert run.times.tolist() == [0.5, 0.25, 0.0]
    other = Solver(grid, text(*back), **{**options, **reversed_options})
    expected = other.run(other.state(wave), 0.5, dt=0.05).final
    # Steady feet, and the places and times where they meet walls, are the same numbers.
    atol = 1e-12 if case == "walls" else 2e-8
    np.testing.assert_allclose(run.final.data, expected.data, rtol=0, atol=atol)
    if case == "bicubic":
        same = solver.run(start, 0.0, cfl=0.5)
        assert same.dt < 0 < len(same.states)
        with pytest.raises(NotSupported, match="back in time"):
            solver.adjoint(run)


def test_decay_backward_grows():
    solver = Solver(OPEN, 0.0, decay=0.7)
    run = solver.run(solver.state(1.0, t=1.0), 0.0, dt=-0.1)
    np.testing.assert_allclose(run.final["u"], np.exp(0.7), rtol=1e-13)
