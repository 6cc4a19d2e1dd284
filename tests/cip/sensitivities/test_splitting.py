"""Tangent-linear and adjoint of steps split into sweeps, in planes and in space."""

import numpy as np
import pytest

from cip import Grid, NotSupported, Solver, State, Velocity
from cip.characteristics import feet as characteristics
from cip.stages import stage as stages

LINE = np.linspace(0, 1, 9)
PLANE = Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), LINE**1.1, periodic=True)
OPEN = Grid([(0, 1), (0, 1)], (8, 7), periodic=(False, True))
SPACE = Grid([(0, 1)] * 3, (6, 5, 7), periodic=(True, True, False))
FLOWS = {
    "plane": (PLANE, ("a + b*sin(2*pi*x2 + t)", "b*cos(2*pi*x1) + 0.7*a")),
    "walls": (OPEN, ("a + b*sin(2*pi*x2 + t)*x1", "b*cos(3*x1) - a")),
    "space": (SPACE, ("a + b*sin(2*pi*x2)", "b*cos(2*pi*x1) + a*x3", "a*0.5 + b*x1")),
}
SLOW = pytest.mark.slow
CASES = [
    pytest.param("plane", "cubic", "transport", marks=SLOW),
    ("space", "cubic", "transport"),
    pytest.param("walls", "cubic", "transport", marks=SLOW),
    pytest.param("plane", "quintic", "advection", marks=SLOW),
    pytest.param("walls", "cubic", "advection", marks=SLOW),
    pytest.param("space", "cubic", "advection", marks=SLOW),
    pytest.param("space", "quintic", "transport", marks=SLOW),
]


def solved(flow, profile, form, start=None, a=0.6, b=0.3, dt=0.083):
    grid, texts = FLOWS[flow]
    velocity = Velocity.from_expression(*texts, parameters={"a": a, "b": b})
    value = 0.0 if form == "advection" else 0.8
    boundary = None if all(grid.periodic) else value
    solver = Solver(grid, velocity, form, profile, splitting="strang", boundary=boundary)
    state = solver.state("sin(2*pi*x1)*cos(2*pi*x2) + 0.5")
    state = state if start is None else State(grid, profile, start)
    return solver, solver.run(state, 0.2, dt=dt)


def scales(run):
    """The largest entry of each moment, for every entry: they differ by powers of 1 / h."""
    data = run.final.data
    largest = np.abs(data).max(axis=tuple(range(1, data.ndim)), keepdims=True)
    return np.broadcast_to(largest, data.shape).ravel()


@pytest.fixture
def equal_substeps(monkeypatch):
    """As many in every run: with another number the feet differ by up to 1e-8 cells."""

    def integrate(*arguments):
        return characteristics.integrate(*arguments[:6], substeps=8)

    monkeypatch.setattr(stages, "integrate", integrate)
    monkeypatch.setattr(stages.Stage, "substeps", lambda self, t, dt: 8)


@pytest.mark.parametrize(("flow", "profile", "form"), CASES)
def test_transpose_and_differences(flow, profile, form, equal_substeps):
    solver, run = solved(flow, profile, form)
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), run[0].data.size
    rng, scale = np.random.default_rng(5), np.append(scales(run), np.ones(2))
    for only in (slice(0, size), slice(size, None)):
        x, y = np.zeros(size + 2), rng.standard_normal(size) / scale[:size]
        x[only] = (rng.standard_normal(size + 2) * scale)[only]
        forward, backward = tangent @ x, adjoint @ y
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        assert np.any(forward)
        assert abs(y @ forward - x @ backward) <= 1e-13 * bound
    for q, name in enumerate(("a", "b")):

        def end(step, name=name):
            values = {"a": 0.6, "b": 0.3}
            values[name] += step
            return solved(flow, profile, form, **values)[1].final.data.ravel()

        e = 2e-5  # no foot passes an edge
        quotient = (8 * (end(e) - end(-e)) - (end(2 * e) - end(-2 * e))) / (12 * e)
        found = tangent @ np.eye(size + 2)[size + q]
        assert np.max(np.abs(found - quotient) / scale[:size]) < 1e-8


def test_the_state_part_is_the_run_itself():
    run = solved("plane", "cubic", "transport")[1]
    change = np.random.default_rng(6).standard_normal(run[0].data.shape)
    solver, other = solved("plane", "cubic", "transport", change)
    found = solver.tangent(other) @ np.append(change, [0, 0])
    assert np.max(np.abs(found - other.final.data.ravel()) / scales(other)) < 1e-12


def test_conservative_sweeps_are_refused():
    grid = Grid([(0, 1)] * 2, (8, 8), periodic=True)
    solver = Solver(grid, (1.0, 0.0), "advection", "csl2", splitting="strang")
    with pytest.raises(NotSupported, match="profile: derivatives of 'csl2' in 2 dimensions"):
        solver.tangent(solver.run(solver.state(0.0), 0.1, dt=0.1))
