"""Factors of a symmetric matrix on a CUDA device by NVIDIA's cuDSS, and solutions by them.

The binding is by ctypes because nvmath-python, which has one, needs a version of cuDSS before
1.0, whose numbers differ. Source: NVIDIA cuDSS 1.0 documentation, data types and functions.
"""

from __future__ import annotations

import ctypes
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from skfem_adini.errors import AdiniError, InputError
from skfem_adini.ground.arrays import host
from skfem_adini.solvers.cudss_handles import CudssHandles, on_device, permutation
from skfem_adini.solvers.cudss_library import (
    CODES,
    chosen_devices,
    device_arrays,
    failed,
    too_large,
)
from skfem_adini.solvers.device_triangle import DeviceRows, DeviceTriangle, on_host_alone

Array = NDArray[np.float64]
Blocks = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]  # of a `DissectionTree`
Order = ArrayLike | Blocks | Callable[[], Blocks | None] | None


_TOGETHER = 32  # maximal number of loads on the device at a time


class CudssMatrix:
    """One symmetric matrix and its factors in the memory of a CUDA device, freed with the object.
    Threads use it one after another; a copy or pickle factors again; forked processes cannot use
    it. Ctrl-C ends a call early, except on several devices; then `refactor` is needed."""

    def __init__(
        self, A: Any, definite: bool, deterministic: bool = True, order: Order = None,
        hybrid_memory: bool | int = False, devices: Iterable[int] | None = None,
    ) -> None:  # fmt: skip
        """Factor the upper triangle of A, (n, n); `deterministic`: equal bits on one device.
        `order[k]` is the unknown of step k, with sizes of a `DissectionTree` in a tuple. The
        host keeps factors beyond `hybrid_memory` bytes, or `devices` share them."""
        _refuse(deterministic, hybrid_memory, devices)
        self._deterministic, self._hybrid = deterministic, hybrid_memory
        self._n, self._lock, self._factored = A.shape[0], threading.Lock(), False
        if not (order is None or callable(order) or isinstance(order, tuple)):
            order = permutation(order, self._n)
        xp = device_arrays()
        self._devices = chosen_devices(xp, devices)
        with self._home(), ExitStack() as opened:
            before = self._free(xp)
            self._triangle = self._stored(xp, A)
            arrays, kind = self._triangle.arrays(A), self._kind(definite)
            self._cudss = CudssHandles(opened, arrays, kind, self._settings(), self._devices)
            order = order() if callable(order) else order
            self._given: tuple[Any, ...] = (
                on_host_alone(A), definite, deterministic, order, hybrid_memory, devices
            )  # fmt: skip
            self._prepare(order)
            self._factor(CODES.analysis, CODES.factorisation)
            self._used = tuple(b - a for b, a in zip(before, self._free(xp), strict=True))
            weakref.finalize(self, self._cudss.release, opened.pop_all())

    def _stored(self, xp: Any, A: Any) -> Any:
        """Return what stores the entries of the matrix on the device."""
        return DeviceTriangle(xp, A)

    def _kind(self, definite: bool) -> int:
        """Return cuDSS's number for the kind of the matrix."""
        return int(CODES.definite if definite else CODES.symmetric)

    def refactor(self, A: Any) -> None:
        """Factor a matrix with entries, zeros included, in the same places; keep the analysis.
        After an `InputError` (another pattern) the old factors remain, after a `SolverError`
        none."""
        self._cudss.here()
        with self._lock, self._home():
            self._cudss.set_values(self._triangle.values(A))
            self._given = A, *self._given[1:]
            self._factor(CODES.refactorisation)

    def statistics(self) -> dict[str, Any]:
        """Entries of the factors, and cuDSS's estimates of the most bytes on device and host.
        "used" is what the matrix and its factors took of the memory of each device."""
        entries = self._cudss.get(CODES.fill, ctypes.c_int64()).value
        return {"entries": entries, **memory(self._cudss), "used": self._used}

    def _free(self, xp: Any) -> list[int]:
        """Return the bytes that are free on each of several devices; empty for one."""
        return [] if self._devices is None else free_memories(xp, self._devices) or []

    def _home(self) -> Any:
        """Return the context of the device that stores the matrix."""
        return on_device(device_arrays(), self._devices)

    def _settings(self) -> dict[int, Any]:
        """Return the settings of cuDSS by their numbers."""
        settings: dict[int, Any] = {
            CODES.refinements: ctypes.c_int(0),
            CODES.deterministic: ctypes.c_int(self._deterministic),
        }
        if self._hybrid:
            settings[CODES.hybrid_memory] = ctypes.c_int(1)
            # Without a limit cuDSS assumes that the whole device is free.
            free = free_memory(device_arrays())
            limit = self._hybrid if self._hybrid is not True else free and free - self._more_bytes()
            if limit is not None:
                settings[CODES.memory_limit] = ctypes.c_int64(max(limit, 1))
        return settings

    def _prepare(self, order: Any) -> None:
        """Pass the other data of the analysis to cuDSS, in particular an order."""
        if not isinstance(order, tuple):
            if order is not None:
                self._cudss.put(CODES.order, order)
            return
        tree = DissectionTree(*order)
        if tree.separates(self._cudss.xp, *self._cudss.triangle[:2]):
            self._cudss.put(CODES.order, permutation(tree.order, self._n))
            self._cudss.put(CODES.tree, tree.sizes.astype(np.int32))
            self._cudss.configure(CODES.levels, ctypes.c_int(tree.levels))

    def _factor(self, *phases: int) -> None:
        self._factored = False
        with ExitStack() as columns:
            b, x = self._cudss.columns(columns, 1)[1::2]
            for phase in phases:
                self._cudss.execute(phase, x, b, long=True)
                if phase == CODES.analysis:
                    check_memory(self._cudss, bool(self._hybrid), self._more_bytes(), self._devices)
        if pivot := self._cudss.get(CODES.info, ctypes.c_int(0)).value:
            raise failed("cudssExecute", pivot, pivot=True)
        self._factored = True

    def _more_bytes(self) -> int:
        """Return the memory that results take in addition to the factors."""
        return 0

    def _executed(self, phase: int, loads: Any, together: int) -> Any:
        """Return the result of a phase for loads (count, n) on the device, several at a time."""
        made = self._cudss.xp.empty_like(loads)
        with ExitStack() as columns:
            right, b, left, x = self._cudss.columns(columns, together)
            for i in range(0, len(loads), together):
                some = loads[i : i + together]
                right[: len(some)] = some
                self._cudss.execute(phase, x, b)
                made[i : i + together] = left[: len(some)]
        return made

    @contextmanager
    def _factors(self) -> Iterator[None]:
        """Lock the factors, and make their device the current one."""
        self._cudss.here()
        with self._lock, self._home():
            if not self._factored:
                raise AdiniError("cuDSS: the last factorisation did not end; call refactor")
            yield

    def placed(self, array: Any) -> Any:
        """Return an array of the device, or a copy there of one on the host."""
        return self._cudss.xp.asarray(array)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the matrix: a copy factors it again."""
        return type(self), self._given


def _refuse(deterministic: bool, hybrid_memory: bool | int, devices: Any) -> None:
    for name, given in (("hybrid_memory", hybrid_memory), ("devices", devices is not None)):
        if given and deterministic:
            raise InputError(f"{name}: cuDSS has no deterministic mode with it")
    if hybrid_memory and devices is not None:
        raise InputError("hybrid_memory: it is for one device; leave out devices")


class Cudss(CudssMatrix):
    """Factors of a symmetric matrix on a CUDA device, for solutions; see `CudssMatrix`."""

    _product: DeviceProduct | None = None

    def refactor(self, A: Any) -> None:
        """Factor a matrix with the same pattern; the analysis is kept."""
        self._product = None
        super().refactor(A)

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads)."""
        # As many corrections as PARDISO makes; deterministic cuDSS makes none.
        return self._solutions(b, 2)

    def once(self, b: Array) -> Array:
        """Return the solution without corrections for loads (n,) or (n, loads)."""
        return self._solutions(b, 0)

    def at(self, places: Any, loads: Array, corrected: bool = True) -> Array:
        """Return solutions at the unknowns `places` (k,) for loads (k,) or (k, count) on them.
        If `corrected`, the residual improves them; no vector of all unknowns leaves the device."""
        some, xp = loads.reshape(len(places), -1), self._cudss.xp
        found = np.empty(some.shape)
        with self._factors():
            chosen = xp.asarray(places)
            for i in range(0, some.shape[1], _TOGETHER):
                part = xp.asarray(np.ascontiguousarray(some[:, i : i + _TOGETHER].T))
                whole = xp.zeros((len(part), self._n))
                whole[:, chosen] = part
                x = self._corrected(whole, 2 if corrected else 0)
                found[:, i : i + _TOGETHER] = host(x[:, chosen]).T
        return found.reshape(loads.shape)

    def _solutions(self, b: Array, corrections: int) -> Array:
        """Solve on the device, for some loads at a time."""
        loads, xp = b.reshape(self._n, -1), self._cudss.xp
        found = np.empty(loads.shape[::-1])
        with self._factors():
            for i in range(0, loads.shape[1], _TOGETHER):
                some = xp.asarray(np.ascontiguousarray(loads[:, i : i + _TOGETHER].T))
                found[i : i + _TOGETHER] = host(self._corrected(some, corrections))
        return np.ascontiguousarray(found.T).reshape(b.shape)

    def _corrected(self, loads: Any, corrections: int) -> Any:
        """Return solutions for loads (count, n), corrected while their residuals fall."""
        xp, together = self._cudss.xp, 1 if self._deterministic else len(loads)
        x = self._executed(CODES.solution, loads, together)
        if not corrections:
            return x
        A = self._product = self._product or DeviceProduct(xp, *self._cudss.triangle)
        residual = loads - A @ x
        for _ in range(corrections):
            corrected = x + self._executed(CODES.solution, residual, together)
            left = loads - A @ corrected
            falls = abs(left).max(axis=1) < abs(residual).max(axis=1)
            if not bool(falls.any()):
                break
            x = xp.where(falls[:, None], corrected, x)
            residual = xp.where(falls[:, None], left, residual)
        return x

    def congruence(self, rows: Any) -> Any:
        """Return ``R A^-1 R^T`` on the device, shape (k, k); R is sparse by rows, shape (k, n)."""
        xp, k = device_arrays(), rows.shape[0]
        together = 1 if self._deterministic else max(1, min(_TOGETHER, k))
        touched, at = np.unique(rows.indices, return_inverse=True)
        row = np.repeat(np.arange(k), np.diff(rows.indptr))
        with self._factors(), ExitStack() as columns:
            load, b, left, x = self._cudss.columns(columns, together)
            places, kept, values = map(xp.asarray, (rows.indices, touched, rows.data))
            moved, R = xp.empty((k, touched.size)), xp.zeros((k, touched.size))
            for i in range(0, k, together):
                part = slice(*rows.indptr[[i, min(i + together, k)]].tolist())
                load.fill(0.0)
                load[xp.asarray(row[part] - i), places[part]] = values[part]
                self._cudss.execute(CODES.solution, x, b)
                moved[i : i + together] = left[: k - i, kept]
            R[xp.asarray(row), xp.asarray(at)] = values
            product = moved @ R.T
            return 0.5 * (product + product.T)


