"""Other solutions for large friction, those of one point by hand; a proof for small friction."""

import numpy as np
import pytest
from convergence import order
from hypothesis import given, settings
from hypothesis import strategies as st
from pressed_pairs import pair
from skfem import ElementHex1, ElementQuad1, ElementTriP1, MeshTri

from contact import ContactProblem, ElasticBody, InputError, LoadStepper, SignedDistance, uniqueness
from contact.checks.frozen_problem import TieElimination

SHEAR = -0.11  # v_n / v_t without contact: the load lifts the point a little and drags it


def one_point(friction, along=1.0, across=SHEAR):
    """A triangle whose lower vertex is free and touches a slope; v without contact is given.

    Returns the problem, the compliance W (2, 2) and the displacement v without contact, in the
    directions of the normal and the tangent, found from the stiffness of the vertex.
    """
    mesh = MeshTri(np.array([[0.0, 1.0, 1.8], [1.0, 1.0, 0.0]]), np.array([[0], [1], [2]]))
    body = ElasticBody.from_mesh(mesh, ElementTriP1(), E=1.0, nu=0.3)
    top = mesh.facets_satisfying(lambda x: x[1] > 0.99, boundaries_only=True)
    body.fix(top)
    side = np.setdiff1d(mesh.boundary_facets(), top)[:1]
    ContactProblem(body, side, 0.0)
    K = body.stiffness.toarray()[4:, 4:]
    a, b = mesh.p[:, mesh.facets[:, side[0]]].T
    n = np.array([(b - a)[1], -(b - a)[0]]) / np.linalg.norm(b - a)
    n *= np.sign(n @ (a - mesh.p.mean(axis=1)))
    frame = np.array([n, [-n[1], n[0]]])
    v = np.array([across, along])
    body.f[4:] = K @ frame.T @ v
    problem = ContactProblem(body, side, SignedDistance(lambda x: x[1]), friction)
    return problem, frame @ np.linalg.inv(K) @ frame.T, v


def by_hand(W, v, F):
    """All (mu, t): open, stick, slip to either side; the laws of one point with gap 0."""
    found = [(0.0, 0.0)] if v[0] <= 0 else []
    mu, t = np.linalg.solve(W, v)
    if mu >= 0 and abs(t) <= F * mu:
        found.append((mu, t))
    for sign in (1, -1):
        mu = v[0] / (W[0, 0] + sign * F * W[0, 1])
        slip = v[1] - W[1, 0] * mu - W[1, 1] * sign * F * mu
        if mu > 0 and sign * slip > 0:
            found.append((mu, sign * F * mu))
    return np.array(sorted(found))


@pytest.mark.parametrize("friction", [2.5, 4.0])
def test_several_solutions_of_one_point(friction):
    """Klarbring's example in this guise: open, stick and slip; what is found is among them."""
    problem, W, v = one_point(friction)
    expected = by_hand(W, v, friction)
    assert len(expected) == 3
    result = problem.solve()
    report = uniqueness(problem, result)
    assert not report.proven
    assert "other solutions found" in str(report)
    found = np.array([(r.mu.max(), r.t[np.abs(r.t).argmax()][0]) for r in (result, *report.others)])
    assert 2 <= len(found) <= 3
    apart = np.abs(found[:, None] - expected).max(axis=2)
    # Each is one by hand, no two the same; slip, which Newton leaves, is found for F = 2.5 only.
    assert apart.min(axis=1).max() < 1e-9 * np.abs(expected).max()
    assert len(set(apart.argmin(axis=1))) == len(found)
    for other in report.others:
        assert max(other.kkt.values()) < 1e-10


