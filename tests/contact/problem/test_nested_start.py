"""Starts from coarser meshes and from fewer points: few steps, the same solution."""

import numpy as np
import pytest
from pressed_pairs import pair
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP2

from contact import ContactProblem, ElasticBody, LayeredBlock, Parabola, Plane, Rigid
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.friction import Coulomb, Tresca
from contact.laws.methods import CoarseProblem
from skfem_adini import ElementQuadAdini

FRICTION = [0.0, 0.3, 0.9, 1.5, 3.0]


def layered(n):
    """The block of `make.block` without a Basis: fine ones are quick to condense."""
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="y", top="x")
    return block.load("top", (0.0, -1.0))


def with_friction(problem, friction):
    """The same problem, its condensation shared."""
    other = ContactProblem(problem.body, "bottom", 0.03, friction)
    other._condensed = problem._condensed
    return other


def full_size(result):
    """Steps with all contact points."""
    return sum(not line.phase.startswith("coarse") for line in result.history)


@pytest.fixture(scope="module")
def blocks():
    problems = [ContactProblem(layered(n), "bottom", 0.03) for n in (16, 32, 64, 128)]
    for problem in problems:
        problem.condense()
    return problems


@pytest.mark.sampled(3)
@pytest.mark.parametrize("friction", FRICTION)
def test_few_steps_at_any_size(blocks, friction):
    """Cold and nested, each mesh from the one before; both give the one solution."""
    coarse = None
    for block in blocks:
        problem = with_friction(block, friction)
        cold, nested = problem.solve(), problem.solve(start=coarse)
        assert full_size(cold) <= 12
        if coarse is not None:
            assert full_size(nested) == len(nested.history) <= 4
        # Newton's tolerance of 1e-12 times the condition of the boundary problem.
        assert np.abs(cold.mu - nested.mu).max() < 1e-9 * cold.mu.max()
        assert np.abs(cold.t - nested.t).max() < 1e-9 * cold.mu.max()
        coarse = nested


def test_coarse_start_spares_steps(blocks):
    """With all of its 258 points the finest block takes a few; the others are taken with fewer."""
    result = with_friction(blocks[-1], 3.0).solve()
    assert full_size(result) <= 3 < len(result.history)
    small = with_friction(blocks[0], 3.0).solve()
    assert full_size(small) == len(small.history)


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad1, ElementQuad2])
def test_nested_on_every_family(element, make):
    def problem(n):
        return make.problem(n, 0.6, element=element)

    fine = problem(16)
    nested, cold = fine.solve(start=problem(8).solve()), fine.solve()
    assert len(nested.history) < len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-10 * np.abs(cold.u).max()


def test_nested_in_three_dimensions(make):
    """Pressed and twisted on a paraboloid, so that tractions turn along the boundary."""
    coarse, fine = make.dome(ElementHex1, 6).solve(), make.dome(ElementHex1, 9)
    nested, cold = fine.solve(start=coarse), fine.solve()
    assert len(nested.history) < len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-10 * np.abs(cold.u).max()


def test_each_boundary_starts_from_its_own(make):
    """A strip between two jaws: the points of one are no neighbours of the other's."""

    def problem(n):
        x, y = np.linspace(0, 1, 8 * n + 1), np.linspace(0, 0.02, 2)
        mesh = make.box(ElementQuad1, x, y)
        body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left", "x")
        jaws = [lambda x: 0.002 * x[0] - 0.001, lambda x: 0.001 - 0.002 * x[0]]
        return ContactProblem(body, ["bottom", "top"], jaws, 0.2)

    coarse, fine = problem(2).solve(), problem(4)
    nested, cold = fine.solve(start=coarse), fine.solve()
    assert len(nested.history) <= len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-10 * np.abs(cold.u).max()


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_motion_of_body_and_stamp_is_found_from_the_start(friction, make):
    """A body held by contact alone, then a stamp driven by a force: few steps to a finer mesh."""

    def floating(n):
        body = make.block(n, sides=()).load("left", (0.02, 0.0))
        return ContactProblem(body, "bottom", Parabola((0.5, -0.03), 4.0), friction)

    def stamped(n):
        ticks = np.linspace(0, 1, n + 1)
        body = ElasticBody.from_mesh(
            make.box(ElementQuadAdini, ticks, ticks), ElementQuadAdini(), E=2.0, nu=0.3
        ).fix("top")
        stamp = Rigid(Plane((0, -5), (0, 1)), force=(None, 0.2), moment=0.01, centre=(0.5, 0))
        return ContactProblem(body, "bottom", stamp, friction)

    for problem in (floating, stamped):
        fine = problem(24)
        nested, cold = fine.solve(start=problem(12).solve()), fine.solve()
        assert len(nested.history) <= 4
        assert len(nested.history) <= len(cold.history)
        assert np.abs(cold.u - nested.u).max() < 1e-9 * np.abs(cold.u).max()


