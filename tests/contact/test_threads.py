"""Contact problems solved in threads, copied and forked: what one thread alone gets."""

import copy
import gc
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from families import PLANE, SOLID
from optional_packages import PARDISO
from posed_pairs import Pose, posed

from contact import ContactProblem

SOLVERS = ["superlu", pytest.param("pardiso", marks=PARDISO)]


def problem(make, solver, n=6):
    return ContactProblem(make.block(n), "bottom", make.foundation[2], 0.9, solver=solver)


def fields(result):
    return result.u, result.mu, result.t


def same(one, other):
    return all(map(np.array_equal, one, other))


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_condensation_for_many_loads(solver, make):
    """400 loads by 8 threads; each is carried to the boundary and back twice, some at once."""
    condensed = problem(make, solver).condense()
    size = condensed.body.basis.N
    loads = list(np.random.default_rng(0).standard_normal((200, size))) * 2

    def there_and_back(load):
        reduced = condensed.reduce(load)
        return reduced, condensed.expand(load, reduced), condensed.reduce(0.5 * load)

    alone = [there_and_back(load) for load in loads]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(there_and_back, loads))
    assert all(map(same, alone, together))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_copy_outlives_its_original(solver, make):
    """The copy used PARDISO's memory of the original, also after that had been given back."""
    original = problem(make, solver)
    expected = fields(original.solve())
    other = copy.deepcopy(original)
    del original
    gc.collect()
    assert same(fields(other.solve()), expected)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
def test_a_pair_of_every_element_by_four_threads(element, solver):
    pose = Pose(np.eye(3 if element in SOLID else 2))
    expected = fields(posed(element, pose, solver=solver)[0].solve())
    shared, *_ = posed(element, pose, solver=solver)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: fields(shared.solve()), range(8)))
        apart = [posed(element, pose, solver=solver)[0] for _ in range(4)]
        found += pool.map(lambda one: fields(one.solve()), apart)
    assert all(same(expected, one) for one in found)


@PARDISO
@pytest.mark.parametrize(("then", "later"), [(2, 1), (1, 2)])
def test_threads_of_mkl_that_change_after_the_factorisation(then, later, make):
    """Read with another number of threads, two-level factors gave wrong displacements."""
    import ctypes

    from pypardiso import ps

    set_threads = ps.libmkl["MKL_Set_Num_Threads_Local"]
    before = set_threads(ctypes.c_int(then))
    try:
        condensed = problem(make, "pardiso", 48).condense()
        set_threads(ctypes.c_int(later))
        load = condensed.body.f
        u = condensed.expand(load, np.linalg.solve(condensed.stiffness, condensed.reduce(load)))
    finally:
        set_threads(ctypes.c_int(before))
    assert np.isfinite(u).all()
    P, _ = condensed.body.constraint
    rest = P.T @ (condensed.body.stiffness @ u - load)
    assert np.abs(rest).max() < 1e-10 * np.abs(load).max()


# MKL takes one threading layer for good, so this runs in a process of its own.
PARENT_AND_CHILD = """
import copy, os, signal
import numpy as np
from skfem import Basis, ElementQuad1, MeshQuad
from skfem.models.poisson import laplace, mass
from contact import ContactProblem, ElasticBody, Plane
from skfem_adini import factorize
from skfem_adini.ground import pardiso

assert pardiso._threads() == 2
basis = Basis(MeshQuad().refined(5), ElementQuad1())
A, b = laplace.assemble(basis) + mass.assemble(basis), np.ones(basis.N)
factors = factorize(A, True, "pardiso")
x = factors.solve(b)

def problem():
    mesh = MeshQuad().refined(5).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=2.0, nu=0.3)
    body.fix("top", "x").fix(["left", "right"], "y").load("top", (0.0, -1.0))
    return ContactProblem(body, "bottom", Plane((0.0, -0.03), (0.0, 1.0)), 0.5, solver="pardiso")

def right(found, expected):
    return np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()

inherited = problem()
u = inherited.solve().u
condensed = inherited.condense()
load = condensed.body.f
expanded = condensed.expand(load, np.linalg.solve(condensed.stiffness, condensed.reduce(load)))
child = os.fork()
if child == 0:
    code = 1
    try:
        signal.alarm(100)  # a child that hangs ends by it
        assert right(factors.solve(b), x)
        assert right(copy.deepcopy(factors).solve(b), x)
        assert right(factorize(A, True, "pardiso").solve(b), x)
        z = np.linalg.solve(condensed.stiffness, condensed.reduce(load))
        assert right(condensed.expand(load, z), expanded)
        assert right(inherited.solve().u, u)
        assert right(copy.deepcopy(inherited).solve().u, u)
        assert right(problem().solve().u, u)
        code = 0
    finally:
        os._exit(code)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
assert code == 0, code
assert right(inherited.solve().u, u) and right(factors.solve(b), x)
"""


@PARDISO
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.sampled(2)
@pytest.mark.parametrize("layer", ["GNU", "INTEL"])
def test_a_forked_process_solves_with_what_it_inherits(layer):
    """With libgomp, whose threads are lost in a fork, children waited for them for ever."""
    threads = {f"{name}_NUM_THREADS": "2" for name in ("MKL", "OMP", "OPENBLAS")}
    environment = os.environ | threads | {"MKL_THREADING_LAYER": layer}
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", PARENT_AND_CHILD],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
