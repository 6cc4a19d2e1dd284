"""Bars and rings that touch and conduct heat, steady and in time, beside closed forms."""

import numpy as np
import pytest
from convergence import order
from families import PLANE_AND_BFS, SOLID, box
from scipy.optimize import brentq
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTetP1, ElementTriP1

from contact import ContactProblem, ElasticBody, Pair, ThermalContact, Tie
from skfem_adini import ElementQuadAdini

K1, K2, HOT, COLD = 2.0, 0.5, 90.0, 10.0


def of_pressure(p, g):
    return 3.0 * p**0.95


def bars(element, cells=(3, 4), load=None, size=1.0, E=2.0, nu=0.3):
    """Two bars, one above the other, 1 and .6 long, of cells that do not match."""
    dim, (n, m) = element().dim, cells
    across = [np.linspace(0, size, n + 1)] * (dim - 1), [np.linspace(0, size, m + 1)] * (dim - 1)
    ticks = np.linspace(0, size, 4), np.linspace(-0.6 * size, 0, 3)
    meshes = [box(element, *x, y) for x, y in zip(across, ticks, strict=True)]
    upper, lower = (ElasticBody.from_mesh(mesh, element(), E=E, nu=nu) for mesh in meshes)
    for body, end in ((upper, "top"), (lower, "bottom")):
        body.fix("left", "x")
        if dim == 3:
            body.fix("front", "y")
        if load is None or end == "bottom":
            body.fix(end, dim - 1)
    if load is not None:
        upper.load("top", [0.0] * (dim - 1) + [-load])
    return upper.named("upper"), lower.named("lower")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("units", [1.0, 1e6])
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, *SOLID], ids=lambda e: e.__name__)
def test_a_pressed_joint_has_the_jump_q_over_h(element, units):
    """q = (T1 - T2) / (L1 / k1 + 1 / h + L2 / k2): temperatures are linear, all elements exact."""
    p = 0.02 * units
    upper, lower = bars(element, load=p, E=2.0 * units)
    problem = ContactProblem(upper, "bottom", lower.surface("top"))
    model = ThermalContact(problem, [K1 * units, K2 * units], lambda p, g: of_pressure(p, g))
    result = model.fix("top", HOT, body=upper).fix("bottom", COLD, body="lower").solve()
    h = of_pressure(p, 0.0)
    q = (HOT - COLD) / (1.0 / (K1 * units) + 1 / h + 0.6 / (K2 * units))
    assert np.abs(result.flux / q - 1).max() < 1e-9  # the pressure is as exact
    assert np.abs(result.jump / (q / h) - 1).max() < 1e-9
    assert np.abs(result.conductance / h - 1).max() < 1e-9
    y = np.array([0.1, 0.77])
    places = np.vstack([np.full((element().dim - 1, 2), 0.4), y])
    assert result.sample(places, upper) == pytest.approx(HOT - q / (K1 * units) * (1 - y), 1e-9)
    assert result.heat[0] == pytest.approx(q, rel=1e-9)  # the area is one
    assert result.balance()["error"] < 1e-12
    assert result.balance(upper)["contact"] == pytest.approx(-q, rel=1e-9)
    assert max(result.kkt.values()) < 1e-10


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, *SOLID], ids=lambda e: e.__name__)
def test_bars_between_walls_press_each_other_as_they_expand(element):
    """Pressure and heat determine each other: E' alpha (means of T times lengths) / length."""
    upper, lower = bars(element)
    dim, alpha, reference = upper.dim, np.zeros(3), 20.0
    alpha[dim - 1] = 1e-4  # along the bars only
    problem = ContactProblem([upper, lower], [Pair(upper, "bottom", lower, "top")])
    model = ThermalContact(
        problem, [K1, K2], lambda p, g: 1e3 * p, expansion=alpha, reference=reference
    )
    result = model.fix("top", HOT, body=upper).fix("bottom", COLD, body=lower).solve()
    E = 2.0 / (1 - 0.3**2) if dim == 2 else 2.0

    def excess(p):
        q = (HOT - COLD) / (1.0 / K1 + 1 / (1e3 * p) + 0.6 / K2)
        means = HOT - q / (2 * K1), COLD + 0.6 * q / (2 * K2)
        return E * 1e-4 * (means[0] - reference + 0.6 * (means[1] - reference)) / 1.6 - p

    p = brentq(excess, 1e-9, 1.0, xtol=1e-16)
    # Strains of linear elements do not follow those of a temperature that varies in a cell.
    exact = {ElementTriP1: 2e-2, ElementTetP1: 2e-2, ElementQuad1: 1e-4, ElementHex1: 1e-4}
    assert result.contact.contact_force == pytest.approx(p, rel=exact.get(element, 1e-8))
    if element not in exact:
        assert np.abs(result.contact.pressure / p - 1).max() < 1e-8
    assert result.balance()["error"] < 1e-12
    assert result.history[-1] < 1e-10
    assert result.gain < 1


