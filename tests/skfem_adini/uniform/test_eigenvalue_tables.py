"""examples/eigenvalues.py reproduces Tables 5.1, 5.2 and 5.3 of the dissertation."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from skfem_adini import UniformSolver

EXAMPLE = runpy.run_path(str(Path(__file__).parents[3] / "examples" / "eigenvalues.py"))
TABLES = {"Neumann": EXAMPLE["NEUMANN"], "Dirichlet": EXAMPLE["DIRICHLET"]}
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
    results = EXAMPLE["main"](arguments)
    assert (folder / "eigenvalues.png").stat().st_size > 20_000
    return results


@pytest.fixture(scope="module")
def full_tables(tmp_path_factory):
    return EXAMPLE["main"](["--output", str(tmp_path_factory.mktemp("eigenvalues"))])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("table", TABLES)
def test_laplace_errors(tables, table):
    for mode, published in TABLES[table].items():
        found = tables[table][mode]
        np.testing.assert_allclose(found[:3], published[:3], rtol=1e-4)
        expected = CORRECTED.get((table, mode), published[3])
        assert found[3] == pytest.approx(expected, rel=2e-3)


@needs_long_double
def test_dirichlet_values_are_those_of_the_symbol(tables):
    for mode, errors in tables["Dirichlet"].items():
        oracle = [UniformSolver((n, n)).eigenvalue_error(*mode) for n in tables["cells"]]
        np.testing.assert_allclose(errors, oracle, rtol=0, atol=1e-15)


def test_elastic_eigenvalues():
    found = EXAMPLE["elastic_eigenvalues"](16)
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
@needs_long_double
def test_dirichlet_values_are_those_of_the_symbol_at_64(full_tables):
    for mode, errors in full_tables["Dirichlet"].items():
        oracle = UniformSolver((64, 64)).eigenvalue_error(*mode)
        assert abs(errors[-1] - oracle) < 2e-12


@pytest.mark.slow
def test_elastic_rates(full_tables):
    np.testing.assert_allclose(full_tables["rates"], EXAMPLE["ELASTIC_RATES"], atol=0.05)


@pytest.mark.slow
def test_fine_cube(full_tables):
    assert full_tables["cube"][1, 0, 0][2] == pytest.approx(8.78e-8, rel=0.01)
