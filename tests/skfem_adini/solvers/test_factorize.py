"""Factors of symmetric sparse matrices: PARDISO, SuperLU; shared, copied, forked, given back."""

import copy
import gc
import os
import pickle
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optional_packages import AMG, PARDISO
from scipy import sparse
from skfem import Basis, MeshHex, MeshQuad
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import AdiniError, ElementHexAdini, ElementQuadAdini, InputError, factorize
from skfem_adini.errors import SolverError
from skfem_adini.ground import pardiso
from skfem_adini.solvers import factorize as sparse_solve

SOLVERS = [pytest.param("pardiso", marks=PARDISO), "superlu"]


def random_matrix(n, seed, definite=True):
    rng = np.random.default_rng(seed)
    A = sparse.random_array((n, n), density=0.2, rng=rng)
    size = 10.0 ** rng.uniform(-6, 6, n)
    sign = np.ones(n) if definite else rng.choice([-1.0, 1.0], n)
    D = sparse.diags_array(size)
    return (D @ (A + A.T + sparse.diags_array(n * sign)) @ D).tocsr()


@pytest.mark.parametrize("definite", [True, False])
@pytest.mark.parametrize("solver", SOLVERS)
@given(n=st.integers(1, 40), seed=st.integers(0, 999), loads=st.integers(0, 3))
def test_solution_of_badly_scaled_matrices(solver, definite, n, seed, loads):
    A = random_matrix(n, seed, definite)
    exact = np.random.default_rng(seed).uniform(1, 2, (n, loads) if loads else n)
    D = 1 / np.sqrt(np.abs(A.diagonal()))
    exact = (exact.T * D).T
    x = factorize(A, definite, solver).solve(A @ exact)
    np.testing.assert_allclose(x, exact, rtol=1e-11)


def test_without_pypardiso(monkeypatch):
    monkeypatch.setattr(sparse_solve, "has_pardiso", lambda: False)
    assert factorize(sparse.eye_array(2)).solve(np.ones(2)).tolist() == [1, 1]
    with pytest.raises(skfem_adini.MissingDependency, match=r"pip install 'skfem-adini\[mkl\]'"):
        factorize(sparse.eye_array(2), solver="pardiso")


NEUMANN = laplace.assemble(Basis(MeshQuad().refined(2), ElementQuadAdini()))
ASYMMETRIC = sparse.csr_array([[2.0, 1.0], [0.0, 2.0]])

CASES = {
    "singular": (lambda s: factorize(NEUMANN, True, s), "singular"),
    "zero row": (lambda s: factorize(sparse.diags_array([1.0, 0.0]), False, s), "row is zero"),
    "zero pivot": (lambda s: factorize(sparse.diags_array([1.0, 0.0]), True, s), "diagonal"),
    "not symmetric": (lambda s: factorize(ASYMMETRIC, True, s), "symmetric"),
    "not square": (lambda s: factorize(ASYMMETRIC[:1], True, s), "square"),
    "empty": (lambda s: factorize(sparse.csr_array((0, 0)), True, s), "square"),
    "NaN": (lambda s: factorize(sparse.diags_array([1.0, np.nan]), True, s), "NaN"),
    "unknown solver": (lambda _: factorize(ASYMMETRIC, True, "umfpack"), "umfpack"),
    "wrong load": (lambda s: factorize(sparse.eye_array(3), True, s).solve(np.ones(2)), "3 rows"),
}


@pytest.mark.parametrize("solver", SOLVERS)
def test_matrices_that_are_refused(solver):
    for attempt, message in CASES.values():
        with pytest.raises(InputError, match=message):
            attempt(solver)


