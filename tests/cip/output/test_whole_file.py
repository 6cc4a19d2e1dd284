"""What a run writes is there whole or not at all, whoever else writes under the name."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cip import Grid, InputError, Solver


def test_series_of_two_runs_under_one_name(tmp_path, monkeypatch):
    """Every file is whole, with one process number as in two containers, and long names do."""
    monkeypatch.setattr(os, "getpid", lambda: 1)
    solver = Solver(Grid((0, 1), 20, periodic=True), 1.0)
    run = solver.run(solver.state(lambda x: np.sin(2 * np.pi * x)), 0.2, dt=0.05)
    name = tmp_path / ("x" * 241 + ".pvd")
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: run.save(name), range(2))
    assert first == second
    assert sorted(tmp_path.iterdir()) == sorted(first)
    assert all(path.read_text().rstrip().endswith("</VTKFile>") for path in first)
    with pytest.raises(InputError, match="path=None"):
        run.save(None)
