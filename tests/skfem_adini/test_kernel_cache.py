"""Machine code kept on disk: never of an older package, found by the next process, not needed."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import skfem_adini
from cip import Grid, Solver, Velocity
from cip.engines import cpu_loops
from gpu.qp.active_set import dual_kernels
from gpu.qp.data.qp_problem import SOLVED
from skfem_adini.curved.quadrature import cut_quadrature
from skfem_adini.ground import jit
from skfem_adini.ground.jit import compiled

PACKAGE = Path(skfem_adini.__file__).parent
KERNELS = """
import sys
from skfem_adini import callee, caller
from skfem_adini.ground.jit import compiled

def compilations(kernel):
    return sum(kernel.stats.cache_misses.values())

callee.inner = compiled(callee.inner)
outer = compiled(caller.outer)
print(outer(3.0), compilations(outer) + compilations(callee.inner))
"""
ASSEMBLE = """
import numpy as np
from skfem import MeshQuad
from skfem.models.poisson import mass
from skfem_adini import ElementQuadAdini, assemble
K = assemble(mass, MeshQuad().refined(2), ElementQuadAdini(), fallback=False)
one = np.zeros(K.shape[0])
one[::3] = 1
print(round(one @ K @ one, 12))
"""
CUT = """
from skfem import LinearForm, MeshQuad
from skfem_adini import CutDomain, ElementQuadAdini
mesh = MeshQuad().refined(2)
domain = CutDomain(mesh, lambda x: (x[0] - .5)**2 + (x[1] - .5)**2 - .09)
load = domain.assemble(LinearForm(lambda v, w: v), ElementQuadAdini())
print(load[::3].sum())
"""

FIRST = """
import sys
from numba.core import event
from skfem import ElementTetP1, ElementTriP2, MeshQuad, MeshTet, MeshTri
from contact import ContactProblem, ElasticBody
from skfem_adini import ElementQuadAdini
from skfem_adini.ground import jit

jit.INTERPRETED = jit.INTERPRETED._replace(seconds=float(sys.argv[1]))
cases = [
    (MeshQuad().refined(2), ElementQuadAdini()), (MeshTri().refined(2), ElementTriP2()),
    (MeshTet().refined(1), ElementTetP1()), (MeshQuad().refined(2), None),
]
with event.install_recorder("numba:compile") as recorder:
    for mesh, element in cases:
        mesh = mesh.with_defaults()
        body = ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3).fix("top", None, 0.01)
        result = ContactProblem(body, "bottom", 0.003, friction=0.2).solve()
        print(body.stiffness.data.tobytes().hex(), result.u.tobytes().hex())
print(len(recorder.buffer))
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package with a kernel that calls another one."""
    home = tmp_path / "skfem_adini"
    shutil.copytree(PACKAGE, home, ignore=shutil.ignore_patterns("__pycache__"))
    caller = "from . import callee\n\ndef outer(x):\n    return callee.inner(x)\n"
    (home / "caller.py").write_text(caller)
    (home / "callee.py").write_text("def inner(x):\n    return x + 1\n")
    return home


def run(package, script, **environment):
    paths = [str(package.parent), str(PACKAGE.parent)]
    clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=package.parent,
        env=clean | {"PYTHONPATH": os.pathsep.join(paths)} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.turns(4)
def test_a_changed_kernel_is_compiled_anew_with_its_callers(package):
    """The caller kept the old formula of what it calls."""
    assert run(package, KERNELS) == ["4.0", "2"]
    assert run(package, KERNELS) == ["4.0", "0"]
    (package / "callee.py").write_text("def inner(x):\n    return x + 2\n")
    assert run(package, KERNELS) == ["5.0", "2"]


@pytest.mark.turns(4)
def test_files_changed_or_damaged_while_a_process_runs(package):
    """What it compiles later from the code it has loaded is not kept as that of the new files."""
    change = "import pathlib; pathlib.Path(callee.__file__).write_text('def inner(x): return 7.0')"
    script = KERNELS.replace("\n\ndef compilations", f"\n{change}\n\ndef compilations")
    assert run(package, script)[0] == "4.0"
    assert run(package, KERNELS)[0] == "7.0"
    for file in package.glob("__pycache__/*.nb?"):
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2])
    assert run(package, KERNELS) == ["7.0", "2"]
    assert run(package, KERNELS) == ["7.0", "0"]


def nowhere(package):
    """Let neither the package's folder nor the user's hold what numba keeps, not even for root."""
    for face in package.glob("**/__init__.py"):
        shutil.rmtree(face.parent / "__pycache__", ignore_errors=True)
        (face.parent / "__pycache__").write_text("in the way")
    nothing = os.path.join(os.devnull, "home")
    return {"HOME": nothing, "XDG_CACHE_HOME": nothing, "LOCALAPPDATA": nothing}


@pytest.mark.turns(4)
def test_assemble_where_no_folder_can_be_written(package):
    """A RuntimeError of numba's came before: "no locator available for file"."""
    assert run(package, ASSEMBLE, **nowhere(package)) == ["1.0"]


