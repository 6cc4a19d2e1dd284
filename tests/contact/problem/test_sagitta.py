"""A polygon that stands for a curve, pressed on an exact obstacle: warned of where it matters."""

import warnings

import numpy as np
import pytest
from rings import A, B, lame, ring
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import (
    ClosestPoint,
    ContactProblem,
    ContactWarning,
    Cylinder,
    ElasticBody,
    LoadStepper,
    Plane,
    Rigid,
    SignedDistance,
)
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

N = 8  # facets of the quarter
SAGITTA = {"right": B * (np.pi / 2 / N) ** 2 / 8, "left": A * (np.pi / 2 / N) ** 2 / 8}


def obstacle(side, d, size=1.0, dim=2):
    hollow = side == "right"
    return Cylinder((0.0,) * dim, size * (B - d if hollow else A + d), hollow=hollow)


def solved(problem, **options):
    """The result, and what was said of facets."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = problem.solve(**options)
    return result, [str(w.message) for w in caught if issubclass(w.category, ContactWarning)]


def error(result, exact):
    w = result.system.rows.weights
    return float(np.sqrt(np.sum(w * (result.pressure / exact - 1) ** 2) / w.sum()))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2, ElementQuadAdini])
def test_shrink_fit(element, side, make):
    """Warned of where the pressure is off, by as much as it is; not where it is right."""
    for ratio in (0.1, 1.0, 3.0, 10.0, 100.0):
        d = ratio * SAGITTA[side]
        body = ring(make, element, N)
        result, said = solved(ContactProblem(body, side, obstacle(side, d), friction=0.2))
        off = error(result, lame(side, d))
        assert len(said) == (ratio < 10)
        assert (off > 0.2) == bool(said)
        if said:
            share = float(said[0].split("pressures are ")[1].split("%")[0]) / 100
            assert share == pytest.approx(off, rel=0.05)
            assert "second order" in said[0]
    if element is ElementQuad2:  # as many facets as the warning asks for
        d = SAGITTA[side]
        _, said = solved(ContactProblem(ring(make, element, N), side, obstacle(side, d)))
        finer = ring(make, element, N * int(said[0].split("facets ")[2].split(" times")[0]))
        result, said = solved(ContactProblem(finer, side, obstacle(side, d)))
        assert not said
        assert error(result, lame(side, d)) < 0.06


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad1])
def test_gaps_read_at_the_vertices(element, side, make):
    """P1 and Q1 read it where the polygon lies on the curve: right, and nothing to warn of."""
    for d in (0.1 * SAGITTA[side], SAGITTA[side]):
        result, said = solved(ContactProblem(ring(make, element, N), side, obstacle(side, d)))
        assert not said
        mean = result.mu.sum() / result.system.rows.weights.sum()
        assert mean == pytest.approx(lame(side, d), rel=0.06)


@pytest.mark.parametrize(
    ("element", "number", "size"),
    [(ElementHex2, 1, 1e-6), (ElementTetP2, 1, 1e3), (ElementHex1, 0, 1e3)],
)
def test_rings_in_space(element, number, size, make):
    d = 2.0 * (B * (np.pi / 2 / 4) ** 2 / 8)
    body = ring(make, element, 4, size=size)
    _, said = solved(ContactProblem(body, "right", obstacle("right", d, size, 3)))
    assert len(said) == number


D = 2.0 * SAGITTA["right"]


def test_whatever_gives_the_gap(make):
    """A wall that moves by little of a facet's height, or by much; obstacles in all guises."""
    around, low = Cylinder((0.0, 0.0), B - D, hollow=True), B * (np.pi / 2 / 24) ** 2 / 8
    wall = Plane((B, 0.0), (-1.0, 0.0))
    for n, gap, warned in (
        (N, ClosestPoint(around), 1),
        (N, SignedDistance(lambda x: B - D - np.hypot(*x)), 1),
        (N, lambda x: B - D - np.hypot(*x), 1),
        (N, Rigid(around), 1),
        (24, Rigid(wall, displacement=(-low, 0.0)), 1),
        (24, Rigid(wall, displacement=(-50 * low, 0.0)), 0),
    ):
        _, said = solved(ContactProblem(ring(make, ElementQuad2, n), "right", gap))
        assert len(said) == warned


def test_load_steps_are_warned_of_too(make):
    problem = ContactProblem(ring(make, ElementQuad2, N), "right", obstacle("right", D))
    with pytest.warns(ContactWarning, match="stands for a curve"):
        LoadStepper(problem).run([1.0])
    free = ContactProblem(problem.body, "right", obstacle("right", 50 * D))
    stepper = LoadStepper(free).obstacle(lambda t: obstacle("right", D / t))
    with pytest.warns(ContactWarning, match="stands for a curve"):
        stepper.run([1.0])


def test_nothing_is_said_of_curved_cells_and_of_a_given_clearance(make):
    curved, straight = (ring(make, ElementQuad2, N, curved=c) for c in (True, False))
    for body, gap, d in (
        *((curved, obstacle("right", d), d) for d in (1e-6, 1e-3, 0.1)),
        (straight, -1e-6, 1e-6),
        (straight, lambda x: -1e-6 + 0 * x[0], 1e-6),
    ):
        result, said = solved(ContactProblem(body, "right", gap))
        assert not said
        assert error(result, lame("right", d)) < 0.01


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2, ElementQuadAdini])
@pytest.mark.parametrize("corner", [0.0, 0.2, 0.5], ids=["square", "chamfer", "steep"])
def test_nothing_is_said_of_flat_sides(element, corner, make):
    """A block that touches by 1e-6 of its size, its lower edges broken by corners."""
    ticks = np.linspace(0.0, 1.0, 9)
    mesh = make.box(element, ticks, ticks)
    p = mesh.p.copy()
    edge = np.maximum(0.125 - np.minimum(p[0], 1 - p[0]), 0.0)
    p[1] += corner * edge * (1 - p[1])
    body = ElasticBody.from_mesh(make.remesh(mesh, p), element(), E=1.0, nu=0.3).fix("top", "xy")
    result, said = solved(ContactProblem(body, "bottom", Plane((0.0, 1e-6), (0.0, 1.0)), 0.3))
    assert result.contact_force > 0
    assert not said


def test_roller_under_a_load_is_not_warned_of(make):
    """A small contact zone moves by the facets' height and its pressure stays: it is not off."""
    (result, said), (fine, _) = (
        solved(
            ContactProblem(
                ring(make, ElementQuad2, n).load("left", (0.02, 0.0)),
                "right",
                Plane((B, 0.0), (-1.0, 0.0)),
            )
        )
        for n in (48, 96)
    )
    assert result.pressure.max() == pytest.approx(fine.pressure.max(), rel=0.05)
    assert not said
