"""Where an interface ends: at the tip of a slit, and where a tie goes over into contact."""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2
from two_blocks import block, facing

from contact import ContactProblem, ElasticBody, Pair, Tie, cross_check
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
LAGRANGE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2]
lagrange = pytest.mark.parametrize("element", LAGRANGE, ids=lambda e: e.__name__)
elements = pytest.mark.parametrize(
    "element", [*LAGRANGE, ElementQuadAdini], ids=lambda e: e.__name__
)


def slit_to_its_tip(element):
    """A block with a slit on the left, up to the vertex at (1, 0) that both faces share."""
    mesh = block(element, np.linspace(0, 2, 7), np.linspace(-0.5, 0.5, 5)).mesh
    cut = np.flatnonzero((np.abs(mesh.p[1]) < 1e-9) & (mesh.p[0] < 1.0 - 1e-9))
    twin = np.arange(mesh.nvertices)
    twin[cut] = mesh.nvertices + np.arange(cut.size)
    below = mesh.p[1, mesh.t].mean(axis=0) < 0
    points, cells = np.hstack([mesh.p, mesh.p[:, cut]]), np.where(below, twin[mesh.t], mesh.t)
    opened = type(mesh)(points, cells).with_defaults()
    middle, facets = opened.p[:, opened.facets].mean(axis=1), opened.boundary_facets()
    faces = facets[(np.abs(middle[1, facets]) < 1e-9) & (middle[0, facets] < 1.0)]
    above = opened.p[1, opened.t[:, opened.f2t[0, faces]]].mean(axis=0) > 0
    return mesh.with_defaults(), opened, faces[above], faces[~above]


def loaded(mesh, element):
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    return body.fix("bottom", "xy").load("top", (0.004, -0.05))


@lagrange
def test_a_slit_that_sticks_is_none(element):
    """Closed and sticking up to its tip, where the rows vanish, the body is the one without it."""
    whole, opened, upper, lower = slit_to_its_tip(element)
    body = loaded(opened, element)
    result = ContactProblem(body, upper, body.surface(lower), friction=2.0).solve()
    held = loaded(whole, element)
    P, u0 = held.constraint
    u = P @ np.linalg.solve((P.T @ held.stiffness @ P).toarray(), P.T @ held.f) + u0
    at = {tuple(np.round(x, 9)): k for k, x in enumerate(held.basis.doflocs.T)}
    places = body.basis.doflocs.T
    twins = [at[tuple(np.round(x, 9))] for x in places]
    twins = np.array(twins) // 2 * 2 + np.arange(len(twins)) % 2  # one place, two components
    assert np.abs(result.u - u[twins]).max() <= 1e-12 * np.abs(u).max()
    assert np.isfinite(result.pressure).all()


@elements
def test_the_peer_agrees_at_the_tip(element):
    _, opened, upper, lower = slit_to_its_tip(element)
    body = loaded(opened, element)
    problem = ContactProblem(body, upper, body.surface(lower), friction=0.05)
    assert cross_check(problem, problem.solve()).verdict == "agrees"


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("kinds", [(Tie, Pair), (Pair, Pair), (Tie, Tie)], ids=str)
def test_two_interfaces_share_an_end(element, kinds):
    """One boundary, tied on its left half and free to slip on its right: forces and a peer."""
    upper, lower = facing(element, 4, 6)
    lower.fix("bottom", "xy")
    upper.fix("top", "x").load("top", (0.0, -0.05))
    facets = upper.facets("bottom")
    left = upper.mesh.p[0, upper.mesh.facets[:, facets]].mean(axis=0) < 0.5
    halves = facets[left], facets[~left]
    pairs = [kind(upper, own, lower, "top") for kind, own in zip(kinds, halves, strict=True)]
    problem = ContactProblem([upper, lower], pairs)
    result = problem.solve()
    assert cross_check(problem, result).verdict == "agrees"
    transmitted = result[upper].resultant + result[upper].tie_resultant
    assert abs(transmitted[1] - 0.05) <= 1e-12
    # No point at the common end carries more than the load with the edges of the block.
    normal = result.pressure + result.tie_pressure
    assert normal.max() < 0.06
    assert normal.min() > 0.035
