"""Velocities identified in planes, by formulas and by splines of a stream function."""

import numpy as np
import pytest
from truths import feet, snapshots

from cip import (
    Grid,
    IdentifiabilityWarning,
    Sensors,
    Solver,
    SplineVelocity,
    Velocity,
    identify_velocity,
)

TAU = 2 * np.pi


def swirl(strength, drift=0.0):
    """Vortices of the stream function -strength cos(2 pi y) ... and a drift along x."""

    def c(x, y):
        first = drift + strength * np.sin(TAU * x + 0.3) * np.cos(TAU * y)
        return np.stack([first, -strength * np.cos(TAU * x + 0.3) * np.sin(TAU * y)])

    return c


FLOW = Velocity.from_expression(
    "d + s*sin(2*pi*x1 + .3)*cos(2*pi*x2)", "-s*cos(2*pi*x1 + .3)*sin(2*pi*x2)",
    parameters={"s": 0.2, "d": 0.0},
)  # fmt: skip


def tracer(x, y):
    return np.sin(TAU * x) + np.cos(TAU * (x + y)) + np.sin(2 * TAU * y)


# The flow keeps areas, so a conservative splitting moves the same field.
SPLIT = {"splitting": "strang", "form": "advection"}


@pytest.mark.parametrize(
    ("profile", "scheme"),
    [("adini", {}), ("bicubic", {}), pytest.param("csl4", SPLIT, marks=pytest.mark.slow)],
)
def test_parameters_of_a_plane_flow(profile, scheme):
    grid = Grid([(0, 1), (0, 1)], (32, 32), periodic=True)
    solver = Solver(grid, FLOW, profile=profile, **scheme)
    data = snapshots(swirl(0.5, 0.1), (0.12, 0.2), grid, 0.02, u=tracer)
    found = identify_velocity(solver, solver.state(tracer), data, dt=0.04, noise=0.02)
    for name, value in {"s": 0.5, "d": 0.1}.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name] <= 0.02
    assert found.explained
    exact = swirl(0.5, 0.1)(*grid.mesh())
    # Some nodes lie where the velocity is 0 whatever its parameters are.
    assert np.all(np.abs(found.values - exact) <= 4.0 * found.value_deviations + 1e-15)
    assert found.plot().get_aspect() == 1.0


@pytest.mark.slow
def test_a_stream_function():
    """One direction is never seen: a constant in the stream function moves nothing."""
    grid = Grid([(0, 1), (0, 1)], (20, 20), periodic=True)
    data = snapshots(swirl(0.5), (0.15,), grid, 0.02, u=tracer)

    def guess(x, y):
        return 0.05 * np.sin(TAU * x + 0.3) * np.sin(TAU * y)

    solver = Solver(grid, SplineVelocity(grid, 6, guess, stream=True))
    with pytest.warns(IdentifiabilityWarning, match="do not determine"):
        found = identify_velocity(solver, solver.state(tracer), data, dt=0.15, noise=0.02)
    exact = swirl(0.5)(*grid.mesh())
    error = found.values - exact
    assert np.linalg.norm(error) <= 0.1 * np.linalg.norm(exact)
    assert np.mean(np.abs(error) <= 2.0 * found.value_deviations) >= 0.9


@pytest.mark.slow
def test_both_components():
    """Each component by splines of its own; nothing says that the flow keeps areas."""
    grid, c = Grid([(0, 1), (0, 1)], (16, 16), periodic=True), swirl(0.5, 0.2)
    data = snapshots(c, (0.1, 0.2), grid, 0.01, u=tracer)
    solver = Solver(grid, SplineVelocity(grid, 6, start=[0.1, 0.0]), profile="adini")
    found = identify_velocity(
        solver, solver.state(tracer), data, dt=0.1, noise=0.01, regularization="H1"
    )
    exact = c(*grid.mesh())
    error = found.values - exact
    assert np.linalg.norm(error) <= 0.05 * np.linalg.norm(exact)
    assert np.mean(np.abs(error) <= 2.0 * found.value_deviations) >= 0.9


def test_sensors_in_a_plane():
    """Reports at points between the nodes, at many times: as well as their deviations say."""
    grid = Grid([(0, 1), (0, 1)], (32, 32), periodic=True)
    places, times = np.random.default_rng(3).random((2, 6)), np.arange(1, 7) * 0.04
    ends = feet(swirl(0.5, 0.1), times, *places)
    values = np.stack([tracer(*at) for at in ends])
    data = Sensors(places, times, values, 0.02).perturbed(seed=4, dropouts=0.1)
    solver = Solver(grid, FLOW, profile="adini")
    found = identify_velocity(solver, solver.state(tracer), data, dt=0.04)
    for name, value in {"s": 0.5, "d": 0.1}.items():
        assert abs(found.parameters[name] - value) <= 4.0 * found.deviations[name] <= 0.05
    assert found.explained
