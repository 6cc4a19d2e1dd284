"""Tangent-linear and adjoint of direct steps in planes: transposes, differences, closed forms."""

from itertools import product

import numpy as np
import pytest

from cip import Grid, NotSupported, Solver, State, Velocity
from cip.stages.stage import Stage

PERIODIC = Grid([(0, 1), (0, 1)], (14, 12), periodic=True)
MIXED = Grid([(-1, 1), (0, 1)], (12, 10), periodic=(False, True))
LINE = np.linspace(0, 1, 15)
UNEVEN = Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), LINE**1.1, periodic=True)
CASES = {
    "steady": (PERIODIC, ("a + b*sin(2*pi*x1)*cos(2*pi*x2)", "b*cos(2*pi*x1) + 0.3")),
    "mixed": (MIXED, ("a*x1", "a + b*sin(2*pi*x2 + t)*x1")),
    "uneven": (UNEVEN, ("a + b*sin(2*pi*x2 - t)", "b*cos(2*pi*x1) + 0.7*a")),
}
VALUES = {"a": 0.4, "b": 0.2}
FIELD = "sin(2*pi*x1) + 0.3*cos(4*pi*x1)*sin(2*pi*x2)"
SCHEMES = [(p, f) for p in ("adini", "bicubic") for f in ("transport", "advection")]
RUNS = [
    pytest.param(*case, *scheme, id="-".join((*scheme, name)))
    for (name, case), scheme in product(CASES.items(), SCHEMES)
]


def every_run(test):
    """Each velocity is compiled anew for each scheme: one pair in the fast lane, by turns."""
    return pytest.mark.sampled(12)(
        pytest.mark.parametrize(("grid", "texts", "profile", "form"), RUNS)(test)
    )


def solved(grid, texts, profile, form, start=None, dt=0.07, **values):
    velocity = Velocity.from_expression(*texts, parameters=VALUES).with_parameters(**values)
    solver = Solver(grid, velocity, form, profile)
    state = solver.state(FIELD) if start is None else State(grid, profile, start)
    return solver, solver.run(state, 0.2, dt=dt)


@every_run
def test_the_adjoint_is_the_transpose_and_the_state_part_the_run(grid, texts, profile, form):
    solver, run = solved(grid, texts, profile, form)
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), run[0].data.size
    assert tangent.shape == adjoint.shape[::-1] == (size, size + 2)
    rng = np.random.default_rng(1)
    for _ in range(3):
        x, y = rng.standard_normal(size + 2), rng.standard_normal(size)
        forward, backward = tangent @ x, adjoint @ y
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        assert abs(y @ forward - x @ backward) <= 1e-14 * bound
        only = x * (np.arange(size + 2) >= size)
        bound = np.abs(y) @ np.abs(tangent @ only) + np.abs(only) @ np.abs(backward)
        assert abs(y @ (tangent @ only) - only @ backward) <= 1e-13 * bound
    change = rng.standard_normal(run[0].data.shape)
    other = solved(grid, texts, profile, form, start=change)[1].final.data
    found = (tangent @ np.append(change, [0, 0])).reshape(change.shape)
    scale = np.abs(other).max(axis=(1, 2), keepdims=True)
    # Rounding of mixed derivatives from random data, h^-2 times that of the values.
    assert np.max(np.abs(found - other) / scale) < 1e-12


@every_run
def test_the_parameters_part_against_differences(grid, texts, profile, form, monkeypatch):
    # Between two runs the numbers of sub-steps may change, and with them the feet by 1e-8 cells.
    monkeypatch.setattr(Stage, "substeps", lambda self, t, dt: 16)
    solver, run = solved(grid, texts, profile, form, dt=0.049)
    tangent, size = solver.tangent(run), run[0].data.size
    for q, name in enumerate(VALUES):

        def end(step, name=name):
            values = {name: VALUES[name] + step}
            return solved(grid, texts, profile, form, dt=0.049, **values)[1].final.data

        e = 2e-5  # no foot passes an edge, where derivatives jump
        quotient = (8 * (end(e) - end(-e)) - (end(2 * e) - end(-2 * e))) / (12 * e)
        found = (tangent @ np.eye(size + 2)[size + q]).reshape(quotient.shape)
        scale = np.abs(quotient).max(axis=(1, 2), keepdims=True)
        assert np.max(np.abs(found - quotient) / scale) < 1e-9


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("profile", "form"), SCHEMES)
def test_the_closed_form_of_a_spiral(profile, form):
    """In complex numbers dz/dt = (a + ib) z: the foot is z exp(-(a + ib) t); det = exp(-2 a t)."""
    grid, t, a, b = Grid([(-1, 1)] * 2, (48, 48)), 0.2, 0.5, 0.3
    texts = "a*x1 - b*x2", "b*x1 + a*x2"
    velocity = Velocity.from_expression(*texts, parameters={"a": a, "b": b})
    solver = Solver(grid, velocity, form, profile)
    run = solver.run(solver.state("exp(-4*((x1-0.2)**2 + x2**2))"), t, dt=0.05)
    tangent, size = solver.tangent(run), run[0].data.size
    x, y = grid.mesh()
    foot = (x + 1j * y) * np.exp(-(a + 1j * b) * t)
    u = np.exp(-4 * ((foot.real - 0.2) ** 2 + foot.imag**2))
    slope = -8 * u * (foot - 0.2)
    exact = [(slope * np.conj(change)).real for change in (-t * foot, -1j * t * foot)]
    if form == "advection":
        exact = [np.exp(-2 * a * t) * part for part in exact]
        exact[0] = exact[0] - 2 * t * np.exp(-2 * a * t) * u
    for q, expected in enumerate(exact):
        found = (tangent @ np.eye(size + 2)[size + q]).reshape(run[0].data.shape)[0]
        # Profiles of order three on cells of 1/24; derivatives of u up to 30.
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_limiters_are_refused():
    grid = Grid([(0, 1)] * 2, (8, 8), periodic=True)
    solver = Solver(grid, (1.0, 0.0), profile="adini", limiter="eno")
    with pytest.raises(NotSupported, match="limiter: 'eno' is not differentiable"):
        solver.adjoint(solver.run(solver.state(0.0), 0.1, dt=0.1))