@PARDISO
def test_pardiso_finds_an_indefinite_matrix():
    A = sparse.csr_array([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(InputError, match="definite"):
        factorize(A, definite=True, solver="pardiso")
    np.testing.assert_allclose(factorize(A, definite=False).solve(A @ [3.0, 4.0]), [3, 4])
    # Constrained problems have zeros on the diagonal, and PARDISO wants them stored.
    A = sparse.csr_array([[0.0, 1, 2], [1, 0, 0], [2, 0, 1]])
    x = factorize(A, definite=False, solver="pardiso").solve(A @ [1.0, 2, 3])
    np.testing.assert_allclose(x, [1, 2, 3], atol=1e-12)


@pytest.mark.parametrize("solver", ["auto", "superlu"])
def test_complex_loads_and_matrices(solver):
    """The imaginary part of a load was dropped, and that of a matrix."""
    rng = np.random.default_rng(1)
    A = sparse.diags_array(rng.uniform(1, 2, 9)).tocsr()
    b = rng.standard_normal((9, 2)) + 1j * rng.standard_normal((9, 2))
    factors = factorize(A, solver=solver)
    for load in (b, b[:, 0]):
        np.testing.assert_allclose(A @ factors.solve(load), load, rtol=1e-14)
    assert factors.solve(b.real).dtype == np.float64
    assert np.array_equal(factorize(A + 0j, solver=solver).solve(b.real), factors.solve(b.real))
    with pytest.raises(InputError, match="A: expected real numbers"):
        factorize(A + 1e-3j * sparse.eye_array(9), solver=solver)
    for bad in (np.nan, np.inf, np.inf * 1j):
        with pytest.raises(InputError, match="b: the load holds NaN"):
            factors.solve(np.full(9, bad))
    for bad in ("load", None, [None] * 9):
        with pytest.raises(InputError, match=r"b: (expected|the load)"):
            factors.solve(bad)


# The one call of PARDISO: phases, Schur complements, partial solutions, errors, release.


def dominant(n, seed):
    rng = np.random.default_rng(seed)
    A = sparse.random_array((n, n), density=0.3, rng=rng)
    return sparse.csr_array(A + A.T + 2 * n * sparse.eye_array(n))


@PARDISO
@given(n=st.integers(3, 25), seed=st.integers(0, 99), share=st.floats(0.1, 0.6))
def test_schur_complement_and_partial_solutions(n, seed, share):
    """Forward elimination leaves the reduced load, backward gives all unknowns from the chosen."""
    A = dominant(n, seed)
    chosen = np.sort(np.random.default_rng(seed).permutation(n)[: max(1, int(share * n))])
    inner = np.setdiff1d(np.arange(n), chosen)
    dense = A.toarray()
    coupling = dense[np.ix_(chosen, inner)] @ np.linalg.inv(dense[np.ix_(inner, inner)])
    expected = dense[np.ix_(chosen, chosen)] - coupling @ dense[np.ix_(inner, chosen)]

    solver = pardiso.Pardiso(A, pardiso.DEFINITE, {1: 3, 23: 1, 35: 2}, chosen)
    block = np.zeros((chosen.size, chosen.size))
    solver(11)
    solver(22, x=block)
    np.testing.assert_allclose((block + block.T) / 2, expected, atol=1e-10)

    exact = np.random.default_rng(seed + 1).uniform(-1, 1, n)
    load, half, x = A @ exact, np.zeros(n), np.zeros(n)
    other, again = pickle.loads(pickle.dumps(solver)), np.zeros(n)
    solver(331, load, half)
    other(331, load, again)  # a copy has a Schur complement of its own
    np.testing.assert_array_equal(again, half)
    reduced = load[chosen] - coupling @ load[inner]
    np.testing.assert_allclose(half[chosen], reduced, atol=1e-10)
    half[chosen] = exact[chosen]
    solver(333, half, x)
    np.testing.assert_allclose(x[inner], exact[inner], atol=1e-11)


@PARDISO
def test_pivots_are_told_from_other_errors():
    solver = pardiso.Pardiso(sparse.csr_array([[1.0, 2], [2, 1]]), pardiso.DEFINITE)
    with pytest.raises(SolverError, match="phase 12 failed with code -4") as caught:
        solver(12)
    assert caught.value.pivot
    solver = pardiso.Pardiso(dominant(3, 0), pardiso.DEFINITE)
    with pytest.raises(SolverError, match="phase 99") as caught:
        solver(99)
    assert not caught.value.pivot


@PARDISO
def test_what_would_end_the_process_is_refused():
    """PARDISO reads whatever memory it is pointed at."""
    solver = pardiso.Pardiso(dominant(4, 0), pardiso.DEFINITE)
    b, x = np.ones(4), np.zeros(4)
    with pytest.raises(AdiniError, match="phase 33 needs a factorisation"):
        solver(33, b, x)
    solver(12)
    with pytest.raises(AdiniError, match="after phase 12 no phase 22"):
        solver(22)
    columns = np.ones((4, 2))
    for bad in (None, np.ones(3), np.ones(4, dtype=np.float32), np.ones(8)[::2], columns):
        with pytest.raises(AdiniError, match="float64 in Fortran order with 4 rows"):
            solver(33, bad, x)
    solver(33, b, x)
    np.testing.assert_allclose(dominant(4, 0) @ x, b)


@pytest.fixture
def phases(monkeypatch):
    """What PARDISO is asked for."""
    library, found = pardiso._library(), []

    def watched(*arguments):
        found.append(arguments[4]._obj.value)
        return library(*arguments)

    monkeypatch.setattr(pardiso, "_library", lambda: watched)
    return found


@PARDISO
def test_memory_is_given_back_where_nothing_can_be_imported(phases, monkeypatch):
    """The garbage collector may release a factor anywhere, with any modules hidden."""
    solver = pardiso.Pardiso(dominant(5, 0), pardiso.DEFINITE)
    solver(12)
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    del solver
    assert phases == [12, -1]


# Factors shared by threads, copied, pickled, inherited by a fork, and given back once.


KINDS = [(solver, definite) for solver in ("pardiso", "superlu") for definite in (True, False)]
ALL = [
    *(pytest.param(*kind, marks=PARDISO if kind[0] == "pardiso" else ()) for kind in KINDS),
    pytest.param("amg", True, marks=AMG),
]


@cache
def plate(n, definite=True):
    """The Laplacian on the unit square, or one shifted into the middle of its spectrum."""
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2), ElementQuadAdini())
    free = skfem_adini.UniformSolver((n, n)).free
    A = laplace.assemble(basis) - (0.0 if definite else 100.0) * mass.assemble(basis)
    return A[free][:, free]


