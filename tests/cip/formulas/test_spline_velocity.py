"""Velocities of B-splines: other splines, polynomials, divergence, derivatives, bad input."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from cip import Grid, Solver, SplineVelocity, Velocity

PERIODIC = Grid((-1, 2), 48, periodic=True)
PLANE = Grid([(0, 2), (-1, 1)], (20, 16))
SQUARE = Grid([(0, 1), (0, 1)], (12, 12), periodic=True)
ONE = (1.0,) * 4


def bump(x):
    return 1 + 0.3 * np.sin(2 * x)


def vortices(x, y):
    return 0.1 * np.sin(2 * np.pi * x + 0.3) * np.cos(2 * np.pi * y + 0.4)


def values(formula, orders, *point):
    point = [*point, *([np.zeros(())] * (4 - len(point)))]
    return formula.derivative((*orders, *([0] * (4 - len(orders)))), ONE)(*point)


@pytest.mark.parametrize("degree", [3, 5])
def test_periodic_splines_are_those_of_scipy(degree):
    """With as many pieces as nodes both interpolate, so they are the same spline."""
    grid = Grid((-1, 2), 12, periodic=True)
    data = np.random.default_rng(1).standard_normal(12)
    (formula,) = SplineVelocity(grid, 12, data, degree).on(grid)
    spline = make_interp_spline(
        grid.edges[0], np.append(data, data[0]), k=degree, bc_type="periodic"
    )
    x = np.linspace(-1, 2, 100)[:-1]
    for order in range(3):
        expected = spline(x, nu=order)
        scale = np.abs(expected).max()
        for shift in (0.0, 3.0, -6.0):
            found = values(formula, (order,), x + shift)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize(("degree", "stream"), [(3, False), (5, False), (5, True)])
def test_polynomials_are_reproduced(degree, stream):
    """Cubic splines contain x^a y^b with a, b <= 3; the curl of the stream function is exact."""

    def psi(x, y):
        return x**3 * y - 2 * x * y**2 + y**3

    start = psi if stream else [psi, lambda x, y: 1 + x * y]
    first, second = SplineVelocity(PLANE, (4, 3), start, degree, stream).on(PLANE)
    x, y = np.random.default_rng(2).uniform([[0], [-1]], [[2], [1]], (2, 50))
    if stream:
        np.testing.assert_allclose(values(first, (), x, y), x**3 - 4 * x * y + 3 * y**2, atol=1e-10)
        np.testing.assert_allclose(values(second, (), x, y), -(3 * x**2 * y - 2 * y**2), atol=1e-10)
        divergence = values(first, (1, 0), x, y) + values(second, (0, 1), x, y)
        np.testing.assert_allclose(divergence, 0, atol=1e-10)
    else:
        np.testing.assert_allclose(values(first, (), x, y), psi(x, y), atol=1e-10)
        np.testing.assert_allclose(values(first, (1, 1), x, y), 3 * x**2 - 4 * y, atol=1e-10)
        np.testing.assert_allclose(values(second, (0, 1), x, y), x, atol=1e-10)


def test_a_velocity_lies_between_its_coefficients():
    velocity = SplineVelocity(PERIODIC, 9, 0.7)
    assert set(np.round(list(velocity.parameters.values()), 12)) == {0.7}
    rng = np.random.default_rng(3)
    numbers = rng.uniform(0.2, 3.0, 9)
    (formula,) = velocity.with_parameters(**dict(zip(velocity.names, numbers, strict=True))).on(
        PERIODIC
    )
    found = values(formula, (), np.linspace(-1, 2, 500))
    assert numbers.min() <= found.min()
    assert found.max() <= numbers.max()
    assert np.ptp(found) > 0.2 * np.ptp(numbers)


def test_a_run_is_that_of_the_formula():
    """A linear speed is a spline; the flow leaves at both ends."""
    grid = Grid((-1, 1), 40)
    ends = [
        Solver(grid, velocity).run(Solver(grid, velocity).state("exp(-9*x1**2)"), 0.5, dt=0.05)
        for velocity in (
            SplineVelocity(grid, 5, lambda x: 0.1 + 0.8 * x),
            Velocity.from_expression("0.1 + 0.8*x1"),
        )
    ]
    np.testing.assert_allclose(ends[0].final.data, ends[1].final.data, rtol=0, atol=1e-9)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("grid", "pieces", "start", "stream"),
    [(PERIODIC, 7, bump, False), (SQUARE, 6, vortices, True)],
    ids=["line", "stream"],
)
def test_the_tangent_against_differences(grid, pieces, start, stream):
    velocity = SplineVelocity(grid, pieces, start, stream=stream)
    field = "sin(2*pi*x1/3)" if grid.dim == 1 else "sin(2*pi*x1)*cos(2*pi*x2)"

    def end(**changed):
        solver = Solver(grid, velocity.with_parameters(**changed))
        return solver, solver.run(solver.state(field), 0.2, dt=0.05)

    solver, run = end()
    tangent, size = solver.tangent(run), run.final.data.size
    for q in (0, 3, 6):
        name, e = velocity.names[q], 1e-5
        here = velocity.parameters[name]
        ahead, behind = (end(**{name: here + s * e})[1].final["u"] for s in (1, -1))
        found = (tangent @ np.eye(1, size + len(velocity.names), size + q)[0]).reshape(
            run.final.data.shape
        )[0]
        quotient = ((ahead - behind) / (2 * e)).reshape(found.shape)
        # The error of the feet over e; no foot passes a node, where derivatives jump.
        np.testing.assert_allclose(found, quotient, rtol=0, atol=2e-6 * np.abs(quotient).max())


def test_the_largest_number_of_pieces():
    velocity = SplineVelocity(PLANE, (16, 4), [1.0, 2.0])  # 21 functions on 21 nodes
    assert len(velocity.names) == 2 * 21 * 9
    np.testing.assert_allclose(values(velocity.on(PLANE)[1], (), *PLANE.mesh()), 2, rtol=1e-9)
