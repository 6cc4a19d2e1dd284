"""cuDSS: results against dense algebra, errors, released handles; on a device or a fake library."""

import gc
import os
import pickle
import signal
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from fake_cudss import FakeCudss
from scipy import sparse

from skfem_adini import AdiniError, InputError, MissingDependency, factorize
from skfem_adini.errors import SolverError
from skfem_adini.ground.arrays import host
from skfem_adini.ground.pardiso import upper_triangle
from skfem_adini.solvers import cudss, cudss_handles, cudss_library
from skfem_adini.solvers.cudss import CudssGeneralSchur, CudssSchur
from skfem_adini.solvers.device_triangle import DeviceTriangle, Restricted, Rows


def _device():
    try:
        cudss_library.device_arrays()
        cudss_library.load_cudss()
    except MissingDependency:
        return False
    return True


@pytest.fixture
def fake(monkeypatch):
    return FakeCudss().put_in_place(monkeypatch)


@pytest.fixture(params=["fake", pytest.param("device", marks=pytest.mark.gpu)])
def engine(request):
    if request.param == "fake":
        return request.getfixturevalue("fake")
    if not _device():
        pytest.skip("cuDSS, CuPy or a CUDA device is not there")
    return None


def matrix(n, definite):
    rng = np.random.default_rng(n)
    A = sparse.random_array((n, n), density=0.3, rng=rng)
    shift = 2 * n * np.where(np.arange(n) % 3 == 0, 1 if definite else -1, 1)
    return sparse.csr_array(A + A.T + sparse.diags_array(shift.astype(float)))


@pytest.mark.parametrize("definite", [True, False])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e11])
def test_solutions(engine, definite, unit):
    A = unit * matrix(40, definite)
    factors = factorize(A, definite=definite, solver="cudss")
    for shape in ((40,), (40, 0), (40, 1), (40, 5)):
        exact = np.random.default_rng(0).uniform(-1, 1, shape)
        for load in (A @ exact, np.asfortranarray(A @ exact)):
            x = factors.solve(load)
            assert x.shape == shape
            np.testing.assert_allclose(x, exact, atol=1e-12)
    saddle = sparse.csr_array([[0.0, 1, 2], [1, 0, 0], [2, 0, 1]])
    x = factorize(unit * saddle, definite=False, solver="cudss").solve(unit * saddle @ [1.0, 2, 3])
    np.testing.assert_allclose(x, [1, 2, 3], atol=1e-12)


def test_repetitions_and_copies_are_equal_bit_by_bit(engine):
    A, b = matrix(60, True), np.random.default_rng(1).uniform(-1, 1, (60, 3))
    factors = factorize(A, solver="cudss")
    expected = factors.solve(b)
    alone = np.column_stack([cudss.Cudss(A, True).solve(column) for column in b.T])
    np.testing.assert_array_equal(cudss.Cudss(A, True).solve(b), alone)
    for other in (factors, factorize(A, solver="cudss"), pickle.loads(pickle.dumps(factors))):
        np.testing.assert_array_equal(other.solve(b), expected)


def test_not_definite_and_singular(engine):
    A = sparse.csr_array([[1.0, 2], [2, 1]])
    with pytest.raises(InputError, match="singular or not positive definite"):
        factorize(A, solver="cudss")
    np.testing.assert_allclose(
        factorize(A, definite=False, solver="cudss").solve(np.array([5.0, 4])), [1, 2]
    )


def test_other_values_keep_the_analysis(engine):
    A, exact = matrix(40, True), np.random.default_rng(7).uniform(-1, 1, 40)
    factors = factorize(A, solver="cudss")
    other = A.copy()
    other.data *= 3.0
    other[0, 0] += 5.0
    factors.refactor(other)
    np.testing.assert_allclose(factors.solve(other @ exact), exact, atol=1e-12)
    if engine is not None:
        assert engine.phases.count(3) == 1
        assert engine.phases.count(8) == 1
    copied = pickle.loads(pickle.dumps(factors))
    np.testing.assert_allclose(copied.solve(other @ exact), exact, atol=1e-12)


def test_zeros_of_the_pattern_keep_their_places(engine):
    A = sparse.csr_array([[4.0, 1, 1], [1, 4, 1], [1, 1, 4]])
    factors = factorize(A, solver="cudss")
    other = A.copy()
    other.data[[2, 6]] = 0.0
    factors.refactor(other)
    np.testing.assert_allclose(factors.solve(other @ np.arange(3.0)), np.arange(3), atol=1e-14)


