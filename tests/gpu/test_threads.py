"""Many threads at once get what one gets, to the last bit."""

import os
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from optional_packages import PARDISO
from scipy import sparse

from gpu import QPFactor, eigs, lqe, lqr, solve_qp, svds
from gpu.arrays.sparse_factor import PardisoFactor, SuperLUFactor
from gpu.eigenvalues.krylov import arnoldi

WORKERS = 8


def everywhere(tasks):
    """The results of all tasks, run by threads that begin together."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return [future.result() for future in [pool.submit(task) for task in tasks]]


def same(tasks, times):
    serial = [task() for task in tasks]
    for found, known in zip(everywhere(tasks * times), serial * times, strict=True):
        for part, other in zip(found, known, strict=True):
            np.testing.assert_array_equal(part, other)


def programs(seed):
    """One shared factor, dense and sparse programs with bounds and rows of both kinds."""
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((30, 30))
    dense = QPFactor(M @ M.T + np.eye(30))
    thin = QPFactor(sparse.csr_array(np.diag(np.r_[np.ones(20), np.zeros(10)])))
    A, G = rng.standard_normal((2, 30)), rng.standard_normal((5, 30))
    tasks = []
    for _ in range(5):
        q, h = rng.standard_normal(30), rng.uniform(0.1, 1.0, 5)
        for factor, rows in ((dense, {"lb": -0.1}), (dense, {"A": A, "b": [0.1, 0.2], "ub": 0.3})):
            tasks.append((factor, q, rows))
        tasks.append((dense, q, {"G": G, "h": h}))
        tasks.append((thin, q, {"G": sparse.csr_array(G), "h": h, "lb": -1.0, "ub": 1.0}))

    def solved(factor, q, rows):
        result = solve_qp(factor, q, **rows)
        return result.x, result.y, result.z, result.z_box

    return [lambda task=task: solved(*task) for task in tasks]


def regulators():
    rng = np.random.default_rng(1)
    A, B = rng.standard_normal((12, 12)), rng.standard_normal((12, 2))
    T = sparse.csr_array(np.diag(-np.arange(1.0, 31.0)) + 0.3 * np.eye(30, k=1))
    wide, unseen = rng.standard_normal((1, 30)), np.diag([1.0, -2.0, 3.0])
    return [
        lambda: tuple(lqr(A, B, 1.0, np.eye(2)))[:2],
        lambda: (lqr(T, np.ones(30), wide, 1.0, factored=True).K,),
        lambda: (lqr(np.diag(T.toarray()), np.ones(30), 1.0, 1.0).K,),
        lambda: (lqe(A, np.eye(12), B.T, np.eye(12), np.eye(2)).K,),
        lambda: tuple(lqr(unseen, [[1e-7], [1.0], [1.0]], 1.0, 1.0))[:2],
    ]


def spectra():
    rng = np.random.default_rng(2)
    A, S = rng.standard_normal((300, 300)), sparse.random_array((400, 400), density=0.02, rng=rng)
    D = sparse.csr_array(S + sparse.diags_array(np.arange(400.0)))
    return [
        lambda: eigs(A, 4),
        lambda: eigs(D, 4, sigma=0.5),
        lambda: eigs(D, 3, which="LR"),
        lambda: svds(A, 3),
    ]


@pytest.mark.turns(4)
def test_quadratic_programs_on_shared_factors():
    same(programs(0), times=20)  # 400 of them


def test_regulators():
    before = list(warnings.filters)
    same(regulators(), times=8)
    assert list(warnings.filters) == before  # that all threads share


def test_eigenvalues_of_one_matrix():
    same(spectra(), times=4)


@pytest.mark.parametrize(
    "kind",
    [
        SuperLUFactor,
        pytest.param(PardisoFactor, marks=PARDISO),
    ],
)
def test_solves_with_one_factor(kind):
    n = 200
    K = sparse.csc_array(sparse.diags_array([4.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)))
    factor = kind(K)
    factor.factor(np.linspace(3.0, 5.0, n))
    same([lambda i=i: (factor.solve(np.eye(n)[i]),) for i in range(40)], times=10)


def test_a_launch_is_granted_the_memory_it_asks_for(monkeypatch):
    """One kernel serves all threads: another's smaller wish between must not take the memory."""
    refused = []

    class Kernel:
        max_dynamic_shared_size_bytes = arnoldi.DEVICE.shared

        def __call__(self, grid, block, arguments, shared_mem):
            time.sleep(1e-4)
            if shared_mem > self.max_dynamic_shared_size_bytes:
                refused.append(shared_mem)

    kernel = Kernel()
    monkeypatch.setattr(arnoldi, "kernel", lambda *_, **__: kernel)
    monkeypatch.setattr(arnoldi, "_granted", {})
    barrier = threading.Barrier(WORKERS)

    def launches(size):
        steps = object.__new__(arnoldi.FusedSteps)
        steps._device, steps._blocks, steps._arrived = 0, 1, 0
        barrier.wait()
        for _ in range(20):
            steps._launch("arnoldi_sweep", 1, size, lambda goal: ())

    everywhere([lambda size=size: launches(size) for size in range(49_000, 49_000 + WORKERS)])
    assert not refused


