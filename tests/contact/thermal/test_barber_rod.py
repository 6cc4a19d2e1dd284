"""Barber's rod: it expands towards a wall whose conductance depends on pressure and gap.

J. R. Barber, J. Dundurs and M. Comninou, J. Appl. Mech. 47 (1980), 871-874. The rod of length 1 and
conductivity 1 is fixed to a wall of temperature 0; the other wall, of temperature 1 and at a gap of
g0, heats it: the better the contact, the longer the rod.
"""

import numpy as np
import pytest
from families import box
from scipy.optimize import brentq
from skfem import ElementQuad1, ElementQuad2

from contact import ContactProblem, ContactWarning, ElasticBody, NotConverged, ThermalContact

ALPHA, GAP, WIDTH = 1e-2, 2.6e-3, 2e-4


def conductance(p, g):
    """A function of the overlap p L / E - g of the rod and its wall."""
    return 0.05 + 10 / (1 + np.exp(-(p - g) / WIDTH))


def end(T):
    """Overlap of the rod whose hot end has the temperature T, and the conductance there."""
    overlap = ALPHA * T / 2 - GAP
    return overlap, conductance(np.maximum(overlap, 0), np.maximum(-overlap, 0))


def states():
    """Temperatures of the hot end in all steady states: T = h (1 - T)."""
    T = np.linspace(0, 1, 4001)

    def excess(T):
        h = end(T)[1]
        return h / (1 + h) - T

    sign = np.sign(excess(T))
    return [brentq(excess, *T[k : k + 2]) for k in np.flatnonzero(np.diff(sign))]


def rod(law=conductance, hot=1.0, cold=0.0, gap=GAP, element=ElementQuad1, rows=2, **options):
    mesh = box(element, np.linspace(0, 1, 13), np.linspace(0, 0.3, rows + 1))
    bar = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.0).fix("left", "x").fix("bottom", "y")
    along = np.array([ALPHA, 0.0, 0.0])
    problem = ContactProblem(bar, "right", gap)
    model = ThermalContact(
        problem, 1.0, law, expansion=along, obstacle_temperature=hot, capacity=1.0, **options
    )
    return model.fix("left", cold)


@pytest.mark.parametrize("rows", [2, 32], ids=["by columns", "by Arnoldi"])
def test_of_three_steady_states_the_middle_one_is_unstable(rows):
    low, middle, high = states()
    model = rod(rows=rows)
    for T, start in ((low, 0.0), (high, 1.0)):
        result = model.solve(start=start)
        assert result.at_vertices().max() == pytest.approx(T, rel=1e-9)
        assert result.gain < 1
        assert result.balance()["error"] < 1e-12
    with pytest.warns(ContactWarning, match=r"unstable: a small change .* comes back 5\.26 times"):
        result = model.solve(start=lambda x: 1.01 * middle * x[0], unstable=True)
    assert result.at_vertices().max() == pytest.approx(middle, rel=1e-9)
    h = result.conductance[0]
    slope = (end(middle + 1e-6)[1] - end(middle - 1e-6)[1]) / 2e-6
    assert result.gain == pytest.approx(slope / (1 + h) ** 2, rel=1e-3)  # dh/dT dT/dh
    assert "unstable (gain 5.26" in result.summary()
    # Without asking for it the iteration leaves it, as the rod does.
    beside = model.solve(start=lambda x: 1.01 * middle * x[0])
    assert beside.at_vertices().max() == pytest.approx(high, rel=1e-9)


def growth(T):
    """Rate of the disturbance sinh(k x) e^(k^2 t) of the steady state with the end at T."""
    h, slope = end(T)[1], (end(T + 1e-6)[1] - end(T - 1e-6)[1]) / 2e-6 / (ALPHA / 2)

    def missing(k):
        longer = ALPHA * (np.cosh(k) - 1) / k
        return k * np.cosh(k) + h * np.sinh(k) - slope * (1 - T) * longer

    return brentq(missing, 1e-3, 20.0) ** 2