Index = NDArray[np.integer[Any]]


class DissectionTree(NamedTuple):
    """An order of elimination in the blocks of a complete binary tree, leaves first, root last."""

    order: Index  # order[k] is the unknown of step k, shape (n,); blocks level by level
    sizes: Index  # unknowns in each block, none zero, shape (2**levels - 1,)

    @property
    def levels(self) -> int:
        """Levels of the tree."""
        return int(self.sizes.size + 1).bit_length() - 1

    def separates(self, xp: Any, starts: Any, columns: Any) -> bool:
        """Whether each upper entry joins unknowns of one block, or of a block and one above it.
        cuDSS trusts a tree, and writes outside its memory if this does not hold."""
        # Blocks are numbered 1, 2, ... from the last to the first: block h is below block h // 2.
        number = np.empty(self.order.size, dtype=np.int32)
        number[self.order] = np.repeat(np.arange(self.sizes.size, 0, -1), self.sizes)
        level = np.frexp(np.arange(self.sizes.size + 1))[1].astype(np.int32)
        of, depth = xp.asarray(number), xp.asarray(level)
        entries = xp.arange(columns.size, dtype=starts.dtype)
        row, column = of[xp.searchsorted(starts[1:], entries, side="right")], of[columns]
        upper, lower = xp.minimum(row, column), xp.maximum(row, column)
        return bool((lower >> (depth[lower] - depth[upper]) == upper).all())