@pytest.mark.parametrize("solver", ["cudss", "superlu"])
def test_another_pattern_is_refused(engine, solver):
    A = matrix(40, True)
    factors = factorize(A, solver=solver)
    for other in (A + sparse.eye_array(40, k=39) + sparse.eye_array(40, k=-39), A[:20][:, :20]):
        with pytest.raises(InputError, match="not in the places"):
            factors.refactor(other)
    np.testing.assert_allclose(factors.solve(A @ np.ones(40)), 1.0, atol=1e-12)
    factors.refactor(2 * A)
    np.testing.assert_allclose(factors.solve(A @ np.ones(40)), 0.5, atol=1e-12)
    with pytest.raises(InputError, match="not definite"):
        factors.refactor(-A)


def test_an_order_is_handed_over(engine):
    A, order = matrix(40, True), np.random.default_rng(8).permutation(40)
    x = factorize(A, solver="cudss", order=order).solve(A @ np.ones(40))
    np.testing.assert_allclose(x, 1.0, atol=1e-12)
    if engine is not None:
        np.testing.assert_array_equal(engine.orders, [order])


@pytest.mark.parametrize("hybrid", [True, 2**30])
def test_factors_on_the_host(engine, hybrid):
    A = matrix(40, True)
    x = factorize(A, solver="cudss", hybrid_memory=hybrid).solve(A @ np.ones((40, 2)))
    np.testing.assert_allclose(x, 1.0, atol=1e-12)
    if engine is not None:
        assert engine.keys[24] == 0
        assert (engine.keys[11], engine.keys.get(12)) == (1, None if hybrid is True else hybrid)


def test_bad_options(fake):
    A = matrix(5, True)
    for order in (np.zeros(5, dtype=int), np.arange(4), np.arange(5) + 0.5):
        with pytest.raises(InputError, match="order: expected the numbers 0 to 4"):
            factorize(A, solver="cudss", order=order)
    for devices in ((), (0, 0), (-1,), (0.5,), 3, "ab"):
        with pytest.raises(InputError, match=r"devices=.*: expected different numbers"):
            factorize(A, solver="cudss", devices=devices)
    assert fake.calls == []
    for option in ({"order": [0, 1, 2]}, {"hybrid_memory": True}, {"devices": (0, 1)}):
        with pytest.raises(InputError, match="for solver='cudss', not 'superlu'"):
            factorize(matrix(3, True), solver="superlu", **option)
    with pytest.raises(InputError, match="deterministic"):
        cudss.Cudss(matrix(3, True), True, hybrid_memory=True)
    with pytest.raises(InputError, match="devices: cuDSS has no deterministic mode"):
        cudss.Cudss(matrix(3, True), True, devices=(0, 1))
    with pytest.raises(InputError, match="hybrid_memory: it is for one device"):
        factorize(matrix(3, True), solver="cudss", hybrid_memory=True, devices=(0, 1))


def test_several_devices_share_the_factors(fake):
    A, exact = matrix(40, True), np.random.default_rng(3).uniform(-1, 1, (40, 3))
    factors = factorize(A, solver="cudss", devices=(1, 0))
    np.testing.assert_allclose(factors.solve(A @ exact), exact, atol=1e-12)
    assert fake.devices == [1, 0]
    assert (fake.keys[21], fake.keys[22], fake.keys[24]) == (2, [1, 0], 0)
    assert "cudssCreate" not in fake.calls
    factors.refactor(2 * A)
    copied = pickle.loads(pickle.dumps(factors))
    for one in (factors, copied):
        np.testing.assert_allclose(one.solve(A @ exact), exact / 2, atol=1e-12)
    del factors, copied, one
    gc.collect()
    assert fake.alive == {}


def test_a_device_that_is_not_there(fake, monkeypatch):
    fake.installed = 2
    with pytest.raises(SolverError, match=r"cudssCreateMg .* invalid value"):
        factorize(matrix(5, True), solver="cudss", devices=(0, 2))
    monkeypatch.setattr(cudss_library, "device_count", lambda xp: 2)
    with pytest.raises(InputError, match="device 2 is not there, 2 answer; take numbers below 2"):
        factorize(matrix(5, True), solver="cudss", devices=(0, 2))
    assert fake.alive == {}


def test_a_handle_that_comes_with_an_error_is_freed(fake):
    opened = fake._cudssCreateMg

    def half_open(*arguments):
        opened(*arguments)
        return 2

    fake._cudssCreateMg = half_open
    with pytest.raises(SolverError, match="allocation failed"):
        factorize(matrix(5, True), solver="cudss", devices=(0, 1))
    assert fake.alive == {}


