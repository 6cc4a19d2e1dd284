"""Deviations against errors in random identifications: no more answers outside than there may be.

Speed, field, noise and times are drawn; the data come from DOP853, the weight of the seminorm from
the discrepancy principle. Of each problem one error is taken, over its stated deviation.
"""

import numpy as np
import pytest
from scipy.stats import binom
from truths import snapshots

from cip import Grid, Solver, SplineVelocity, Velocity, identify_velocity

GRID = Grid((0, 1), 64, periodic=True)
SPEED = Velocity.from_expression(
    "a + b*sin(2*pi*x1) + d*cos(2*pi*x1)", parameters={"a": 1.0, "b": 0.0, "d": 0.0}
)


def waves(rng, sizes):
    """A function with random waves of these sizes."""
    numbers = rng.standard_normal((2, len(sizes))) * sizes

    def f(x):
        angle = 2 * np.pi * np.multiply.outer(np.arange(1, len(sizes) + 1), x)
        return np.tensordot(numbers[0], np.sin(angle), 1) + np.tensordot(
            numbers[1], np.cos(angle), 1
        )

    return f, numbers


def deviation(seed):
    """The error of one random problem in stated deviations: of a parameter or of c at a node."""
    rng = np.random.default_rng(seed)
    u, _ = waves(rng, [1.0, 0.7, 0.5])
    bump, numbers = waves(rng, [0.15] if seed % 2 else [0.15, 0.05])
    mean = rng.uniform(0.8, 1.3)
    noise, times = 10 ** rng.uniform(-2.5, -1.5), np.sort(rng.uniform(0.08, 0.3, 3))

    def c(x):
        return mean + bump(x)

    data = snapshots(c, times, GRID, noise, seed, u)
    solver = Solver(GRID, SPEED if seed % 2 else SplineVelocity(GRID, 10, 1.0))
    found = identify_velocity(solver, solver.state(u), data, dt=0.05, noise=noise)
    if seed % 2:
        name, value = [("a", mean), ("b", numbers[0, 0]), ("d", numbers[1, 0])][rng.integers(3)]
        return (found.parameters[name] - value) / found.deviations[name]
    node = rng.integers(GRID.size)
    error = found.values[0, node] - c(GRID.coordinates[0])[node]
    return error / found.value_deviations[0, node]


@pytest.mark.slow
@pytest.mark.filterwarnings("default::UserWarning")
def test_three_hundred_problems():
    errors = [deviation(seed) for seed in range(300)]
    # As many lie outside so many deviations with a chance below 1 : 1000 if these are right.
    for size, chance in ((1, 0.3173), (2, 0.0455), (3, 0.0027)):
        assert np.sum(np.abs(errors) > size) <= binom.ppf(0.999, len(errors), chance), errors
    # Nor are they far too large: then the errors would be small beside them.
    assert np.sqrt(np.mean(np.square(errors))) > 0.5