@pytest.mark.slow
def test_a_changed_rule_of_cut_cells(package):
    """`height_rule` is called by `cut_boxes`, whose code on disk kept the old weights."""
    (area,) = run(package, CUT)
    rules = package / "curved/quadrature/graph_rules.py"
    before = "row[3] = geometry[2] * geometry[3] * w"
    assert before in rules.read_text()
    rules.write_text(rules.read_text().replace(before, "row[3] = 0 * geometry[3] * w"))
    assert float(run(package, CUT)[0]) < 0.9 * float(area)


@pytest.mark.turns(4)
def test_first_results_need_no_compiler_and_are_those_of_machine_code(tmp_path):
    """A first contact problem took nine seconds, nearly all of them to compile."""
    found = []
    for seconds, folder in (("100", "a"), ("0", "b"), ("100", "b")):
        path = os.pathsep.join([str(PACKAGE.parent), os.environ.get("PYTHONPATH", "")])
        environment = {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / folder)}
        line = [sys.executable, "-c", FIRST.replace("sys.argv[1]", repr(seconds))]
        done = subprocess.run(line, env=os.environ | environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.append(done.stdout.split())
    (*interpreted, none), (*machine, many), (*kept, again) = found
    assert interpreted == machine == kept
    assert int(none) == int(again) == 0 < int(many)


def test_a_kernel_is_compiled_once_calls_have_taken_that_long(monkeypatch):
    made = []
    monkeypatch.setattr(jit, "compiled", lambda f, parts: made.append(f) or (lambda x: -1.0))
    monkeypatch.setattr(jit, "_is_on_disk", lambda machine: False)
    clock = iter(np.arange(0.0, 100.0, 0.3))
    monkeypatch.setattr(jit.time, "perf_counter", lambda: next(clock))
    kernel = jit.compiled_later(lambda x: x.sum())
    assert [kernel(np.ones(3)) for _ in range(6)] == [3.0] * 4 + [-1.0] * 2
    large = jit.compiled_later(lambda x: x.sum())
    assert large(np.ones(jit.INTERPRETED.entries + 1)) == -1.0
    assert len(made) == 2


def test_a_full_disk(monkeypatch):
    full = Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr("numba.core.caching.FunctionCache.save_overload", full)

    def plus_one(x):
        return x + 1

    assert compiled(plus_one)(2.0) == 3.0


def test_kernels_asked_for_in_threads():
    cut_quadrature.compiled_cut_boxes.cache_clear()
    with ThreadPoolExecutor(8) as pool:
        found = {pool.submit(cut_quadrature.compiled_cut_boxes).result() for _ in range(8)}
    assert len(found) == 1


# Loops and formulas of cip.


SCRIPT = """
import numba
from numba.core import event
from cip import Grid, Solver, Velocity

with event.install_recorder("numba:compile") as recorder:
    grid, velocity = Grid((0, 1), 8, periodic=True), Velocity.from_expression("cos(t)")
    solver = Solver(grid, velocity, profile="linear")
    solver.step(solver.state("x1"), 0.1)
    print(sum(e.is_start for _, e in recorder.buffer))
    numba.njit("int64(int64)")(lambda x: x)
    print(sum(e.is_start for _, e in recorder.buffer))
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


@pytest.mark.parametrize("seed", range(6))
def test_quadratic_programs_in_plain_python_are_those_of_machine_code(seed):
    """The first small problems of a new installation are solved before anything is compiled."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 12)), int(rng.integers(0, 15))
    root = rng.normal(size=(n + 2, n))
    data = root.T @ root, rng.normal(size=(m, n)), rng.normal(size=n), np.full(m + n, -1.0)
    given = (*data, rng.uniform(-0.5, 1.0, m + n), m == 0, 4 * (m + n))
    plain = jit.plain_function(dual_kernels, "solve_one")
    with np.errstate(all="ignore"):
        python = plain(*given)
    machine = dual_kernels.solve_one(*given)
    assert python[0] == machine[0]
    assert np.array_equal(python[5], machine[5])
    if python[0] == SOLVED:
        assert np.abs(python[2] - machine[2]).max() < 1e-13
        assert python[6].max() < 1e-14