@pytest.mark.gpu
@pytest.mark.parametrize("n", [500, 2000])
def test_eigenvalues_of_one_matrix_on_a_device(n):
    """From three threads on it ended in a refused launch: spaces of several sizes at once."""
    import cupy

    A = cupy.asarray(np.random.default_rng(4).standard_normal((n, n)))
    S = cupy.asarray(np.diag(np.arange(float(n))) + 0.1)

    def found(matrix, k):
        stream = cupy.cuda.Stream(non_blocking=True) if k % 2 else cupy.cuda.Stream.null
        with stream:
            w, v = eigs(matrix, k)
            return w.get(), v.get()

    cupy.cuda.Device().synchronize()  # streams of their own see finished matrices
    same([lambda M=M, k=k: found(M, k) for M in (A, S) for k in (2, 5, 12, 30)], times=6)


@pytest.mark.gpu
def test_quadratic_programs_and_regulators_on_a_device():
    import cupy

    rng = np.random.default_rng(5)
    M = rng.standard_normal((200, 200))
    factor = QPFactor(cupy.asarray(M @ M.T + np.eye(200)))
    G, h = cupy.asarray(rng.standard_normal((20, 200))), cupy.full(20, 0.1)
    # Stable: thirty unstable modes and two inputs would be hard for any method.
    A, B = cupy.asarray(M[:60, :60] / 8 - np.eye(60)), cupy.asarray(M[:60, 60:62])
    q = [cupy.asarray(rng.standard_normal(200)) for _ in range(6)]
    tasks = [lambda q=q: (solve_qp(factor, q, G, h).x.get(),) for q in q]
    tasks.append(lambda: (lqr(A, B, 1.0, np.eye(2)).K.get(),))
    same(tasks, times=10)


# MKL takes its number of threads for good, so this runs in a process of its own.
AGAIN = """
import os
import numpy as np
from scipy import sparse
from gpu.arrays.sparse_factor import PardisoFactor

line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(60, 60))
one, rng = sparse.eye_array(60), np.random.default_rng(0)
H = sparse.kron(line, one) + sparse.kron(one, line)
C = sparse.random_array((900, 3600), density=0.002, rng=rng)
K = sparse.csc_array(sparse.block_array([[H, C.T], [C, -sparse.eye_array(900)]]))
factors, b = PardisoFactor(K), rng.standard_normal(4500)
for k in range(30):
    child = os.fork() if k == 15 and hasattr(os, "fork") else None
    diagonal = K.diagonal() * 10.0 ** rng.uniform(0.0, 0.2 * k, 4500)
    factors.factor(diagonal)
    x = factors.solve(b)
    r = b - K @ x - (diagonal - K.diagonal()) * x
    assert abs(r).max() <= 1e-9 * abs(b).max(), (k, abs(r).max())
    if child == 0:
        os._exit(7)
    if child:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
print("factored")
"""


@PARDISO
@pytest.mark.parametrize("threads", ["1", "2"])
def test_one_analysis_serves_many_factorisations(threads):
    done = subprocess.run(
        [sys.executable, "-c", AGAIN],
        env=os.environ | {"OMP_NUM_THREADS": threads, "MKL_NUM_THREADS": threads},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.stdout.strip() == "factored", done.stderr