def wall(element=ElementQuad2, **options):
    """A bar on a rigid floor that has a temperature."""
    upper, _ = bars(element, load=0.02)
    return ThermalContact(ContactProblem(upper, "bottom", 0.0), K1, of_pressure, **options)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad1, ElementHex1])
def test_a_floor_of_given_temperature_and_convection_above(element):
    dim = element().dim
    model = wall(element, obstacle_temperature=lambda x: COLD + 0 * x[0])
    result = model.convection("top", 0.7, HOT).source(1.5).inflow("right", 0.2).solve()
    heat, h = result.balance(), of_pressure(0.02, 0)
    assert heat["sources"] == pytest.approx(1.5 + 0.2, rel=1e-12)
    assert heat["error"] < 1e-12
    assert heat["contact"] == pytest.approx(-result.heat.sum(), rel=1e-12)
    sides = wall(element, obstacle_temperature=COLD).convection("top", 0.7, HOT).source(1.5).solve()
    # -k T'' = Q with both ends: T = a + b y - Q y^2 / (2 k).
    A = np.array([[h, -K1], [0.7, 0.7 + K1]])
    a, b = np.linalg.solve(A, [h * COLD, 0.7 * HOT + 0.7 * 1.5 / (2 * K1) + 1.5])
    exact = {ElementQuad1: 2e-2, ElementHex1: 2e-2, ElementQuadAdini: 1e-10}[element]
    x = np.full((dim, 1), 0.5)
    assert sides.sample(x) == pytest.approx(a + b / 2 - 1.5 / (8 * K1), rel=exact)
    assert sides.flux == pytest.approx(h * (a - COLD), rel=1e-9)


def test_bodies_of_one_temperature_exchange_no_heat():
    upper, lower = bars(ElementQuad2)
    problem = ContactProblem(upper, "bottom", lower.surface("top"))
    model = ThermalContact(problem, 1.0, of_pressure, expansion=1e-5, reference=273.0, capacity=2.0)
    model.fix("top", 293.15, body=upper).convection("bottom", 4.0, 293.15, body=lower)
    for result in (model.solve(), model.run([0.0, 1.0], initial=293.15)[-1]):
        assert np.abs(result.T - 293.15).max() < 1e-10
        assert result.balance()["error"] < 1e-12
        assert max(result.kkt.values()) < 1e-10
        assert result.contact.pressure.min() > 0


@pytest.mark.parametrize("law", ["tresca", "compliant"])
def test_other_laws_of_the_contact_conduct_as_well(law):
    upper, _ = bars(ElementQuad1, load=0.02)
    more = {"overclosure": 3.0} if law == "compliant" else {"friction": 1e-3, "law": "tresca"}
    model = ThermalContact(
        ContactProblem(upper, "bottom", 0.0, **more), K1, of_pressure, obstacle_temperature=COLD
    )
    result = model.fix("top", HOT).solve()
    q = (HOT - COLD) / (1.0 / K1 + 1 / of_pressure(0.02, 0.0))
    assert result.heat[0] == pytest.approx(q, rel=1e-3)
    assert result.balance()["error"] < 1e-12


def test_an_open_joint_conducts_by_its_gap_and_ties_conduct():
    upper, lower = bars(ElementQuad2)
    gap = lambda p, g: 0.02 / (0.01 + g)  # noqa: E731
    apart = Pair(upper, "bottom", lower, "top", clearance=lambda x: 0.01 + 0 * x[0])
    for pair, given, h in ((apart, gap, 1.0), (Tie(upper, "bottom", lower, "top"), 5.0, 5.0)):
        model = ThermalContact(ContactProblem([upper, lower], [pair]), [K1, K2], given)
        result = model.fix("top", HOT, body=0).fix("bottom", COLD, body=1).solve()
        q = (HOT - COLD) / (1.0 / K1 + 1 / h + 0.6 / K2)
        assert np.abs(result.flux / q - 1).max() < 1e-9


