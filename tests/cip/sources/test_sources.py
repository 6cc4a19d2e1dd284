"""Sources and decay: closed forms, order in time, balance of mass, walls, and bad input."""

import copy
import pickle

import numpy as np
import pytest
from convergence import order
from schemes import form_of

from cip import Grid, Solver, Source, Velocity

PERIODIC = Grid((0, 1), 48, periodic=True)
SCHEMES = ["linear", "piecewise_linear", "cubic", "quintic", "csl2", "csl4"]
SPEED = 0.5
# u = 1 + cos(2 pi x) sin t solves u_t + c u_x = s - k u with
RATE = "0.6 + 0.3*sin(2*pi*x1 + t)"
SOURCE = f"cos(2*pi*x1)*cos(t) - 0.5*2*pi*sin(2*pi*x1)*sin(t) + ({RATE})*(1 + cos(2*pi*x1)*sin(t))"


def exact(x, t):
    return 1 + np.cos(2 * np.pi * x) * np.sin(t)


@pytest.mark.parametrize("profile", SCHEMES)
def test_the_order_in_time_is_two(profile):
    """Feet lie on nodes, where the transport of a constant speed is exact."""
    solver = Solver(PERIODIC, SPEED, form_of(profile), profile, source=SOURCE, decay=RATE)
    (x,), steps, errors = PERIODIC.coordinates, [6, 12, 24], []
    for count in steps:
        end = solver.run(solver.state(1.0), 1.0, dt=1 / count).final
        errors.append(np.abs(end["u"] - exact(x, 1.0)).max())
    assert 1.9 < order(steps, errors) < 2.1
    assert errors[-1] < 2e-3
    expected = solver.state(lambda x: exact(x, 1.0))
    for found, one in zip(end.data, expected.data, strict=True):  # slopes and means follow
        np.testing.assert_allclose(found, one, rtol=0, atol=3.2e-3 * np.abs(one).max())


