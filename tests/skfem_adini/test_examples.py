"""The examples of this package run headless and return the numbers they print."""

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


# examples/plate.py: order 2 for deflections and frequencies, and a certified contact problem.


PLATE = load("plate")
CLASSICAL = PLATE.CLASSICAL


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    found = PLATE.main(["--floor-cells", "24", "--output", str(folder)])
    assert (folder / "plate.png").stat().st_size > 20_000
    return found


@pytest.mark.parametrize("support", CLASSICAL)
def test_orders_and_frequencies_of_plates(results, support):
    """Frequencies come from below; independent runs of the same discretisation gave the numbers."""
    np.testing.assert_allclose(results[f"{support}, orders"], 2, atol=0.1)
    deflections, omega = results[support][:, 0], results[support][:, 1]
    assert (np.diff(omega) > 0).all()
    assert omega[-1] < CLASSICAL[support][1]
    if support == "clamped":
        np.testing.assert_allclose(omega, [35.45374, 35.84428, 35.94943], rtol=1e-5)
        errors = np.abs(deflections / CLASSICAL[support][0] - 1)
        np.testing.assert_allclose(errors, [3.05e-2, 7.79e-3, 1.96e-3], rtol=1e-2)
    else:
        assert omega[0] == pytest.approx(19.57898, rel=1e-5)


def test_floor_of_a_plate(results):
    """The deflections obey the floor and solve the program; the picture is symmetric.

    Inside the zone of contact a force of q h^2, and more than that on the rim. The residual of
    every free dof is the contact force, and nothing else.
    """
    basis, x, forces, qp = results["floor"]
    gap, w = 1e-4, x[basis.nodal_dofs[0]]
    assert qp.kkt.worst < 1e-10
    assert w.max() <= gap
    assert forces.min() >= 0
    np.testing.assert_array_equal(w[forces > 0], gap)
    square = forces.reshape(25, 25) * 24**2
    for image in (square.T, square[::-1], square[:, ::-1]):
        np.testing.assert_allclose(image, square, atol=1e-9 * square.max())
    np.testing.assert_allclose(square[10:15, 10:15], 1, atol=0.03)
    assert square.max() > 2.5
    assert forces.sum() == pytest.approx(0.364, abs=0.002)
    residual = PLATE.unit_load.assemble(basis) - PLATE.bending.assemble(basis) @ x
    residual[basis.nodal_dofs[0]] -= forces
    free = basis.complement_dofs(PLATE.supports(basis, "clamped"))
    np.testing.assert_allclose(residual[free], 0, atol=1e-12)
