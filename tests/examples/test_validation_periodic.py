"""Periodic contact beside closed forms: errors at 64 points a wave, and orders from both sides."""

import numpy as np
import pytest

SIZES = (32, 64, 128)


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("validation")
    cases = example("validation_periodic").main(["--output", str(folder)]).cases
    assert (folder / "validation_periodic.png").stat().st_size > 10_000
    return cases


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("body", ["half plane", "thick block", "layers on a half plane"])
def test_partial_contact_by_westergaard(found, body, share):
    """Maxima, longest wave and mean gap; the root at the edge of contact limits the rms error."""
    case = found[f"{body}, s = {share}"]
    assert case.errors[1, :3].max() < 1e-3
    assert case.errors[2, :3].max() < 2e-4
    assert 1.4 < case.orders[1] < 2.7
    assert case.errors[2, 3] < 2e-3
    assert 0.6 < case.orders[3] < 2.3


@pytest.mark.parametrize(
    ("body", "order"), [("thick block", (1.9, 2.1)), ("layers on a half plane", (1.7, 2.1))]
)
def test_full_contact_of_a_sinusoid(found, body, order):
    case = found[f"{body}, s = 1.2"]
    assert case.errors[1, :2].max() < 1e-3
    assert np.all((order[0] < case.orders[:2]) & (case.orders[:2] < order[1]))


def test_the_half_plane_has_a_full_contact_exactly(found):
    assert found["half plane, s = 1.2"].errors.max() < 1e-12


def test_two_waves_in_full_contact(found):
    """Along the diagonal 96 points a period are 68 a wave."""
    case = found["two waves, full contact"]
    assert case.errors[-1, 0] < 1e-3
    assert 1.9 < case.orders[0] < 2.1


def test_ball_in_a_wide_period(found):
    case = found["ball"]
    assert case.errors[-1] == pytest.approx(0, abs=5e-3)
    assert case.errors[-1, 1] < 1e-3
    assert 0.7 < case.orders[0] < 1.6


def test_coating(found):
    """A hundred times as stiff as its ground: bending of linear bricks takes its points."""
    case = found["coating"]
    assert case.errors[-1].max() < 2e-3
    assert np.all((case.orders > 1.85) & (case.orders < 2.1))
    soft, exact = found_symbol(), 2 * (1 - 0.3**2) / (2 * np.pi)
    assert soft == pytest.approx(exact, rel=1e-12)


def found_symbol():
    """The example's closed form where the coating is of the ground's own material."""
    import example_scripts

    script = example_scripts.load("validation_periodic")
    return script.symbol_of_coating(2 * np.pi, (0.125, script.E, script.NU))[1, 1].real