A, B, C, NU, ALPHA = 1.0, 1.5, 2.2, 0.3, 1e-5


def rings(element, n):
    """Two rings in plane strain, a hot inner one and a cold one around it."""
    bodies = []
    for low, high, cells in ((A, B, n), (B, C, n + 1)):
        ticks = np.linspace(low, high, cells + 1), np.linspace(0, 0.4, cells // 2 + 1)
        body = ElasticBody.from_mesh(
            box(element, *ticks), element(), E=200.0, nu=NU, plane="axisymmetric"
        )
        bodies.append(body.fix(["bottom", "top"], "y"))
    problem = ContactProblem(bodies, [Pair(bodies[0], "right", bodies[1], "left")])
    conductance = lambda p, g: 80.0 * p  # noqa: E731
    model = ThermalContact(problem, [K1, K2], conductance, expansion=ALPHA, reference=COLD)
    return model.fix("left", HOT, body=0).fix("right", COLD, body=1).solve()


def fitted():
    """Pressure and heat per length of the rings; S. P. Timoshenko and J. N. Goodier 1970, 150."""

    def mean(T, dT, low, high):  # of T + dT log(r / low), in u = (1 + nu) alpha mean(T) r
        log = 0.5 * (high**2 * np.log(high / low) - 0.5 * (high**2 - low**2))
        return T + 2 * dT * log / (high**2 - low**2)

    def state(p):
        Q = (HOT - COLD) / (np.log(B / A) / K1 + 1 / (80 * p * B) + np.log(C / B) / K2)
        inner = mean(HOT - COLD, -Q / K1, A, B)
        outer = mean(Q * np.log(C / B) / K2, -Q / K2, B, C)
        overlap = (1 + NU) * ALPHA * B * (inner - outer)
        a, b, c = A**2, B**2, C**2
        return 200 / (1 - NU**2) * overlap / B * (b - a) * (c - b) / (2 * b * (c - a)) - p, Q

    p = brentq(lambda p: state(p)[0], 1e-9, 1.0, xtol=1e-16)
    return p, 2 * np.pi * state(p)[1] * 0.4


@pytest.mark.parametrize(
    ("element", "error"), [(ElementQuad1, 3e-4), (ElementQuad2, 1e-8), (ElementQuadAdini, 3e-9)]
)
def test_hot_rings_fit_as_lame_says(element, error):
    p, heat = fitted()
    cells, errors = [4, 8, 16], []
    for n in cells:
        result = rings(element, n)
        force = result.contact.contact_force / (p * 2 * np.pi * B * 0.4)
        errors.append(abs(force - 1))
        assert np.ptp(result.contact.pressure) < 1e-5 * p
        assert result.balance()["error"] < 1e-12
    assert errors[-1] < error
    assert abs(result.heat[0] / heat - 1) < error
    assert order(cells, errors) > 1.5


H, END = 1.3, 0.4
# Two unit bars that differ in sign from the mean each lose heat to it by 2 h: z tan z = 2 h
# (H. S. Carslaw and J. C. Jaeger 1959, section 3.11).
ROOTS = np.array(
    [
        brentq(lambda z: z * np.sin(z) - 2 * H * np.cos(z), k * np.pi, (k + 0.5) * np.pi)
        for k in range(40)
    ]
)


def equalised(element, method, steps, n=8, initial=None):
    """Heat in the left one of two bars at 1 and 0 that touch, or from given temperatures on."""
    left, right = (
        ElasticBody.from_mesh(
            box(element, np.linspace(a, a + 1, n + 1), [0.0, 0.5]), element(), E=1.0, nu=0.3
        )
        for a in (-1.0, 0.0)
    )
    left.fix("left").fix("bottom", "y")
    right.fix("right", "x", -1e-3).fix("bottom", "y")
    problem = ContactProblem(left, "right", right.surface("left"))
    model = ThermalContact(problem, 1.0, H, capacity=1.0, method=method)
    results = model.run(np.linspace(0, END, steps + 1), initial=initial or [1.0, 0.0])
    assert max(result.balance()["error"] for result in results) < 1e-12
    assert max(max(result.kkt.values()) for result in results) < 1e-10
    system = results[-1].system
    return (system.before.capacity @ results[-1].T)[: system.ends[1]].sum() / 0.5


def test_two_bars_come_to_one_temperature_as_the_series_says():
    part = 2 * np.sin(ROOTS) ** 2 / (ROOTS * (ROOTS + np.sin(ROOTS) * np.cos(ROOTS)))
    exact = 0.5 + 0.5 * np.sum(part * np.exp(-(ROOTS**2) * END))
    assert equalised(ElementQuad2, "crank-nicolson", 40) == pytest.approx(exact, abs=5e-6)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("element", "method", "rate", "cells", "steps"),
    [
        (ElementQuad2, "euler", 1.0, 8, [10, 20, 40]),
        (ElementQuad2, "crank-nicolson", 2.0, 16, [5, 10, 20]),
        (ElementQuad1, "crank-nicolson", 2.0, [4, 8, 16], 60),
    ],
)
def test_orders_in_time_and_space(element, method, rate, cells, steps):
    """From the slowest mode of the two bars, which stays what it is."""
    z = ROOTS[0]
    mode = [
        lambda x: 0.5 + 0.5 * np.cos(z * (1 + x[0])),
        lambda x: 0.5 - 0.5 * np.cos(z - z * x[0]),
    ]
    exact = 0.5 + 0.5 * np.sin(z) / z * np.exp(-(z**2) * END)
    counts = steps if isinstance(steps, list) else cells
    each = zip(np.broadcast_to(cells, 3), np.broadcast_to(steps, 3), strict=True)
    errors = [abs(equalised(element, method, k, n, mode) - exact) for n, k in each]
    assert order(counts, errors) == pytest.approx(rate, abs=0.2)


