"""A CUDA device played by the host: names of CuPy over NumPy, kernels by a C++ compiler."""

import ctypes
import re
import shutil
import subprocess
import sys
import tempfile
import types
from functools import cache
from pathlib import Path

import numpy as np
import pytest

_HEAD = """
#include <math.h>
#define __global__
#define __device__
#define __forceinline__ inline
#define __shared__ static
#define __launch_bounds__(threads, blocks)
#include <string.h>
#include <functional>
#include <ucontext.h>
struct Three { int x, y; };
static Three blockIdx, threadIdx, blockDim;
static int __double2loint(double x) { int parts[2]; memcpy(parts, &x, 8); return parts[0]; }
static int __float_as_int(float x) { int whole; memcpy(&whole, &x, 4); return whole; }
static unsigned __float_as_uint(float x) { return __float_as_int(x); }
template <class T> void atomicMax(T* place, T value) { if (value > *place) *place = value; }
// Threads of a block that wait for each other take turns.
static ucontext_t scheduler, fibers[1024];
static char stacks[1024][32768];
static bool ended[1024];
static int turn;
static std::function<void()> body;
static void __syncthreads() { swapcontext(&fibers[turn], &scheduler); }
static void begin() { body(); ended[turn] = true; }
namespace kernels {
"""
# All threads one after another, in one order or in the opposite one.
_LAUNCH = """
extern "C" void launch(int gx, int gy, int bx, int by, int backward, %s) {
    const long long all = (long long)gx * gy * bx * by;
    blockDim = {bx, by};
    body = [&] { run(%s); };
    for (int q = 0; WAITS && q < gx * gy; q++) {
        blockIdx = {q %% gx, q / gx};
        for (int n = 0; n < bx * by; n++) {
            getcontext(&fibers[n]);
            fibers[n].uc_stack.ss_sp = stacks[n];
            fibers[n].uc_stack.ss_size = sizeof stacks[n];
            fibers[n].uc_link = &scheduler;
            makecontext(&fibers[n], begin, 0);
            ended[n] = false;
        }
        for (int left = bx * by; left > 0;)
            for (int n = 0; n < bx * by; n++) {
                turn = backward ? bx * by - 1 - n : n;
                if (ended[turn]) continue;
                threadIdx = {turn %% bx, turn / bx};
                swapcontext(&scheduler, &fibers[turn]);
                left -= ended[turn];
            }
    }
    for (long long q = 0; !WAITS && q < all; q++) {
        const long long p = backward ? all - 1 - q : q, block = p / (bx * by);
        threadIdx = {(int)(p %% bx), (int)(p / bx %% by)};
        blockIdx = {(int)(block %% gx), (int)(block / gx)};
        body();
    }
}
}
"""


class Array(np.lib.mixins.NDArrayOperatorsMixin):
    """An array that only the functions of `HostCupy` see into."""

    def __init__(self, host):
        self._host = host

    def __array__(self, *arguments, **options):
        raise TypeError("Implicit conversion to a NumPy array is not allowed")

    def __array_ufunc__(self, ufunc, method, *inputs, **options):
        return _wrapped(getattr(ufunc, method))(*inputs, **options)

    def __getattr__(self, name):
        found = getattr(self._host, name)
        if isinstance(found, np.ndarray):
            return Array(found)
        return _wrapped(found) if callable(found) else found

    def __getitem__(self, key):
        return Array(np.asarray(self._host[_inside(key)]))

    def __setitem__(self, key, value):
        self._host[_inside(key)] = _inside(value)

    def __len__(self):
        return len(self._host)

    def __float__(self):
        return float(self._host)

    def __int__(self):
        return int(self._host)

    def __bool__(self):
        return bool(self._host)

    def get(self):
        """A copy in NumPy."""
        return self._host.copy()


def _inside(value):
    if isinstance(value, np.ndarray):
        raise TypeError("Unsupported type numpy.ndarray")
    if isinstance(value, Array):
        return value._host
    return type(value)(map(_inside, value)) if isinstance(value, tuple | list) else value


def _wrapped(function):
    def call(*arguments, **options):
        named = {name: _inside(value) for name, value in options.items()}
        found = function(*map(_inside, arguments), **named)
        return Array(np.asarray(found)) if isinstance(found, np.ndarray | np.generic) else found

    return call


