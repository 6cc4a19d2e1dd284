"""Bonded points: equal to supports, to a saddle point solve, and beside contact and friction."""

from dataclasses import replace

import numpy as np
import pytest
from families import STRAIGHT
from skfem import ElementHex1, ElementQuad1, ElementQuad2

from contact import (
    ContactProblem,
    ElasticBody,
    Infeasible,
    InputError,
    LoadStepper,
    Status,
    Unbounded,
    cross_check,
)
from contact.checks.uniqueness import unique_below
from contact.condensation.boundary_problem import BoundaryProblem
from skfem_adini import ElementQuadAdini


def tied(problem, chosen):
    """The problem with the chosen points bonded."""
    problem.__dict__["rows"] = replace(problem.rows, bonded=np.asarray(chosen, dtype=bool))
    return problem


def body_of(element, unit=1.0):
    mesh = STRAIGHT[type(element)]().refined(2 if element.dim == 2 else 1)
    mesh = mesh.scaled(unit).with_defaults()
    return ElasticBody.from_mesh(mesh, element, E=2e5, nu=0.3)


def bottom(body):
    """The facets with the lowest last coordinate, by name."""
    return "bottom" if body.dim == 2 else "front"


def tied_and_supported(element, friction, law, hold):
    """A body bonded on the left of its lower side, and the same held there."""
    body = body_of(element)
    last = body.dim - 1
    problem = ContactProblem(hold(body), bottom(body), 0.0, friction, law=law)
    left = problem.rows.x_nominal[0] < 0.6
    facets = body.mesh.boundaries[bottom(body)]
    places = body.mesh.p[0][body.mesh.facets[:, facets]].max(axis=0)
    supported = hold(body_of(element)).fix(facets[places < 0.6], "xyz"[: last + 1])
    oracle = ContactProblem(supported, bottom(body), 0.0, friction, law=law)
    return tied(problem, left), oracle, left


@pytest.mark.sampled(4)
@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop", "qp:osqp"])
@pytest.mark.parametrize(("law", "friction"), [("coulomb", 0.3), ("tresca", 5.0), (None, 0.0)])
@pytest.mark.parametrize("element", [ElementQuad1(), ElementHex1()])
def test_bonded_points_beside_contact_are_supports(element, law, friction, method):
    dim = element.dim
    if (law != "coulomb" and method == "tresca_loop") or (dim == 3 and law and "qp" in method):
        pytest.skip("not offered")
    pull = (30.0,) + (0.0,) * (dim - 2) + (-50.0,)
    problem, oracle, left = tied_and_supported(
        element, friction, law, lambda body: body.load("top" if dim == 2 else "back", pull)
    )
    result, expected = problem.solve(method), oracle.solve()
    assert np.any(expected.mu > 0)
    size, tol = problem.body.largest_displacement(expected.u), 1e-5 if "qp" in method else 1e-9
    assert problem.body.largest_displacement(result.u - expected.u) <= tol * size
    assert np.all((result.status == Status.BONDED) == left)
    assert np.any(result.mu[left] < 0), "a bonded point pulls"


def test_the_bound_of_uniqueness_is_that_of_a_body_held_at_its_bonded_points():
    root = np.random.default_rng(3).standard_normal((9, 9))
    W, free = root @ root.T + np.eye(9), [1, 2, 4, 5, 7, 8]
    held = np.linalg.inv(np.linalg.inv(W)[np.ix_(free, free)])
    bounds = []
    for A, m, bonded in ((W, 3, np.array([True, False, False])), (held, 2, np.zeros(2, bool))):
        tangent = m + np.arange(2 * m).reshape(2, m).T
        none, no_slip = np.zeros((3 * m, 0)), np.zeros((m, 2))
        problem = BoundaryProblem(
            A, np.zeros(3 * m), none, np.zeros(0), np.zeros(m), np.arange(m), tangent, no_slip,
            bonded=bonded,
        )  # fmt: skip
        bounds.append(unique_below(problem))
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-10)


def test_tie_of_either_sign_keeps_a_lifted_body():
    body = body_of(ElementQuad2()).load("top", (0.0, 40.0))
    problem = ContactProblem(body, "bottom", 0.0)
    with pytest.raises(Unbounded):
        problem.solve()
    problem = ContactProblem(body, "bottom", 0.0)
    result = tied(problem, np.ones(problem.rows.gap.size)).solve()
    assert result.tie_resultants[0] == pytest.approx([0.0, -40.0], rel=1e-9, abs=1e-8)
    for rows in (result.system.rows.G, result.system.rows.T):  # one opened, one slipped
        u = result.u + 1e-3 * np.asarray(rows.T @ np.ones(rows.shape[0]))
        assert result.system.kkt(u, result.mu, result.t)["tie"] > 1e-5


def test_one_bonded_point_leaves_a_rotation_about_it():
    body = body_of(ElementQuad1()).load("right", (0.0, 40.0))
    problem = ContactProblem(body, "bottom", 0.0)
    first = problem.rows.x_nominal[0] == problem.rows.x_nominal[0].min()
    with pytest.raises(Unbounded, match="rotation"):
        tied(problem, first).solve()


def test_the_fixed_point_refuses_by_type_and_peers_agree():
    body = body_of(ElementQuad1()).load("top", (1.0, -40.0))
    problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    tied(problem, problem.rows.x_nominal[0] < 0.3)
    with pytest.raises(InputError, match=r"^method"):
        problem.solve("fixed_point")
    assert cross_check(problem, problem.solve()).verdict == "agrees"
    problem = ContactProblem(body, "bottom", lambda x: np.where(x[0] < 0.6, 0.0, np.inf))
    tied(problem, np.ones(problem.rows.gap.size))
    with pytest.raises(InputError, match=r"^rows\.bonded"):
        problem.solve()


def test_supports_that_move_a_bonded_point_contradict_it():
    for component, value in (("y", -0.1), ("y", 0.1), ("x", 0.1)):
        body = body_of(ElementQuad1()).fix("bottom", component, value).fix("top", "xy")
        problem = ContactProblem(body.load("right", (1.0, 0.0)), "bottom", 0.0)
        tied(problem, np.ones(problem.rows.gap.size))
        with pytest.raises(Infeasible):
            problem.solve()


def test_ties_through_a_history_do_not_drift():
    body = body_of(ElementQuadAdini()).fix("top", "xy")
    problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    tied(problem, problem.rows.x_nominal[0] < 0.3)
    stepper = LoadStepper(problem).move("top", "y", -0.01).move("top", "x", 0.01, factor=np.square)
    history = stepper.run([0.5, 1.0, 2.0])
    ties = problem.rows.ties
    for result in history:
        assert np.abs(result.slip[ties]).max() <= 1e-12
        assert np.any(result.slip[~ties])
