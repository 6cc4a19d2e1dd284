"""Examples of skfem_adini return the numbers that they print."""

import numpy as np
import pytest
import pyvista as pv
from example_scripts import load


def test_poisson_adini(run):
    l2, h1 = run("poisson_adini", "8", "16", "32", says="order", files=["poisson_adini.png"])
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.1)


@pytest.mark.turns(4)
def test_hanging_nodes(run):
    found = run("hanging_nodes", says="largest jump", files=["hanging_nodes.png"])
    uniform, refined, jump = found
    assert jump < 1e-13
    dofs, error = refined[-1]
    # Local refinement reaches the error of the finest uniform mesh with a sixth of its dofs.
    assert dofs < uniform[-1, 0] / 6
    assert error < 1.1 * uniform[-1, 1]


@pytest.mark.turns(4)
def test_shape_functions(run):
    files = ["shape_functions.png", "stiffness_matrix.png"]
    distance, entries = run("shape_functions", says="identity", files=files)
    assert distance < 1e-14
    assert entries == 21


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["auto", "amg"])
def test_bending(run, example, tmp_path, solver):
    """Saint-Venant's solution to round-off, and the same stress inside the cells of the file."""
    if solver == "amg":
        pytest.importorskip("pyamg", reason="multigrid is optional")
    found = run("bending", "--solver", solver, says="relative errors", files=["bending.png"])
    error, stress_error, iterations = found
    assert max(error, stress_error) < 1e-11
    assert (iterations > 0) == (solver == "amg")
    points = np.random.default_rng(0).uniform(0.01, 0.99, (50, 3)) * [4, 1, 1] - [0, 0.5, 0.5]
    found = pv.PolyData(points).sample(pv.read(tmp_path / "new/bending.vtk"), tolerance=1e-12)
    np.testing.assert_allclose(found["stress"][:, 0], -0.2 * points[:, 1], atol=1e-10)
    np.testing.assert_allclose(found["von_mises"], 0.2 * np.abs(points[:, 1]), atol=1e-10)
    exact = example("bending").exact(points.T).T
    np.testing.assert_allclose(found["displacement"], exact, atol=1e-10)


@pytest.mark.turns(4)
def test_order_one_of_2012_beside_order_six(run):
    arguments = ("curved_2012", "--cells", "8", "16", "32")
    found = run(*arguments, says="Table 5.4", files=["curved_2012.png"])
    errors = {name: np.abs(values) for name, values in found.items()}
    assert errors["exact"][-1] > 1e-4
    assert errors["chords"][-1] > 1e-4
    assert errors["extension"][-1] < 3e-9
    assert found["inverse"][-1] > 1e5


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
    """A force of q h^2 inside the zone of contact, more on its rim, and nothing else is left."""
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


# examples/eigenvalues.py reproduces Tables 5.1, 5.2 and 5.3 of the dissertation.


EIGENVALUES = load("eigenvalues")
TABLES = {"Neumann": EIGENVALUES.NEUMANN, "Dirichlet": EIGENVALUES.DIRICHLET}
# Where the dissertation's numbers at n = 32 are off by rounding; confirmed in extended precision.
CORRECTED = {("Neumann", (1, 0)): 2.770e-11, ("Dirichlet", (1, 1)): 8.5475e-10}
# Richardson extrapolation from an independent computation, lambda = mu = 1.
ELASTIC = [15.4161997726, 17.8058839646, 2 * np.pi**2, 26.1134057551, 36.2220646042, 39.8185310458]

needs_long_double = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="numpy.longdouble is double here"
)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("eigenvalues")
    arguments = ["--cells", "4", "8", "16", "32", "--cube", "2", "4", "--output", str(folder)]
    results = EIGENVALUES.main(arguments)
    assert (folder / "eigenvalues.png").stat().st_size > 20_000
    return results


@pytest.fixture(scope="module")
def full_tables(tmp_path_factory):
    return EIGENVALUES.main(["--output", str(tmp_path_factory.mktemp("eigenvalues"))])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("table", TABLES)
def test_laplace_errors(tables, table):
    for mode, published in TABLES[table].items():
        found = tables[table][mode]
        np.testing.assert_allclose(found[:3], published[:3], rtol=1e-4)
        expected = CORRECTED.get((table, mode), published[3])
        assert found[3] == pytest.approx(expected, rel=2e-3)


def test_elastic_eigenvalues():
    found = EIGENVALUES.elastic_eigenvalues(16)
    np.testing.assert_allclose(found, ELASTIC, rtol=3e-6)


def test_cube(tables):
    expected = {(1, 0, 0): [1.366e-4, 3.778e-6], (1, 1, 0): [3.090e-3, 8.799e-5]}
    for mode, errors in expected.items():
        np.testing.assert_allclose(tables["cube"][mode], errors, rtol=1e-3)


@pytest.mark.slow
@needs_long_double
@pytest.mark.parametrize("table", TABLES)
def test_order_six(full_tables, table):
    for mode in TABLES[table]:
        coarse, fine = full_tables[table][mode][3:]
        assert np.log2(coarse / fine) == pytest.approx(6, abs=0.1)


@pytest.mark.slow
def test_elastic_rates(full_tables):
    np.testing.assert_allclose(full_tables["rates"], EIGENVALUES.ELASTIC_RATES, atol=0.05)


@pytest.mark.slow
def test_fine_cube(full_tables):
    assert full_tables["cube"][1, 0, 0][2] == pytest.approx(8.78e-8, rel=0.01)
