"""The example of the pressed disk: Hertz and Cattaneo on cut cells."""

from functools import cache

import numpy as np
import pytest


@pytest.fixture(scope="module")
def cut_hertz(example):
    return example("cut_hertz")


@pytest.fixture(scope="module")
def pressed(cut_hertz):
    """Return the result without friction, computed once for each mesh."""
    return cache(lambda cells: cut_hertz.press(0.025, cells, 0.3))


@pytest.mark.parametrize("cells", [4, 8])
def test_half_width_and_peak_pressure_within_two_per_cent(cut_hertz, pressed, cells):
    result, h = pressed(cells)
    row = cut_hertz.compare(result, h, 0.3)
    assert row.h <= 1 / cells
    assert abs(row.half_width) <= 0.02
    assert abs(row.peak) <= 0.02
    assert row.pressure <= 0.02
    assert max(result.kkt.values()) <= 1e-10


def test_pressure_has_no_oscillation(pressed):
    """It rises to its peak and falls: no difference changes sign twice."""
    result, _ = pressed(8)
    steps = np.sign(np.diff(result.pressure[result.mu > 0]))
    assert np.count_nonzero(np.diff(steps)) == 1


@pytest.mark.turns(4)
def test_friction_sticks_where_cattaneo_says(cut_hertz):
    """Within one contact point at each end."""
    friction = 0.3
    result, h = cut_hertz.press(0.025, 8, 0.49, friction, turn=0.7)
    fit = cut_hertz.compare(result, h, 0.49)
    stick = cut_hertz.cattaneo(result, fit, friction)
    assert 0.4 < stick.exact < 0.6
    x = result.x[0] / fit.a
    off = np.abs(result.shear[:, 0]) / (friction * fit.p0) - stick.shear(x)
    assert np.sqrt(np.mean(off**2)) < 0.03
    smooth = (np.abs(np.abs(x) - stick.exact) > 0.2) & (np.abs(np.abs(x) - 1) > 0.15)
    assert np.abs(off[smooth]).max() < 0.035
    assert abs(stick.found - stick.exact) <= 1.5 * fit.h
    slip = result.status == 2
    np.testing.assert_allclose(np.abs(result.t[slip, 0]), friction * result.mu[slip], rtol=1e-9)
    assert slip.sum() >= 4
    assert (result.status == 1).sum() >= 5


@pytest.mark.slow
def test_the_error_falls_with_the_mesh_and_the_example_writes_its_files(cut_hertz, tmp_path):
    found = cut_hertz.main(["--output", str(tmp_path)])
    assert found.rows[-1].h < 1 / 16
    assert found.rows[-1].pressure < 0.005
    for name in ("cut_hertz.png", "cut_hertz.vtu", "cut_hertz_arc.vtp"):
        assert (tmp_path / name).stat().st_size > 5_000
