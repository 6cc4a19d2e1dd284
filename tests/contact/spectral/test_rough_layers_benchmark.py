"""The benchmark of rough layers fits growth as it says, and solves 2-D Adini as well as bricks."""

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


def test_growth_is_recovered(benchmark):
    sizes = {n: n**2 * np.log2(n) for n in (256, 512, 1024)}
    rows = [
        {"n": n, "dim": 3, "friction": 0.0, "products": n, "contact": n * m**0.9, "condense": m}
        for n, m in sizes.items()
    ]
    depths = [{"rows": 2**k, "condense": 0.5 + 0.01 * k} for k in (4, 8, 12)]
    found = benchmark.growth([*rows, rows[0] | {"dim": 2, "contact": 1e9}], depths)
    assert found.pop("off the line") < 1e-12
    assert 0 < found.pop("power of depth") < 0.03
    wanted = {"product": 0.9, "condense": 1.0, "doubling": 0.01, "no_doubling": 0.5}
    wanted |= {f"{name} of all sizes": wanted[name] for name in ("product", "condense")}
    assert found == pytest.approx(wanted, rel=1e-9)
    bent = [row | {"condense": row["condense"] + 0.1 * (k == 1)} for k, row in enumerate(depths)]
    assert benchmark.growth([], bent)["off the line"] > 0.05
    assert benchmark.growth(rows[:1], depths[:1]) == {}


@pytest.mark.parametrize("directions", [1, 2])
@pytest.mark.parametrize("dragged", [False, True])
def test_rows_are_certified(benchmark, directions, dragged):
    row = benchmark.measure(benchmark.surface(32, directions), dragged, np)
    assert row["residual"] < 1e-10
    assert 0.02 < row["area"] < 0.3
    nodes = 32 * 32 * (6 if directions == 1 else 32 * 3)
    assert abs(row["unknowns"] / nodes - 1) < 0.05
    assert bool(row["newton"]) == dragged
