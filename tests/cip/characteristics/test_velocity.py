"""Formulas, their derivatives, and the characteristics against independent answers."""

import numpy as np
import pytest
from convergence import order

from cip import Grid, Solver, Velocity
from cip.characteristics.feet import integrate
from cip.characteristics.flow_derivatives import System, foot

SLOW = pytest.mark.slow
KINDS = ["traced", pytest.param("values", marks=SLOW), "jacobian", "arrays", "expression"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_velocity_gives_the_same_step(kind):
    grid = Grid([(0, 2 * np.pi)] * 2, (24, 24), periodic=True)

    def c(x, y):
        return np.sin(y) + 0.3, 0.4 * np.cos(x)

    def branched(x, y):
        return np.where(x > 1e9, x, np.sin(y) + 0.3), 0.4 * np.cos(x)

    def jacobian(x, y):
        return [[0 * x, np.cos(y)], [-0.4 * np.sin(x), 0 * x]]

    velocity = {
        "traced": lambda: Velocity(c),
        "values": lambda: Velocity(branched),
        "jacobian": lambda: Velocity(branched, jacobian=jacobian),
        "arrays": lambda: Velocity(np.array(c(*grid.mesh()))),
        "expression": lambda: Velocity.from_expression("sin(x2) + 0.3", "0.4*cos(x1)"),
    }[kind]()
    assert all(f.exact for f in velocity.on(grid)) == (kind in ("traced", "expression"))
    solver = Solver(grid, velocity, profile="bicubic")
    after = solver.step(solver.state("sin(x1)*cos(2*x2)"), 0.4)
    reference = Solver(
        grid, Velocity.from_expression("sin(x2)+0.3", "0.4*cos(x1)"), profile="bicubic"
    )
    expected = reference.step(reference.state("sin(x1)*cos(2*x2)"), 0.4)
    # Quintic splines and sixth-order differences on 24 nodes a period.
    tolerance = {"arrays": 2e-5, "values": 1e-6, "jacobian": 1e-6}.get(kind, 1e-12)
    np.testing.assert_allclose(after.data, expected.data, atol=tolerance)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stored", [True, False])
def test_unsteady_velocity_has_order_three(stored):
    """u_t + cos(t) u_x = 0: the exact shift is sin t."""
    errors, sizes = [], (20, 40, 80)
    for n in sizes:
        grid = Grid((0, 1), n, periodic=True)
        solver = Solver(grid, Velocity.from_expression("cos(t)"), store_feet=stored)
        run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.7 / n)
        exact = np.sin(2 * np.pi * (grid.coordinates[0] - np.sin(1.0)))
        errors.append(np.abs(run.final["u"] - exact).max())
    assert 2.9 <= order(sizes, errors) <= 3.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "shift"), [("20*exp(-((t-0.5)/0.02)**2)", 0.4 * np.sqrt(np.pi)), ("t**7", 0.125)]
)
def test_substeps_of_a_velocity_that_changes_between_two_counts(text, shift):
    """A pulse between two of the times at which sub-steps are counted anew."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, Velocity.from_expression(text), profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.05)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - shift))
    np.testing.assert_allclose(run.final["u"], exact, atol=1e-7)


def test_partial_steps_have_their_own_feet():
    """The cache is keyed by dt: a short last step must not use the feet of a long one."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, lambda x: 1 + 0 * x, profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 0.25, dt=0.1)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - 0.25))
    np.testing.assert_allclose(run.final["u"], exact, atol=1e-8)


@pytest.mark.parametrize("steepness", [0.1, 3.0, 10.0])
def test_substeps_follow_the_steepness(steepness):
    """dx/dt = k sin(2 pi x) has tan(pi x(t)) = tan(pi x) exp(2 pi k t); |c'| dt is `steepness`."""
    grid, dt = Grid((0.01, 1.01), 40, periodic=True), 0.5  # no node where c = 0
    k = steepness / (2 * np.pi * dt)
    formulas = Velocity.from_expression(f"{k!r}*sin(2*pi*x1)").on(grid)
    system = System([f.expression for f in formulas], [0], [foot(0, 0)])
    x = grid.coordinates[0]
    found = integrate(grid, formulas, system, [x], 0.0, dt)
    shrink = np.exp(-steepness)
    exact = np.arctan2(shrink * np.sin(np.pi * x), np.cos(np.pi * x)) / np.pi
    miss = x + found.jets[foot(0)] - exact
    np.testing.assert_allclose(miss - np.round(miss), 0, atol=3e-11)
    slope = shrink / (np.cos(np.pi * x) ** 2 + (shrink * np.sin(np.pi * x)) ** 2)
    np.testing.assert_allclose(found.jets[foot(0, 0)], slope, rtol=3e-9)
    assert steepness / 2 <= found.substeps <= 512 * (1 + steepness)


@pytest.mark.parametrize(
    ("profile", "dim", "splitting"),
    [
        ("adini", 2, None),
        pytest.param("bicubic", 2, None, marks=SLOW),
        pytest.param("quintic", 1, None, marks=SLOW),
        pytest.param("csl4", 1, None, marks=SLOW),
        pytest.param("cubic", 3, "strang", marks=SLOW),
    ],
)
def test_single_precision_follows_double(profile, dim, splitting):
    grid = Grid([(0, 1)] * dim, (32,) * dim, periodic=True)
    field = ("0.3 + 0.1*sin(2*pi*x1)",) if dim == 1 else ("sin(2*pi*x2)", "cos(2*pi*x1)", "0.4")
    ends = []
    for dtype in (np.float64, np.float32):
        form = "advection" if profile == "csl4" else "transport"
        solver = Solver(
            grid, Velocity.from_expression(*field[:dim]), form, profile, splitting=splitting,
            dtype=dtype,
        )  # fmt: skip
        final = solver.run(solver.state("sin(2*pi*x1)"), 0.3, dt=0.05).final
        assert final["u"].dtype == dtype
        ends.append(final["u"])
    np.testing.assert_allclose(ends[1], ends[0], atol=5e-6)