def test_the_memory_of_all_devices_counts(fake, monkeypatch):
    fake.estimates[1] = 6 * 2**30
    monkeypatch.setattr(cudss, "free_memory", lambda xp: 4 * 2**30)
    with pytest.raises(SolverError, match="4 GiB are free"):
        factorize(matrix(5, True), solver="cudss")
    free = iter([7, 6, 4, 4, 5, 4])  # GiB of each of two before, at the estimate, and after
    monkeypatch.setattr(cudss, "free_memory", lambda xp: next(free) * 2**30)
    shared = cudss.Cudss(matrix(5, True), True, False, devices=(0, 1))
    assert shared.statistics()["used"] == (2 * 2**30, 2 * 2**30)
    monkeypatch.setattr(cudss, "free_memory", lambda xp: 4 * 2**30)
    fake.estimates[1] = 9 * 2**30
    with pytest.raises(SolverError, match="8 GiB are free"):
        factorize(matrix(5, True), solver="cudss", devices=(0, 1))


@pytest.mark.parametrize(
    ("free", "hybrid", "remedy"),
    [
        (5, False, r"5 GiB are free; take hybrid_memory=True, which needs 2 GiB .* or solver"),
        (1, False, r"1 GiB are free; take solver='pardiso' on the host"),
        (1, True, r"needs 2 GiB .* take solver='pardiso' on the host"),
    ],
)
def test_factors_that_do_not_fit_are_foreseen(fake, monkeypatch, free, hybrid, remedy):
    fake.estimates[1], fake.estimates[4] = 6 * 2**30, 2 * 2**30
    monkeypatch.setattr(cudss, "free_memory", lambda xp: free * 2**30)
    with pytest.raises(SolverError, match=remedy) as caught:
        factorize(matrix(5, True), solver="cudss", hybrid_memory=hybrid)
    assert caught.value.free == free * 2**30
    assert 4 not in fake.phases
    assert fake.alive == {}
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    monkeypatch.setattr(cudss, "free_memory", lambda xp: 6 * 2**30)
    factorize(matrix(5, True), solver="cudss", hybrid_memory=hybrid)


class _Device:
    """What the foresight of memory asks of CuPy, for four bytes that nobody keeps and two kept."""

    def __init__(self):
        self.released = False
        self.cuda = SimpleNamespace(
            Device=nullcontext,
            runtime=SimpleNamespace(memGetInfo=lambda: (4 + 2 * self.released, 8)),
        )

    def get_default_memory_pool(self):
        return SimpleNamespace(free_all_blocks=lambda: setattr(self, "released", True))


@pytest.mark.parametrize(("needed", "released", "fits"), [(4, 0, 1), (5, 1, 1), (7, 1, 0)])
def test_memory_that_cupy_keeps_is_released_where_it_is_needed(needed, released, fits):
    device = _Device()
    handles = SimpleNamespace(xp=device, get=lambda key, out: [0, needed - 1] + [0] * 14)
    with nullcontext() if fits else pytest.raises(SolverError):
        cudss.check_memory(handles, hybrid=False, more=1)
    assert device.released == released


def test_statistics_and_the_way_out_of_too_little_memory(fake):
    fake.estimates[1], fake.estimates[3] = 7, 8
    found = cudss.Cudss(matrix(5, True), True).statistics()
    assert found == {"entries": 15, "device": 7, "host": 8, "used": ()}
    fake.fail["cudssExecute"] = 2
    with pytest.raises(SolverError, match="solver='pardiso'"):
        factorize(matrix(5, True), solver="cudss")


