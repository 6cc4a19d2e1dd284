"""Bonded points: equal to supports, to a saddle point solve, and beside contact and friction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTriP2,
    MeshHex,
    MeshQuad,
    MeshTri,
)

from contact import (
    ContactProblem,
    ContactResult,
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
from contact.laws.friction import Coulomb
from contact.laws.load_balance import check_held
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from gpu import Infeasible as NotHeld
from skfem_adini import ElementQuadAdini


def tied(problem, chosen):
    """The problem with the chosen points bonded."""
    problem.__dict__["rows"] = replace(problem.rows, bonded=np.asarray(chosen, dtype=bool))
    return problem


def body_of(element, unit=1.0):
    mesh = {2: MeshQuad, 3: MeshHex}[element.refdom.dim()]
    if element.refdom.name == "Triangular":
        mesh = MeshTri
    mesh = mesh().refined(2 if element.refdom.dim() == 2 else 1)
    mesh = mesh.scaled(unit).with_defaults()
    return ElasticBody.from_mesh(mesh, element, E=2e5, nu=0.3)


def bottom(body):
    """The facets with the lowest last coordinate, by name."""
    return "bottom" if body.dim == 2 else "front"


def saddle(body, rows, load):
    """The displacement and forces with every row prescribed, by one sparse solve."""
    P, u0 = body.constraint
    B = sparse.vstack((rows.G, rows.T)).tocsr()
    keep = np.abs(B @ P).sum(axis=1) > 1e-12
    B = B[np.flatnonzero(keep)]
    value = np.concatenate((rows.gap, np.zeros(rows.T.shape[0])))[keep]
    S = P.T @ body.stiffness @ P
    A = sparse.block_array([[S, (B @ P).T], [B @ P, None]], format="csc")
    right = np.concatenate((P.T @ (load - body.stiffness @ u0), value - B @ u0))
    found = sparse.linalg.spsolve(A, right)
    return P @ found[: P.shape[1]] + u0


ELEMENTS = [
    ElementQuad1(),
    ElementQuad2(),
    ElementTriP2(),
    ElementQuadAdini(),
    ElementHex1(),
    ElementHex2(),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e4])
@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: type(element).__name__)
def test_all_points_tied_is_a_saddle_point_solve(element, unit, held):
    body = body_of(element, unit)
    if held:
        body = body.fix("right", "x")
    body = body.load("top" if body.dim == 2 else "back", np.arange(3.0, 3.0 + body.dim))
    problem = ContactProblem(body, bottom(body), 0.01 * unit)
    tied(problem, np.ones(problem.rows.gap.size))
    result = problem.solve()
    expected = saddle(body, problem.rows, body.f)
    assert body.reach(result.u - expected) <= 1e-9 * body.reach(expected)
    assert set(result.status.tolist()) == {int(Status.BONDED)}
    assert max(result.kkt.values()) <= 1e-10
    assert result.kkt["tie"] <= 1e-10
    assert np.isnan(result.zone).all()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop", "qp:osqp"])
@pytest.mark.parametrize("law", ["coulomb", "tresca", None])
@pytest.mark.parametrize("dim", [2, 3])
def test_bonded_points_beside_contact_are_supports(dim, law, method):
    if (law != "coulomb" and method == "tresca_loop") or (dim == 3 and law and "qp" in method):
        pytest.skip("not offered")
    body = body_of(ElementQuad1() if dim == 2 else ElementHex1())
    pull = np.zeros(dim)
    pull[0], pull[-1] = 30.0, -50.0
    top = "top" if dim == 2 else "back"
    whole = body.load(top, pull)
    friction = {"coulomb": 0.3, "tresca": 5.0, None: 0.0}[law]
    problem = ContactProblem(whole, bottom(body), 0.0, friction, law=law)
    left = problem.rows.x_nominal[0] < 0.6
    tied(problem, left)
    facets = body.mesh.boundaries[bottom(body)]
    places = body.mesh.p[0][body.mesh.facets[:, facets]].max(axis=0)
    kept = facets[places < 0.6]
    supported = body_of(body.element).load(top, pull).fix(kept, "xyz"[:dim])
    oracle = ContactProblem(supported, bottom(body), 0.0, friction, law=law).solve()
    result = problem.solve(method)
    size = body.reach(oracle.u)
    tol = 1e-5 if "qp" in method else 1e-9
    assert np.any(oracle.mu > 0)
    assert body.reach(result.u - oracle.u) <= tol * size
    assert np.all((result.status == Status.BONDED) == left)
    assert np.any(result.mu[left] < 0), "a bonded point pulls"


def test_tie_of_either_sign_keeps_a_lifted_body():
    body = body_of(ElementQuad2()).load("top", (0.0, 40.0))
    with pytest.raises(Unbounded):
        ContactProblem(body, "bottom", 0.0).solve()
    problem = ContactProblem(body, "bottom", 0.0)
    result = tied(problem, np.ones(problem.rows.gap.size)).solve()
    assert result.tie_resultants[0] == pytest.approx([0.0, -40.0], rel=1e-9, abs=1e-8)


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


def test_certificate_sees_an_opened_and_a_slipped_tie():
    body = body_of(ElementQuad2()).fix("top", "xy", 0.01)
    problem = ContactProblem(body, "bottom", 0.0)
    result = tied(problem, np.ones(problem.rows.gap.size)).solve()
    for rows in (result.system.rows.G, result.system.rows.T):
        u = result.u + 1e-3 * np.asarray(rows.T @ np.ones(rows.shape[0]))
        assert result.system.kkt(u, result.mu, result.t)["tie"] > 1e-5


def test_saved_ties_are_read_again(tmp_path):
    body = body_of(ElementQuad2()).load("top", (3.0, 40.0))
    problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    result = tied(problem, problem.rows.x_nominal[0] < 0.6).solve()
    again = ContactResult.load(result.save(tmp_path / "tied"))
    assert np.array_equal(again.status, result.status)
    assert np.array_equal(again.boundary_to_pyvista()["status"], result.status)
    assert "bonded" in again.summary()


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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(40))
def test_random_problems_equal_the_condensed_ones_without_the_tie(seed):
    """Elimination of the bonded rows by a dense solve leaves the other laws."""
    rng = np.random.default_rng([seed, 3])
    m, dim_t = int(rng.integers(2, 30)), int(rng.choice([1, 2]))
    n = m * (1 + dim_t)
    root = rng.standard_normal((n, n))
    W = root @ root.T / n + 0.3 * np.eye(n)
    W /= np.sqrt(np.outer(np.diag(W), np.diag(W)))
    normal, tangent = np.arange(m), m + np.arange(m * dim_t).reshape(dim_t, m).T
    v0, gap = rng.standard_normal(n), rng.uniform(-0.2, 0.6, m)
    bonded = rng.random(m) < 0.4
    bonded[0], bonded[1] = True, False
    held, none = np.zeros((m, dim_t)), np.zeros((n, 0))
    law = Coulomb(np.full(m, 0.2))
    whole = BoundaryProblem(W, v0, none, np.zeros(0), gap, normal, tangent, held, bonded=bonded)
    options = Options.checked("coulomb", 1 + dim_t, "newton", None, None, None)
    ones = np.ones(m)
    found, _ = solve_boundary(whole, law, options, None, ones, lambda line: None)

    at = np.concatenate((normal[bonded], tangent[bonded].ravel()))
    free = np.setdiff1d(np.arange(n), at)
    number = np.full(n, -1)
    number[free] = np.arange(free.size)
    W_bb = W[np.ix_(at, at)]
    target = v0[at] - np.concatenate((gap[bonded], np.zeros(at.size - bonded.sum())))
    reduced = BoundaryProblem(
        W[np.ix_(free, free)] - W[np.ix_(free, at)] @ np.linalg.solve(W_bb, W[np.ix_(at, free)]),
        v0[free] - W[np.ix_(free, at)] @ np.linalg.solve(W_bb, target),
        none[free],
        np.zeros(0),
        gap[~bonded],
        number[normal[~bonded]],
        number[tangent[~bonded]],
        held[~bonded],
    )
    law = Coulomb(np.full(int((~bonded).sum()), 0.2))
    expected, _ = solve_boundary(reduced, law, options, None, ones[~bonded], lambda line: None)
    size = max(1.0, np.abs(expected.mu).max())
    assert np.abs(found.mu[~bonded] - expected.mu).max() <= 1e-8 * size
    assert np.abs(found.t[~bonded] - expected.t).max() <= 1e-8 * size
    u_n, u_t = whole.displacements(found.mu, found.t, found.a)
    assert np.abs((u_n - gap)[bonded]).max() <= 1e-9 * size
    assert np.abs(u_t[bonded]).max() <= 1e-9 * size
    assert unique_below(whole) == pytest.approx(unique_below(reduced), rel=1e-8)


def test_bonded_rows_hold_motions_in_both_directions():
    one, two = np.ones((2, 1)), np.arange(2)
    for load in (-1.0, 1.0):
        problem = BoundaryProblem(
            np.eye(2),
            np.zeros(2),
            one,
            np.array([load]),
            np.zeros(2),
            two,
            np.full((2, 1), -1),
            np.zeros((2, 1)),
        )
        check_held(replace(problem, bonded=np.array([True, False])), None)
        if load < 0:  # pulled away from the obstacle
            with pytest.raises(NotHeld):
                check_held(problem, None)
