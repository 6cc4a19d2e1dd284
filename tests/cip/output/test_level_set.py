"""Contours, areas and distances against circles, lines, and shapes across periodic sides."""

import numpy as np
import pytest
from convergence import order

from cip import Grid, InputError, NotSupported, Solver, State, area, contour, reinitialise

SIZES = (16, 32, 64)
BOX = [(-2, 2)] * 2
CIRCLE = "(x1 - 0.1)**2 + (x2 + 0.2)**2 - 1"
BENT = f"({CIRCLE})*(1.5 + sin(2*x1)*cos(x2))"  # gradients on the circle from 1 to 5


def away(x, y):
    return np.hypot(x - 0.1, y + 0.2) - 1


@pytest.mark.parametrize("profile", ["bicubic", "adini"])
def test_a_circle_is_found_to_fourth_order(profile):
    areas, lines, apart = [], [], []
    for n in SIZES:
        state = State.from_function(BENT, Grid(BOX, (n, n)), profile)
        areas.append(abs(area(state) - np.pi))
        (line,) = contour(state)
        assert (line[0] == line[-1]).all()
        lines.append(np.abs(away(*line.T)).max())
        found, (x, y) = reinitialise(state), state.grid.mesh()
        near = np.abs(away(x, y)) < 0.6
        apart.append(np.abs(found["u"] - away(x, y))[near].max())
        assert abs(area(found) - area(state)) < 0.4 * areas[-1] + 1e-7
        slope = np.hypot(found["u_x"], found["u_y"])[near]
        np.testing.assert_allclose(slope, 1.0, atol=1e-9)
    assert order(SIZES, areas) > 3.6
    assert order(SIZES, lines) > 3.0  # the largest error is that of the profile
    assert order(SIZES, apart) > 3.4
    assert apart[-1] < 1e-5


def test_second_derivatives_are_those_of_the_distance():
    grid = Grid(BOX, (96, 96))
    found, (x, y) = reinitialise(State.from_function(CIRCLE, grid)), grid.mesh()
    radius = away(x, y) + 1
    near = np.abs(away(x, y)) < 0.6
    exact = -(x - 0.1) * (y + 0.2) / np.maximum(radius, 0.1) ** 3
    np.testing.assert_allclose(found["u_xy"][near], exact[near], atol=1e-4)


def test_ellipses_on_uneven_grids():
    lines = [np.linspace(-2, 2, n) + 0.05 * np.sin(np.pi * np.linspace(-2, 2, n)) for n in (41, 33)]
    state = State.from_function("x1**2 + 4*x2**2 - 1", Grid.from_coordinates(*lines))
    assert area(state) == pytest.approx(np.pi / 2, abs=1e-6)
    assert area(state, 1.0) == pytest.approx(np.pi, abs=1e-6)
    whole = 16.0 - area(State.from_function("1 - x1**2 - 4*x2**2", state.grid))
    assert whole == pytest.approx(np.pi / 2, abs=1e-6)


def test_sides_belong_to_the_boundary_of_an_area():
    grid = Grid([(0, 1)] * 2, (20, 12), periodic=(True, False))
    state = State.from_function("sin(2*pi*x1) + 2*(x2 - 0.5)", grid)
    assert area(state) == pytest.approx(0.5, abs=1e-12)
    assert area(State.from_function("-1", grid)) == pytest.approx(1.0)
    assert area(State.from_function("1", grid)) == 0.0
    quarter = State.from_function("x1**2 + x2**2 - 1", Grid([(0, 2)] * 2, (20, 20)))
    assert area(quarter) == pytest.approx(np.pi / 4, abs=1e-8)
    hole = State.from_function("(x1**2 + x2**2 - 1)*(0.25 - x1**2 - x2**2)", Grid(BOX, (60, 60)))
    assert 16 - area(hole) == pytest.approx(0.75 * np.pi, abs=2e-5)


def test_distances_reach_across_periodic_sides():
    grid = Grid([(0, 1)] * 2, (40, 40), periodic=True)
    found = reinitialise(State.from_function("0.5*cos(2*pi*x1) + 0*x2", grid, "bicubic"))
    x = grid.mesh()[0]
    np.testing.assert_allclose(found["u"], 0.25 - np.abs((x + 0.5) % 1 - 0.5), atol=1e-9)


def test_lines_that_cross():
    """At a saddle on the contour there is no normal; elsewhere the nearer line counts."""
    grid = Grid([(0, 1)] * 2, (20, 20), periodic=True)
    found = reinitialise(State.from_function("sin(2*pi*x1)*sin(2*pi*x2)", grid, "bicubic"))
    near = [np.abs((x + 0.25) % 0.5 - 0.25) for x in grid.mesh()]
    assert np.isfinite(found.data).all()
    np.testing.assert_allclose(np.abs(found["u"]), np.minimum(*near), atol=1e-9)


def test_a_translated_circle_keeps_its_area():
    solver = Solver(Grid([(0, 1)] * 2, (40, 40), periodic=True), [1.0, 0.5], profile="bicubic")
    start = solver.state("cos(2*pi*x1) + cos(2*pi*x2) + 1")
    run = solver.run(start, 0.37, dt=0.037)
    assert area(run.final) == pytest.approx(area(start), rel=2e-5)


def test_refused():
    state = State.from_function("x1**2 + x2**2", Grid(BOX, (8, 8)))
    with pytest.raises(InputError, match="does not take the value -1"):
        reinitialise(state, -1.0)
    assert contour(state, -1.0) == []
    line = State.from_function("x1", Grid((0, 1), 8))
    with pytest.raises(InputError, match=r"level: the field is at 1 in 16 whole cells"):
        area(State.from_function("1", Grid([(0, 1)] * 2, (4, 4))), 1.0)
    for call in (contour, area, reinitialise):
        with pytest.raises(NotSupported, match="'bicubic' or 'adini'"):
            call(line)
        with pytest.raises(InputError, match="state"):
            call(3.0)
        with pytest.raises(InputError, match="level"):
            call(state, "low")
