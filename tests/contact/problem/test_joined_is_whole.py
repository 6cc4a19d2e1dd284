"""Faces of matching meshes that stick are joined: slits, stacks and ties give the whole body."""

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import ContactProblem, ElasticBody, Pair, Status, Tie

# Adini's derivative along the normal is continuous in the whole body alone.
LAGRANGE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2]
LAGRANGE += [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2]
elements = pytest.mark.parametrize("element", LAGRANGE, ids=lambda e: e.__name__)
PUSH, MATERIAL = 0.2, {"E": 2.0, "nu": 0.3}


def ticks(element):
    """Graded along x; the layers of three bodies."""
    space = element in LAGRANGE[4:]
    along = np.linspace(0, 1, 5 if space else 8) ** 1.3
    return [along] + [np.linspace(0, 1, 4)] * space, np.linspace(0.0, 3.0, 7)


def press(body):
    """Push the upper side down, aside and round."""
    dim = body.mesh.dim()
    u = [0.004, 0.003, -PUSH] if dim == 3 else [0.004, -PUSH]
    for k in range(dim):
        body.fix("top", k, lambda x, k=k: u[k] + (0.03 * x[0] if k == dim - 1 else 0.0 * x[0]))


def same(part, whole, mesh):
    """Displacement and stress in the middle of each cell."""
    x = mesh.p[:, mesh.t].mean(axis=1)
    assert np.abs(part.sample(x) - whole.sample(x)).max() <= 1e-8 * PUSH
    off = np.abs(part.stress(x) - whole.stress(x)).max()
    assert off <= 1e-8 * np.abs(whole.stress()).max()


def whole(element, make):
    """The body in one piece, which does not touch the obstacle far away."""
    sides, heights = ticks(element)
    body = ElasticBody.from_mesh(make.box(element, *sides, heights), element(), **MATERIAL)
    press(body.fix("bottom"))
    return ContactProblem(body, "right", 1e3).solve()


def layers(element, make):
    """Three bodies of the same cells, from below to above."""
    sides, heights = ticks(element)
    return [
        ElasticBody.from_mesh(make.box(element, *sides, part), element(), **MATERIAL)
        for part in (heights[:3], heights[2:5], heights[4:])
    ]


JOINTS = {
    "contact": lambda one, two, side: Pair(
        one, "bottom", two, "top", friction=5.0, multipliers=side
    ),
    "tie": lambda one, two, side: Tie(one, "bottom", two, "top", multipliers=side),
}


@pytest.mark.sampled(9)
@elements
@pytest.mark.parametrize("side", ["first", "second"])
@pytest.mark.parametrize(
    ("upper", "lower"), [("contact", "contact"), ("contact", "tie"), ("tie", "contact")]
)
def test_a_stack_of_three(element, upper, lower, side, make):
    low, middle, top = layers(element, make)
    low.fix("bottom")
    press(top)
    pairs = [JOINTS[upper](top, middle, side), JOINTS[lower](middle, low, side)]
    result = ContactProblem([top, middle, low], pairs).solve()
    assert set(result.status) <= {Status.STICK, Status.BONDED}
    expected = whole(element, make)
    for part in (low, middle, top):
        same(result[part], expected, part.mesh)


def slit(mesh, low, high):
    """The mesh with the vertices on the middle plane between two places doubled, and both lips."""
    on = (np.abs(mesh.p[-1] - 1.5) < 1e-9) & (mesh.p[0] > low) & (mesh.p[0] < high)
    cut = np.flatnonzero(on)
    twin = np.arange(mesh.nvertices)
    twin[cut] = mesh.nvertices + np.arange(cut.size)
    above = mesh.p[-1, mesh.t].mean(axis=0) > 1.5
    t = np.where(above, twin[mesh.t], mesh.t)
    opened = type(mesh)(np.hstack([mesh.p, mesh.p[:, cut]]), t, sort_t=False)
    middle = opened.p[:, opened.facets].mean(axis=1)
    lips = np.flatnonzero(np.abs(middle[-1] - 1.5) < 1e-9)
    lips = np.intersect1d(lips, opened.boundary_facets())
    up = opened.p[-1, opened.t[:, opened.f2t[0, lips]]].mean(axis=0) > 1.5
    ends = {
        name: opened.facets_satisfying(lambda x, end=end: np.abs(x[-1] - end) < 1e-9, True)
        for name, end in (("bottom", 0.0), ("top", 3.0))
    }
    return opened.with_boundaries(ends | {"upper lip": lips[up], "lower lip": lips[~up]})


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("low", "high"), [(-1.0, 0.6), (0.05, 0.9)], ids=["open", "inner"])
@elements
def test_a_slit_that_sticks(element, low, high, make):
    sides, heights = ticks(element)
    mesh = slit(make.box(element, *sides, heights), low, high)
    body = ElasticBody.from_mesh(mesh, element(), **MATERIAL).fix("bottom")
    press(body)
    problem = ContactProblem(body, "upper lip", body.surface("lower lip"), friction=5.0)
    result = problem.solve()
    assert result.contact_force > 0
    same(result, whole(element, make), mesh)
