"""Random pairs of bodies: every result is certified and balanced, every refusal says why."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from skfem import ElementQuad1
from two_blocks import facing, graded

from contact import (
    ContactError,
    ContactProblem,
    ElasticBody,
    InputError,
    Pair,
    Tie,
    Unbounded,
    cross_check,
)
from skfem_adini import ElementQuadBFS

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def random_pair(seed, dim, make):
    """Elements, cells, tilts, units, materials, supports, laws and partial cover at random."""
    rng = np.random.default_rng(seed)
    known = PLANE_AND_BFS if dim == 2 else SOLID
    one, two = (known[rng.integers(len(known))] for _ in range(2))
    turn = Rotation.random(random_state=seed).as_matrix()
    if dim == 2:
        turn = Rotation.from_euler("z", rng.uniform(-0.6, 0.6)).as_matrix()[:2, :2]
    if rng.random() < 0.3 or ElementQuadBFS in (one, two):
        turn = np.eye(dim)
    size, gap = 10 ** rng.uniform(-3, 3), rng.choice([0.0, 0.01, -0.005])
    bodies = []
    for element, at, heights in (
        (one, np.zeros(dim - 1), (gap, gap + 0.5, gap + 1.0)),
        (two, rng.uniform(-0.7, 0.7, dim - 1), (-1.0, -0.5, 0.0)),
    ):
        cells = (2 ** rng.uniform(0, 4.3 if dim == 2 else 2.3, dim - 1)).astype(int)
        sides = [graded(rng, low, low + 1, n) for low, n in zip(at, cells, strict=True)]
        mesh = make.box(element, *sides, np.array(heights))
        mesh = make.remesh(mesh, size * (turn @ mesh.p))
        E, nu = 10 ** rng.uniform(-1, 1), rng.uniform(0, 0.45)
        bodies.append(ElasticBody.from_mesh(mesh, element(), E=E, nu=nu))
    upper, lower = bodies
    lower.fix("bottom")
    kind = int(rng.integers(4))
    push = turn @ np.array([*rng.uniform(-0.02, 0.02, dim - 1), -0.03])
    for c in range(dim):
        if kind == 0:
            upper.fix("top", c, float(size * push[c]))
        elif kind == 1:
            upper.fix("left", c)
    if kind:
        upper.load("top", 0.3 * (-0.03 * turn[:, -1] if kind == 3 else push))
    law = str(rng.choice(["coulomb", "tresca"]))
    friction = float(rng.choice([0.0, rng.uniform(0, 1.5)])) * (1.0 if law == "coulomb" else 1e-3)
    functional = [None, "standard", "hat"][rng.integers(3)]
    side = str(rng.choice(["first", "second"]))
    pair = Pair(
        upper, "bottom", lower, "top", friction=friction, functional=functional, multipliers=side
    )
    return ContactProblem([upper, lower], [pair], law=law), kind, friction


def check(seed, dim, make, second_opinion):
    problem, kind, friction = random_pair(seed, dim, make)
    try:
        result = problem.solve()
    except Unbounded:  # of a body that friction alone may hold, or nothing
        assert kind >= 2
        return
    except InputError as refused:  # a load that moves a soft body beyond the theory
        if kind == 0 or "times the size of the body, in a theory of small" not in str(refused):
            raise
        return
    assert max(result.kkt.values()) <= 1e-10
    size = np.abs(result.mu).sum() + np.abs(result.t).sum() + 1e-300
    assert np.abs(result[0].resultant + result[1].resultant).max() <= 1e-10 * size
    for k in (0, 1):
        assert np.abs(result[k].balance()["residual"]).max() <= 1e-8
    if second_opinion and friction <= (0.5 if dim == 2 else 0.0):
        assert cross_check(problem, result).verdict != "disagrees"


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "seeds",
    [
        *(pytest.param(range(k, k + 5), marks=pytest.mark.sampled(3)) for k in range(0, 20, 5)),
        *(pytest.param(range(k, k + 20), marks=pytest.mark.slow) for k in range(20, 220, 20)),
    ],
    ids=str,
)
def test_random_pairs(seeds, dim, make):
    for seed in seeds:
        check(seed, dim, make, second_opinion=len(seeds) == 5)


@pytest.mark.turns(3)
@settings(max_examples=40, deadline=None)
@given(
    ratio=st.sampled_from([1e-8, 1e-4, 1.0, 1e4, 1e8]),
    kind=st.sampled_from([Pair, Tie]),
    shift=st.floats(-1.2, 1.2),
    gap=st.one_of(st.sampled_from([0.0, 1e-12, -1e-12]), st.floats(-0.6, 3.0)),
    friction=st.floats(0.0, 1.5),
    push=st.floats(-0.1, 0.1),
)
def test_certified_or_refused(ratio, kind, shift, gap, friction, push):
    """Stiffness ratios, places and pushes of any kind: balanced forces, or a typed error."""
    _, lower = facing(ElementQuad1, 3, 5, shift=shift, gap=gap)
    stiff, _ = facing(ElementQuad1, 3, 5, shift=shift, gap=gap, E=ratio)
    lower.fix("bottom", "xy")
    stiff.fix("top", "x", 0.01).fix("top", "y", -push)
    more = {} if kind is Tie else {"friction": friction}
    try:
        problem = ContactProblem([stiff, lower], [kind(stiff, "bottom", lower, "top", **more)])
        result = problem.solve()
    except ContactError:
        return
    assert max(result.kkt.values()) <= 1e-10
    forces = np.array([own.resultant + own.tie_resultant for own in (result[0], result[1])])
    if kind is Tie:
        assert np.abs(forces).max() > 0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-9 * max(np.abs(forces).max(), 1e-300)
