"""Without a device that answers, `backend="cupy"` says so in this package's own words."""

import sys
from types import SimpleNamespace

import pytest

from cip import Grid, InputError, MissingDependency, Solver


class CUDARuntimeError(RuntimeError):
    """As CuPy's, which is no ValueError either."""


def no_driver():
    raise CUDARuntimeError("cudaErrorInsufficientDriver: CUDA driver version is insufficient")


def test_cupy_without_a_device(monkeypatch):
    runtime = SimpleNamespace(CUDARuntimeError=CUDARuntimeError, getDeviceCount=no_driver)
    fake = SimpleNamespace(cuda=SimpleNamespace(runtime=runtime))
    monkeypatch.setitem(sys.modules, "cupy", fake)
    with pytest.raises(InputError, match=r"no CUDA device answers .cudaErrorInsuff"):
        Solver(Grid((0, 1), 8, periodic=True), 1.0, backend="cupy")


def test_no_cupy(monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(MissingDependency, match=r"pip install 'skfem-adini\[cuda13\]'"):
        Solver(Grid((0, 1), 8, periodic=True), 1.0, backend="cupy")
