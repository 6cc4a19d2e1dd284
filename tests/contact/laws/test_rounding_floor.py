"""Newton's method ends by itself where rounding is all that is left of the residual."""

import numpy as np
import pytest

from contact import ContactProblem, ElasticBody, Plane, Rigid
from contact.laws.condensed_newton import Condensed
from contact.laws.newton import newton
from contact.problem.nested_start import start_forces
from skfem_adini import ElementQuadAdini


def stamped(make, n, friction, force):
    """A plane five units away, driven against a block by a force and a moment."""
    ticks = np.linspace(0, 1, n + 1)
    body = ElasticBody.from_mesh(
        make.box(ElementQuadAdini, ticks, ticks), ElementQuadAdini(), E=2.0, nu=0.3
    ).fix("top")
    stamp = Rigid(Plane((0, -5), (0, 1)), force=(None, force), moment=0.05 * force, centre=(0.5, 0))
    return ContactProblem(body, "bottom", stamp, friction)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("friction", [0.1, 0.25, 0.4, 0.9])
@pytest.mark.parametrize("n", [6, 12, 20])
def test_driven_stamp_takes_few_steps(n, friction, make):
    """Displacements of five cancel in gaps of 1e-2: the floor is near the tolerance of 1e-12."""
    result = stamped(make, n, friction, 0.2).solve()
    assert len(result.history) <= 14
    assert result.history[-1].residual <= 1e-12
    again = stamped(make, n, friction, 0.2).solve(start=result)
    assert len(again.history) <= 3


@pytest.mark.parametrize("force", [1e-4, 1e-2, 0.2])
def test_tolerance_below_rounding(force, make):
    """What no step can meet costs no hundred steps, and is not taken for convergence elsewhere."""
    problem = stamped(make, 12, 0.4, force)
    condensed, system = problem.condense(), problem.system
    boundary = condensed.boundary_problem(system.load, system.rows.gap, None, system.motion)
    law, scale = system.scaled_friction(condensed.point_scale), condensed.point_scale
    start = start_forces(problem.solve(), system, boundary, scale)
    lines, laws = [], Condensed(boundary, law)
    forces = newton(laws, start, tol=1e-17, report=lines.append)
    assert len(lines) <= 20
    left = laws.residual(laws.state(forces))
    # Rounding of displacements of five, over what the forces of the step cause.
    assert left <= 1e-14 * 5.0 / force