class DeviceProduct:
    """The symmetric matrix of an upper triangle by rows, as an operator on the rows of an array.
    The entries below the diagonal are stored by rows too, so that one thread sums each entry."""

    def __init__(self, xp: Any, starts: Any, columns: Any, values: Any) -> None:
        n = len(starts) - 1
        places = xp.arange(columns.size, dtype=np.int32)
        rows = xp.searchsorted(starts[1:], places, side="right").astype(np.int32)
        below = xp.flatnonzero(columns > rows)
        below = below[xp.argsort(columns[below], kind="stable" if xp is np else None)]
        counts = xp.bincount(columns[below], minlength=n) if below.size else xp.zeros(n, np.int64)
        ends = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(counts)]).astype(np.int32)
        self._xp, self._upper = xp, (starts, columns, values)
        self._lower = ends, rows[below], values[below]

    def __matmul__(self, x: Any) -> Any:
        """Return ``A x`` for each row of an array, shape (count, n)."""
        if self._xp is np:
            n = x.shape[1]
            U, L = (
                sparse.csr_array((values, at, starts), shape=(n, n))
                for starts, at, values in (self._upper, self._lower)
            )
            return (U @ x.T + L @ x.T).T
        (starts, columns, upper), (ends, rows, lower) = self._upper, self._lower
        bounds = starts[:-1], starts[1:], ends[:-1], ends[1:]
        product = self._xp.empty_like(x)
        for one, found in zip(x, product, strict=True):
            _kernel()(*bounds, columns, upper, rows, lower, one, found)
        return product


