"""OSQP on the full problem of two bodies, and on the condensed one, finds the same solution."""

from dataclasses import replace

import numpy as np
import pytest
from pressed_pairs import PROBLEMS, pair, slit

from contact import InputError, cross_check, uniqueness


@pytest.mark.sampled(3)
@pytest.mark.parametrize("condensed", [True, False])
@pytest.mark.parametrize("name", PROBLEMS)
def test_osqp_agrees(name, condensed):
    problem = PROBLEMS[name]()
    check = cross_check(problem, problem.solve(), condensed=condensed)
    assert check.verdict == "agrees", check
    # OSQP polishes its solution; a millionth is what `verdict` asks for.
    assert max(check.displacement, check.multipliers) < 1e-9
    unknowns = sum(body.constraint[0].shape[1] for body in problem.body.bodies)
    assert (check.size >= unknowns) == (not condensed)


def test_osqp_disagrees_with_another_solution():
    """Of a pair with less friction: its forces are no solution of this one."""
    slippery, rough = pair(friction=0.05), pair(friction=0.3)
    other = slippery.solve()
    wrong = replace(other, system=rough.solve().system)
    assert cross_check(rough, wrong).verdict == "disagrees"


def test_result_of_another_problem_is_refused():
    problem = pair()
    with pytest.raises(InputError, match="result: has 288 unknowns"):
        cross_check(slit(), problem.solve())


def test_one_solution_of_two_bodies():
    """Held on both sides; the proof holds below F*, which does not depend on units."""
    limits = []
    for size, E in ((1.0, 2.0), (1e-3, 2e11)):
        problem = pair(friction=0.02, size=size, E=E)
        problem.body.bodies[0].fix("top", "y", -0.01 * size)
        found = uniqueness(problem, problem.solve(), starts=1)
        assert found.proven
        assert not found.others
        limits.append(found.coefficient)
    assert 0.02 < limits[0] < 1.0
    assert abs(limits[1] / limits[0] - 1) < 1e-6


def test_nothing_is_known_of_a_body_held_by_contact():
    problem = pair(friction=0.3)
    found = uniqueness(problem, problem.solve(), starts=2)
    assert found.coefficient == 0.0
    assert not found.others


def test_other_material_of_one_body_is_noticed():
    problem, other = pair(), pair(E=3.0)
    with pytest.raises(InputError, match="another material"):
        uniqueness(problem, other.solve())


def test_energy_is_that_of_all_bodies():
    """Work of the loads against half of it in the bodies, each from its own stiffness."""
    problem = pair()
    result = problem.solve()
    parts = [0.5 * result[b].u @ (b.stiffness @ result[b].u) for b in problem.body.bodies]
    loads = result.system.load @ result.u
    assert abs(result.system.energy(result.u) - (sum(parts) - loads)) < 1e-14 * abs(loads)
    assert np.isfinite(loads)
