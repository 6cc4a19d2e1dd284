"""Feet of unsteady winds by displacements: against paths of many sub-steps, DOP853 and orders."""

from unittest import mock

import numpy as np
import pytest
from compilations import compilations
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st
from schemes import form_of, sampled
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

from cip import Grid, LeftDomain, NotConverged, Solver, Velocity
from cip.characteristics.feet import integrate
from cip.engines import displacements, engine
from cip.engines.displacement_loops import of_half_angles
from cip.formulas.expression import numpy_function, ordered
from cip.formulas.parsing import parse
from cip.formulas.snapshots import Snapshots
from skfem_adini.ground.jit import loop

SLOW = pytest.mark.slow
ONE = (1.0,) * 4
WIND = "0.2 + sin(2*pi*x1)*cos(2*pi*x2 + t)", "-cos(2*pi*x1 + 1.5*t)*sin(2*pi*x2) + 0.1*cos(t)"
TIMES = np.linspace(0, 1, 7)


def solver_of(velocity, grid, profile="bicubic", **more):
    boundary, form = None if all(grid.periodic) else 0.0, more.pop("form", form_of(profile))
    return Solver(grid, velocity, form, profile, boundary=boundary, **more)


def feet_of(solver, stage, t, dt):
    """Feet by the solver, shape (blocks, jets, nodes), and whether displacements gave them."""
    with mock.patch.object(engine, "LIMITS", engine.LIMITS._replace(differences=1)):
        found = solver.feet(stage, t, dt)
    return found, ("displaced", *stage.part(dt)) in solver._kernels.substep_counts


def reference(solver, stage, block, t_end, length, substeps=24):
    """Displacements in cells, by Runge-Kutta steps of the velocity as NumPy evaluates it."""
    velocity = [c.derivative((0,) * 4, ONE) for c in solver.velocity.on(solver.grid)]
    start = [x.ravel() for x in stage.points(block)] + [np.zeros(solver.grid.size)] * 3
    h = length / substeps

    def back(place, t):
        rate = np.zeros_like(place)
        for axis in stage.moving:
            rate[axis] = -velocity[axis](*place, t)
        return rate

    y, t = np.array(start[:3]), t_end
    for _ in range(substeps):
        a = back(y, t)
        b = back(y + h / 2 * a, t - h / 2)
        c = back(y + h / 2 * b, t - h / 2)
        d = back(y + h * c, t - h)
        y, t = y + h / 6 * (a + 2 * b + 2 * c + d), t - h
    return [(y[axis] - start[axis]) / solver.grid.spacing[axis] for axis in stage.moving]


@st.composite
def winds(draw):
    """Two waves of random length, direction, phase and frequency; one code for all numbers, and one
    for those that are steady."""
    waves, steady = [], draw(st.sampled_from([True, False, False]))
    for _ in range(2):
        k, l = (6.283185307179586 * draw(st.sampled_from([-2, -1, 1, 2])) for _ in "xy")
        a, phase, w = (draw(st.floats(0.1, 0.9)) for _ in range(3))
        clock = "" if steady else f" + {4 * w!r}*t"
        waves.append(f"{a!r}*sin({k!r}*x1 + {l!r}*x2 + {5 * phase!r}{clock})")
    shift = draw(st.floats(0.1, 0.4))
    return Velocity.from_expression(f"{shift!r} + " + " + ".join(waves), " - ".join(waves))


def grid_of(uneven, periodic):
    """12 by 14 cells, of equal widths or of 1 to 1.5."""
    lines = [np.linspace(0, 1, n + 1) for n in (12, 14)]
    if not uneven:
        return Grid([(0, 1)] * 2, (12, 14), periodic)
    bend = [0.2 / (2 * np.pi) * np.sin(2 * np.pi * x) for x in lines]
    return Grid.from_coordinates(
        *(x + d for x, d in zip(lines, bend, strict=True)), periodic=periodic
    )


