"""Random bodies of large strain, pressed and dragged: no wrong answer, few that are given up."""

import numpy as np
import pytest
from families import box
from rubber_blocks import check_laws
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import (
    ContactProblem,
    Cylinder,
    FinitePlasticity,
    MooneyRivlin,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    NotConverged,
    Ogden,
    Pair,
    Plane,
    SaintVenant,
    Sphere,
    Viscous,
)

PLANAR = (ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2)
SOLID = (ElementHex1, ElementTetP2)


def law_of(rng, E):
    """A material of a Young's modulus of about E, and the part of 1 that it is strained by."""
    rubber = NeoHooke(0.35 * E, E * rng.choice([0.5, 2.0, 10.0]))
    laws = [
        (rubber, 1.0),
        (NeoHooke(0.33 * E, 30 * E), 1.0),
        (MooneyRivlin(0.12 * E, 0.05 * E, 5 * E), 1.0),
        (Ogden((0.3 * E, 0.02 * E), (1.3, 4.0), 5 * E), 1.0),
        (SaintVenant(E, 0.3), 0.3),
        (FinitePlasticity(E, 0.3, 0.01 * E, rng.choice([0.02, 0.2]) * E), 0.35),
        (Viscous(rubber, 0.5, 1.0), 1.0),
    ]
    return laws[rng.integers(len(laws))]


def block(rng, element, law, wide, size):
    """A block, its lower side flat, round or sloped, its inner vertices shaken."""
    n = rng.integers(3, 7) if element in PLANAR else rng.integers(2, 4)
    across = [np.linspace(0.0, wide, max(2, int(n * wide)) + 1)]
    ticks = [*across, *[np.linspace(0.0, 1.0, n + 1)] * (element().dim - 1)]
    mesh = box(element, *ticks)
    names, p = dict(mesh.boundaries), mesh.p.copy()
    inner = np.setdiff1d(np.arange(p.shape[1]), mesh.boundary_nodes())
    p[:, inner] += 0.15 / n * rng.uniform(-1.0, 1.0, (len(p), inner.size))
    x = p[0] / wide
    p[-1] += (1 - p[-1]) * [0.0 * x, 0.8 * (x - 0.5) ** 2, 0.2 * x][rng.integers(3)]
    mesh = type(mesh)(size * p, mesh.t, sort_t=False).with_boundaries(names)
    planes = ["strain", "stress", "axisymmetric"]
    planes = planes[:1] if isinstance(law, FinitePlasticity) else planes
    plane = str(rng.choice(planes)) if element in PLANAR else None
    stiff = isinstance(law, NeoHooke) and law.lam > 20 * law.mu
    full = element in (ElementQuad1, ElementQuad2, ElementHex1) and plane != "stress"
    mean = full and (stiff or rng.uniform() < 0.3)
    options = {"plane": plane or "strain", "dilatation": "mean" if mean else "pointwise"}
    return NonlinearBody.from_mesh(mesh, element(), stress=law, **options).fix("top")


def opposite(rng, body, wide, size, friction):
    """The problem of a block opposite a plane, a round obstacle or a wider block."""
    dim, ring = body.dim, body.plane == "axisymmetric"
    up = np.eye(dim)[-1]
    kind = rng.choice(["flat", "round", "sloped", "rubber"])
    if kind == "rubber" and not ring and body.plane == "strain" and dim == 2:
        element = type(body.element)
        x = np.linspace(-1.0, wide + 1.0, int(4 * (wide + 2)) + 1)
        mesh = box(element, size * x, size * np.linspace(-0.5, 0.0, 3))
        soft = float(np.abs(body.cells.tangent(np.zeros(body.ndofs), body.cells.rest, 1.0)).max())
        low = NonlinearBody.from_mesh(mesh, element(), stress=NeoHooke(soft, 3 * soft))
        pair = Pair(body.named("upper"), "bottom", low.fix("bottom"), "top", friction=friction)
        return ContactProblem([body, low], [pair]), {"body": "upper"}
    obstacle = Plane(0.0 * up, up)
    if kind == "round":
        radius = rng.choice([0.4, 1.0, 3.0])
        center = -radius * up
        center[0] = 0.0 if ring else wide * rng.uniform(0.2, 0.8)
        center[1:-1] = 0.5
        shape = Sphere if ring or dim == 3 else Cylinder
        obstacle = shape(size * center, size * radius)
    elif kind == "sloped" and not ring:
        normal = up + rng.uniform(-0.4, 0.4) * np.eye(dim)[0]
        obstacle = Plane(body.mesh.p[:, np.argmin(normal @ body.mesh.p)], normal)
    sides = ["bottom", "right"] if ring else ["bottom", "left", "right"]
    sides = sides if rng.uniform() < 0.5 else "bottom"
    return ContactProblem(body, sides, obstacle, friction=friction), {}


def press(seed):
    """A stepper, its times and its friction."""
    rng = np.random.default_rng(seed)
    element = rng.choice(PLANAR if rng.uniform() < 0.85 else SOLID)
    size, E = 10.0 ** rng.integers(-3, 3), 10.0 ** rng.integers(-1, 8)
    wide, friction = rng.choice([0.6, 1.0, 2.0]), float(rng.choice([0.0, 0.1, 0.3, 0.6, 1.0]))
    law, share = law_of(rng, E)
    body = block(rng, element, law, wide, size)
    ring = body.plane == "axisymmetric"
    if ring:
        body.fix("left", "x")
    problem, upper = opposite(rng, body, wide, size, friction)
    steps, depth = int(rng.choice([1, 2, 5, 10])), share * size * rng.uniform(0.15, 0.5)
    stepper = NonlinearStepper(problem)
    stepper.move("top", body.dim - 1, -depth, lambda t: min(t, 1.0), **upper)
    times = np.linspace(0.0, 1.0, steps + 1)[1:]
    if not ring:
        far = share * size * rng.choice([0.0, -0.3, 0.3, 0.8])
        stepper.move("top", 0, far, lambda t: max(t - 1.0, 0.0), **upper)
        times = np.r_[times, 1.0 + times]
    return stepper, times, friction


def given_up(seeds):
    """Why seeds end early, in words; fails where a law does not hold."""
    found = []
    for seed in seeds:
        stepper, times, friction = press(seed)
        try:
            stepper.run(times)
        except NotConverged as error:
            found.append(str(error))
        for result in stepper.history:
            if result.mu.max() > 0:
                check_laws(result, friction, stepper.problem.body.extent)
    assert all(said.startswith("large strain: ") and "least det F is" in said for said in found)
    return found


@pytest.mark.sampled(10)
@pytest.mark.parametrize("seed", range(40))
def test_no_wrong_answer(seed):
    assert len(given_up([seed])) <= 1


@pytest.mark.slow
def test_few_are_given_up():
    """In three of a hundred the corner of a cell folds."""
    seeds = range(100, 200)
    assert len(given_up(seeds)) <= 3
