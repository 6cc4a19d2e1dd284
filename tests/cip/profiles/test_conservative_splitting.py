"""CSL2 and CSL4 through splitting: order, polynomials, integral and bounds in two dimensions."""

import numpy as np
import pytest
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st

from cip import Grid, Solver, Velocity


def solver_of(profile, grid, velocity, limiter=None, **more):
    return Solver(grid, velocity, "advection", profile, limiter, "strang", **more)


@pytest.mark.parametrize(("profile", "low", "high"), [("csl2", 2.9, 3.3), ("csl4", 4.8, 5.3)])
def test_order_of_uniform_flow(profile, low, high):
    sizes, errors = (12, 24, 48), []
    for n in sizes:
        solver = solver_of(profile, Grid((0, 1), (n, n), periodic=True), [1.0, 0.5])
        start = solver.state(lambda x, y: 2 + np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y))
        final = solver.run(start, 2.0, dt=0.4 / n).final
        errors.append(np.abs(final["u"] - start["u"]).mean())
        assert abs(final.mass / start.mass - 1) <= 1e-13
    assert low <= order(sizes, errors) <= high


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_order_of_the_splitting(profile):
    """Rotation of a smooth bell by half a turn: the sweeps add an error of order two."""
    sizes, errors = (20, 30, 45), []
    for n in sizes:
        grid = Grid((-1, 1), (n, n))
        field = Velocity.from_expression("-x2", "x1")
        solver = solver_of(profile, grid, field, boundary=0.0)
        start = solver.state(lambda x, y: np.exp(-20 * ((x - 0.3) ** 2 + y**2)))
        final = solver.run(start, np.pi, dt=np.pi / n).final
        errors.append(np.abs(final["u"] - start["u"][::-1]).mean())
    assert 1.9 <= order(sizes, errors) <= 3.3


def quartic(x, y):
    return (1 + x - 2 * x**2 + x**3 - x**4) * (2 - y + y**2 + 0.5 * y**4)


def uneven(periodic):
    x = np.cumsum([0, 0.2, 0.15, 0.25, 0.1, 0.2, 0.15])
    return Grid.from_coordinates(x, 2 * x[::-1].max() - 2 * x[::-1], periodic=periodic)


def test_quartics_between_the_nodes():
    """The slopes that csl4 finds, at walls too, make its profile exact for quartics."""
    from cip.output.sample import sample

    grid = uneven(False)
    state = solver_of("csl4", grid, [1.0, 1.0], boundary=0.0).state(quartic)
    points = np.random.default_rng(7).uniform(0, 1, (2, 40)) * [[1.05], [2.1]]
    np.testing.assert_allclose(sample(state, points), quartic(*points), rtol=1e-11)


def test_quartics_are_moved_exactly():
    """Values, line means and cell means that no inflow reaches, up to the walls of the outflow."""
    solver = solver_of("csl4", uneven(False), [0.4, -0.7], boundary=0.0)
    start, dt = solver.state(quartic), 0.17
    after = solver.step(start, dt)
    expected = solver.state(lambda x, y: quartic(x - 0.4 * dt, y + 0.7 * dt))
    for name in start.names:
        np.testing.assert_allclose(after[name][3:, :-1], expected[name][3:, :-1], rtol=1e-11)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), dt=st.floats(0.005, 0.4))
def test_bounds_and_mass_for_random_data(seed, dt):
    """Divergence-free sweeps keep both bounds, any flow keeps zero and the integral."""
    rng = np.random.default_rng(seed)
    grid = Grid((0, 1), (9, 8), periodic=True)
    shear = Velocity.from_expression("1 + sin(2*pi*x2)", "0.3*cos(2*pi*x1)")
    squeeze = Velocity.from_expression("sin(2*pi*x1)*cos(2*pi*x2)/3", "0.5*sin(2*pi*x2)")
    for profile in ("csl2", "csl4"):
        for velocity, high in ((shear, 1.0), (squeeze, np.inf)):
            solver = solver_of(profile, grid, velocity, "bounds", bounds=(0.0, high))
            state = solver.state(0.0)
            state.data[...] = rng.uniform(0, 1, state.data.shape)
            mass = state.mass
            for _ in range(3):
                state = solver.step(state, dt)
            assert state.data.min() >= -1e-12
            assert state.data.max() <= high + 1e-12
            assert abs(state.mass - mass) <= 1e-13


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["csl2", "csl4"])
def test_an_upper_bound_does_not_cut_what_a_sweep_compresses(profile):
    """A swirl there and back: between the sweeps of a step the field truly passes the bound."""
    grid = Grid((0, 1), (40, 40), periodic=True)
    swirl = Velocity.from_expression(
        "sin(2*pi*x1)*cos(2*pi*x2)*cos(pi*t)", "-cos(2*pi*x1)*sin(2*pi*x2)*cos(pi*t)"
    )
    errors = []
    for high in (1.0, np.inf):
        solver = solver_of(profile, grid, swirl, "bounds", bounds=(0.0, high))
        start = solver.state("sin(pi*x1)**4*sin(pi*x2)**4")
        final = solver.run(start, 1.0, dt=0.0125).final
        errors.append(np.abs(final["u"] - start["u"]).max())
        assert final["u"].min() >= 0.0
        assert final["u"].max() <= 1.0 + 1e-8
        assert abs(final.mass / start.mass - 1) <= 1e-12
    # Cut in every sweep it was 2 (csl2) and 30 times (csl4) that without an upper bound.
    assert errors[0] <= 1.5 * errors[1]
