"""benchmarks/sparse_solving.py measures right systems and finds the crossover of known times."""

import sys
from pathlib import Path

import numpy as np
import pytest
from skfem import Basis
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import essential_dofs

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
pytest.importorskip("pyamg", reason="multigrid is optional")


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    import sparse_solving

    yield sparse_solving
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("problem", ["poisson", "elasticity"])
def test_systems(benchmark, problem, monkeypatch):
    from skfem import ElementVector, MeshHex

    from skfem_adini import ElementHexAdini

    monkeypatch.setattr(benchmark, "PIECE", 10**4)  # several pieces
    A, b, near_null = benchmark.system(problem, 2)
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3)
    elastic = problem == "elasticity"
    basis = Basis(mesh, ElementVector(ElementHexAdini()) if elastic else ElementHexAdini())
    facets = mesh.facets_satisfying(lambda x: x[2] == 0) if elastic else mesh.boundary_facets()
    free = basis.complement_dofs(essential_dofs(basis, facets))
    K = (linear_elasticity(1.0, 1.0) if elastic else laplace).assemble(basis)
    np.testing.assert_allclose(A.toarray(), K[free][:, free].toarray(), atol=1e-13)
    assert b.any()
    assert len(near_null.modes) == len(b)


def test_crossover_of_known_times(benchmark):
    sizes = np.array([10, 100, 1000, 10000])
    lines = []
    for name, times in (("direct", sizes**1.5), ("iterative", 300.0 * sizes**0.5)):
        lines += [
            {"unknowns": n, "solver": name, "setup": t / 3, "solve": 2 * t / 3}
            for n, t in zip(sizes, times, strict=True)
        ]
    assert benchmark.crossover(lines, "direct", "iterative") == pytest.approx(300)
    assert benchmark.crossover(lines, "iterative", "direct") is None
    assert benchmark.crossover(lines[2:4] + lines[6:], "direct", "iterative") == 1000


def test_report(benchmark, tmp_path, capsys):
    arguments = ["--problems", "poisson", "--largest", "4", "--repeats", "1"]
    record = benchmark.main([*arguments, "--results", str(tmp_path)])
    lines = record["problems"]["poisson"]["lines"]
    assert {line["solver"] for line in lines} >= {"superlu", "amg"}
    assert max(line["residual"] for line in lines) <= 1e-10
    import performance_tables

    table = performance_tables.sparse_solving(record)
    assert f"| poisson | {lines[-1]['unknowns']:,} |" in table
    assert "overtakes" in capsys.readouterr().out
