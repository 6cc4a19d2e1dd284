"""What checks and exports say of arguments that are no problem, no result, or hold no numbers."""

import dataclasses

import numpy as np
import pytest

from contact import ContactProblem, ElasticBody, InputError, Plane, cross_check


@pytest.fixture(scope="module")
def solved(make):
    problem = ContactProblem(make.block(4), "bottom", make.foundation[2], 0.9)
    return problem, problem.solve()


@pytest.mark.parametrize("swapped", [False, True])
def test_cross_check_names_what_it_was_given(solved, swapped):
    problem, result = solved
    with pytest.raises(InputError, match="problem: expected a ContactProblem"):
        cross_check(result if swapped else None, problem if swapped else result)
    with pytest.raises(InputError, match="result: expected a ContactResult"):
        cross_check(problem, problem if swapped else None)


@pytest.mark.parametrize("name", ["mu", "t"])
def test_forces_that_are_no_numbers_are_not_written(solved, name):
    _, result = solved
    spoilt = dataclasses.replace(result, **{name: np.full_like(getattr(result, name), np.nan)})
    with pytest.raises(InputError, match=name):
        spoilt.boundary_to_pyvista()


def test_balance_of_a_body_that_is_only_moved(make):
    """No load and no contact: what is left is the rounding of the forces inside, not all of it."""
    body = ElasticBody.from_mesh(make.block(4).mesh, E=1.0, nu=0.3)
    body = body.fix("top", "x").fix("top", "y", 0.1)
    result = ContactProblem(body, "bottom", Plane((0.0, -0.03), (0.0, 1.0)), 0.9).solve()
    assert np.abs(result.u).max() > 0.09
    assert np.abs(result.balance()["residual"]).max() < 1e-12
