"""Starts from coarser meshes and from fewer points: few steps, the same solution."""

import numpy as np
import pytest
from pressed_pairs import pair
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP2

from contact import ContactProblem, ElasticBody, LayeredBlock, Parabola, Plane, Rigid
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


def jaws(make, n):
    """A strip between two: the points of one are no neighbours of the other's."""
    mesh = make.box(ElementQuad1, np.linspace(0, 1, 8 * n + 1), np.linspace(0, 0.02, 2))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left", "x")
    gaps = [lambda x: 0.002 * x[0] - 0.001, lambda x: 0.001 - 0.002 * x[0]]
    return ContactProblem(body, ["bottom", "top"], gaps, 0.2)


def floating(make, n, friction):
    """Held by contact alone."""
    body = make.block(n, sides=()).load("left", (0.02, 0.0))
    return ContactProblem(body, "bottom", Parabola((0.5, -0.03), 4.0), friction)


def stamped(make, n, friction):
    ticks = np.linspace(0, 1, n + 1)
    mesh = make.box(ElementQuadAdini, ticks, ticks)
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3).fix("top")
    stamp = Rigid(Plane((0, -5), (0, 1)), force=(None, 0.2), moment=0.01, centre=(0.5, 0))
    return ContactProblem(body, "bottom", stamp, friction)


# Sizes of the coarse and the fine problem, the largest count of steps, and how it is made.
NESTED = {
    "P2": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementTriP2)),
    "Q1": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementQuad1)),
    "Q2": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementQuad2)),
    "space": (6, 9, 99, lambda m, n: m.dome(ElementHex1, n)),
    "jaws": (2, 4, 99, jaws),
    "floating": (12, 24, 4, lambda m, n: floating(m, n, 0.0)),
    "floating, rough": (12, 24, 4, lambda m, n: floating(m, n, 0.4)),
    "stamped": (12, 24, 4, lambda m, n: stamped(m, n, 0.0)),
    "stamped, rough": (12, 24, 4, lambda m, n: stamped(m, n, 0.4)),
}


@pytest.mark.parametrize("case", NESTED)
def test_start_from_a_coarser_mesh(case, make):
    """In space tractions turn along the boundary; motions of body and stamp are found too."""
    coarse, fine, most, made = NESTED[case]
    problem = made(make, fine)
    nested, cold = problem.solve(start=made(make, coarse).solve()), problem.solve()
    assert len(nested.history) <= min(most, len(cold.history) - (fine in (9, 16)))
    assert np.abs(cold.u - nested.u).max() < 1e-9 * np.abs(cold.u).max()


@pytest.mark.parametrize("element", [ElementQuad2, ElementTriP2, ElementQuadAdini])
def test_start_of_two_bodies_from_another_element(element):
    """Tractions go from contact point to contact point; the free punch is brought into touch."""
    coarse, problem = pair(friction=0.2).solve(), pair(element, friction=0.2)
    cold, nested = problem.solve(), problem.solve(start=coarse)
    assert len(nested.history) <= len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-11 * np.abs(cold.u).max()
