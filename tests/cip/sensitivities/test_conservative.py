"""Tangent-linear and adjoint of conservative profiles on lines: transposes, differences, mass."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cip import Grid, Solver, State, Velocity
from cip.characteristics import feet as characteristics
from cip.stages import stage as stages

LINE = np.linspace(0, 1, 24)
GRIDS = {
    "periodic": Grid((0, 1), 25, periodic=True),
    "uneven": Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), periodic=True),
    "walls": Grid((0, 1), 21),
}
TEXTS = ("a + b*sin(2*pi*x1)", "a*sin(5*(x1 - 0.53)) + b*cos(3*t)")
every_profile = pytest.mark.parametrize("profile", ["csl2", "csl4"])
FAST = (("csl2", "uneven"), ("csl4", "walls"))
every_scheme = pytest.mark.parametrize(
    ("profile", "grid"),
    [
        pytest.param(
            profile, grid,
            marks=[pytest.mark.slow] * ((profile, grid) not in FAST),
        )
        for profile in ("csl2", "csl4")
        for grid in GRIDS
    ],
)  # fmt: skip


def solved(grid, text, profile, dt, a=0.9, b=0.3, start=None):
    velocity = Velocity.from_expression(text, parameters={"a": a, "b": b})
    grid = GRIDS[grid]
    boundary = None if grid.periodic[0] else "0.4 + sin(3*t)"
    solver = Solver(grid, velocity, "advection", profile, boundary=boundary)
    first = solver.state("sin(2*pi*x1) + 0.5") if start is None else State(grid, profile, start)
    return solver, solver.run(first, 0.2, dt=dt)


def scales(run):
    """The largest entry of each moment, for every entry: they differ by powers of 1 / h."""
    data = run.final.data
    return np.broadcast_to(np.abs(data).max(axis=1, keepdims=True), data.shape).ravel()


@every_scheme
@settings(max_examples=8)
@given(
    text=st.sampled_from(TEXTS), a=st.floats(0.5, 1.5), b=st.floats(-0.4, 0.4),
    dt=st.floats(0.01, 0.21), seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose(grid, profile, text, a, b, dt, seed):
    solver, run = solved(grid, text, profile, dt, a, b)
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), run[0].data.size
    rng, scale = np.random.default_rng(seed), np.append(scales(run), np.ones(2))
    for only in (slice(0, size), slice(size, None)):
        x, y = np.zeros(size + 2), rng.standard_normal(size) / scale[:size]
        x[only] = (rng.standard_normal(size + 2) * scale)[only]
        forward, backward = tangent @ x, adjoint @ y
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        assert np.any(forward)
        assert abs(y @ forward - x @ backward) <= 1e-13 * bound


@every_scheme
def test_the_parameters_part_against_differences(grid, profile, monkeypatch):
    def integrate(*arguments):  # as many sub-steps in every run
        return characteristics.integrate(*arguments[:6], substeps=16)

    monkeypatch.setattr(stages, "integrate", integrate)
    arguments = (grid, TEXTS[0], profile, 0.083)
    solver, run = solved(*arguments)
    tangent, size, values = solver.tangent(run), run[0].data.size, {"a": 0.9, "b": 0.3}
    for q, name in enumerate(values):

        def end(step, name=name):
            moved = {**values, name: values[name] + step}
            return solved(*arguments, **moved)[1].final.data.ravel()

        e = 2e-5  # no foot passes a node
        quotient = (8 * (end(e) - end(-e)) - (end(2 * e) - end(-2 * e))) / (12 * e)
        found = tangent @ np.eye(size + 2)[size + q]
        # Rounding is 1e-15 / e, and more for slopes.
        assert np.max(np.abs(found - quotient) / scales(run)) < 1e-8


@every_profile
def test_the_state_part_is_the_run_and_the_integral_is_kept(profile):
    solver, run = solved("periodic", TEXTS[0], profile, 0.07)
    shape = run[0].data.shape
    change = np.random.default_rng(2).standard_normal(shape)
    other = solved("periodic", TEXTS[0], profile, 0.07, start=change)[1]
    tangent = solver.tangent(run)
    found = (tangent @ np.append(change, [0, 0])).reshape(shape)
    np.testing.assert_allclose(found, other.final.data, rtol=0, atol=1e-11)
    for direction in np.eye(2):  # no parameter of the velocity changes the integral
        moved = (tangent @ np.append(np.zeros(change.size), direction)).reshape(shape)
        assert np.abs(moved[-1]).max() > 0.1
        assert abs(moved[-1].sum()) < 1e-12
