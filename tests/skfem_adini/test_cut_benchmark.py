"""The benchmark of curved domains runs, and its figures are those of the right problem."""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def curved():
    sys.path.insert(0, str(BENCHMARKS))
    import curved

    yield curved
    sys.path.remove(str(BENCHMARKS))


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
