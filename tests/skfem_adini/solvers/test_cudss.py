"""cuDSS: results against dense algebra, errors, released handles; on a device or a fake library.

The fake reads the memory that the binding points at, as the library does, and factors with NumPy.
"""

import gc
import os
import pickle

import numpy as np
import pytest
from fake_cudss import FakeCudss
from scipy import sparse

from skfem_adini import InputError, MissingDependency, factorize
from skfem_adini.solvers import cudss, cudss_library


def _device():
    try:
        cudss_library.device_arrays()
        cudss_library.load_cudss()
    except MissingDependency:
        return False
    return True


@pytest.fixture
def fake(monkeypatch):
    library = FakeCudss()
    monkeypatch.setattr(cudss, "load_cudss", lambda: library)
    monkeypatch.setattr(cudss, "device_arrays", lambda: np)
    monkeypatch.setattr(cudss, "threading_layer", lambda: None)
    return library


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
@pytest.mark.parametrize("loads", [None, 0, 1, 5])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e11])
def test_solutions(engine, definite, loads, unit):
    n = 40
    A = unit * matrix(n, definite)
    shape = (n,) if loads is None else (n, loads)
    exact = np.random.default_rng(0).uniform(-1, 1, shape)
    factors = factorize(A, definite=definite, solver="cudss")
    for load in (A @ exact, np.asfortranarray(A @ exact)):
        x = factors.solve(load)
        assert x.shape == shape
        np.testing.assert_allclose(x, exact, atol=1e-12)


def test_saddle_point_with_zeros_on_the_diagonal(engine):
    A = sparse.csr_array([[0.0, 1, 2], [1, 0, 0], [2, 0, 1]])
    x = factorize(A, definite=False, solver="cudss").solve(A @ [1.0, 2, 3])
    np.testing.assert_allclose(x, [1, 2, 3], atol=1e-12)


def test_repetitions_and_copies_are_equal_bit_by_bit(engine):
    A, b = matrix(60, True), np.random.default_rng(1).uniform(-1, 1, 60)
    factors = factorize(A, solver="cudss")
    expected = factors.solve(b)
    for other in (factors, factorize(A, solver="cudss"), pickle.loads(pickle.dumps(factors))):
        np.testing.assert_array_equal(other.solve(b), expected)


def test_not_definite_and_singular(engine):
    A = sparse.csr_array([[1.0, 2], [2, 1]])
    with pytest.raises(InputError, match="singular or not positive definite"):
        factorize(A, solver="cudss")
    np.testing.assert_allclose(
        factorize(A, definite=False, solver="cudss").solve(np.array([5.0, 4])), [1, 2]
    )


@pytest.mark.parametrize("deterministic", [True, False])
def test_loads_one_by_one_or_together(engine, deterministic):
    A, exact = matrix(50, True), np.random.default_rng(4).uniform(-1, 1, (50, 3))
    factors = cudss.Cudss(A, True, deterministic)
    np.testing.assert_allclose(factors.solve(A @ exact), exact, atol=1e-12)
    if engine is not None:
        assert set(engine.solved) == {1 if deterministic else 3}
        assert engine.keys == {24: int(deterministic), 5: 0}


def test_the_columns_of_several_loads_are_those_of_each_alone(engine):
    A, b = matrix(60, True), np.random.default_rng(5).uniform(-1, 1, (60, 3))
    factors = cudss.Cudss(A, True)
    alone = np.column_stack([factors.solve(column) for column in b.T])
    np.testing.assert_array_equal(factors.solve(b), alone)


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


@pytest.mark.parametrize(
    "call", ["cudssConfigCreate", "cudssDataCreate", "cudssMatrixCreateCsr", "cudssExecute"]
)
def test_failed_construction_frees_every_handle(fake, call):
    fake.fail[call] = 4
    with pytest.raises(cudss_library.CudssError, match=f"{call} .* 4: not supported") as caught:
        cudss.Cudss(matrix(5, True), True)
    assert (caught.value.status, caught.value.pivot) == (4, False)
    assert fake.alive == {}


def test_handles_live_as_long_as_the_object(fake):
    factors = cudss.Cudss(matrix(5, True), True)
    assert len(fake.alive) == 4
    fake.fail["cudssExecute"] = 5
    with pytest.raises(cudss_library.CudssError, match="execution failed"):
        factors.solve(np.ones(5))
    assert len(fake.alive) == 4  # those of the columns are gone
    del factors
    gc.collect()
    assert fake.alive == {}


def test_memory_names_a_way_out(fake):
    fake.fail["cudssExecute"] = 2
    with pytest.raises(cudss_library.CudssError, match="solver='pardiso'"):
        factorize(matrix(5, True), solver="cudss")


def test_a_forked_process_is_refused(fake, monkeypatch):
    factors = cudss.Cudss(matrix(5, True), True)
    parent = os.getpid()
    monkeypatch.setattr(cudss.os, "getpid", lambda: parent + 1)
    with pytest.raises(cudss_library.AdiniError, match="forked"):
        factors.solve(np.ones(5))
    del factors
    gc.collect()
    assert len(fake.alive) == 4


def test_missing_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    monkeypatch.setattr(cudss, "load_cudss", lambda: FakeCudss())
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cudss\]"):
        factorize(matrix(5, True), solver="cudss")
