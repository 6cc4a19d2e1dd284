"""A boundary problem is solved where its matrix lies; what stalls there, the host solves."""

from dataclasses import replace

import numpy as np
import pytest

from contact import ContactProblem, LayeredBlock
from contact.arrays.dense_arrays import DeviceMatrix, HostArrays
from contact.laws.methods import device_newton, solve_boundary
from contact.laws.newton import LIMITS
from contact.laws.options import Options


class Elsewhere(HostArrays):
    """The host's arrays in the place of a device's."""

    def values(self, W):
        return W.values


@pytest.fixture
def pressed():
    block = LayeredBlock(1.0, [(1.0, 16, 2.0, 0.3)]).fix("top", "xy", -0.05)
    problem = ContactProblem(block, "bottom", lambda x: 0.3 * (x[0] - 0.4) ** 2, 0.4)
    condensed, system = problem.condense(), problem.system
    here = condensed.boundary_problem(system.load, system.rows.gap)
    moved = replace(here, W=DeviceMatrix(Elsewhere(), here.W))
    return here, moved, system.scaled_friction(condensed.point_scale)


def options(method="newton", limit=None):
    return Options.checked("coulomb", 2, method, None, limit, None)


def solved(problem, law, chosen):
    ones, lines = np.ones(problem.gap.size), []
    forces, _ = solve_boundary(problem, law, chosen, None, ones, lines.append)
    return forces, lines


def test_newton_runs_where_the_matrix_lies(pressed):
    here, moved, law = pressed
    chosen, lines = options(), []
    tol = LIMITS.inner * chosen.tol
    expected = device_newton(moved, law, None, tol=tol, max_iterations=100, report=lines.append)
    forces, history = solved(moved, law, chosen)
    np.testing.assert_array_equal(forces.mu, expected.mu)
    np.testing.assert_array_equal(forces.t, expected.t)
    assert list(map(str, history)) == list(map(str, lines))
    on_host, _ = solved(here, law, chosen)
    assert np.abs(forces.mu - on_host.mu).max() <= 1e-10 * on_host.mu.max()


@pytest.mark.parametrize("chosen", [options(limit=1), options("pdas"), options("tresca_loop")])
def test_the_host_solves_what_stalls_and_all_other_methods(pressed, chosen):
    here, moved, law = pressed
    forces, _ = solved(moved, law, chosen)
    expected, _ = solved(here, law, chosen)
    assert np.abs(forces.mu - expected.mu).max() <= 1e-10 * expected.mu.max()