def boundary_problem(seed, m=130):
    """Random, some points out of reach, some without a normal or a tangent row, a free motion."""
    rng = np.random.default_rng(seed)
    has = rng.random((m, 2)) < 0.9
    rows = np.where(has.T, np.cumsum(has.T).reshape(2, m) - 1, -1)
    n = int(has.sum())
    root = rng.standard_normal((n, n))
    gap = np.where(rng.random(m) < 0.2, np.inf, rng.standard_normal(m))
    return BoundaryProblem(
        root @ root.T + n * np.eye(n),
        rng.standard_normal(n),
        rng.standard_normal((n, 1)),
        np.ones(1),
        gap,
        rows[0],
        rows[1:].T,
        rng.standard_normal((m, 1)),
    )


@pytest.mark.parametrize("law", [Coulomb, Tresca])
@pytest.mark.parametrize("seed", range(5))
def test_fewer_points_by_the_principle_of_virtual_work(seed, law):
    """Forces on groups do the work of the same forces on their points, and balance as they do."""
    fine = boundary_problem(seed)
    coarse = CoarseProblem.of(fine, law(np.full(fine.gap.size, 0.5)))
    rng = np.random.default_rng(seed)
    p = coarse.problem
    assert p.gap.size == 33
    np.testing.assert_allclose(
        np.mean([p.W[rows[rows >= 0]][:, rows[rows >= 0]].trace() / (rows >= 0).sum()
                 for rows in np.column_stack((p.normal, p.tangent)) if (rows >= 0).any()]),
        1.0,
    )  # fmt: skip
    mu = np.where(p.can_touch, rng.random(33), 0.0)
    t = np.where(p.tangent >= 0, rng.standard_normal((33, 1)), 0.0)
    forces = coarse.refined(Forces(mu, t, np.zeros(1)))
    l, f = p.forces(mu, t), fine.forces(forces.mu, forces.t)
    assert np.all(forces.mu[~fine.can_touch] == 0)
    assert l @ p.W @ l == pytest.approx(f @ fine.W @ f)
    assert l @ p.v0 == pytest.approx(f @ fine.v0)
    assert l @ p.C == pytest.approx(f @ fine.C)
    bears, here = p.can_touch, fine.can_touch
    assert mu[bears] @ p.gap[bears] == pytest.approx(forces.mu[here] @ fine.gap[here])
    if law is Tresca:  # the bound on a group is reached where that on its points is
        whole = coarse.refined(Forces(mu, coarse.friction.given[:, None], np.zeros(1)))
        np.testing.assert_allclose(whole.t[fine.tangent >= 0], 0.5)


def test_few_points_have_no_coarser_ones():
    problem = boundary_problem(0, 99)
    assert CoarseProblem.of(problem, None) is None


@pytest.mark.parametrize("element", [ElementQuad2, ElementTriP2, ElementQuadAdini])
def test_start_of_two_bodies_from_another_element(element):
    """Tractions go from contact point to contact point; the free punch is brought into touch."""
    coarse, problem = pair(friction=0.2).solve(), pair(element, friction=0.2)
    cold, nested = problem.solve(), problem.solve(start=coarse)
    assert len(nested.history) <= len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-11 * np.abs(cold.u).max()