class _Ufuncs:
    """``cupy.add``, which is called or used by its method ``at``."""

    def __init__(self, ufunc):
        self._ufunc = ufunc

    def __call__(self, *arguments, **options):
        return _wrapped(self._ufunc)(*arguments, **options)

    def at(self, target, places, values):
        self._ufunc.at(target._host, _inside(places), _inside(values))


class HostCupy(types.ModuleType):
    """The names of CuPy that the package uses; `backward` turns the order of all threads."""

    ndarray = Array

    def __init__(self):
        super().__init__("cupy")
        self.backward = False
        runtime = types.SimpleNamespace(getDeviceCount=lambda: 1, CUDARuntimeError=RuntimeError)
        self.cuda = types.SimpleNamespace(runtime=runtime, is_available=lambda: True)
        self.add = _Ufuncs(np.add)

    def __getattr__(self, name):
        if name.startswith("__"):  # what tools ask of a module, its file for one
            raise AttributeError(name)
        return _wrapped(getattr(np, name))

    def asarray(self, values, dtype=None):
        """The only way from NumPy to the device."""
        host = values._host if isinstance(values, Array) else np.array(values)
        return Array(np.asarray(host, dtype=dtype))

    def RawModule(self, code, options):
        """Kernels of a source, compiled by a C++ compiler."""
        return types.SimpleNamespace(get_function=lambda name: _Kernel(self, _library(code)))


class Operator:
    """`cupyx.scipy.sparse.linalg.LinearOperator`, as far as the package uses it."""

    def __init__(self, shape, matvec, rmatvec, dtype):
        self.shape, self.dtype, self._matvec, self._rmatvec = shape, dtype, matvec, rmatvec

    def matvec(self, x):
        """The product with a vector."""
        assert x.shape == self.shape[1:]
        return self._matvec(x)

    def rmatvec(self, x):
        """The product of the transpose with a vector."""
        assert x.shape == self.shape[:1]
        return self._rmatvec(x)

    __matmul__ = matvec

    @property
    def T(self):
        """The transpose."""
        return Operator(self.shape[::-1], self._rmatvec, self._matvec, self.dtype)


class _Kernel:
    def __init__(self, device, library):
        self._device, self._library = device, library

    def __call__(self, grid, block, arguments):
        shape = [*grid, 1][:2] + [*block, 1][:2]
        self._library.launch(*shape, int(self._device.backward), *map(_argument, arguments))


def _argument(value):
    if isinstance(value, Array):
        assert value.flags.c_contiguous
        return ctypes.c_void_p(value._host.ctypes.data)
    kinds = {np.float32: ctypes.c_float, np.int32: ctypes.c_int, np.int64: ctypes.c_longlong}
    return kinds.get(type(value), ctypes.c_double)(value)


@cache
def _library(source):
    folder = Path(tempfile.mkdtemp(prefix="kernels"))
    try:
        text = folder / "kernels.cpp"
        (parameters,) = re.findall(r"void run\((.*?)\) \{", source)
        names = ", ".join(part.split()[-1].lstrip("*") for part in parameters.split(","))
        waits = f"\n#define WAITS {int('__syncthreads' in source)}\n"
        text.write_text(_HEAD + source + waits + _LAUNCH % (parameters, names))
        made = folder / "kernels.so"
        command = ["g++", "-std=c++14", "-O1", "-w", "-shared", "-fPIC", text, "-o", made]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(made))
    finally:
        shutil.rmtree(folder)


@pytest.fixture(params=["host", pytest.param("cuda", marks=pytest.mark.gpu)])
def cupy(request, monkeypatch):
    """CuPy where there is a device; on every machine the host in its place."""
    from cip.engines.cuda_kernels import compiled

    if request.param == "cuda":
        yield pytest.importorskip("cupy")
        return
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler: install g++")
    module = HostCupy()
    monkeypatch.setitem(sys.modules, "cupy", module)
    operators = types.SimpleNamespace(LinearOperator=Operator)
    for name in ("cupyx", "cupyx.scipy", "cupyx.scipy.sparse"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "cupyx.scipy.sparse.linalg", operators)
    compiled.cache_clear()
    yield module
    compiled.cache_clear()
