"""The limit on OpenBLAS threads is lifted by the last one out and changes no result."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from contact import ContactProblem
from contact.arrays import blas_threads
from contact.arrays.blas_threads import one_blas_thread

threadpoolctl = pytest.importorskip("threadpoolctl")


def threads():
    """Number of threads of each OpenBLAS in the process."""
    controller = threadpoolctl.ThreadpoolController().select(internal_api="openblas")
    return [library["num_threads"] for library in controller.info()]


@pytest.fixture(autouse=True)
def two_threads():
    """Start from two threads, whatever the environment says; needs OpenBLAS."""
    if not threads():
        pytest.skip("NumPy and SciPy use no OpenBLAS here")
    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        yield


def test_nested_limits_end_with_the_outermost():
    before = threads()
    with one_blas_thread(100):
        with one_blas_thread(50):
            assert set(threads()) == {1}
        assert set(threads()) == {1}
    assert threads() == before
    assert max(before) == 2


def test_lifted_after_an_error():
    before = threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread(100):
        _ = 1 / 0
    assert threads() == before


def test_large_matrices_keep_their_threads():
    before = threads()
    with one_blas_thread(5000):
        assert threads() == before


def test_without_threadpoolctl_the_result_is_the_same(make, monkeypatch):
    body = make.block(6)
    limited = ContactProblem(body, "bottom", make.foundation[2], 0.9).solve()
    monkeypatch.setattr(blas_threads, "_openblas", lambda: None)
    plain = ContactProblem(body, "bottom", make.foundation[2], 0.9).solve()
    # Another split of the sums: round-off.
    assert np.abs(limited.u - plain.u).max() < 1e-13


def test_every_thread_can_limit():
    """One that was not the first to do so, too, and one that ends it for another."""
    with one_blas_thread(100):
        pass
    before = threads()

    def inside():
        with one_blas_thread(100):
            return threads()

    with ThreadPoolExecutor(1) as pool:
        assert set(pool.submit(inside).result()) == {1}
    assert threads() == before
