"""Three bodies that meet at a corner, each touching both others: a uniform state of all."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID

from contact import ContactProblem, ElasticBody, Pair, Tie

ACROSS, DOWN, E, NU = 0.3, 0.7, 50.0, 0.3


def brick(make, element, counts, low, high):
    ticks = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    return ElasticBody.from_mesh(make.box(element, *ticks), element(), E=E, nu=NU)


def corner(make, element, counts, kinds, friction):
    """Left and right body below, a third on both; the wall on the left is smooth, as is the floor.

    All other sides carry the traction of the uniform state; in space nothing moves along y.
    """
    space = element in SOLID
    dim = 2 + space
    deep, n, m, k = [0.0] * space, *counts
    far = [1.0] * space
    left = brick(make, element, (n, *[2] * space, 2), (0.0, *deep, -1.0), (0.45, *far, 0.0))
    right = brick(make, element, (m, *[3] * space, 3), (0.45, *deep, -1.0), (1.0, *far, 0.0))
    top = brick(make, element, (k, *[2] * space, 2), (0.0, *deep, 0.0), (1.0, *far, 1.0))
    for body in (left, right):
        body.fix("bottom", dim - 1)
    for body in (left, top):
        body.fix("left", "x")
    for body in (right, top):
        body.load("right", (-ACROSS, *[0.0] * (dim - 1)))
    top.load("top", (*[0.0] * (dim - 1), -DOWN))
    if space:
        for body in (left, right, top):
            body.fix("front", "y").fix("back", "y")
    pairs = []
    for kind, one, of_one, two, of_two in (
        (kinds[0], left, "top", top, "bottom"),
        (kinds[1], right, "top", top, "bottom"),
        (kinds[2], left, "right", right, "left"),
    ):
        more = {"friction": friction} if kind is Pair else {}
        pairs.append(kind(one, of_one, two, of_two, **more))
    return ContactProblem([left, right, top], pairs), (left, right, top)


@pytest.mark.sampled(7)
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.parametrize(
    ("kinds", "friction"),
    [
        ((Pair, Pair, Pair), 0.0),
        ((Pair, Pair, Pair), 0.6),
        ((Pair, Tie, Pair), 0.6),
        ((Tie, Pair, Tie), 0.0),
    ],
)
@pytest.mark.parametrize("element", PLANE_AND_BFS + SOLID, ids=lambda e: e.__name__)
def test_uniform_stress(element, kinds, friction, make):
    counts = (2, 3, 4) if element in SOLID else (3, 2, 5)
    problem, bodies = corner(make, element, counts, kinds, friction)
    result = problem.solve()
    normal = result.pressure + result.tie_pressure
    assert np.abs(normal - np.array([DOWN, DOWN, ACROSS])[result.part]).max() <= 1e-9
    sigma = np.diag([-ACROSS, -DOWN])
    if element in SOLID:
        sigma = np.diag([-ACROSS, -NU * (ACROSS + DOWN), -DOWN])
    for body in bodies:
        assert np.abs(result[body].stress() - sigma[:, :, None, None]).max() <= 1e-9
    assert max(result.kkt.values()) <= 1e-10
