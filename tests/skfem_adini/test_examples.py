"""The examples run headless and return the numbers they print."""

import numpy as np
import pytest
import pyvista as pv
from example_scripts import load


def test_poisson_adini(tmp_path, capsys):
    l2, h1 = load("poisson_adini").main(["8", "16", "32", "--output", str(tmp_path)])
    assert (tmp_path / "poisson_adini.png").stat().st_size > 10_000
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.1)
    assert "order" in capsys.readouterr().out


@pytest.mark.turns(4)
def test_hanging_nodes(tmp_path, capsys):
    uniform, refined, jump = load("hanging_nodes").main(["--output", str(tmp_path)])
    assert (tmp_path / "hanging_nodes.png").stat().st_size > 10_000
    assert jump < 1e-13
    dofs, error = refined[-1]
    # Local refinement reaches the error of the finest uniform mesh with a sixth of its dofs.
    assert dofs < uniform[-1, 0] / 6
    assert error < 1.1 * uniform[-1, 1]
    assert "largest jump" in capsys.readouterr().out


@pytest.mark.turns(4)
def test_shape_functions(tmp_path, capsys):
    distance, entries = load("shape_functions").main(["--output", str(tmp_path)])
    assert distance < 1e-14
    assert entries == 21
    for name in ("shape_functions", "stiffness_matrix"):
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    assert "identity" in capsys.readouterr().out


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["auto", "amg"])
def test_bending(tmp_path, capsys, solver):
    """Saint-Venant's solution to round-off, and the same stress inside the cells of the file."""
    if solver == "amg":
        pytest.importorskip("pyamg", reason="multigrid is optional")
    example = load("bending")
    error, stress_error, iterations = example.main(["--solver", solver, "--output", str(tmp_path)])
    assert error < 1e-11
    assert stress_error < 1e-11
    assert (iterations > 0) == (solver == "amg")
    assert (tmp_path / "bending.png").stat().st_size > 10_000
    points = np.random.default_rng(0).uniform(0.01, 0.99, (50, 3)) * [4, 1, 1] - [0, 0.5, 0.5]
    found = pv.PolyData(points).sample(pv.read(tmp_path / "bending.vtk"), tolerance=1e-12)
    np.testing.assert_allclose(found["stress"][:, 0], -0.2 * points[:, 1], atol=1e-10)
    np.testing.assert_allclose(found["von_mises"], 0.2 * np.abs(points[:, 1]), atol=1e-10)
    np.testing.assert_allclose(found["displacement"], example.exact(points.T).T, atol=1e-10)
    assert "relative errors" in capsys.readouterr().out


def test_open_vtk_writes_and_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    example = load("open_vtk")
    monkeypatch.setattr(example.sys, "platform", "linux")
    cells, kind, low, high = example.main([])
    assert (cells, kind) == (9, 70)
    assert (tmp_path / "out" / "open_vtk.png").stat().st_size > 10_000
    assert high == pytest.approx(0.951781, abs=1e-6)
    assert low == pytest.approx(-high, abs=1e-12)
    assert example.main(["out/adini_field.vtu"]) == (cells, kind, low, high)


def test_open_vtk_renders_off_screen(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load("open_vtk").main(["--screenshot", "picture.png"])
    picture = pv.read("picture.png")
    assert picture.n_points > 10_000
    low, high = picture.get_data_range()
    assert high - low > 100