@cache
def brick():
    basis = Basis(MeshHex().refined(2), ElementHexAdini())
    return laplace.assemble(basis) + mass.assemble(basis), skfem_adini.near_null_space(basis)


def factor(solver, definite=True, n=16):
    if solver == "amg":
        A, near_null = brick()
        return factorize(A, solver="amg", near_null=near_null)
    return factorize(plate(n, definite), definite, solver)


def loads(factors, count):
    rows = len(factors._scale)
    return list(np.random.default_rng(0).standard_normal((count, rows)))


@pytest.mark.parametrize(("solver", "definite"), ALL)
def test_threads_get_what_one_alone_gets(solver, definite):
    """400 solutions by 8 threads, to the last bit; 44 were wrong, by up to 190 %."""
    factors = factor(solver, definite)
    b = loads(factors, 24 if solver == "amg" else 400)
    alone = [factors.solve(load) for load in b]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(factors.solve, b))
    assert all(map(np.array_equal, alone, together))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", SOLVERS)
def test_factors_made_and_dropped_in_threads(solver):
    """Factors of several sizes, made, used and given back at the same time."""
    sizes = [6, 10, 14, 18] * 6
    b = {n: np.random.default_rng(n).standard_normal(plate(n).shape[0]) for n in sizes}
    alone = {n: factor(solver, n=n).solve(b[n]) for n in sizes}

    def whole(n):
        factors = factor(solver, n=n)
        x = factors.solve(b[n])
        del factors
        gc.collect()
        return x

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(whole, sizes))
    assert all(np.array_equal(x, alone[n]) for n, x in zip(sizes, found, strict=True))


COPIES = [
    copy.copy,
    lambda factors: pickle.loads(pickle.dumps(factors)),
    lambda factors: copy.deepcopy(copy.deepcopy(factors)),
]


@pytest.mark.parametrize(("solver", "definite"), ALL)
def test_copies_live_on_their_own(solver, definite):
    """The memory of a factor was shared by its copies, and used after it had been given back."""
    for copied in COPIES:
        factors = factor(solver, definite)
        (load,) = loads(factors, 1)
        expected = factors.solve(load)
        first, second = copied(factors), copied(factors)
        del first
        gc.collect()
        assert np.array_equal(factors.solve(load), expected)
        del factors
        gc.collect()
        assert np.array_equal(second.solve(load), expected)


@PARDISO
def test_memory_of_copies_is_given_back_once(phases):
    """Each factor has one release of its own, also where its copy never factored."""
    solver = pardiso.Pardiso(plate(6), pardiso.DEFINITE)
    solver(12)
    unused, used = copy.deepcopy(solver), copy.deepcopy(solver)
    b = np.ones(plate(6).shape[0])
    used(33, b, np.zeros_like(b))
    solver(-1)
    for each in (solver, unused, used):
        each.__del__()
    del solver, unused, used, each
    gc.collect()
    assert phases == [12, 12, 33, -1, -1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
@PARDISO
def test_a_forked_process_inherits_the_factors():
    """Also while other threads are at work in them: a fork waits for the end of their calls."""
    factors = factor("pardiso", n=12)
    (load,) = loads(factors, 1)
    expected, stop = factors.solve(load), threading.Event()

    def work():
        while not stop.is_set():
            factors.solve(load)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        codes = [in_child(factors, load, expected) for _ in range(5)]
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert codes == [0] * 5


def in_child(factors, load, expected):
    child = os.fork()
    if child == 0:
        # No assertion and no pytest in here: the child must leave by this door.
        signal.alarm(60)  # a child that hangs ends by it
        same = np.array_equal(factors.solve(load), expected)
        same = same and np.array_equal(copy.deepcopy(factors).solve(load), expected)
        os._exit(0 if same else 1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