@cache
def _kernel() -> Any:
    import cupy

    return cupy.ElementwiseKernel(
        "int32 first, int32 last, int32 begin, int32 end, raw int32 columns, raw float64 upper, "
        "raw int32 rows, raw float64 lower, raw float64 x",
        "float64 y",
        # In the order of the entries, so that equal calls give equal bits.
        "double sum = 0.0;"
        "for (int k = first; k < last; ++k) sum += upper[k] * x[columns[k]];"
        "for (int k = begin; k < end; ++k) sum += lower[k] * x[rows[k]];"
        "y = sum;",
        "skfem_adini_symmetric_row",
    )


def check_memory(
    cudss: Any, hybrid: bool, more: int, devices: tuple[int, ...] | None = None
) -> None:
    """After the analysis: raise `SolverError` if the factors and `more` bytes do not fit.
    With several devices the free memory of all of them counts."""
    estimates = _estimates(cudss)
    least = int(estimates[CODES.hybrid_least]) + more
    needed = least if hybrid else int(estimates[CODES.peak]) + more
    if devices is None and needed <= _unused(cudss.xp):
        return
    each = free_memories(cudss.xp, devices)
    if each is None:
        return
    free = sum(each)
    if needed > free:
        raise too_large(needed, free, None if hybrid or least > free else least, more)


def memory(cudss: Any) -> dict[str, int]:
    """The most bytes of the device and of the host, after the analysis."""
    estimates = _estimates(cudss)
    return {"device": int(estimates[CODES.peak]), "host": int(estimates[CODES.host_peak])}


def _estimates(cudss: Any) -> Any:
    return cudss.get(CODES.estimates, (ctypes.c_int64 * 16)())


