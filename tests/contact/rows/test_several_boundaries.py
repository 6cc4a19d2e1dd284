"""Several contact boundaries in one problem, each with obstacle, friction and functional."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTriP2

from contact import ContactProblem, ElasticBody, InputError, Plane
from skfem_adini import ElementQuadAdini

ELEMENTS = [ElementQuadAdini, ElementTriP2, ElementQuad1, ElementHex1]


def squeezed(make, element, n=6):
    """A square or cube between two planes, on a smooth wall at its left."""
    dim = element().dim
    ticks = np.linspace(0, 1, (n if dim == 2 else 3) + 1)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=2.0, nu=0.3)
    body.fix("left", "x").body_force(0.02 * np.eye(dim)[-1])
    return body if dim == 2 else body.fix("front", "y")


def faces(dim):
    up = np.eye(dim)[-1]
    return Plane(0.05 * up, up), Plane(0.97 * up, -up)


@pytest.mark.parametrize("element", ELEMENTS)
def test_two_disjoint_boundaries(element, make):
    """Two in a list = their union under one gap that is looked up by place."""
    body = squeezed(make, element)
    below, above = faces(body.dim)
    result = ContactProblem(body, ["bottom", "top"], [below, above], 0.3).solve()

    def gap(x):
        return np.where(x[-1] < 0.5, -0.05, -0.03)

    union = ContactProblem(body, ["bottom", "top"], gap, 0.3).solve()
    order = [
        int(np.argmin(np.abs(result.x_nominal - x[:, None]).sum(axis=0))) for x in union.x_nominal.T
    ]
    assert sorted(order) == list(range(result.mu.size))
    # Newton's tolerance of 1e-12 times the condition of the body.
    assert np.abs(result.mu[order] - union.mu).max() < 1e-9 * union.mu.max()
    assert np.abs(result.u - union.u).max() < 1e-9 * np.abs(union.u).max()
    np.testing.assert_allclose(result.resultants.sum(axis=0), result.resultant, atol=1e-13)
    assert result.resultants[0, -1] > 0 > result.resultants[1, -1]
    assert np.array_equal(np.unique(result.part), [0, 1])


def test_each_its_own(make):
    """Friction and functional differ: the law holds with each point's own coefficient."""
    body = squeezed(make, ElementQuadAdini).load("right", (-0.1, 0.0))
    problem = ContactProblem(
        body,
        ["bottom", "top"],
        list(faces(2)),
        friction=[0.0, lambda x: 0.3 + 0.2 * x[0]],
        functional=["gauss", "bernstein"],
    )
    result = problem.solve()
    assert np.all(result.t[result.part == 0] == 0)
    assert np.abs(result.t[result.part == 1]).max() > 0
    assert (result.part == 0).sum() == 12
    assert (result.part == 1).sum() == 14
    assert make.law_error(result) < 1e-11
    shared = ContactProblem(body, ["bottom", "top"], list(faces(2)), 0.3, functional="gauss")
    assert shared.rows.functional == "gauss"
    assert np.all(shared.friction == 0.3)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementQuad1])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_corner(element, friction, make):
    """Two walls that meet: pressed into the corner by loads on the other sides."""
    ticks = np.linspace(0, 1, 7)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=2.0, nu=0.3)
    body.load("top", (0.0, -0.2)).load("right", (-0.1, 0.0))
    result = ContactProblem(body, ["left", "bottom"], [0.0, 0.01], friction).solve()
    assert max(result.kkt.values()) < 1e-10
    np.testing.assert_allclose(result.resultant, [0.1, 0.2], rtol=1e-9)
    if friction == 0:
        np.testing.assert_allclose(result.resultants, [[0.1, 0], [0, 0.2]], atol=1e-10)
        # Free to slide on both walls: uniform stress.
        assert np.abs(result.pressure[result.part == 0] - 0.1).max() < 1e-10
        assert np.abs(result.pressure[result.part == 1] - 0.2).max() < 1e-10


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((["bottom", "top"], [0.0, 0.1, 0.2]), "3 obstacles for 2"),
        ((["bottom", ["top", "bottom"]], [0.0, 0.1]), "two contact boundaries"),
        ((["bottom", "nowhere"], [0.0, 0.1]), "nowhere"),
        ((["bottom", "top"], [0.0, 0.1], [0.3]), "friction"),
        ((["bottom", "top"], [0.0, 0.1], [0.3, np.nan]), "friction"),
        ((["bottom", "top"], [0.0, np.nan]), "NaN"),
        ((["bottom", "top"], [0.0, 0.1], 0.3, "coulomb", ["gauss", "no"]), "functional"),
        (([], []), "0 obstacles"),
    ],
)
def test_malformed(arguments, word, make):
    with pytest.raises(InputError, match=word):
        ContactProblem(squeezed(make, ElementQuadAdini, 2), *arguments)
