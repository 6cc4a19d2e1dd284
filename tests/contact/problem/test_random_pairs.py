"""Random pairs of bodies: every result is certified and balanced, every refusal says why."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from two_blocks import block, turned

from contact import ContactProblem, Pair, Unbounded, cross_check
from skfem_adini import ElementQuadBFS

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def random_pair(seed):
    """Elements, ratios, tilts, units, materials, supports, laws and partial cover at random."""
    rng = np.random.default_rng(seed)
    one, two = (PLANE_AND_BFS[rng.integers(len(PLANE_AND_BFS))] for _ in range(2))
    n, m = (int(2 ** rng.uniform(0, 4.3)) for _ in range(2))
    angle = 0.0 if ElementQuadBFS in (one, two) else rng.uniform(-0.6, 0.6)
    size, gap, shift = (
        10 ** rng.uniform(-3, 3),
        rng.choice([0.0, 0.01, -0.005]),
        rng.uniform(-0.8, 0.8),
    )
    upper, lower = (
        block(
            element,
            np.linspace(left, 1 + left, count + 1),
            ys,
            place=turned(angle),
            size=size,
            E=10 ** rng.uniform(-1, 1),
            nu=rng.uniform(0, 0.45),
        )
        for element, left, count, ys in (
            (one, 0.0, n, [gap, gap + 0.5, gap + 1.0]),
            (two, shift, m, [-1.0, -0.5, 0.0]),
        )
    )
    lower.fix("bottom", "xy")
    kind, upright = rng.integers(4), angle == 0.0
    if kind == 0:
        upper.fix("top", "xy", lambda x: np.full(x.shape[1:], -0.02 * size))
    elif kind == 1:
        upper.fix("top", "x", 0.01 * size).fix("top", "y", -0.03 * size)
    elif kind == 2:
        upper.load("top", (0.01 * np.sin(angle), -0.01 * np.cos(angle)))
    else:
        upper.fix("left", "x" if upright else "xy").load("top", (0.01 * rng.normal(), -0.01))
    law = str(rng.choice(["coulomb", "tresca"]))
    friction = float(rng.choice([0.0, rng.uniform(0, 1.5)])) * (1.0 if law == "coulomb" else 1e-3)
    functional = [None, "standard", "hat"][rng.integers(3)]
    side = str(rng.choice(["first", "second"]))
    pair = Pair(
        upper, "bottom", lower, "top", friction=friction, functional=functional, multipliers=side
    )
    return ContactProblem([upper, lower], [pair], law=law), kind, friction


def check(seed, second_opinion):
    problem, kind, friction = random_pair(seed)
    try:
        result = problem.solve()
    except Unbounded:  # of a body that friction alone may hold, or nothing
        assert kind in (2, 3)
        return
    assert max(result.kkt.values()) <= 1e-10
    size = np.abs(result.mu).sum() + np.abs(result.t).sum() + 1e-300
    assert np.abs(result[0].resultant + result[1].resultant).max() <= 1e-10 * size
    for k in (0, 1):
        assert np.abs(result[k].balance()["residual"]).max() <= 1e-8
    if second_opinion and friction <= 0.5:
        assert cross_check(problem, result).verdict != "disagrees"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("part", range(4))
def test_twenty_random_pairs(part):
    for seed in range(5 * part, 5 * part + 5):
        check(seed, second_opinion=True)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_two_hundred_random_pairs(part):
    for seed in range(20 + 20 * part, 40 + 20 * part):
        check(seed, second_opinion=False)
