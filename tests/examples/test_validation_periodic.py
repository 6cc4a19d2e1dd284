"""Periodic contact beside closed forms: errors at 64 points a wave, and orders from both sides."""

import numpy as np
import pytest

pytestmark = pytest.mark.slow


def within(orders, low, high):
    return np.all((low < orders) & (orders < high))


def test_closed_forms(run):
    found = run("validation_periodic", files=["validation_periodic.png"]).cases
    for body in ("half plane", "thick block", "layers on a half plane"):
        for share in (0.2, 0.5, 0.8):  # Westergaard
            case = found[f"{body}, s = {share}"]
            # Pressure, half-width, longest wave and mean gap; forces alone miss the pressure.
            pressure, raw, *rest = case.errors[1]
            assert pressure < 1e-3 < raw
            assert max(rest) < 1e-3
            assert case.errors[2, 0] < 0.25 * case.errors[2, 1]
            assert 0.7 < case.orders[0] < 2.3
            assert 0.7 < case.orders[1] < 1.3
            assert 1.4 < case.orders[3] < 3.2
    # A sinusoid in full contact, which the half plane has exactly.
    for body, low, high in (("thick block", 2.9, 3.1), ("layers on a half plane", 1.7, 2.1)):
        case = found[f"{body}, s = 1.2"]
        assert case.errors[1, :4].max() < 1e-3
        assert within(case.orders[[0, 3]], low, high)
    assert found["half plane, s = 1.2"].errors.max() < 1e-12
    # Two waves: along the diagonal 48 points a period are 34 a wave, 96 are 68.
    full, light = found["two waves, full contact"], found["two waves, light contact"]
    assert full.errors[1, 0] < 1e-3
    assert full.errors[2, 0] < 1e-4
    assert 2.8 < full.orders[0] < 3.2
    # 64 points a wave, the contact nine of them in radius, and twice as many.
    assert light.errors[1, 0] < 1e-3
    assert light.errors[2, 0] < 4e-4
    assert np.all(light.errors[1:, 0] < 0.4 * light.errors[1:, 1])
    assert 1.7 < light.orders[0] < 2.6
    # A ball in a wide period, at 64 points a period; the radius, too.
    ball = found["ball"]
    assert ball.errors[0, 0] < 1e-3
    assert ball.errors[0, 2] < 2.5e-3
    assert ball.errors[1, 2] < 1e-3
    assert np.all(ball.errors[:, 0] < 0.4 * ball.errors[:, 1])
    assert 0.8 < ball.orders[0] < 2.0
    # A hundred times as stiff as its ground: linear cells take more points for its bending.
    coating, linear = found["coating"], found["coating, linear cells"]
    assert coating.errors[1].max() < 1e-3
    assert within(coating.orders, 2.8, 3.2)
    assert linear.errors[-1].max() < 2e-3
    assert within(linear.orders, 1.85, 2.1)


def test_pressure_of_a_crest(example):
    """It closes the gap of the contact where it was not asked to, and is Hertz' for small ones."""
    script, a = example("validation_periodic"), 0.1
    force, q = script.crest(a)
    r, angle = a * np.array([0.0, 0.3, 0.62, 0.9]), np.array([0.3, 1.9, 3.5, 5.1])
    x, y = r * np.cos(angle), r * np.sin(angle)
    images = (script.THIRD * 2**1.5 + 0.9 * script.FIFTH * 2**2.5 * a**2) / (4 * np.pi)
    gap = 1 - np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y)
    left = gap + script.chords(q, x, y, a) / np.pi + images * force * (x**2 + y**2)
    assert np.ptp(left) < 1e-7 * np.ptp(gap)
    off = [script.crest(a)[0] / (16 / 3 * np.pi**2 * a**3) - 1 for a in (0.01, 0.02)]
    assert abs(off[0]) < 1e-3
    assert off[1] / off[0] == pytest.approx(4.0, rel=0.02)


def test_symbol_of_a_coating_of_its_grounds_own_material(example):
    script = example("validation_periodic")
    soft = script.symbol_of_coating(2 * np.pi, (0.125, script.E, script.NU))[1, 1].real
    assert soft == pytest.approx(2 * (1 - 0.3**2) / (2 * np.pi), rel=1e-12)
