"""The rough surface: area against load beside two theories, and slip while it is dragged."""

import numpy as np


def test_press_and_drag(example, tmp_path):
    arguments = ["--points", "96", "--steps", "4", "--output", str(tmp_path)]
    found = example("rough_surface").main(arguments)
    assert (tmp_path / "rough_surface.png").stat().st_size > 10_000
    script = example("rough_surface")
    assert max(max(r.kkt.values()) for r in found.loads + found.drags) < 1e-10
    # Between the asymptotes of the two theories while the area is small.
    light = found.corrected / script.PRESSURES
    few = found.corrected < 0.1
    assert np.all(light[few] > np.sqrt(8 / np.pi))
    assert np.all(light[few] < np.sqrt(2 * np.pi))
    assert np.all(np.diff(found.corrected) > 0)
    assert np.all(found.corrected > found.persson)
    assert np.abs(found.corrected - found.persson).max() < 0.09
    # The force grows to F P while what sticks shrinks.
    assert np.all(np.diff(found.share) > 0)
    assert 0.98 < found.share[-1] <= 1 + 1e-9
    assert np.all(np.diff(found.stuck[1:]) <= 0)
    assert found.stuck[1] > 0.1
    assert found.stuck[-1] < 0.02
