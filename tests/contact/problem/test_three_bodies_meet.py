"""Where the corners of three bodies meet, rows of the pairs depend on each other.

Two blocks side by side on a third one: the corner of each lies on the base and on the other block,
so that up to six conditions act on the four differences of three displacements.
"""

import dataclasses
from itertools import product

import numpy as np
import pytest
from skfem import ElementQuad1, ElementTriP2
from two_blocks import block

from contact import ContactProblem, Pair, Tie, cross_check
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
KINDS = list(product((Pair, Tie), repeat=3))
kinds = pytest.mark.parametrize("kinds", KINDS, ids=lambda k: "-".join(c.__name__ for c in k))
# Facets of the base, of the left and of the right block.
cells = pytest.mark.parametrize("cells", [(4, 2, 2), (4, 6, 5)], ids=str)
elements = pytest.mark.parametrize(
    "element", [ElementTriP2, ElementQuad1, ElementQuadAdini], ids=lambda e: e.__name__
)


def meeting(element, kinds, cells, friction=0.3):
    """The blocks pushed down and against each other."""
    base = block(element, np.linspace(0, 2, cells[0] + 1), [-1.0, -0.5, 0.0])
    left = block(element, np.linspace(0, 1, cells[1] + 1), np.linspace(0, 1, 4))
    right = block(element, np.linspace(1, 2, cells[2] + 1), [0.0, 0.5, 1.0])
    base.fix("bottom", "xy").named("base")
    left.load("top", (0.0, -0.05)).load("left", (0.03, 0.0)).named("left")
    right.load("top", (0.0, -0.08)).load("right", (-0.03, 0.0)).named("right")
    facing = (left, "bottom", base, "top"), (right, "bottom", base, "top"), None
    facing = (*facing[:2], (left, "right", right, "left"))
    pairs = [
        kind(*sides, **({} if kind is Tie else {"friction": friction}))
        for kind, sides in zip(kinds, facing, strict=True)
    ]
    return ContactProblem([base, left, right], pairs)


@pytest.mark.sampled(7)
@cells
@kinds
@elements
def test_the_displacement_is_right_where_forces_may_not_be_unique(element, kinds, cells):
    problem = meeting(element, kinds, cells)
    result = problem.solve()
    assert max(result.kkt.values()) <= 1e-10
    check = cross_check(problem, result)
    # The other solver is given unknowns that satisfy the ties, which nearly determine other rows.
    assert check.verdict != "disagrees", check
    assert check.displacement <= 1e-7, check
    assert check.effect <= 1e-7, check
    assert check.objective <= 1e-8, check
    # The forces at the corners are not unique, but what all pairs transmit to a body is.
    for body, load in (("left", [0.03, -0.05]), ("right", [-0.03, -0.08])):
        transmitted = result[body].resultant + result[body].tie_resultant
        assert np.abs(transmitted + load).max() <= 1e-10, body


def test_forces_that_are_not_unique_are_said_to_be_so():
    problem = meeting(ElementQuad1, (Pair, Pair, Pair), (4, 2, 2))
    result = problem.solve()
    check = cross_check(problem, result)
    assert check.verdict == "agrees, forces not unique"
    assert check.multipliers > 1e-3
    # Forces that do act are told apart from these.
    spoiled = dataclasses.replace(result, t=1.001 * result.t)
    assert cross_check(problem, spoiled).verdict == "disagrees"