@pytest.mark.sampled(3)
@pytest.mark.parametrize("load", np.linspace(0, 2 * np.pi, 7)[:-1] + 0.1)
def test_one_solution_of_one_point(load):
    """Below F*, which the compliance gives by hand, there is one solution whatever the load."""
    least = one_point(0.1)[1:]
    W = least[0]
    bound = np.sqrt((W[0, 0] - W[0, 1] ** 2 / W[1, 1]) / W[1, 1])
    problem, W, v = one_point(0.99 * bound, np.sin(load), np.cos(load))
    expected = by_hand(W, v, 0.99 * bound)
    assert len(expected) == 1
    report = uniqueness(problem, problem.solve())
    assert report.proven
    assert report.coefficient == pytest.approx(bound)
    assert not uniqueness(one_point(1.01 * bound)[0], one_point(1.01 * bound)[0].solve()).proven


def test_full_stick_at_rest():
    """Forces that cancel where nothing moves: displacements are the rounding of what they cause."""
    _, W, _ = one_point(5.0)
    mu, t = 1.0, -2.0
    result = one_point(5.0, *(W @ [mu, t])[::-1])[0].solve()
    assert np.abs(result.u).max() < 1e-12
    assert result.mu.max() == pytest.approx(mu)
    assert np.abs(result.t).max() == pytest.approx(-t)


def test_bound_falls_like_the_root_of_the_mesh(make):
    """F* of the block, 3 to 12 cells: order 1/2 (Hild 2002)."""
    cells = np.array([3, 6, 12])
    bounds = []
    for n in cells:
        problem = make.problem(int(n), 5.0, element=ElementQuad1)
        bounds.append(uniqueness(problem, problem.solve(), starts=0).coefficient)
    rate = order(cells, bounds)
    assert 0.35 < rate < 0.65


def test_without_coulomb_the_solution_is_unique(make):
    for problem in (make.problem(4, 0.2, "tresca"), make.problem(4, 0.0)):
        report = uniqueness(problem, problem.solve())
        assert report.proven
        assert report.coefficient == np.inf
        assert str(report) == "unique: no friction depends on the pressure"


def test_in_space_in_a_history_and_of_floating_bodies(make):
    floating = make.problem(4, 0.3, sides=())
    report = uniqueness(floating, floating.solve(), starts=2)
    assert report.coefficient == 0 or report.proven
    several = pair(friction=0.3)
    found = uniqueness(several, several.solve(), starts=2)
    assert found.coefficient == 0.0
    assert not found.others
    problem = make.dome(ElementHex1, 3, friction=0.1)
    stepper = LoadStepper(problem).load("top", (0.0, 0.0, 0.0))
    report = uniqueness(problem, stepper.run([1.0, 2.0]).results[-1], starts=2)
    assert report.coefficient > 0
    assert not report.others


@settings(deadline=None, max_examples=60)
@given(
    st.integers(1, 8), st.integers(0, 8), st.integers(0, 3), st.floats(-4, 4), st.integers(0, 999)
)
def test_every_solution_and_the_forces(n, count, copies, decades, seed):
    """Against the pseudo-inverse, in unknowns of several units, with dependent equations."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.uniform(-abs(decades), abs(decades), n)
    A = rng.standard_normal((count, n))
    A = np.vstack((A, rng.standard_normal((copies, count)) @ A))
    E, z = A / unit, unit * rng.standard_normal(n)
    ties = TieElimination.of(E, E @ z, unit)
    rank = min(count, n)
    assert ties.free.shape == (n, n - rank)
    np.testing.assert_allclose(A @ (ties.start / unit), A @ (z / unit), atol=1e-8)
    np.testing.assert_allclose(A @ (ties.free / unit[:, None]), 0.0, atol=1e-10)
    # All solutions are reached.
    y = np.linalg.lstsq(ties.free / unit[:, None], (z - ties.start) / unit, rcond=None)[0]
    np.testing.assert_allclose((ties.start + ties.free @ y) / unit, z / unit, atol=1e-6)
    load = E.T @ rng.standard_normal(len(E))
    forces = ties.forces(load, len(E))
    np.testing.assert_allclose(unit * (E.T @ forces), unit * load, atol=1e-6)
    assert np.count_nonzero(forces) <= rank


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


def test_other_material_of_one_body_is_noticed():
    problem, other = pair(), pair(E=3.0)
    with pytest.raises(InputError, match="another material"):
        uniqueness(problem, other.solve())
