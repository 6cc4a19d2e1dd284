"""Periodic contact beside closed forms: errors at 64 points a wave, and orders from both sides."""

import example_scripts
import numpy as np
import pytest

pytestmark = pytest.mark.slow
PARTIAL = [(body, share) for body in ("half plane", "thick block", "layers on a half plane")
           for share in (0.2, 0.5, 0.8)]  # fmt: skip


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("validation")
    cases = example("validation_periodic").main(["--output", str(folder)]).cases
    assert (folder / "validation_periodic.png").stat().st_size > 10_000
    return cases


@pytest.mark.parametrize(("body", "share"), PARTIAL)
def test_partial_contact_by_westergaard(found, body, share):
    """Pressure, half-width, longest wave and mean gap; forces alone miss the pressure."""
    case = found[f"{body}, s = {share}"]
    pressure, raw, *rest = case.errors[1]
    assert pressure < 1e-3 < raw
    assert max(rest) < 1e-3
    assert case.errors[2, 0] < 0.25 * case.errors[2, 1]
    assert 0.7 < case.orders[0] < 2.3
    assert 0.7 < case.orders[1] < 1.3
    assert 1.4 < case.orders[3] < 3.2


@pytest.mark.parametrize(
    ("body", "order"), [("thick block", (2.9, 3.1)), ("layers on a half plane", (1.7, 2.1))]
)
def test_full_contact_of_a_sinusoid(found, body, order):
    case = found[f"{body}, s = 1.2"]
    assert case.errors[1, :4].max() < 1e-3
    assert np.all((order[0] < case.orders[[0, 3]]) & (case.orders[[0, 3]] < order[1]))


def test_the_half_plane_has_a_full_contact_exactly(found):
    assert found["half plane, s = 1.2"].errors.max() < 1e-12


def test_two_waves_in_full_contact(found):
    """Along the diagonal 48 points a period are 34 a wave, 96 are 68."""
    case = found["two waves, full contact"]
    assert case.errors[1, 0] < 1e-3
    assert case.errors[2, 0] < 1e-4
    assert 2.8 < case.orders[0] < 3.2


def test_two_waves_in_light_contact(found):
    """64 points a wave, the contact nine of them in radius, and twice as many."""
    case = found["two waves, light contact"]
    assert case.errors[1, 0] < 1e-3
    assert case.errors[2, 0] < 4e-4
    assert np.all(case.errors[1:, 0] < 0.4 * case.errors[1:, 1])
    assert 1.7 < case.orders[0] < 2.6


def test_pressure_of_a_crest():
    """It closes the gap of the contact where it was not asked to, and is Hertz' for small ones."""
    script, a = example_scripts.load("validation_periodic"), 0.1
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


def test_ball_in_a_wide_period(found):
    """At 64 points a period; the radius, too."""
    case = found["ball"]
    assert case.errors[0, 0] < 1e-3
    assert case.errors[0, 2] < 2.5e-3
    assert case.errors[1, 2] < 1e-3
    assert np.all(case.errors[:, 0] < 0.4 * case.errors[:, 1])
    assert 0.8 < case.orders[0] < 2.0


def test_coating(found):
    """A hundred times as stiff as its ground: linear cells take more points for its bending."""
    case, linear = found["coating"], found["coating, linear cells"]
    assert case.errors[1].max() < 1e-3
    assert np.all((case.orders > 2.8) & (case.orders < 3.2))
    assert linear.errors[-1].max() < 2e-3
    assert np.all((linear.orders > 1.85) & (linear.orders < 2.1))
    soft, exact = found_symbol(), 2 * (1 - 0.3**2) / (2 * np.pi)
    assert soft == pytest.approx(exact, rel=1e-12)


def found_symbol():
    """The example's closed form where the coating is of the ground's own material."""
    script = example_scripts.load("validation_periodic")
    return script.symbol_of_coating(2 * np.pi, (0.125, script.E, script.NU))[1, 1].real
