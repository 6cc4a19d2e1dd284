"""Random velocities, grids and steps against characteristics by an independent integrator."""

import numpy as np
import pytest
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cip import Grid, Solver, Velocity
from cip.characteristics.flow_derivatives import LOG_DETERMINANT

PI = np.pi


def traced_back(c, divergence, points, t, dt):
    """Feet and logarithm of the determinant by DOP853 at rtol 1e-12."""
    shape = (len(points) + 1, points[0].size)

    def rates(tau, q):
        q = q.reshape(shape)
        parts = [*c(*q[:-1], t - tau), divergence(*q[:-1], t - tau)]
        return -np.concatenate([np.broadcast_to(part, shape[1:]) for part in parts])

    start = np.concatenate([*points, np.zeros(shape[1])])
    end = solve_ivp(rates, (0, dt), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return end.reshape(shape)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10**6), dt=st.floats(1e-3, 6.0))
def test_feet_of_steep_velocities_and_long_steps(seed, dt):
    """|c'| dt up to 40: as many sub-steps as that needs, a third of which would not do."""
    a, b, phase = np.random.default_rng(seed).uniform(-1, 1, 3)
    grid = Grid([(0, 1), (0, 3)], (7, 9), periodic=True)
    texts = [f"{a}*sin(2*pi*x1 + {phase})", f"{b}*cos(2*pi*x2/3) + {a}*sin(2*pi*x1)*cos(t)"]

    def c(x, y, t):
        second = b * np.cos(2 * PI * y / 3) + a * np.sin(2 * PI * x) * np.cos(t)
        return a * np.sin(2 * PI * x + phase), second

    def divergence(x, y, t):
        return 2 * PI * (a * np.cos(2 * PI * x + phase) - b / 3 * np.sin(2 * PI * y / 3))

    solver = Solver(grid, Velocity.from_expression(*texts), "advection", "adini")
    stage, t = solver._stages[0], 0.4
    feet = stage.feet(t, dt).data.reshape(9, -1)
    points = [x.ravel() for x in grid.mesh()]
    expected = traced_back(c, divergence, points, t + dt, dt)
    moved = np.stack([expected[q] - points[q] for q in (0, 1)]) * np.array([[7], [3]])
    # The tolerance of the feet grows with the flow's own sensitivity.
    worst = max(1.0, np.abs(feet[2:6]).max())
    np.testing.assert_allclose(feet[:2], moved, rtol=0, atol=1e-8 * worst)
    np.testing.assert_allclose(np.log(feet[6]), expected[2], rtol=0, atol=1e-7 * worst)
    assert LOG_DETERMINANT in stage.jets


@pytest.mark.turns(4)
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), dt=st.floats(1e-3, 50.0), single=st.booleans())
def test_constants_and_reversal_on_uneven_grids(seed, dt, single):
    """Any uniform flow over any grid keeps constants; a step of one period is the identity."""
    rng = np.random.default_rng(seed)
    lines = [np.cumsum(rng.uniform(0.1, 3.0, n)) for n in (7, 9)]
    grid = Grid.from_coordinates(*lines, periodic=True)
    kind = np.float32 if single else np.float64
    u, v = rng.uniform(-2, 2, 2)
    solver = Solver(grid, Velocity.from_expression(u, v), profile="adini", dtype=kind)
    after = solver.step(solver.state(3.25), dt)
    tolerance = 64 * np.finfo(kind).eps
    np.testing.assert_allclose(after["u"], 3.25, rtol=tolerance)
    # One whole period in each direction, whatever their lengths: the identity.
    lengths = [line[-1] - line[0] for line in lines]
    turn = Solver(
        grid, Velocity.from_expression(*(length / dt for length in lengths)), profile="adini",
        dtype=kind,
    )  # fmt: skip
    state = turn.state(0.0)
    state.data[...] = rng.uniform(-1, 1, state.data.shape)
    back = turn.step(state, dt)
    # Rounding of the feet, times slopes over the narrowest cell.
    np.testing.assert_allclose(back["u"], state["u"], rtol=0, atol=1e3 * np.finfo(kind).eps * 300)


