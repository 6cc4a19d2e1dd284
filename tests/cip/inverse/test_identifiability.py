"""What data cannot tell: waves that came back, parameters that act alike, and closed-form gains."""

import numpy as np
import pytest
from truths import FIELD, snapshots

from cip import Grid, IdentifiabilityWarning, Solver, SplineVelocity, Velocity, identify_velocity

GRID = Grid((0, 1), 100, periodic=True)


@pytest.mark.parametrize("noise", [0, 1e-3, None])
def test_a_period_of_the_flow_tells_the_mean_alone(noise):
    """c = 1 and T = 1: every node is back, and changes of c of mean 0 move it by nothing."""
    solver = Solver(GRID, SplineVelocity(GRID, 12, 1.0))
    data = snapshots(lambda x: 1 + 0 * x, [1.0], GRID, noise or 0.0)
    with pytest.warns(IdentifiabilityWarning, match="do not determine 11 of 12 directions: waves"):
        found = identify_velocity(solver, solver.state(FIELD), data, dt=0.05, noise=noise)
    seen = found.identifiability
    assert seen.seen.tolist() == [True] + 11 * [False]
    assert np.ptp(seen.patterns[0]) < 0.05 * np.abs(seen.patterns[0]).max()
    assert np.min(found.value_deviations) > 0.9
    assert "do not determine" in found.summary()


def test_a_quarter_of_a_period_hides_four_waves():
    """c = 1 / (1 + .3 sin 8 pi x) from t = .25: the travel time over .25 is that of c = 1."""
    solver = Solver(GRID, SplineVelocity(GRID, 24, 1.0))

    def c(x):
        return 1 / (1 + 0.3 * np.sin(8 * np.pi * x))

    data = snapshots(c, [0.25], GRID, 1e-3)
    with pytest.warns(IdentifiabilityWarning, match="length 0.25"):
        found = identify_velocity(
            solver, solver.state(FIELD), data, dt=0.025, noise=1e-3, bounds=(0.05, np.inf)
        )
    error = found.values[0] - c(GRID.coordinates[0])
    assert found.explained  # the misfit is that of the noise
    assert np.linalg.norm(error) > 0.1 * np.linalg.norm(c(GRID.coordinates[0]))  # the answer is not
    assert np.all(np.abs(error) <= found.value_deviations[0])  # which the deviations say


def test_parameters_that_act_alike_are_named():
    speed = Velocity.from_expression("a + b", parameters={"a": 0.5, "b": 0.5})
    solver = Solver(GRID, speed)
    data = snapshots(lambda x: 1.1 + 0 * x, [0.3], GRID, 1e-3)
    with pytest.warns(IdentifiabilityWarning, match=r"1 of 2 directions: .0\.71 [ab] .0\.71 [ab]"):
        found = identify_velocity(solver, solver.state(FIELD), data, dt=0.03, noise=1e-3)
    assert found.parameters["a"] + found.parameters["b"] == pytest.approx(1.1, abs=1e-3)
    assert min(found.deviations.values()) > 0.5  # each alone is unknown
    assert found.value_deviations.max() < 1e-3  # their sum is not
