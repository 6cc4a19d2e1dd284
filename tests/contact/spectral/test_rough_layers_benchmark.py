"""The benchmark of rough layers solves 2-D Adini as well as bricks."""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    import rough_layers

    yield rough_layers
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.parametrize("directions", [1, 2])
@pytest.mark.parametrize("dragged", [False, True])
def test_rows_are_certified(benchmark, directions, dragged):
    row = benchmark.measure(benchmark.surface(32, directions), dragged, np)
    assert row["residual"] < 1e-10
    assert 0.02 < row["area"] < 0.3
    nodes = 32 * 32 * (6 if directions == 1 else 32 * 3)
    assert abs(row["unknowns"] / nodes - 1) < 0.05
    assert bool(row["newton"]) == dragged