@pytest.mark.parametrize(("sign", "to"), [(1, 2), (-1, 0)])
def test_disturbances_of_the_middle_state_grow_as_they_should(sign, to):
    T = states()
    model = rod(element=ElementQuad2, rows=1, method="crank-nicolson")
    with pytest.warns(ContactWarning, match="unstable"):
        steady = model.solve(start=lambda x: T[1] * x[0], unstable=True)
    rate = growth(T[1])
    k = np.sqrt(rate)
    times = np.linspace(0, 0.8 / rate, 25)
    start = lambda x: T[1] * x[0] + sign * 1e-5 * np.sinh(k * x[0]) / np.sinh(k)  # noqa: E731
    results = model.run(times, initial=start)
    grown = [(one.T - steady.T)[np.argmax(steady.T)] for one in results]
    assert np.polyfit(times, np.log(np.abs(grown)), 1)[0] == pytest.approx(rate, rel=2e-2)
    late = rod().run(
        [0.0, 0.5, 2.0, 8.0, 30.0, 120.0], initial=lambda x: (T[1] + 0.02 * sign) * x[0]
    )
    assert late[-1].at_vertices().max() == pytest.approx(T[to], rel=1e-5)


def test_no_steady_state_is_said_so():
    """Touching the cold wall the hot rod shrinks from it, alone it grows to it again."""
    model = rod(lambda p, g: 10.0 * (p > 0), hot=0.0, cold=1.0, gap=0.007)
    with pytest.raises(NotConverged, match=r"may be no steady state.*Barber"):
        model.solve()
    # A layer of air makes it continuous: one state, stable though the iteration swings.
    result = rod(lambda p, g: 1e-3 / (1e-4 + g), hot=0.0, cold=1.0, gap=0.007).solve()
    q = result.flux[0]
    T = 1 - q
    gap = 0.007 - ALPHA * (1 + T) / 2
    assert gap > 0
    assert q == pytest.approx(1e-3 / (1e-4 + gap) * T, rel=1e-8)
    assert result.gain < 1


STEEP = {
    "of the gap": lambda w: lambda p, g: 10 * np.clip(1 - g / w, 0, 1) + 0 * p,
    "of the pressure": lambda w: lambda p, g: 10 * np.clip(p / w, 0, 1),
    "smooth": lambda w: lambda p, g: 10 / (1 + np.exp(-np.clip((p - g) / w, -500, 500))),
}


@pytest.mark.parametrize("width", [1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize("name", STEEP)
def test_a_conductance_may_be_steep(name, width):
    """As in the last test; the rod would overlap the wall by 3e-3 if no heat left it there."""
    law = STEEP[name](width)

    def excess(T):
        overlap = ALPHA * (1 + T) / 2 - 0.007
        return law(np.maximum(overlap, 0), np.maximum(-overlap, 0)) * T - (1 - T)

    T = brentq(excess, 0.0, 1.0, xtol=1e-16)
    assert 0.2 < T < 0.9
    result = rod(law, hot=0.0, cold=1.0, gap=0.007).solve(stability=False)
    assert result.flux == pytest.approx(1 - T, rel=1e-6)
    assert max(result.kkt.values()) < 1e-10
    assert result.history[-1] < 1e-6
    assert len(result.history) < 60


def test_points_of_a_wavy_end_close_one_after_the_other():
    """Conductances of each point hold with its own pressure and gap; so do those of steps."""
    mesh = box(ElementQuad1, np.linspace(0, 1, 13), np.linspace(0, 0.5, 17))
    bar = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left", "xy")
    problem = ContactProblem(bar, "right", lambda x: 4e-3 + 2e-3 * np.cos(9 * x[1]))
    law = STEEP["of the gap"](1e-5)
    model = ThermalContact(
        problem, 1.0, law, expansion=1e-2, obstacle_temperature=0.0, capacity=1.0
    )
    model.fix("left", 1.0)
    results = model.solve(stability=False), model.run([0.0, 0.3, 5.0], initial=1.0)[-1]
    for result in results:
        contact = result.contact
        p, gap = contact.pressure, np.maximum(contact.gap, 0.0)
        width = 1e-11 * np.abs(contact.u).max()  # of overlaps, in doubles
        low, high = law(p, gap + width), law(p, np.maximum(gap - width, 0.0))
        assert np.all(low <= result.conductance * (1 + 1e-9))
        assert np.all(result.conductance <= high * (1 + 1e-9))
        assert np.any((result.conductance > 0.1) & (result.conductance < 9.9))
        assert max(result.kkt.values()) < 1e-10