@pytest.mark.parametrize("method", ["euler", "crank-nicolson"])
def test_heat_of_each_step_is_balanced_where_everything_acts(method):
    """Two bodies sources, convection, friction, expansion, conditions in time."""
    upper, lower = bars(ElementQuadAdini, load=0.02)
    lower.fix("bottom", "x")
    problem = ContactProblem(upper, "bottom", lower.surface("top"))
    model = ThermalContact(
        problem,
        [lambda x: 1 + x[1], np.array([[2.0, 0.3], [0.3, 1.0]])],
        lambda p, g: 0.1 + 50 * p / (1 + 1e3 * g),
        capacity=[1.0, lambda x: 2 + x[0]],
        expansion=1e-5,
        friction_heat=lambda x: 2 * x[0],
        partition=0.3,
        method=method,
    )
    model.fix("bottom", lambda x: 5 * x[0], lambda t: 1 + t, body=lower).source(2.0, body=upper)
    model.convection("top", 3.0, 20.0, np.cos, body=upper).inflow("right", -1.0, body=upper)
    results = model.run([0, 0.1, 0.15, 0.4], initial=[3.0, lambda x: x[0]])
    for result in results[1:]:
        parts = [result.balance(body) for body in (upper, lower)]
        assert max(one["error"] for one in (*parts, result.balance())) < 1e-12
        assert all(abs(one["friction"]) > 1e-3 for one in parts)
        whole = result.balance()
        assert abs(whole["contact"]) < 1e-12 * abs(parts[0]["contact"])
        rubbed = 0.3 * result.power.sum()
        assert parts[0]["friction"] == pytest.approx(rubbed, rel=1e-12)


def test_a_plane_of_symmetry_cuts_the_heat_in_half():
    """Of a roller on a block, in the units of metres and millimetres."""
    heats = []
    for scale, ends in ((1.0, (-1, 1)), (1.0, (0, 1)), (1e3, (-1, 1))):
        ticks = scale * np.linspace(*ends, 12 * (ends[1] - ends[0]) + 1)
        mesh = box(ElementQuad2, ticks, scale * np.array([-1, -0.5, -0.25, 0.0]))
        body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0 / scale**2, nu=0.3)
        body.fix("bottom")
        if ends[0] == 0:
            body.fix("left", "x")
        wheel = lambda x, s=scale: x[0] ** 2 / s - 0.02 * s  # noqa: E731
        problem = ContactProblem(body, "top", wheel)
        model = ThermalContact(
            problem,
            1.0,
            lambda p, g, s=scale: 100 * p * s,
            obstacle_temperature=1.0,
            expansion=1e-3,
        )
        heats.append(model.fix("bottom", 0.0).solve().heat[0])
    assert heats[0] < 0
    assert heats[1] == pytest.approx(heats[0] / 2, rel=1e-6)
    assert heats[2] == pytest.approx(heats[0], rel=1e-6)
