"""The main job: examples/contact_block.py, its numbers and its files."""

import matplotlib.image
import numpy as np
import pytest
import pyvista

from contact import ContactResult


@pytest.fixture(scope="module")
def run(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("block")
    result, check = example("contact_block").main(["--output", str(folder)])
    return folder, result, check


def test_numbers(run) -> None:
    _, result, _ = run
    # Converged values on 10 x 10 cells; OSQP agrees with them to 1e-13 (test below).
    assert result.contact_force == pytest.approx(0.1186442, abs=1e-7)
    assert result.u[1::6].min() == pytest.approx(-0.311533, abs=1e-6)
    assert np.abs(result.u[::6]).max() == pytest.approx(0.073175, abs=1e-6)
    assert result.pressure.max() == pytest.approx(0.221212, abs=1e-6)
    np.testing.assert_allclose(result.zone[0], [1 / 6, 5 / 6], rtol=1e-12)


def test_proof(run) -> None:
    _, result, check = run
    assert max(result.kkt.values()) < 1e-12
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert result.mu.min() >= 0
    assert check.displacement < 1e-7  # OSQP, polished


def test_body_opens_in_pyvista_and_holds_the_field_exactly(run) -> None:
    folder, result, _ = run
    grid = pyvista.read(folder / "contact_block.vtu")
    assert set(grid.celltypes) == {pyvista.CellType.LAGRANGE_QUADRILATERAL}
    points = np.random.default_rng(0).uniform(0.02, 0.98, (40, 2))
    cloud = pyvista.PolyData(np.column_stack((points, np.zeros(40))))
    sampled = np.asarray(cloud.sample(grid, tolerance=1e-12)["displacement"])[:, :2]
    np.testing.assert_allclose(sampled, result.sample(points.T).T, atol=1e-12)
    assert {"von_mises", "stress_yy"} <= set(grid.cell_data)


def test_boundary_file(run) -> None:
    folder, result, _ = run
    line = pyvista.read(folder / "contact_block_boundary.vtp")
    np.testing.assert_array_equal(line["pressure"], result.pressure)
    assert {"shear", "gap", "status", "slip", "normal"} <= set(line.point_data)


def test_saved_result_is_the_result(run) -> None:
    folder, result, _ = run
    again = ContactResult.load(folder / "contact_block.npz")
    np.testing.assert_array_equal(again.u, result.u)
    assert again.kkt == pytest.approx(result.kkt, abs=1e-15)


def test_picture(run) -> None:
    image = matplotlib.image.imread(run[0] / "contact_block.png")
    assert image.shape[0] > 1000
    assert image[..., :3].std() > 0.1  # not blank
