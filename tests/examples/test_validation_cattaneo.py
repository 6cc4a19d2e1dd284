"""Cattaneo-Mindlin under a load history: examples/validation_cattaneo.py against the formulas."""

import numpy as np
import pytest
import pyvista
from convergence import order

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def script(example):
    return example("validation_cattaneo")


@pytest.fixture(scope="module")
def run(script, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cattaneo")
    return script.main(["--cells", "24", "--steps", "4", "--output", str(folder)]), folder


def test_pressure_is_that_of_hertz(script, run):
    x = run[0].history.results[0].x[0]
    expected = np.sqrt(np.maximum(1 - x**2, 0))
    inside = np.abs(x) < 0.8
    assert np.abs(run[0].pressure / script.P0 - expected)[inside].max() < 1e-3


def test_shear_at_every_instant(run):
    """The rms over every point of the contact is below .01 F p0, at a / h = 24."""
    assert run[0].history.times.tolist() == (np.arange(1, 17) / 4).tolist()
    # .0058 at worst; .0021 at the turns, t = 1 and t = 3.
    assert run[0].rms.max() < 0.0065
    assert run[0].rms[[3, 11]].max() < 0.003


def test_stick_edge_and_order(script, run):
    """The stick edge within one cell; of first order at least, at that vertical tangent."""
    assert np.abs(run[0].edge).max() < 1.0
    worst = [script.uncoupled(cells, 4, "bernstein").rms.max() for cells in (8, 16)]
    rate = order([8, 16, 24], [*worst, run[0].rms.max()])
    assert 0.8 < rate < 1.5


def test_reference_is_a_mean_with_the_right_moments(script, run):
    """Constants are means of themselves; a linear traction's is its value at the mean's place."""
    result = run[0].history.results[0]
    np.testing.assert_allclose(script.averaged(result, lambda x: 0 * x + 1), 1.0, rtol=1e-10)
    # Graded cells far away are 1e4 times larger than those below the contact.
    near = result.x[0] < 1
    np.testing.assert_allclose(script.averaged(result, lambda x: x)[near], result.x[0, near])


def test_formula_stops_at_dissimilar_bodies(script):
    """Elastic on rigid: the closer to incompressible, the closer to the uncoupled formula."""
    pressed_with_friction = [script.coupled(8, nu, False) for nu in (0.0, 0.3, 0.45)]
    assert np.all(np.diff(pressed_with_friction) < 0)
    assert pressed_with_friction[0] > 0.3
    assert script.coupled(8, 0.3, True) < 0.1 * pressed_with_friction[1]


def test_animation(run):
    reader = pyvista.get_reader(run[1] / "cattaneo.pvd")
    assert len(reader.time_values) == 16
    assert (run[1] / "validation_cattaneo.png").stat().st_size > 10_000