@pytest.fixture
def ctrl_c():
    """Ctrl-C raises KeyboardInterrupt, also where the tests were started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("phase", [3, 4])
def test_an_interrupt_ends_the_factorisation(fake, ctrl_c, phase):
    fake.during[phase] = lambda: interrupted(fake)
    with pytest.raises(KeyboardInterrupt):
        factorize(matrix(5, True), solver="cudss")
    assert fake.phases[-1] == phase
    assert fake.seen
    assert fake.alive == {}


def test_factors_are_gone_after_an_interrupt_and_come_again(fake, ctrl_c):
    A = matrix(5, True)
    factors = cudss.Cudss(A, True)
    fake.during[8] = lambda: interrupted(fake)
    with pytest.raises(KeyboardInterrupt):
        factors.refactor(A)
    with pytest.raises(AdiniError, match="did not end; call refactor"):
        factors.solve(np.ones(5))
    fake.during.clear()
    factors.refactor(A)
    np.testing.assert_allclose(factors.solve(A @ np.ones(5)), 1.0, atol=1e-12)


def interrupted(fake):
    """What Ctrl-C does while the library works: it sees the flag, and then only stops."""
    kept = (content for content in fake.alive.values() if isinstance(content, dict))
    flag = next(content["interrupt"] for content in kept if "interrupt" in content)
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    end = time.monotonic() + 30
    while not flag[0] and time.monotonic() < end:
        time.sleep(1e-3)
    fake.seen = bool(flag[0])


@pytest.mark.parametrize("kind", ["sorted", "unsorted", "zeros", "lower only"])
def test_the_triangle_is_that_of_the_host(kind):
    A = matrix(30, True)
    if kind == "unsorted":
        A = sparse.csr_array((A.data[::-1], A.indices[::-1], len(A.data) - A.indptr[::-1]))
        A.has_sorted_indices = False
    if kind == "zeros":
        A.data[(A.indices == 3) | (np.repeat(np.arange(30), np.diff(A.indptr)) == 3)] = 0.0
        A.eliminate_zeros()
    if kind == "lower only":
        A = sparse.csr_array(sparse.tril(A))
    expected = upper_triangle(A)
    starts, columns, values = DeviceTriangle(np, A).arrays(A)
    np.testing.assert_array_equal(starts, expected.indptr)
    np.testing.assert_array_equal(columns, expected.indices)
    np.testing.assert_array_equal(values, expected.data)
    assert (starts.dtype, columns.dtype) == (np.int32, np.int32)


@pytest.mark.parametrize("corrected", [True, False])
@pytest.mark.parametrize("count", [None, 1, 40])
def test_solutions_at_some_unknowns(engine, corrected, count):
    A, places = matrix(60, True), np.array([2, 3, 31, 59])
    loads = np.random.default_rng(3).uniform(-1, 1, (4,) if count is None else (4, count))
    expected = np.linalg.inv(A.toarray())[np.ix_(places, places)] @ loads
    found = cudss.Cudss(A, True).at(places, loads, corrected)
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("loads", [1, 32, 70])
def test_corrections_come_from_the_present_values(engine, loads):
    A = matrix(60, True)
    factors = cudss.Cudss(A, True)
    exact = np.random.default_rng(2).uniform(-1, 1, (60, loads))
    for scale in (1.0, 3.0):
        factors.refactor(scale * A)
        np.testing.assert_allclose(factors.solve(scale * A @ exact), exact, atol=1e-12)


@pytest.mark.parametrize("deterministic", [True, False])
@pytest.mark.parametrize("rows", [1, 32, 75])
def test_congruence(engine, deterministic, rows):
    A, rng = matrix(80, True), np.random.default_rng(7)
    R = sparse.csr_array(sparse.random_array((rows, 80), density=0.05, rng=rng))
    factors = cudss.Cudss(A, True, deterministic)
    W = factors.congruence(R)
    W = W.get() if hasattr(W, "get") else W
    np.testing.assert_array_equal(W, W.T)
    expected = R @ np.linalg.solve(A.toarray(), R.toarray().T)
    np.testing.assert_allclose(W, expected, atol=1e-13 * np.abs(expected).max())
    if engine is not None:
        together = 1 if deterministic else min(rows, 32)
        assert engine.solved == [together] * -(-rows // together)
        assert engine.keys == {24: int(deterministic), 5: 0}
    exact = rng.uniform(-1, 1, (80, 3))
    np.testing.assert_allclose(factors.solve(A @ exact), exact, atol=1e-12)
    if engine is not None:
        assert engine.solved[-1] == (1 if deterministic else 3)


@pytest.mark.parametrize("error", [0.0, 1e-6, 0.5, 3.0])
def test_corrections_lower_the_residual_or_stop(fake, error):
    A, exact = matrix(40, True), np.random.default_rng(6).uniform(-1, 1, (40, 2))
    b = A @ exact
    factors = cudss.Cudss(A, True)
    fake.error = error
    noise = 1 + error * np.sin(np.arange(40))[:, None]
    first = np.abs(b - A @ (noise * exact)).max(axis=0)
    left = np.abs(b - A @ factors.solve(b)).max(axis=0)
    # Two corrections leave the cube of the error; one that diverges leaves the first solution.
    bound = min(1.0, 20 * error**2) * first
    assert (left <= bound + 1e-13 * np.abs(b).max()).all()
    assert len(fake.solved) <= 2 * 3


CALLS = ["cudssConfigCreate", "cudssDataCreate", "cudssMatrixCreateCsr", "cudssExecute"]
ON_SEVERAL = ["cudssCreateMg", "cudssConfigSet", "cudssExecute"]


@pytest.mark.parametrize(
    ("call", "devices"),
    [*((call, None) for call in CALLS), *((call, (0, 1)) for call in ON_SEVERAL)],
)
def test_failed_construction_frees_every_handle(fake, call, devices):
    fake.fail[call] = 4
    with pytest.raises(SolverError, match=f"{call} .* 4: not supported") as caught:
        factorize(matrix(5, True), solver="cudss", devices=devices)
    assert (caught.value.status, caught.value.pivot) == (4, False)
    assert fake.alive == {}


def test_handles_live_as_long_as_the_object(fake):
    factors = cudss.Cudss(matrix(5, True), True)
    assert len(fake.alive) == 4
    fake.fail["cudssExecute"] = 5
    with pytest.raises(SolverError, match="execution failed"):
        factors.solve(np.ones(5))
    assert len(fake.alive) == 4  # those of the columns are gone
    del factors
    gc.collect()
    assert fake.alive == {}


def test_a_forked_process_is_refused(fake, monkeypatch):
    factors = cudss.Cudss(matrix(5, True), True)
    parent = os.getpid()
    monkeypatch.setattr(cudss_handles.os, "getpid", lambda: parent + 1)
    with pytest.raises(AdiniError, match="forked"):
        factors.solve(np.ones(5))
    del factors
    gc.collect()
    assert len(fake.alive) == 4


def test_missing_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    monkeypatch.setattr(cudss_handles, "load_cudss", lambda: FakeCudss())
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cudss\]"):
        factorize(matrix(5, True), solver="cudss")


def test_a_restricted_matrix_is_that_of_the_host(fake):
    A, rng = matrix(30, True), np.random.default_rng(9)
    free, scale = np.sort(rng.choice(30, 20, replace=False)), np.ldexp(1.0, rng.integers(-3, 3, 20))
    restricted = Restricted(A, free, scale)
    expected = upper_triangle(restricted.on_host())
    triangle = DeviceTriangle(np, restricted)
    for ours, theirs in zip(
        triangle.arrays(restricted), (expected.indptr, expected.indices, expected.data), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)
    with pytest.raises(InputError, match="not in the places"):
        triangle.values(Restricted(A, free[1:], scale[1:]))
    A.sum_duplicates()
    asked = []
    there = Restricted(lambda: asked.append(1) or A, free, scale, (A.indptr, A.indices, A.data))
    placed = DeviceTriangle(np, there)
    for ours, theirs in zip(placed.arrays(there), triangle.arrays(restricted), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert not asked  # for the matrix on the host, which only another pattern or a copy needs
    np.testing.assert_array_equal(placed.values(restricted), triangle.values(there))
    with pytest.raises(InputError, match="not in the places"):
        placed.values(Restricted(A, free[1:], scale[1:]))
    copied = pickle.loads(pickle.dumps(there))
    assert copied.placed is None
    assert abs(copied.on_host() - restricted.on_host()).max() == 0.0
    S = CudssSchur(restricted, [3, 5]).complement
    np.testing.assert_allclose(S, CudssSchur(restricted.on_host(), [3, 5]).complement, atol=1e-12)


@pytest.mark.parametrize("n", [7, 60])
def test_partial_factors_without_symmetry(engine, n):
    rng, last = np.random.default_rng(n), np.array([1, n // 2, n - 1])
    A = sparse.csr_array(matrix(n, True) + sparse.random_array((n, n), density=0.2, rng=rng))
    A.sort_indices()
    inner = np.setdiff1d(np.arange(n), last)
    factors = CudssGeneralSchur(Rows(A.indptr, A.indices, A.data), last)
    put, load = factors.placed, rng.standard_normal(n)
    for scale in (1.0, -3.0):
        S = scale * A.toarray()
        expected = S[np.ix_(last, last)] - S[np.ix_(last, inner)] @ np.linalg.solve(
            S[np.ix_(inner, inner)], S[np.ix_(inner, last)]
        )
        found = host(factors.complement)
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(S).max())
        halfway = factors.forward(load).copy()
        halfway[-3:] = put(np.linalg.solve(expected, host(halfway[-3:])))
        x = host(factors.backward(halfway)).copy()
        x[last] = host(halfway[-3:])
        np.testing.assert_allclose(S @ x, load, atol=1e-12 * np.abs(S).max())
        factors.refactor(Rows(A.indptr, A.indices, -3.0 * A.data))
    with pytest.raises(InputError, match="not in the places"):
        factors.refactor(Rows(A.indptr, A.indices[::-1], A.data))
    singular = A.toarray()
    singular[inner[0], inner] = 0.0
    rows, columns = A.nonzero()
    with pytest.raises(SolverError, match="pivot"):
        factors.refactor(Rows(A.indptr, A.indices, singular[rows, columns]))
