"""Random pairs of bodies in space: every result is certified and balanced, or refused by type."""

import numpy as np
import pytest
from families import SOLID
from scipy.spatial.transform import Rotation

from contact import ContactProblem, ElasticBody, Pair, Unbounded, cross_check

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def ticks(rng, low, high, n):
    size = rng.uniform(1, 3, n)
    return low + (high - low) * np.r_[0.0, np.cumsum(size) / size.sum()]


def random_pair(seed, make):
    """Elements, cells, tilts, units, materials, supports, laws and partial cover at random."""
    rng = np.random.default_rng(seed)
    one, two = (SOLID[rng.integers(len(SOLID))] for _ in range(2))
    turn = Rotation.random(random_state=seed).as_matrix() if rng.random() < 0.7 else np.eye(3)
    size, gap = 10 ** rng.uniform(-3, 3), rng.choice([0.0, 0.01, -0.005])
    shift = rng.uniform(-0.7, 0.7, 2)
    bodies = []
    for element, at, heights in (
        (one, np.zeros(2), (gap, gap + 0.5, gap + 1.0)),
        (two, shift, (-1.0, -0.5, 0.0)),
    ):
        cells = rng.integers(1, 5, 2)
        sides = [ticks(rng, a, a + 1.0, n) for a, n in zip(at, cells, strict=True)]
        mesh = make.box(element, *sides, np.array(heights))
        mesh = make.remesh(mesh, size * (turn @ mesh.p))
        E, nu = 10 ** rng.uniform(-1, 1), rng.uniform(0, 0.45)
        bodies.append(ElasticBody.from_mesh(mesh, element(), E=E, nu=nu))
    upper, lower = bodies
    lower.fix("bottom")
    kind = int(rng.integers(3))
    push = turn @ np.array([*rng.uniform(-0.02, 0.02, 2), -0.03])
    for c in range(3):
        if kind == 0:
            upper.fix("top", c, float(size * push[c]))
        elif kind == 1:
            upper.fix("left", c)
    if kind:
        upper.load("top", 0.3 * push)
    law = str(rng.choice(["coulomb", "tresca"]))
    friction = float(rng.choice([0.0, rng.uniform(0, 1.5)])) * (1.0 if law == "coulomb" else 1e-3)
    pair = Pair(
        upper,
        "bottom",
        lower,
        "top",
        friction=friction,
        functional=[None, "standard", "hat"][rng.integers(3)],
        multipliers=str(rng.choice(["first", "second"])),
    )
    return ContactProblem([upper, lower], [pair], law=law), kind, friction


def check(seed, make, second_opinion):
    problem, kind, friction = random_pair(seed, make)
    try:
        result = problem.solve()
    except Unbounded:  # of a body that friction alone may hold, or nothing
        assert kind == 2
        return
    assert max(result.kkt.values()) <= 1e-10
    size = np.abs(result.mu).sum() + np.abs(result.t).sum() + 1e-300
    assert np.abs(result[0].resultant + result[1].resultant).max() <= 1e-10 * size
    for k in (0, 1):
        assert np.abs(result[k].balance()["residual"]).max() <= 1e-8
    if second_opinion and friction == 0.0:
        assert cross_check(problem, result).verdict != "disagrees"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("part", range(4))
def test_twenty_random_pairs(part, make):
    for seed in range(5 * part, 5 * part + 5):
        check(seed, make, second_opinion=True)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_two_hundred_random_pairs(part, make):
    for seed in range(20 + 20 * part, 40 + 20 * part):
        check(seed, make, second_opinion=False)
