"""Bodies held by contact alone: exactly the loads that contact forces can balance are accepted."""

import numpy as np
import pytest
from skfem import ElementHex1, MeshHex, MeshQuad

from contact import ContactProblem, ElasticBody, Unbounded
from skfem_adini import ElementQuadAdini

TICKS = np.linspace(0, 1, 5)
F = 0.3


def square(force):
    mesh = MeshQuad.init_tensor(TICKS, TICKS).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3)
    return body.body_force(force)


def cube(force):
    mesh = MeshHex.init_tensor(TICKS, TICKS, TICKS)
    facets = mesh.facets_satisfying(lambda x: np.abs(x[2]) < 1e-9)
    mesh = mesh.with_boundaries({"bottom": facets})
    return ElasticBody.from_mesh(mesh, ElementHex1(), E=2.0, nu=0.3).body_force(force)


# Weight 1 presses on the foundation; it slides when the horizontal force exceeds F.
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("pull", [-0.29, 0.1, 0.29])
def test_friction_holds_what_it_can(pull, law) -> None:
    result = ContactProblem(square((pull, -1.0)), "bottom", 0.03, F, law=law).solve()
    np.testing.assert_allclose(result.resultant, [-pull, 1.0], atol=1e-9)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("pull", [-0.31, 0.31, 2.0])
def test_friction_holds_no_more(pull, law) -> None:
    with pytest.raises(Unbounded, match="not held"):
        ContactProblem(square((pull, -1.0)), "bottom", 0.03, F, law=law).solve()


# |(.2, .2)| = .283 < F < .311 = |(.22, .22)|: the cone is round, not a square or an octagon.
def test_round_cone_in_three_dimensions() -> None:
    result = ContactProblem(cube((0.2, 0.2, -1.0)), "bottom", 0.01, F).solve()
    np.testing.assert_allclose(result.resultant, [-0.2, -0.2, 1.0], atol=1e-9)
    with pytest.raises(Unbounded, match="translation"):
        ContactProblem(cube((0.22, 0.22, -1.0)), "bottom", 0.01, F).solve()


def test_lift_off_names_the_axis() -> None:
    with pytest.raises(Unbounded, match="translation along z") as caught:
        ContactProblem(cube((0.0, 0.0, 1.0)), "bottom", 0.01, F).solve()
    lifted = caught.value.mode.reshape(-1, 3)
    np.testing.assert_allclose(lifted, np.tile([0, 0, 1.0], (len(lifted), 1)), atol=1e-9)


def test_gaps_given_point_by_point_stay_in_order() -> None:
    body = square((0.0, -1.0)).fix("top", "xy")
    count = ContactProblem(body, "bottom", 0.1).rows.gap.size
    gaps = np.linspace(0.01, 0.1, count)
    problem = ContactProblem(body, "bottom", gaps)
    np.testing.assert_array_equal(problem.rows.gap, gaps)
    assert np.all(np.diff(problem.rows.x[0]) > 0)
