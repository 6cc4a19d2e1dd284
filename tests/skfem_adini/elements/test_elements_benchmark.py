"""The model problems of benchmarks/elements.py are solved right, so their errors mean something."""

import sys
from pathlib import Path

import numpy as np
import pytest
from skfem import Basis, ElementTriArgyris, ElementVector, FacetBasis

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    import element_problems
    import elements

    yield elements, element_problems
    sys.path.remove(str(BENCHMARKS))


ORDERS = {"Adini": 4, "QuadP(2)": 3, "QuadP(3)": 4, "TriP3": 4, "BFS": 4, "Argyris": 6}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("problem", ["poisson", "elasticity"])
@pytest.mark.parametrize("name", ORDERS)
def test_orders_of_smooth_problems(benchmark, name, problem):
    elements, problems = benchmark
    family = problems.FAMILIES[name]
    sizes = [100, 200, 400] if name == "Argyris" else [300, 900, 2700]
    rows = elements.sweep(problems.PROBLEMS[problem], family, sizes, repeats=1)
    # The dofs of coarse meshes are not yet proportional to n^2.
    n = np.log([row["n"] for row in rows])
    assert -np.polyfit(n, np.log([row["L2"] for row in rows]), 1)[0] == pytest.approx(
        ORDERS[name], abs=0.5 if name == "Argyris" else 0.25
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ORDERS)
def test_order_at_the_corner(benchmark, name):
    """The regularity gives 2/3 in the energy and not more, whatever the degree."""
    elements, problems = benchmark
    sizes = [100, 200, 400] if name == "Argyris" else [400, 1600, 3200]
    rows = elements.sweep(problems.PROBLEMS["corner"], problems.FAMILIES[name], sizes, repeats=1)
    half = np.log([2 * max(1, round(row["n"] / np.sqrt(3))) for row in rows])
    order = -np.polyfit(half, np.log([row["H1"] for row in rows]), 1)[0]
    assert order == pytest.approx(2 / 3, abs=0.12)


@pytest.mark.parametrize("components", [1, 2])
def test_argyris_holds_the_trace_and_nothing_else(benchmark, components):
    _, problems = benchmark
    family = problems.FAMILIES["Argyris"]
    mesh = problems.l_shape(family, 5)
    element = family.make() if components == 1 else ElementVector(ElementTriArgyris())
    basis = Basis(mesh, element)
    facets = mesh.boundary_facets()
    fixed = problems.fixed_dofs(basis, facets)
    trace = FacetBasis(mesh, element, facets=facets, intorder=12)
    x = np.random.default_rng(0).uniform(-1, 1, basis.N)
    x[fixed] = 0
    assert np.abs(np.asarray(trace.interpolate(x))).max() < 1e-9
    # One column of the traces for each fixed dof, and independent ones: the condition is minimal.
    columns = []
    for dof in fixed:
        unit = basis.zeros()
        unit[dof] = 1
        columns.append(np.ravel(trace.interpolate(unit)))
    columns = np.array(columns)
    columns /= np.linalg.norm(columns, axis=1, keepdims=True)
    assert np.linalg.svd(columns, compute_uv=False).min() > 1e-4


def test_target_and_order_of_known_sequences(benchmark):
    elements, _ = benchmark
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
def test_report_and_picture(benchmark, tmp_path, capsys):
    elements, _ = benchmark
    arguments = ["--problems", "eigenvalue", "--sizes", "200", "400", "800", "--repeats", "1"]
    record = elements.main([*arguments, "--results", str(tmp_path), "--output", str(tmp_path)])
    found = record["problems"]["eigenvalue"]["runs"]["Adini"][-1]
    assert found["8 pi^2"] < 1e-5
    assert found["5 pi^2"] < 1e-5
    assert (tmp_path / "elements.png").stat().st_size > 20_000
    printed = capsys.readouterr().out
    assert "Adini wins" in printed
    assert "Adini loses" in printed

    import performance_tables

    table = performance_tables.elements(record)
    assert table.splitlines()[0] == "| problem | " + " | ".join(ORDERS) + " |"
    dofs = record["problems"]["eigenvalue"]["summary"]["5 pi^2"]["BFS"]["dofs_to_target"]
    assert f" {dofs:,.0f} (" in table
