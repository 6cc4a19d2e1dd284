"""A real part from a mesh file: examples/contact_part.py."""

import numpy as np
import pytest
import pyvista

from contact import InputError, Status

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("part")
    result, check = example("contact_part").main(["--output", str(folder)])
    return folder, result, check


def test_mesh_is_a_real_one(run) -> None:
    _, result, _ = run
    mesh = result.system.body.mesh
    assert mesh.nelements >= 5000
    assert set(mesh.boundaries) == {"mount", "flank", "contact", "bore"}


def test_numbers(run) -> None:
    _, result, _ = run
    # Regression values of the default mesh; the proof below says that they solve the problem.
    np.testing.assert_allclose(result.resultant, [-0.2958, 2.0266], atol=2e-3)
    assert result.pressure.max() == pytest.approx(0.613, abs=0.006)
    counts = np.bincount(result.status, minlength=3)
    # On a curve a contact point is a vertex: 15 of them touch.
    assert counts[Status.STICK] >= 8
    assert counts[Status.SLIP] >= 4


def test_proof(run) -> None:
    _, result, check = run
    assert max(result.kkt.values()) < 1e-10
    assert check.displacement < 1e-7
    # The mount takes the load: reaction and contact force cancel.
    assert np.abs(result.balance()["residual"]).max() < 1e-10


def test_files(run) -> None:
    folder, result, _ = run
    grid = pyvista.read(folder / "contact_part.vtu")
    assert grid.n_cells == result.system.body.mesh.nelements
    assert (folder / "contact_part.png").stat().st_size > 50_000


def test_own_mesh(run, example, tmp_path) -> None:
    folder, result, _ = run
    again, _ = example("contact_part").main(
        ["--mesh", str(folder / "bumper.msh"), "--output", str(tmp_path), "--no-picture"]
    )
    np.testing.assert_allclose(again.resultant, result.resultant, rtol=1e-10)


def test_truncated_mesh_file(run, example, tmp_path) -> None:
    text = (run[0] / "bumper.msh").read_text()
    broken = tmp_path / "broken.msh"
    broken.write_text(text[: len(text) // 3])
    with pytest.raises(InputError, match="cannot be read"):
        example("contact_part").main(["--mesh", str(broken), "--output", str(tmp_path)])