def check_feet(wind, form, degree, profile, periodic, tolerance, cells, place):
    """All feet against a hundred sub-steps of the same velocity."""
    grid, data = grid_of(place == "uneven", periodic), Grid([(0, 1)] * 2, (10, 11), periodic)
    velocity, more = wind, {}
    if form != "formula":
        arrays = sampled(wind, TIMES, data)
        velocity = Velocity.from_snapshots(TIMES, arrays, data, degree, form)
    if place == "land" and profile == "csl4":
        more["land"] = np.zeros(grid.cells, bool)
        more["land"][3:5, 6:9] = True
    solver = solver_of(velocity, grid, profile, foot_tolerance=tolerance, **more)
    dt, compared = cells / 12, 0
    for stage in solver._stages[:2]:
        # A kink of linear interpolation is in the middle.
        feet, _ = feet_of(solver, stage, 0.5 - dt * 0.5 * (stage.begin + stage.end), dt)
        size = len(stage.blocks) * len(stage.jets) * grid.size  # at coasts more follows
        rows = feet.data[:size].reshape(len(stage.blocks), len(stage.jets), -1)
        length = feet.t_end - feet.t_start
        for number, block in enumerate(stage.blocks):
            inside = feet.interior(grid.size, number)
            exact = reference(solver, stage, block, feet.t_end, length, 100)
            points = [x.ravel() for x in stage.points(block)]
            for q, axis in enumerate(stage.moving):
                index = np.indices(grid.nodes)[axis].ravel()
                shift = exact[q] * grid.spacing[axis]
                there = grid.index_displacement(axis, points[axis], shift, index)
                error = np.abs(rows[number, q] - there)[inside]
                assert error.max(initial=0.0) <= tolerance
                compared += error.size
    assert compared > grid.size


CHOICES = {
    "wind": winds(),
    "form": st.sampled_from(["formula", "cubic", "linear"]),
    "degree": st.sampled_from([3, 5]),
    "profile": st.sampled_from(["bicubic", "csl4"]),
    "periodic": st.sampled_from([True, False, (True, False)]),
    "tolerance": st.sampled_from([1e-3, 1e-5, 1e-6]),
    "cells": st.floats(0.3, 3.0),
    "place": st.sampled_from(["even", "even", "uneven", "land"]),
}


@settings(max_examples=10, deadline=None)
@given(**CHOICES)
def test_every_foot_is_within_the_tolerance(**choices):
    check_feet(**choices)


def test_feet_beyond_a_kink_in_time():
    """Halved sub-steps change them by h^2, not by h^4; on uneven grids paths run through kinks."""
    wind = Velocity.from_expression(*WIND)
    check_feet(wind, "linear", 3, "bicubic", True, 1e-6, 1.0, "uneven")


@SLOW
@settings(max_examples=100, deadline=None)
@given(**CHOICES)
def test_every_foot_of_a_hundred_winds_is_within_the_tolerance(**choices):
    check_feet(**choices)


