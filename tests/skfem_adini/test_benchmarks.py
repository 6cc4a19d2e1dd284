"""The scripts of benchmarks/ solve the right problems, and compare and report them rightly."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from convergence import order
from optional_packages import AMG
from skfem import Basis, ElementVector, MeshHex
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import ElementHexAdini, ElementQuadAdini, assemble, essential_dofs
from tests.skfem_adini.cut_problems import disk_eigenvalues

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture(scope="module")
def script():
    """Import a script of benchmarks/."""
    sys.path.insert(0, BENCHMARKS)
    yield importlib.import_module
    sys.path.remove(BENCHMARKS)


# elements.py


ORDERS = {"Adini": 4, "QuadP(2)": 3, "QuadP(3)": 4, "TriP3": 4, "BFS": 4, "Argyris": 6}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("problem", ["poisson", "elasticity", "corner"])
@pytest.mark.parametrize("name", ORDERS)
def test_orders_of_elements(script, name, problem):
    """At the corner the regularity gives 2/3 in the energy and not more, whatever the degree."""
    elements, problems, corner = script("elements"), script("element_problems"), problem == "corner"
    sizes = [400, 1600, 3200] if corner else [300, 900, 2700]
    sizes = [100, 200, 400] if name == "Argyris" else sizes
    rows = elements.sweep(problems.PROBLEMS[problem], problems.FAMILIES[name], sizes, repeats=1)
    # The dofs of coarse meshes are not yet proportional to n^2.
    n = np.array([row["n"] for row in rows])
    n = 2 * np.maximum(1, np.round(n / np.sqrt(3))) if corner else n
    found = order(n, [row["H1" if corner else "L2"] for row in rows])
    off = 0.12 if corner else 0.5 if name == "Argyris" else 0.25
    assert found == pytest.approx(2 / 3 if corner else ORDERS[name], abs=off)


def test_target_and_order_of_known_sequences(script):
    elements = script("elements")
    rows = [{"dofs": n**2, "seconds": n / 100, "L2": 3.0 * n**-4.0} for n in (4, 8, 16, 32)]
    assert elements.order(rows, "L2") == pytest.approx(4)
    assert elements.to_reach(rows, "L2", 3.0 * 10**-4.0, "dofs") == pytest.approx(100)
    assert elements.to_reach(rows, "L2", 3.0 * 10**-4.0, "seconds") == pytest.approx(0.1)
    assert elements.to_reach(rows, "L2", 1e-9, "dofs") is None
    assert elements.at(rows, "L2", 144) == pytest.approx(3.0 * 12**-4.0)
    rising = [*rows, {"dofs": 64**2, "seconds": 1, "L2": 1.0}]
    assert elements.order(rising, "L2") == pytest.approx(4)
    assert elements.before_rounding([1, 0.1, 0.2]) == 2


@pytest.mark.turns(4)
def test_report_of_elements(script, tmp_path, capsys):
    elements = script("elements")
    arguments = ["--problems", "eigenvalue", "--sizes", "200", "400", "800", "--repeats", "1"]
    record = elements.main([*arguments, "--results", str(tmp_path), "--output", str(tmp_path)])
    found = record["problems"]["eigenvalue"]["runs"]["Adini"][-1]
    assert found["8 pi^2"] < 1e-5
    assert found["5 pi^2"] < 1e-5
    assert (tmp_path / "elements.png").stat().st_size > 20_000
    printed = capsys.readouterr().out
    assert "Adini wins" in printed
    assert "Adini loses" in printed

    table = script("performance_tables").elements(record)
    assert table.splitlines()[0] == "| problem | " + " | ".join(ORDERS) + " |"
    dofs = record["problems"]["eigenvalue"]["summary"]["5 pi^2"]["BFS"]["dofs_to_target"]
    assert f" {dofs:,.0f} (" in table


# assembly.py


def test_the_global_element_is_the_same_element(script):
    benchmark = script("assembly")
    mesh = benchmark.square(3)
    slow = laplace.assemble(Basis(mesh, benchmark.ElementQuadAdiniGlobal()))
    quick = assemble(laplace, mesh, ElementQuadAdini())
    # Its monomials lose digits.
    assert np.abs(slow - quick).max() <= 1e-10 * np.abs(quick).max()


def test_error_of_the_rows_of_a_vertex_and_cells_that_differ(script):
    benchmark = script("assembly")
    n = 5
    K = assemble(laplace, benchmark.square(n), ElementQuadAdini())
    assert benchmark.error(K, n) <= 1e-14
    assert benchmark.error((1 + 1e-6) * K, n) == pytest.approx(1e-6, rel=1e-3)
    turned = benchmark.turned(4)
    sides = turned.p[:, turned.t[1:]] - turned.p[:, turned.t[:1]]
    assert len(np.unique(sides.reshape(-1, 16).T, axis=0)) > 8


def test_a_small_run_of_assembly(script, tmp_path):
    benchmark = script("assembly")
    record = benchmark.main(["--n", "8", "--repeats", "1", "--results", str(tmp_path)])
    assert json.loads((tmp_path / "assembly.json").read_text())["solver"] == record["solver"]
    assert set(record["reached"]) == set(record["targets"])
    assert record["reached"]["residual"]
    assert record["tetrahedra"]["difference"] <= 1e-13
    for line in record["matrices"]:
        assert line["difference"] <= 1e-14
        assert line["floor"]["bytes"] == 12 * line["entries"] + 4 * (line["unknowns"] + 1)


# curved.py


@pytest.mark.turns(4)
def test_report_of_curved(script, tmp_path, capsys):
    curved = script("curved")
    np.testing.assert_allclose(curved.EXACT, disk_eigenvalues(10))
    arguments = ["--most", "2", "--repeats", "1", "--output", str(tmp_path)]
    record = curved.main([*arguments, "--results", str(tmp_path)])
    for name, rows in record["runs"].items():
        assert rows[1]["worst"] < rows[0]["worst"], name
        assert rows[1]["first"] < 1e-2
    assert record["runs"]["extension"][1]["first"] < 2e-7
    assert (tmp_path / "curved.json").stat().st_size > 1000
    assert (tmp_path / "curved.png").stat().st_size > 10_000
    assert "ghost penalty" in capsys.readouterr().out


@pytest.mark.slow
def test_materials_of_curved(script, tmp_path, capsys):
    """Each order is that of its docstring; what was measured before stays in the file."""
    curved = script("curved")
    arguments = ["--parts", "materials", "--most", "4", "--results", str(tmp_path)]
    (tmp_path / "curved.json").write_text('{"benchmark": "curved", "runs": {"kept": []}}')
    record = curved.main(arguments)
    assert record["runs"] == {"kept": []}
    for row in record["materials"]["incompressible"]:
        if row["nu"] <= 0.49:
            assert row["orders"][0] == pytest.approx(4.1, abs=0.5), row
            assert row["orders"][1] == pytest.approx(3.1, abs=0.4), row
        assert row["l2"][-1] < 1e-3
    for row in record["materials"]["contrasts"]:
        if row["conductivity"] == "smooth":
            assert row["orders"] == pytest.approx([4.1, 3.1], abs=0.5)
        else:
            assert row["orders"][1] < 1.2
    assert "torsion" in capsys.readouterr().out


# sparse_solving.py


@AMG
@pytest.mark.sampled(2)
@pytest.mark.parametrize("problem", ["poisson", "elasticity"])
def test_systems(script, problem, monkeypatch):
    benchmark = script("sparse_solving")
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


@AMG
def test_crossover_of_known_times(script):
    benchmark = script("sparse_solving")
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


@AMG
def test_report_of_sparse_solving(script, tmp_path, capsys):
    benchmark = script("sparse_solving")
    arguments = ["--problems", "poisson", "--largest", "4", "--repeats", "1"]
    record = benchmark.main([*arguments, "--results", str(tmp_path)])
    lines = record["problems"]["poisson"]["lines"]
    assert {line["solver"] for line in lines} >= {"superlu", "amg"}
    assert max(line["residual"] for line in lines) <= 1e-10
    table = script("performance_tables").sparse_solving(record)
    assert f"| poisson | {lines[-1]['unknowns']:,} |" in table
    assert "overtakes" in capsys.readouterr().out
