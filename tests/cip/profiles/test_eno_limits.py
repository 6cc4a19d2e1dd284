"""What `eno` does not promise, with the numbers that the docstring of `Solver` gives for it."""

import numpy as np
import pytest
from example_scripts import load

from cip import Grid, Solver, Velocity


def passed(limiter, n=200):
    """How far Jiang and Shu's profile leaves its range at a speed that varies by a factor 19."""
    example = load("cip_jiang_shu")
    speed = Velocity.from_expression(f"1 + 0.9*sin({np.pi}*x1)")
    solver = Solver(example.grid(n), speed, profile="cubic", limiter=limiter)
    found = solver.run(example.start(solver), 8.0, cfl=0.4, snapshots=16).diagnostics
    return max(found.maximum.max() - 1.0, -found.minimum.min())


def test_new_extrema_at_varying_speed():
    """The piecewise linear profile follows tangents beyond both ends where slopes are steep."""
    eno, none, clamp = passed("eno"), passed(None), passed("clamp")
    assert 0.2 < eno < 0.3
    assert 0.06 < none < 0.08
    assert clamp < 1e-12


def lost(profile, limiter):
    """The share of the integral of a bell, two cells wide, that a swirl draws out."""
    grid = Grid([(0, 1)] * 2, (48, 48))
    swirl = Velocity.from_expression(
        "sin(pi*x1)**2*sin(2*pi*x2)".replace("pi", repr(np.pi)),
        "-sin(pi*x2)**2*sin(2*pi*x1)".replace("pi", repr(np.pi)),
    )
    solver = Solver(grid, swirl, profile=profile, limiter=limiter, boundary=0.0)
    start = solver.state(lambda x, y: np.exp(-((x - 0.5) ** 2 + (y - 0.75) ** 2) / 0.05**2))
    return 1 - solver.run(start, 1.0, dt=1 / 48).final.mass / start.mass


@pytest.mark.parametrize(
    ("profile", "eno", "clamp"),
    [("adini", 0.25, 0.05), pytest.param("bicubic", 0.31, 0.11, marks=pytest.mark.slow)],
)
def test_the_integral_of_a_thinning_bell(profile, eno, clamp):
    assert abs(lost(profile, "eno") - eno) < 0.02
    assert abs(lost(profile, "clamp") - clamp) < 0.02
    assert abs(lost(profile, None)) < 1e-3