@pytest.mark.parametrize("profile", ["bicubic", "csl4", pytest.param("csl2", marks=SLOW)])
@pytest.mark.parametrize("form", ["transport", "advection"])
def test_feet_of_a_formula_against_an_ode_solver(profile, form):
    """And derivatives against those of the equations."""
    if profile != "bicubic" and form == "transport":
        pytest.skip("conservative")
    grid = Grid([(0, 1)] * 2, (64, 64), periodic=True)
    more = {"form": form} if profile == "bicubic" else {}
    solver = solver_of(Velocity.from_expression(*WIND), grid, profile, foot_tolerance=1e-5, **more)
    stage, dt = solver._stages[1 % len(solver._stages)], 2 / 64
    feet, displaced = feet_of(solver, stage, 0.3, dt)
    assert displaced
    some = np.arange(0, grid.size, 97)
    block = stage.blocks[-1]
    points = [x.ravel()[some] for x in stage.points(block)]
    own = feet.data.reshape(len(stage.blocks), len(stage.jets), -1)[-1][:, some]
    exact = integrate(
        grid, solver.velocity.on(grid), stage.system, points, feet.t_end, feet.t_end - feet.t_start
    )
    expected = stage.components(exact.jets, points, some)
    for jet, one, other in zip(stage.jets, own, expected, strict=True):
        unit = 64.0 ** max(sum(jet.orders) - (jet.component < 3), 0)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5 * unit)
    if profile == "bicubic":
        rates = [c.derivative((0,) * 4, ONE) for c in solver.velocity.on(grid)]

        def back(t, y):
            x1, x2 = y.reshape(2, -1)
            return np.concatenate([c(x1, x2, 0 * x1, t) for c in rates])

        start = np.concatenate(points)
        end = solve_ivp(back, (0.3 + dt, 0.3), start, method="DOP853", rtol=1e-11, atol=1e-12)
        moved = 64 * (end.y[:, -1] - start).reshape(2, -1)
        np.testing.assert_allclose(own[:2], moved, rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", ["formula", "snapshots"])
def test_paths_have_order_four_and_derivatives_order_eight(kind):
    """Sub-steps are fixed by a tolerance that nothing exceeds."""
    velocity, sizes, errors, slopes = Velocity.from_expression(*WIND), (1, 2, 4), [], []
    grid = Grid([(0, 1)] * 2, (24, 24), periodic=True)
    if kind == "snapshots":
        velocity = Velocity.from_snapshots(TIMES, sampled(velocity, TIMES, grid), grid)
    for count in sizes:
        solver = solver_of(velocity, grid, foot_tolerance=1.0)
        (stage,) = solver._stages
        feet_of(solver, stage, 0.2, 0.1)
        found = solver._kernels._memory.displaced[stage].feet(0.2, 0.1, count)
        exact = reference(solver, stage, 0, 0.3, 0.1)
        errors.append(np.abs(found.data.reshape(len(stage.jets), -1)[:2] - exact).max())
    assert 3.7 <= order(sizes, errors) <= 5.0
    if kind == "snapshots":
        return
    for n in (16, 24, 32):
        grid = Grid([(0, 1)] * 2, (n, n), periodic=True)
        solver = solver_of(velocity, grid, foot_tolerance=1.0)
        (stage,) = solver._stages
        feet_of(solver, stage, 0.2, 0.02)
        found = solver._kernels._memory.displaced[stage].feet(0.2, 0.02, 8).data.reshape(8, -1)
        exact = integrate(grid, velocity.on(grid), stage.system, grid.mesh(), 0.22, 0.02)
        rows = stage.components(exact.jets, list(grid.mesh()))
        slopes.append(np.abs(found[2:6] - rows[2:6]).max())
    assert 7.5 <= order((16, 24, 32), slopes) <= 8.5


def test_data_on_another_grid_in_other_cells():
    """Two periods of coarser data, elsewhere; a step over a time of linear interpolation."""
    data = Grid([(0, 1), (0, 2)], (12, 20), True)
    grid = Grid([(-0.3, 1.7), (0.4, 2.4)], (20, 18), True)
    wind = Velocity.from_expression(*WIND)
    velocity = Velocity.from_snapshots(TIMES, sampled(wind, TIMES, data), data, 5, "linear")
    for profile in ("bicubic", "csl4"):
        solver = solver_of(velocity, grid, profile, foot_tolerance=1e-7)
        stage = solver._stages[-1]
        # The kink at TIMES[2] is in the middle of the part of the step that the stage takes.
        dt = 0.1
        start = TIMES[2] - dt * 0.5 * (stage.begin + stage.end)
        feet, displaced = feet_of(solver, stage, start, dt)
        exact = reference(solver, stage, 0, feet.t_end, feet.t_end - feet.t_start)
        assert displaced
        np.testing.assert_allclose(feet.data[: grid.size], exact[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("profile", ["bicubic", "csl4"])
@pytest.mark.parametrize("periodic", [True, (True, False)])
def test_the_derivative_in_the_state_is_that_of_the_run(profile, periodic):
    """The scheme is linear in the moments at the feet of the run."""
    grid = Grid([(0, 1)] * 2, (18, 16), periodic)
    wind = Velocity.from_expression(*WIND)
    velocity = Velocity.from_snapshots(TIMES, sampled(wind, TIMES, grid), grid)
    solver = solver_of(velocity, grid, profile)
    first, other = solver.state("sin(2*pi*x1)"), solver.state("cos(2*pi*x2) + 0.3*x2")
    ends = [solver.run(state, 0.4, dt=0.1) for state in (first, other)]
    change = other.data.ravel() - first.data.ravel()
    moved = solver.tangent(ends[0]) @ change
    expected = ends[1].final.data.ravel() - ends[0].final.data.ravel()
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    weight = np.random.default_rng(0).standard_normal(change.size)
    back = solver.tangent(ends[0]).rmatvec(weight)
    assert abs(back @ change - weight @ moved) <= 1e-12 * np.abs(weight).sum() * np.abs(moved).max()


@pytest.mark.parametrize("kind", ["formula", "snapshots"])
def test_csl4_keeps_the_mass_and_repeats_bit_by_bit(kind):
    grid = Grid([(0, 1)] * 2, (32, 40), periodic=True)
    velocity = Velocity.from_expression(*WIND)
    if kind == "snapshots":
        velocity = Velocity.from_snapshots(TIMES, sampled(velocity, TIMES, grid), grid)
    solver = solver_of(velocity, grid, "csl4")
    start = solver.state("2 + sin(2*pi*x1)*cos(2*pi*x2)")
    with mock.patch.object(engine, "LIMITS", engine.LIMITS._replace(differences=1)):
        one, two = (solver.run(start, 1.0, dt=0.04).final for _ in range(2))
    assert abs(one.mass - start.mass) <= 1e-14 * start.mass
    assert np.abs(one.data - start.data).max() > 0.1
    assert (one.data == two.data).all()


@pytest.mark.parametrize(("time", "size"), [("cubic", 30), ("linear", 131)])
def test_coefficients_at_two_times_at_once_have_the_bits_of_each_alone(time, size):
    """A run that begins anew combines them in another order than one that goes on."""
    from cip.engines.displacement_loops import HEAD

    grid = Grid([(0, 1)] * 2, (size, 12), periodic=True)
    wind = Velocity.from_expression(*WIND)
    velocity = Velocity.from_snapshots(TIMES, sampled(wind, TIMES, grid), grid, 5, time)
    found = []
    for times in ([0.4, 0.45, 0.49], [0.4], [0.45, 0.49], [0.49, 0.45]):
        stage = solver_of(velocity, grid)._stages[0]
        flow = displacements.Displacements(stage, {})._flow(0)
        found.append(dict(zip(times, flow.boxes(*times), strict=True)))
    for some in found[1:]:
        assert all((box[HEAD:] == found[0][t][HEAD:]).all() for t, box in some.items())


def test_vector_code_of_sine_and_cosine():
    from cip.engines.displacement_loops import address, fast_cos, fast_sin

    @loop
    def run(start, stop, x, a, b):
        x, a, b = address(x), address(a), address(b)
        for o in range(start, stop):
            a[o] = fast_sin(x[o])
            b[o] = fast_cos(x[o])

    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-s, s, 5000) for s in (1e-9, 1, 10, 1e3, 1e6)])
    x = np.append(x, np.pi / 4 * np.arange(-99, 100))
    a, b = np.empty_like(x), np.empty_like(x)
    run(0, x.size, x, a, b)
    np.testing.assert_allclose(a, np.sin(x), rtol=3e-16, atol=3e-16)
    np.testing.assert_allclose(b, np.cos(x), rtol=3e-16, atol=3e-16)
    run(0, 2, np.array([np.nan, np.inf]), a, b)
    assert np.isnan([a[:2], b[:2]]).all()


