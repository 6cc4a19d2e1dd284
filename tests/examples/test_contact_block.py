"""examples/contact_block.py and examples/contact_part.py: their numbers, proofs and files."""

import matplotlib.image
import numpy as np
import pytest
import pyvista

from contact import InputError, Status


@pytest.fixture(scope="module")
def run(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("block")
    result, check = example("contact_block").main(["--output", str(folder)])
    return folder, result, check


def test_numbers(run):
    _, result, _ = run
    # Converged values on 10 x 10 cells; OSQP agrees with them to 1e-13 (test below).
    assert result.contact_force == pytest.approx(0.1186442, abs=1e-7)
    assert result.u[1::6].min() == pytest.approx(-0.311533, abs=1e-6)
    assert np.abs(result.u[::6]).max() == pytest.approx(0.073175, abs=1e-6)
    assert result.pressure.max() == pytest.approx(0.221212, abs=1e-6)
    np.testing.assert_allclose(result.zone[0], [1 / 6, 5 / 6], rtol=1e-12)


def test_proof(run):
    _, result, check = run
    assert max(result.kkt.values()) < 1e-12
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert result.mu.min() >= 0
    assert check.displacement < 1e-7  # OSQP, polished


def test_body_opens_in_pyvista_and_holds_the_field_exactly(run):
    folder, result, _ = run
    grid = pyvista.read(folder / "contact_block.vtu")
    assert set(grid.celltypes) == {pyvista.CellType.LAGRANGE_QUADRILATERAL}
    points = np.random.default_rng(0).uniform(0.02, 0.98, (40, 2))
    cloud = pyvista.PolyData(np.column_stack((points, np.zeros(40))))
    sampled = np.asarray(cloud.sample(grid, tolerance=1e-12)["displacement"])[:, :2]
    np.testing.assert_allclose(sampled, result.sample(points.T).T, atol=1e-12)
    assert {"von_mises", "stress_yy"} <= set(grid.cell_data)


@pytest.mark.slow
def test_a_real_part_from_a_mesh_file(example, tmp_path):
    main = example("contact_part").main
    result, check = main(["--output", str(tmp_path)])
    # Regression values of the default mesh; the proof below says that they solve the problem.
    np.testing.assert_allclose(result.resultant, [-0.2958, 2.0266], atol=2e-3)
    assert result.pressure.max() == pytest.approx(0.613, abs=0.006)
    counts = np.bincount(result.status, minlength=3)
    # On a curve a contact point is a vertex: 15 of them touch.
    assert counts[Status.STICK] >= 8
    assert counts[Status.SLIP] >= 4
    assert max(result.kkt.values()) < 1e-10
    assert check.displacement < 1e-7
    # The mount takes the load: reaction and contact force cancel.
    assert np.abs(result.balance()["residual"]).max() < 1e-10
    grid = pyvista.read(tmp_path / "contact_part.vtu")
    assert grid.n_cells == result.system.body.mesh.nelements
    assert (tmp_path / "contact_part.png").stat().st_size > 50_000
    mesh = tmp_path / "bumper.msh"
    again, _ = main(["--mesh", str(mesh), "--output", str(tmp_path / "again"), "--no-picture"])
    np.testing.assert_allclose(again.resultant, result.resultant, rtol=1e-10)
    mesh.write_text(mesh.read_text()[: mesh.stat().st_size // 3])
    with pytest.raises(InputError, match="cannot be read"):
        main(["--mesh", str(mesh), "--output", str(tmp_path)])


def test_picture(run):
    image = matplotlib.image.imread(run[0] / "contact_block.png")
    assert image.shape[0] > 1000
    assert image[..., :3].std() > 0.1  # not blank
