"""A forked process solves with what it inherits, whichever OpenMP library MKL works with."""

import os
import subprocess
import sys

import pytest
from optional_packages import PARDISO

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system"),
    PARDISO,
]

# MKL takes one threading layer for good, so this runs in a process of its own.
PARENT_AND_CHILD = """
import copy, os, signal
import numpy as np
from skfem import Basis, ElementQuad1, MeshQuad
from skfem.models.poisson import laplace, mass
from contact import ContactProblem, ElasticBody, Plane
from skfem_adini import factorize
from skfem_adini.solvers import pardiso

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