def _unused(xp: Any) -> int:
    """Free bytes of the device, without those in CuPy's pool; -1 without a device.
    To empty and refill that pool takes milliseconds."""
    return int(xp.cuda.runtime.memGetInfo()[0]) if hasattr(xp, "cuda") else -1


def free_memories(xp: Any, devices: tuple[int, ...] | None) -> list[int] | None:
    """Bytes that are free on each of the devices; None where there is no device."""
    found = []
    for device in devices or (None,):
        with on_device(xp, None if device is None else (device,)):
            free = free_memory(xp)
        if free is None:
            return None
        found.append(free)
    return found


def free_memory(xp: Any) -> int | None:
    """Free bytes of the device, including those in CuPy's pool."""
    if not hasattr(xp, "cuda"):
        return None
    xp.get_default_memory_pool().free_all_blocks()
    return int(xp.cuda.runtime.memGetInfo()[0])


class CudssSchur(CudssMatrix):
    """Factors of the unknowns that are not chosen, and the dense Schur complement of the chosen.
    Not deterministic: in that mode cuDSS 1.0 leaves out terms of the complement without an
    error. NVIDIA cuDSS 1.0 documentation, Schur complement mode."""

    def __init__(
        self, A: Any, chosen: ArrayLike, tree: Order = None,
        hybrid_memory: bool | int = False,
    ) -> None:  # fmt: skip
        """Factor A, whose block without the chosen unknowns is positive definite; `chosen` ascends.
        The tree is as the order of `CudssMatrix`, with the chosen unknowns last and ascending."""
        self._marks = np.zeros(A.shape[0], dtype=np.int32)
        self._marks[np.asarray(chosen)] = 1
        self._count = int(self._marks.sum())
        super().__init__(A, True, False, tree, hybrid_memory)
        self._given = self._given[0], chosen, self._given[3], hybrid_memory
        self.complement = self._complement()

    def refactor(self, A: Any) -> None:
        """Factor a matrix with the same pattern, and replace the complement."""
        super().refactor(A)
        self.complement = self._complement()

    def forward(self, load: Any) -> Any:
        """Eliminate a load (n,) on host or device: its last k entries are the chosen unknowns'.
        The result, like that of `backward`, lies on the device, in an order of cuDSS."""
        return self._one(CODES.forward, load)

    def backward(self, halfway: Any) -> Any:
        """Solve for all unknowns (n,) after `forward`, values of the chosen ones in the last k."""
        return self._one(CODES.backward, halfway)

    def _one(self, phase: int, load: Any) -> Any:
        """Return the result of a phase for one load (n,)."""
        with self._factors():
            return self._executed(phase, self._cudss.xp.asarray(load)[None], 1)[0]

    def _settings(self) -> dict[int, Any]:
        return {**super()._settings(), CODES.schur_mode: ctypes.c_int(1)}

    def _prepare(self, order: Any) -> None:
        self._cudss.put(CODES.chosen, self._marks)
        super()._prepare(order)

    def _more_bytes(self) -> int:
        return 8 * self._count**2

    def _complement(self) -> Any:
        shape = self._cudss.get(CODES.schur_shape, (ctypes.c_int64 * 3)())
        if tuple(shape)[:2] != (self._count, self._count):
            raise AssertionError(
                f"cuDSS: a Schur complement of {tuple(shape)[:2]}, not {self._count}"
            )
        S = self._cudss.xp.zeros((self._count, self._count))
        with ExitStack() as opened:
            self._cudss.get(CODES.schur, self._cudss.dense(opened, S))
        return S


class CudssGeneralSchur(CudssSchur):
    """The same of a matrix without symmetry, by rows of SciPy with values on host or device; pivots
    are exchanged within dense blocks only."""

    def _stored(self, xp: Any, A: Any) -> Any:
        return DeviceRows(xp, A)

    def _kind(self, definite: bool) -> int:
        return int(CODES.general)

    def _complement(self) -> Any:
        if count := self._cudss.get(CODES.pivots, ctypes.c_int(0)).value:
            raise failed("cudssExecute", count, pivot=True)
        return super()._complement().T  # cuDSS writes columns