@pytest.mark.parametrize("size", [16, 130])
def test_new_numbers_in_the_text_compile_nothing(size):
    """By the equations of derivatives on small grids, by displacements on large ones."""
    grid = Grid([(0, 1)] * 2, (size, size), periodic=True)

    def end(a, b):
        text = f"{a}*sin(2*pi*x1 + {b}*t)", f"0.1 + {b}*cos(2*pi*x2)*exp(-{a}*t)"
        solver = solver_of(Velocity.from_expression(*text), grid)
        return solver.step(solver.state("sin(2*pi*x1)"), 0.3 / size).data

    first = end(0.3, 0.45)
    with compilations() as names:
        others = [end(a, b) for a, b in ((0.7, 0.11), (-1.3, 4.5))]
    assert names == []
    assert all(np.abs(other - first).max() > 1e-4 for other in others)


def test_what_cannot_be_followed_names_the_remedy():
    grid = Grid([(0, 1)] * 2, (16, 16), periodic=True)
    noise = np.random.default_rng(0).standard_normal((2, 2, 16, 16))
    velocity = Velocity.from_snapshots([0, 1], 1e3 * noise, grid)
    solver = solver_of(velocity, grid, foot_tolerance=1e-9)
    with (
        mock.patch.object(engine, "FEET", engine.FEET._replace(substeps=64)),
        pytest.raises(NotConverged, match="smaller dt, or a larger foot_tolerance"),
    ):
        solver.step(solver.state("x1*0"), 0.5)
    box = Grid([(0, 1)] * 2, (16, 16))
    arrays = np.ones((2, 2, 17, 17))
    inflow = Solver(box, Velocity.from_snapshots([0, 1], arrays, box), profile="bicubic")
    with pytest.raises(LeftDomain, match="characteristic of node"):
        inflow.step(inflow.state("x1"), 0.1)


