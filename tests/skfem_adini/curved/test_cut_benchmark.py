"""The benchmark of curved domains runs, and its figures are those of the right problem."""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def curved():
    sys.path.insert(0, str(BENCHMARKS))
    import curved

    yield curved
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.turns(4)
def test_report(curved, cut_problems, tmp_path, capsys):
    np.testing.assert_allclose(curved.EXACT, cut_problems.disk_eigenvalues(10))
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
def test_materials(curved, tmp_path, capsys):
    """Each order is that of its docstring; what was measured before stays in the file."""
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


def test_the_exact_solutions_solve_their_equations(curved):
    """Volume forces and sources against central differences of the stresses and fluxes."""
    materials = curved.curved_materials
    x, d = np.array([[[0.31, 0.62]], [[0.44, 0.57]]]), 1e-5
    shifts = [np.array([[[d]], [[0]]]), np.array([[[0]], [[d]]])]

    def divergence(flux):
        return sum((flux(x + s)[..., i, :, :] - flux(x - s)[..., i, :, :]) / (2 * d)
                   for i, s in enumerate(shifts))  # fmt: skip

    for lam in (1.5, 4999.0):
        u, slope, force = materials.elastic(lam)
        by_difference = np.stack([(u(x + s) - u(x - s)) / (2 * d) for s in shifts], axis=1)
        np.testing.assert_allclose(slope(x), by_difference, atol=1e-8)

        def stress(x, lam=lam, slope=slope):
            G = slope(x)
            trace = (G[0, 0] + G[1, 1]) * np.eye(2)[:, :, None, None]
            return lam * trace + G + G.swapaxes(0, 1)

        np.testing.assert_allclose(-divergence(stress), force(x), rtol=1e-5, atol=1e-5)
    for kind in ("smooth", "jump at a grid line", "jump in the cells"):
        k, u, slope, source = materials.conduction(kind, 1e3)
        by_difference = np.stack([(u(x + s) - u(x - s)) / (2 * d) for s in shifts])
        np.testing.assert_allclose(slope(x), by_difference, rtol=1e-6, atol=1e-8)
        found = -divergence(lambda x, k=k, slope=slope: k(x) * slope(x))
        np.testing.assert_allclose(found, source(x), rtol=1e-5)
