"""Planes with walls: data only where the flow comes in, along walls and out of corners."""

from itertools import product

import numpy as np
import pytest

from cip import Grid, Solver, Velocity

DIRECTIONS = [d for d in product((-1, 0, 1), repeat=2) if any(d)]


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_uniform_flow_needs_data_only_where_it_comes_in(profile):
    """Cubics are carried exactly, in all eight directions: walls may be followed, corners met."""
    for a, b in DIRECTIONS:

        def field(x, y, t, a=a, b=b):
            x, y = x - 0.7 * a * t, y - 0.6 * b * t
            return x**2 * y - y**3 + 2 * x * y - 1

        into = {"x-": a > 0, "x+": a < 0, "y-": b > 0, "y+": b < 0}
        data = {wall: field for wall, comes_in in into.items() if comes_in}
        grid = Grid([(0, 1), (0, 2)], (8, 8))
        solver = Solver(grid, [0.7 * a, 0.6 * b], profile=profile, boundary=data)
        state = solver.state(lambda x, y, field=field: field(x, y, 0.0))
        for dt in (0.05, 0.4):
            state = solver.step(state, dt)
        expected = solver.state(lambda x, y, field=field, t=state.t: field(x, y, t))
        np.testing.assert_allclose(state.data, expected.data, atol=1e-12)


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_turning_flow_leaves_through_its_corner(profile):
    """x' = 1 + x, y' = -y: in at x-, along y- where y = 0, in at y+; exact to the profile."""

    def field(x, y, t):
        return np.log(1 + x) - t + (y * np.exp(t)) ** 2

    errors = []
    for n in (8, 16, 32):
        grid = Grid((0, 1), (n, n))
        solver = Solver(
            grid, Velocity.from_expression("1 + x1", "-x2"), profile=profile,
            boundary={"x-": field, "y+": field},
        )  # fmt: skip
        run = solver.run(solver.state(lambda x, y: field(x, y, 0.0)), 0.5, dt=1 / n)
        errors.append(np.abs(run.final["u"] - field(*grid.mesh(), 0.5)).max())
    assert errors[-1] < 1e-5
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 2.5)
