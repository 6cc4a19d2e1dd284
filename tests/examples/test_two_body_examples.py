"""Shrink fit and tied meshes: the scripts against closed forms and the orders of their elements."""

import numpy as np
import pytest


@pytest.mark.filterwarnings("ignore:the cells are not parallelograms")
def test_shrink_fit_has_the_pressure_of_lame(example, tmp_path):
    found = example("shrink_fit").main(["--output", str(tmp_path)])
    for name in ("Q1", "Q2", "Adini"):
        assert found.errors[name][-1] <= 1e-3
        assert 1.8 <= found.orders[name] <= 2.5
        result, *bodies = found.results[name]
        assert max(result.kkt.values()) <= 1e-10
        # The two meet on polygons, on which normals jump: each body's forces balance.
        for body in bodies:
            assert np.abs(result[body].balance()["residual"]).max() <= 1e-10
    assert (tmp_path / "shrink_fit.png").stat().st_size > 10_000


@pytest.mark.slow
def test_ties_keep_the_order_of_the_elements(example, tmp_path):
    script = example("tied_meshes")
    found = script.main(["--cells", "2", "4", "6", "--output", str(tmp_path)])
    for (name, _), (of_field, of_gradient) in found.orders.items():
        low, lower = script.LIMITS[name]
        assert of_field >= low
        assert of_gradient >= lower
    assert (tmp_path / "tied_meshes.png").stat().st_size > 10_000


@pytest.mark.slow
def test_two_cylinders_have_the_pressure_of_hertz(example, tmp_path):
    found = example("validation_two_cylinders").main(["--output", str(tmp_path)])
    for name, lines in found.lines.items():
        middle = lines[1]  # 16 cells in the half-width
        assert middle.rms <= 1e-3
        assert abs(middle.peak) <= 5e-4
        assert found.orders[name] >= 1.7
        for line in lines[1:]:  # which start from the solution on fewer points
            coarse = [step.phase.startswith("coarse") for step in line.result.history]
            assert any(coarse)
            assert coarse.count(False) <= 8
    for pair in found.cgs1.values():
        assert abs(pair.a / 6.215 - 1) <= 0.01
        assert abs(pair.p / 3585 - 1) <= 0.01
        assert max(pair.result.kkt.values()) <= 1e-10
    assert (tmp_path / "validation_two_cylinders.png").stat().st_size > 10_000