@pytest.mark.parametrize("profile", SCHEMES)
def test_the_same_rate_everywhere_multiplies_every_moment(profile):
    form = form_of(profile)
    start = Solver(PERIODIC, SPEED, form, profile).state(lambda x: np.exp(np.sin(2 * np.pi * x)))
    plain = Solver(PERIODIC, SPEED, form, profile).run(start, 0.3, dt=0.043).final
    for rate in (0.8, lambda x: 0.8 + 0 * x):
        end = Solver(PERIODIC, SPEED, form, profile, decay=rate).run(start, 0.3, dt=0.043).final
        np.testing.assert_allclose(end.data, np.exp(-0.24) * plain.data, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize(("profile", "dim"), [("csl2", 1), ("csl4", 1), ("csl2", 2), ("csl2", 3)])
def test_the_mass_changes_by_sources_less_decay(profile, dim):
    grid = Grid([(0, 1)] * dim, (12,) * dim, periodic=True)
    flow = Velocity.from_expression(*["0.4 + 0.2*sin(2*pi*x1)", "0.3*cos(2*pi*x1)", "0.2"][:dim])
    source = "(1 + t + t**3)*(2 + sin(2*pi*x1))"  # its integral from 0 to t: 2 t + t^2 + t^4 / 2

    def run(**more):
        solver = Solver(grid, flow, "advection", profile, **more)
        return solver.run(solver.state(lambda *x: 1 + 0.5 * np.cos(2 * np.pi * x[0])), 0.6, dt=0.1)

    found = run(source=source).diagnostics.mass
    assert found[-1] - found[0] == pytest.approx(1.2 + 0.36 + 0.0648, abs=1e-13)
    found = run(decay=0.9).diagnostics.mass
    assert found[-1] / found[0] == pytest.approx(np.exp(-0.54), abs=1e-13)
    # M' = 2 - k M
    both = [run(source="2 + sin(2*pi*x1)", decay=0.9).diagnostics.mass[-1]]
    assert both[0] == pytest.approx(2 / 0.9 + (1 - 2 / 0.9) * np.exp(-0.54), abs=1e-3)


@pytest.mark.parametrize(
    ("profile", "dim"),
    [
        ("adini", 2),
        ("bicubic", 2),
        ("cubic", 2),
        ("csl2", 2),
        pytest.param("csl4", 2, marks=pytest.mark.slow),
        pytest.param("quintic", 3, marks=pytest.mark.slow),
    ],
)
def test_planes_and_space(profile, dim):
    """u = e^{-k t} (f(x - c t) + t s(x - c t)): source and decay move with the flow."""
    grid = Grid([(0, 1)] * dim, (24, 20, 8)[:dim], periodic=True)
    c = (0.5, -0.3, 0.4)[:dim]
    moving = "sin(2*pi*(x1 - 0.5*t)) * cos(2*pi*(x2 + 0.3*t)) * exp(-0.7*t)"
    solver = Solver(grid, c, form_of(profile), profile, source=moving, decay=0.7)
    end = solver.run(solver.state(2.0), 0.5, dt=0.05).final
    expected = solver.state(
        lambda *x: (
            np.exp(-0.35)
            * (2 + 0.5 * np.sin(2 * np.pi * (x[0] - 0.25)) * np.cos(2 * np.pi * (x[1] + 0.15)))
        )
    )
    for found, one in zip(end.data, expected.data, strict=True):
        np.testing.assert_allclose(found, one, rtol=0, atol=6e-3 * np.abs(one).max())


@pytest.mark.parametrize(
    ("profile", "dim"),
    [("bicubic", 2), ("csl2", 2), ("csl4", 1), pytest.param("csl2", 3, marks=pytest.mark.slow)],
)
def test_a_rate_that_varies_acts_on_every_moment(profile, dim):
    """At rest, u = u0 exp(-K): means and mixed derivatives against those of the closed form."""
    errors = []
    for n in (8, 16):
        grid = Grid([(0, 1)] * dim, (n,) * dim)
        rate = "1 + 0.5*x1*x2 + x1**2" if dim > 1 else "1 + x1**2"
        solver = Solver(grid, (0.0,) * dim, form_of(profile), profile, decay=rate)
        end = solver.run(solver.state("1 + sin(x1)"), 0.4, dt=0.2).final
        last = "x1*x2" if dim > 1 else "0"
        expected = solver.state(f"(1 + sin(x1))*exp(-0.4*(1 + 0.5*{last} + x1**2))")
        errors.append(np.abs(end.data - expected.data).max())
    if profile == "bicubic":
        assert errors[1] < 1e-13
    else:  # the rule for means is of order 4, with slopes 6
        assert errors[1] < 2e-6
        assert np.log2(errors[0] / errors[1]) > (5.5 if profile == "csl4" else 3.7)


@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
def test_what_enters_through_a_wall(profile):
    """Second order up to the wall: u = g(t - x) e^{-k x} + s (1 - e^{-k x}) / k for c = 1."""
    grid = Grid((0, 1), 200)

    def truth(x, t):
        return np.cos(3 * (t - x)) * np.exp(-0.8 * x) + 2 * (1 - np.exp(-0.8 * x)) / 0.8

    solver = Solver(
        grid, 1.0, form_of(profile), profile, boundary={"x-": "cos(3*t)"}, source=2.0, decay=0.8
    )
    steps, errors = [5, 10, 20], []
    for count in steps:
        end = solver.run(solver.state(lambda x: truth(x, 0.0)), 0.5, dt=0.5 / count).final
        errors.append(np.abs(end["u"] - truth(grid.coordinates[0], 0.5)).max())
    assert 1.8 < order(steps, errors) < 2.3
    if profile == "csl2":
        mass = solver.state(lambda x: truth(x, 0.5)).mass
        assert end.mass == pytest.approx(mass, abs=1e-3)


@pytest.mark.parametrize("kind", ["text", "callable", "timeless", "array", "snapshots", "opaque"])
def test_the_forms_of_a_source(kind):
    (x,) = PERIODIC.coordinates
    times = np.linspace(0, 1, 6)
    source = {
        "text": "sin(2*pi*x)*(1 + t)",
        "callable": lambda x, t: np.sin(2 * np.pi * x) * (1 + t),
        "timeless": lambda x: 1.5 * np.sin(2 * np.pi * x),
        "array": 1.5 * np.sin(2 * np.pi * x),
        "snapshots": Source.from_snapshots(
            times, np.sin(2 * np.pi * x) * (1 + times[:, None]), PERIODIC
        ),
        "opaque": lambda x, t=0.0: np.where(x > 9, x, np.sin(2 * np.pi * x)) * (1 + t),
    }[kind]
    solver = Solver(PERIODIC, 0.0, source=source)
    end = solver.run(solver.state(0.0), 1.0, dt=0.25).final
    expected = solver.state("1.5*sin(2*pi*x1)")
    for found, one, scale in zip(end.data, expected.data, (1, 10), strict=True):
        np.testing.assert_allclose(found, one, rtol=0, atol=1e-7 * scale)
    other = pickle.loads(pickle.dumps(solver)) if kind != "opaque" else copy.deepcopy(solver)
    again = other.run(other.state(0.0), 1.0, dt=0.25).final
    np.testing.assert_allclose(again.data, end.data, rtol=0, atol=1e-14)
