"""Two elastic bodies in space: patch states, ties, friction, facets covered in part."""

import numpy as np
import pytest
from families import SOLID, STRAIGHT
from skfem import ElementHex1, ElementHex2, ElementTetP1, ElementTetP2

from contact import ContactProblem, ElasticBody, Pair, Plane, Tie

PRESSURE = 0.7
elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
SIDES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0)}
SIDES |= {"top": (2, 1)}


def box(element, cells, corner=(0.0, 0.0, 0.0), sizes=(1.0, 1.0, 1.0), turn=None, **more):
    ticks = [a + np.linspace(0, l, n + 1) for a, l, n in zip(corner, sizes, cells, strict=True)]
    mesh = STRAIGHT[element].init_tensor(*ticks)
    named = mesh.with_boundaries(
        {
            name: (lambda x, k=k, v=ticks[k][-end]: np.abs(x[k] - v) < 1e-9)
            for name, (k, end) in SIDES.items()
        }
    )
    if turn is not None:
        names = dict(named.boundaries)
        named = type(named)(turn @ named.p, named.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(named, element(), **({"E": 3.0, "nu": 0.3} | more))


def stacked(element, other, n, m, **more):
    upper = box(element, (n, n, 2), (0, 0, 1.0), **more)
    return upper, box(other, (m, m + 1, 2), **more)


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize(("n", "m"), [(1, 3), (3, 4), (4, 2)])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_uniform_pressure_is_carried_across_meshes_that_do_not_match(element, n, m, friction):
    upper, lower = stacked(element, element, n, m)
    lower.fix("bottom", "z").fix("left", "x").fix("front", "y")
    upper.fix("left", "x").fix("front", "y").load("top", (0.0, 0.0, -PRESSURE))
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=friction).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-11
    exact = np.zeros((3, 3, 1, 1))
    exact[2, 2] = -PRESSURE
    for body in (upper, lower):
        assert np.abs(result[body].stress() - exact).max() <= 1e-11
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.parametrize(
    ("element", "other"), [(ElementHex1, ElementTetP2), (ElementTetP1, ElementHex2)]
)
def test_tilted_hexahedra_on_tetrahedra(element, other):
    a, b = 0.4, 0.3
    one = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    two = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    turn, E, nu = one @ two, 3.0, 0.3
    n = turn @ [0.0, 0.0, 1.0]
    sigma = -PRESSURE * np.outer(n, n)
    strain = ((1 + nu) * sigma - nu * np.trace(sigma) * np.eye(3)) / E
    upper, lower = stacked(element, other, 3, 4, turn=turn)
    for body, side in ((upper, "top"), (lower, "bottom")):
        for c in range(3):
            body.fix(side, c, lambda x, c=c: np.einsum("j,j...->...", strain[c], x))
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-11
    for body in (upper, lower):
        assert np.abs(result[body].stress() - sigma[:, :, None, None]).max() <= 1e-11


@elements
def test_a_tie_carries_tension(element):
    upper, lower = stacked(element, element, 2, 3)
    lower.fix("bottom", "z").fix("left", "x").fix("front", "y")
    upper.fix("left", "x").fix("front", "y").load("top", (0.0, 0.0, 0.5))
    result = ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve()
    assert np.abs(result.tie_pressure + 0.5).max() <= 1e-10
    for body in (upper, lower):
        assert np.abs(result[body].stress()[2, 2] - 0.5).max() <= 1e-10


@elements
@pytest.mark.parametrize("seed", range(3))
def test_a_block_dragged_over_an_edge(element, seed):
    """Partly covered facets, stick and slip: forces of both bodies cancel, and Newton is short."""
    shift = np.random.default_rng(seed).uniform(-0.3, 0.5, 2)
    lower = box(element, (4, 4, 2), E=1.0).fix("bottom", "xyz")
    upper = box(element, (3, 3, 2), (*shift, 1.0), (0.7, 0.7, 0.6), E=2.0)
    upper.fix("top", "z", -0.03).fix("top", "x", 0.02).fix("top", "y", 0.005)
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.4).solve()
    one, two, size = result[upper].resultant, result[lower].resultant, result.contact_force
    assert np.abs(one + two).max() <= 1e-12 * size
    assert np.abs(one - result.resultant).max() <= 1e-12 * size
    assert np.hypot(*one[:2]) <= 0.4 * one[2] * (1 + 1e-9)
    assert sum(line.phase == "newton" for line in result.history) <= 15


def test_a_stiff_body_is_a_rigid_obstacle():
    upper, lower = stacked(ElementHex1, ElementHex1, 4, 4)
    lower.E = 1e7 * np.max(upper.E)
    lower.fix("bottom", "xyz")
    upper.fix("top", "z", lambda x: -0.03 - 0.02 * x[0]).fix("top", "x", 0.01).fix("top", "y")
    floor = Plane((0, 0, 1.0), (0, 0, 1))
    rigid = ContactProblem(upper, "bottom", floor, friction=0.3).solve()
    two = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    size = rigid.contact_force
    np.testing.assert_allclose(two.resultant, rigid.resultant, atol=1e-5 * size)


def test_three_boxes_and_both_choices_of_multipliers():
    a = box(ElementHex1, (2, 2, 1), (0, 0, 2.0)).fix("left", "x").fix("front", "y")
    b = box(ElementTetP1, (3, 3, 1), (0, 0, 1.0)).fix("left", "x").fix("front", "y")
    c = box(ElementTetP2, (2, 1, 1)).fix("left", "x").fix("front", "y").fix("bottom", "z")
    a.load("top", (0.0, 0.0, -PRESSURE))
    for side in ("first", "second"):
        pairs = [
            Pair(a, "bottom", b, "top", friction=0.2, multipliers=side),
            Pair(b, "bottom", c, "top", multipliers=side),
        ]
        result = ContactProblem([a, b, c], pairs).solve()
        assert np.abs(result.pressure - PRESSURE).max() <= 1e-11


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP2])
@pytest.mark.parametrize("m", [2, 3, 4])
def test_ties_that_end_at_held_edges(element, m):
    """Both bodies held where the tie ends: the traction across it does not oscillate."""
    upper, lower = stacked(element, element, m, 3)
    lower.fix("left", "xyz").fix("bottom", "xyz")
    upper.fix("left", "xyz").load("top", (0.1, 0.0, 0.5))
    result = ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve()
    free = result.x_nominal[0] > 1e-9
    assert result.tie_pressure[free].max() < 0
    assert result.tie_pressure[free].min() > -0.6
