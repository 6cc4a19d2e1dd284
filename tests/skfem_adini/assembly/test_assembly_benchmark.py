"""benchmarks/assembly.py compares equal things, and its error measure knows a wrong matrix."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from skfem import Basis
from skfem.models.poisson import laplace

from skfem_adini import ElementQuadAdini, assemble

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    import assembly

    yield assembly
    sys.path.remove(str(BENCHMARKS))


def test_the_global_element_is_the_same_element(benchmark):
    mesh = benchmark.square(3)
    slow = laplace.assemble(Basis(mesh, benchmark.ElementQuadAdiniGlobal()))
    quick = assemble(laplace, mesh, ElementQuadAdini())
    # Its monomials lose digits.
    assert np.abs(slow - quick).max() <= 1e-10 * np.abs(quick).max()


def test_error_of_the_rows_of_a_vertex(benchmark):
    n = 5
    K = assemble(laplace, benchmark.square(n), ElementQuadAdini())
    assert benchmark.error(K, n) <= 1e-14
    assert benchmark.error((1 + 1e-6) * K, n) == pytest.approx(1e-6, rel=1e-3)


def test_no_two_cells_of_the_turned_square_are_equal(benchmark):
    mesh = benchmark.turned(4)
    sides = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]
    assert len(np.unique(sides.reshape(-1, 16).T, axis=0)) > 8


def test_a_small_run(benchmark, tmp_path):
    record = benchmark.main(["--n", "8", "--repeats", "1", "--results", str(tmp_path)])
    assert json.loads((tmp_path / "assembly.json").read_text())["solver"] == record["solver"]
    assert set(record["reached"]) == set(record["targets"])
    assert record["reached"]["residual"]
    assert record["tetrahedra"]["difference"] <= 1e-13
    for line in record["matrices"]:
        assert line["difference"] <= 1e-14
        assert line["floor"]["bytes"] == 12 * line["entries"] + 4 * (line["unknowns"] + 1)