@pytest.mark.parametrize("form", ["formula", "linear"])
def test_steps_back_in_time(form):
    """The same paths from the other end; with a kink of the interpolation in the middle."""
    grid = Grid([(0, 1)] * 2, (16, 16), periodic=True)
    velocity = Velocity.from_expression(*WIND)
    if form == "linear":
        arrays = sampled(velocity, TIMES, grid)
        velocity = Velocity.from_snapshots(TIMES, arrays, grid, time=form)
    solver = solver_of(velocity, grid, foot_tolerance=1e-7)
    (stage,) = solver._stages
    feet, displaced = feet_of(solver, stage, TIMES[2] + 0.05, -0.1)
    exact = reference(solver, stage, 0, TIMES[2] - 0.05, -0.1, 40)
    assert displaced
    np.testing.assert_allclose(feet.data[: 2 * grid.size], np.ravel(exact), rtol=0, atol=1e-7)


def test_half_angles_are_used_where_they_occur():
    """Fewer angles, the same values."""
    text = "sin(pi*x1)**2*sin(2*pi*x2) + cos(2*pi*x1)*cos(x2)", "cos(2*x2)*sin(pi*x2) + sin(3*x1)"
    rates = [parse(part, "") for part in text]
    made = of_half_angles(rates)
    angles = [
        {node.args[0] for node in ordered(one) if node.op in ("sin", "cos")}
        for one in (rates, made)
    ]
    assert (len(angles[0]), len(angles[1])) == (7, 4)
    x = np.random.default_rng(5).uniform(-3, 3, (2, 50))
    old, new = (numpy_function(one, ["x1", "x2"])(*x) for one in (rates, made))
    np.testing.assert_allclose(new, old, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("times", "kind"), [(2, "linear"), (3, "cubic"), (4, "cubic"), (9, "cubic")]
)
def test_weights_in_time_are_those_of_scipy(times, kind):
    times = np.sort(np.random.default_rng(times).uniform(size=times))
    data = Snapshots(
        times, np.zeros((times.size, 1, 8)), Grid((0, 1), 8, periodic=True), 3, time=kind
    )
    for t in [*np.linspace(times[0] - 0.1, times[-1] + 0.1, 29), *times]:
        first, weights = data.time_weights(t)
        at = np.clip([t], times[0], times[-1])
        expected = BSpline.design_matrix(at, data.knots[0], data.degrees[0]).toarray()[0]
        found = np.zeros(expected.size)
        found[first : first + weights.size] = weights
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)