def test_grids_far_from_the_origin_keep_their_widths():
    """Jitter of a third of a cell, 1e-13 of the coordinates, whose digits hold it exactly."""
    rng = np.random.default_rng(12)
    x = np.arange(25) + np.concatenate([[0], rng.integers(-70, 70, 23) / 256, [0]])
    ends = []
    for start, h in ((0.0, 1.0), (2.0**20, 2.0**-22)):
        grid = Grid.from_coordinates(start + h * x, periodic=True)
        assert grid.uniform == (False,)
        solver = Solver(grid, 0.7 * h)
        state = solver.state(lambda q, s=start, h=h: np.sin(PI * (q - s) / (12 * h)))
        ends.append(solver.run(state, 3.0, dt=1.0).final["u"])
    # The places of the feet are known to 2^-33 there, .0005 cells.
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-3)
    assert Grid((1e6, 1e6 + 1e-3), 1000).uniform == (True,)
    assert Grid.from_coordinates(np.cumsum(np.full(2000, 0.1))).uniform == (True,)


FLOWS = {
    "swirl": (
        ("-2*sin(pi*x1)**2*sin(pi*x2)*cos(pi*x2)*cos(t)", "sin(pi*x2)**2*sin(2*pi*x1)*cos(t)"),
        lambda x, y, t: (
            -2 * np.sin(PI * x) ** 2 * np.sin(PI * y) * np.cos(PI * y) * np.cos(t),
            np.sin(PI * y) ** 2 * np.sin(2 * PI * x) * np.cos(t),
        ),
        lambda x, y, t: 0 * x,
    ),
    "compression": (
        ("0.4 + 0.2*sin(2*pi*x1)*cos(2*pi*x2)*cos(3*t)", "0.1*sin(2*pi*(x1 + x2))"),
        lambda x, y, t: (
            0.4 + 0.2 * np.sin(2 * PI * x) * np.cos(2 * PI * y) * np.cos(3 * t),
            0.1 * np.sin(2 * PI * (x + y)),
        ),
        lambda x, y, t: (
            0.4 * PI * np.cos(2 * PI * x) * np.cos(2 * PI * y) * np.cos(3 * t)
            + 0.2 * PI * np.cos(2 * PI * (x + y))
        ),
    ),
}


FAST = {("bicubic", "compression"), ("adini", "compression")}


@pytest.mark.parametrize(
    ("profile", "low", "flow"),
    [
        pytest.param(*case, flow, marks=[] if (case[0], flow) in FAST else pytest.mark.slow)
        for flow in FLOWS
        for case in (("bicubic", 2.7), ("adini", 2.7), ("cubic", 1.9), ("csl4", 1.9))
    ],
)
def test_order_in_unsteady_flows(profile, low, flow):
    """p_t + div(c p) = 0 to t = .5 at two cells a step; the splitting's own order is two."""
    texts, c, divergence = FLOWS[flow]

    def start(x, y):
        return 1.5 + np.sin(2 * PI * x) * np.cos(2 * PI * y)

    errors, sizes = [], (32, 64, 128)
    for n in sizes:
        grid = Grid((0, 1), (n, n), periodic=True)
        splitting = "strang" if profile in ("cubic", "csl4") else None
        field = Velocity.from_expression(*texts)
        solver = Solver(grid, field, "advection", profile, splitting=splitting)
        final = solver.run(solver.state(start), 0.5, dt=2 / n).final["u"]
        coarse = (slice(None, None, n // 8),) * 2
        x, y, log = traced_back(c, divergence, [m[coarse].ravel() for m in grid.mesh()], 0.5, 0.5)
        errors.append(np.sqrt(np.mean((final[coarse].ravel() - np.exp(log) * start(x, y)) ** 2)))
    assert low <= order(sizes, errors) <= 4.3
