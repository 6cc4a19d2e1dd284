"""What numba keeps on disk: every loop and every formula, found again by the next process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cip import Grid, Solver, Velocity
from cip.engines import cpu_loops
from skfem_adini.ground import jit

SCRIPT = """
import numba
from numba.core import event
from cip import Grid, Solver, Velocity

compiled = []

class Listener(event.Listener):
    def on_start(self, found):
        compiled.append(found.data["dispatcher"].py_func.__name__)
    def on_end(self, found):
        pass

event.register("numba:compile", Listener())
grid, velocity = Grid((0, 1), 8, periodic=True), Velocity.from_expression("cos(t)")
solver = Solver(grid, velocity, profile="linear")
solver.step(solver.state("x1"), 0.1)
print(len(compiled))
numba.njit("int64(int64)")(lambda x: x)
print(len(compiled))
"""


@pytest.mark.turns(4)
def test_the_next_process_compiles_nothing():
    """What this process has compiled the next one finds; the listener does count."""
    grid, velocity = Grid((0, 1), 8, periodic=True), Velocity.from_expression("cos(t)")
    solver = Solver(grid, velocity, profile="linear")
    solver.step(solver.state("x1"), 0.1)
    path = os.pathsep.join([str(Path(jit.__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    output = subprocess.run(
        [sys.executable, "-c", SCRIPT], env={**os.environ, "PYTHONPATH": path}, check=True,
        capture_output=True,
    ).stdout  # fmt: skip
    assert output.split() == [b"0", b"1"]


def test_one_path_serves_all_grids_and_solvers():
    paths = []
    for n in (8, 9):
        grid = Grid((0, 1 + n), n)
        solver = Solver(grid, Velocity.from_expression("cos(3*t)"), boundary=0.0)
        paths.append(cpu_loops.compiled(grid, solver._stages[0])[0])
    assert paths[0] is paths[1]


def test_no_folder_to_write_to(monkeypatch):
    """Kernels then live as long as the process."""
    from numba.core.caching import CacheImpl

    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    twice = jit.loop(lambda x: 2 * x)
    assert twice(21) == 42
    assert not twice._cache.cache_path


def test_files_of_formulas_do_not_pile_up(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "GENERATED", jit.GENERATED._replace(kept=3))
    for age in range(5):
        file = tmp_path / f"cpu_loops.path{jit.GENERATED.mark}{age}.py311.1.nbc"
        file.touch()
        os.utime(file, (1000 - age, 1000 - age))
    (tmp_path / "cpu.run_line_node_linear.py311.nbi").touch()
    jit._forget_old(tmp_path)
    left = sorted(file.name for file in tmp_path.iterdir())
    assert len(left) == 4
    assert not any(f"{jit.GENERATED.mark}{age}" in name for name in left for age in (3, 4))
