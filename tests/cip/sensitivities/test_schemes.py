"""Tangents and adjoints of all schemes: transposes, differences, Taylor remainders, integrals."""

from functools import reduce

import numpy as np
import pytest
from derivative_checks import (
    along,
    dot_test,
    equal_substeps,
    few_examples,
    parameter_error,
    state_error,
    taylor_order,
)
from hypothesis import given
from hypothesis import strategies as st
from schemes import FAMILIES, solved


@few_examples
@given(
    a=st.floats(0.4, 1.2), b=st.floats(-0.4, 0.4), k=st.floats(0.0, 2.0), m=st.floats(0, 1),
    w=st.floats(-5, 5), dt=st.floats(0.01, 0.21), seed=st.integers(0, 99),
)  # fmt: skip
def check_transpose(scheme, dt, seed, **values):
    solver, run = solved(*scheme, dt=dt, **values)
    assert max(dot_test(solver, run, np.random.default_rng(seed))) <= 1e-13


def check(scheme, bound, e=2e-5):
    """`bound`: of rounding, 1e-15 over the step `e` of differences and powers of cells' widths."""
    check_transpose(scheme)
    rng = np.random.default_rng(1)
    with equal_substeps():  # no foot passes an edge and no path another wall
        solver, run = solved(*scheme)
        assert dot_test(solver, run, rng)[0] <= 1e-14
        assert state_error(solver, run, rng) < 1e-12
        assert parameter_error(solver, run, e) < bound
        direction = dict(zip(solver.parameters, rng.uniform(-1, 1, 8), strict=False))
        order = taylor_order(solver, run, direction, 5e-4 * 0.5 ** np.arange(5))
        assert abs(order - 2.0) <= 0.05
        grid, profile = solver.grid, solver.profile
        if profile.startswith("csl") and all(grid.periodic) and solver.source is None:
            volumes = reduce(np.multiply.outer, grid.widths)
            for name in "ab":  # no parameter of the velocity changes the integral
                moved = along(solver, run, name).reshape(run[0].data.shape)[-1] * volumes
                assert np.abs(moved).max() > 1e-3
                assert abs(moved.sum()) < 4e-14


def family(name, every):
    """Each scheme is compiled anew: a few in the fast lane, others each turn."""
    return lambda test: pytest.mark.sampled(every)(
        pytest.mark.parametrize("scheme", FAMILIES[name], ids=", ".join)(test)
    )


@family("lines", 8)
def test_lines(scheme):
    check(scheme, 1e-9, 6e-5)


@family("inflow", 8)
def test_inflow(scheme):
    check(scheme, 2e-9)


@family("csl2", 4)
def test_csl2(scheme):
    check(scheme, 1e-8)


@family("csl4", 4)
def test_csl4(scheme):
    check(scheme, 1e-8)


@family("planes", 10)
def test_planes(scheme):
    check(scheme, 2e-9)


@family("sweeps", 15)
def test_sweeps(scheme):
    check(scheme, 1e-8)


@family("reactions", 8)
def test_reactions(scheme):
    check(scheme, 5e-9)


@pytest.mark.slow
@family("reactions in planes and space", 1)
def test_reactions_in_planes_and_space(scheme):
    check(scheme, 5e-9)
