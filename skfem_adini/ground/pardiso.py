"""MKL's PARDISO: a handle for each matrix, and one call for all phases.

Source: Intel oneMKL developer reference, ``pardiso`` and its parameter table ``iparm``.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import os
import sys
import threading
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from skfem_adini.ground.errors import AdiniError, SolverError

Array = NDArray[np.float64]

# PARDISO's numbers of real matrices; the last one has all entries, not the upper triangle.
DEFINITE, INDEFINITE, GENERAL = 2, -2, 11


class _Phases(NamedTuple):  # of PARDISO (oneMKL reference, `pardiso`)
    analyses: tuple[int, ...] = (11, 12)
    factorisations: tuple[int, ...] = (12, 22)
    solutions: tuple[int, ...] = (33, 331, 332, 333)
    release: int = -1


PHASES = _Phases()


def has_pardiso() -> bool:
    """Return whether pypardiso, which includes MKL, can be imported."""
    return importlib.util.find_spec("pypardiso") is not None


def upper_triangle(A: Any) -> Any:
    """Return the upper triangle, columns ascending, with every diagonal entry stored."""
    n = A.shape[0]
    upper = sparse.csr_array(sparse.triu(A, format="csr"))
    if np.count_nonzero(upper.diagonal()) < n:
        # Sums of sparse matrices drop zeros; conversion from triplets keeps them.
        entries, k = upper.tocoo(), np.arange(n)
        row, column = (np.concatenate([part, k]) for part in entries.coords)
        data = np.concatenate([entries.data, np.zeros(n)])
        upper = sparse.csr_array(sparse.coo_array((data, (row, column)), shape=A.shape))
    upper.sort_indices()
    return upper


def _number(value: int) -> Any:
    return ctypes.byref(ctypes.c_int32(value))


def _address(array: NDArray[Any]) -> Any:
    return ctypes.c_void_p(array.__array_interface__["data"][0])


_ONE, _NOTHING = _number(1), np.zeros(1)


class Pardiso:
    """One matrix in PARDISO's memory, released with the object; threads use it one after another. A
    copy or pickle factors again when used. A forked process inherits the factors and has one
    thread, as libgomp's do not survive; two-level factors are computed again."""

    def __init__(
        self,
        A: Any,
        kind: int,
        iparm: Mapping[int, int] | None = None,
        chosen: ArrayLike | None = None,
    ) -> None:
        """Take the upper triangle of A, shape (n, n), of the kind `DEFINITE` or `INDEFINITE`, or
        all of a `GENERAL` one, whose columns ascend in each row.
        `iparm` holds PARDISO's integer parameters that are not zero, counted from 0; without any
        its defaults hold. `chosen` marks the unknowns of a Schur complement (iparm[35])."""
        n = A.shape[0]
        upper = A if kind == GENERAL else upper_triangle(A)
        if upper.nnz >= 2**31:
            raise AdiniError(f"PARDISO: {upper.nnz} entries are too many for 32-bit indices")
        self._kind, self._factored = kind, False
        self._threads = 1  # of the analysis, and so of all later phases
        self._phases: tuple[int, ...] = ()  # the calls that made the factors
        self._anew: tuple[int, ...] = ()  # the calls that a copy must still repeat
        self._lock = threading.Lock()
        self._data = np.ascontiguousarray(upper.data, dtype=np.float64)
        self._ia = (upper.indptr + 1).astype(np.int32)
        self._ja = (upper.indices + 1).astype(np.int32)
        self._perm = np.zeros(n, dtype=np.int32)
        if chosen is not None:
            self._perm[np.asarray(chosen)] = 1
        self._chosen = int(self._perm.sum())
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        for place, value in (iparm or {}).items():
            self._iparm[place] = value
        if iparm:
            self._iparm[0] = 1
        self._given_iparm = self._iparm.copy()  # PARDISO writes into self._iparm
        _watch(self)

    def __call__(self, phase: int, b: Array | None = None, x: Array | None = None) -> None:
        """Run a phase: 11 analysis, 22 factorisation, 12 both, 33 solution, 331 to 333 its parts.
        Load b and output x are (n,) or in Fortran order (n, loads), checked because PARDISO
        would crash; phase 22 writes the dense Schur complement to x."""
        with self._lock:
            if self._anew:
                self._repeat()
            self._run(phase, b, x)

    @property
    def values(self) -> Array:
        """Entries of the upper triangle, row by row, which may be changed before phase 22."""
        return self._data

    @property
    def perturbed(self) -> int:
        """Pivots of the last factorisation that were replaced because they were too small."""
        return int(self._iparm[13])

    @property
    def fill(self) -> int:
        """Entries of the factors, if iparm[17] is -1."""
        return int(self._iparm[17])

    @property
    def pending(self) -> bool:
        """Whether the factors must be recomputed; partial solutions then do not match."""
        return bool(self._anew)

    def _repeat(self) -> None:
        """Factor the matrix of the object that was copied."""
        for phase in self._anew:
            # If a Schur complement was requested, PARDISO writes its matrix again.
            block = np.zeros((self._chosen, self._chosen)) if self._given_iparm[35] else None
            self._run(phase, x=block if phase in PHASES.factorisations else None)
        self._anew = ()

    def _check(self, phase: int, b: Array | None, x: Array | None) -> None:
        """Raise on wrong calls that PARDISO does not check: they would crash the process."""
        if phase in PHASES.solutions:
            if not self._factored:
                raise AdiniError(f"PARDISO: phase {phase} needs a factorisation, phase 22, before")
            for array in (b, x):
                if (
                    array is None
                    or array.dtype != np.float64
                    or len(array) != self._perm.size
                    or not array.flags.f_contiguous
                ):
                    raise AdiniError(
                        f"PARDISO: phase {phase} takes b and x of float64 in Fortran order with "
                        f"{self._perm.size} rows"
                    )
            if b is not None and x is not None and b.shape != x.shape:
                raise AdiniError(f"PARDISO: b has the shape {b.shape} and x {x.shape}")
        elif phase == 22 and self._phases[:1] == (12,):
            raise AdiniError("PARDISO: after phase 12 no phase 22: analyse by phase 11 instead")
        elif phase in PHASES.factorisations and self._given_iparm[35]:
            schur = (self._chosen, self._chosen)
            if x is None or x.shape != schur:
                raise AdiniError(f"PARDISO: phase {phase} takes x of shape {schur} here")

    def _run(self, phase: int, b: Array | None = None, x: Array | None = None) -> None:
        self._check(phase, b, x)
        if phase in PHASES.analyses + PHASES.factorisations:
            self._factored = False
        b, x = (_NOTHING if array is None else array for array in (b, x))
        error = ctypes.c_int32(0)
        if phase in PHASES.analyses:
            self._threads = _threads()
        # Two-level factors depend on the number of threads, and a numeric factorisation crashes
        # after solutions with fewer. With others, factored once and for all, one thread solves.
        alone = phase in PHASES.solutions and self._phases == (12,) and not self._given_iparm[23]
        with _held_to(1 if alone else self._threads):
            _library()(
                _address(self._handle),
                _ONE,  # maxfct: number of factorisations kept
                _ONE,  # mnum: which of them
                _number(self._kind),
                _number(phase),
                _number(self._ia.size - 1),
                *map(_address, (self._data, self._ia, self._ja, self._perm)),
                _number(b.shape[1] if b.ndim == 2 else 1),
                _address(self._iparm),
                _number(0),  # msglvl: no messages
                _address(b),
                _address(x),
                ctypes.byref(error),
            )
        if error.value == -2:
            raise MemoryError("PARDISO: not enough memory for the factorisation")
        if error.value != 0:
            text, pivot = f"PARDISO phase {phase} failed with code", error.value in (-4, -7)
            raise SolverError(f"{text} {error.value}", error.value, pivot)
        if phase in PHASES.factorisations:
            self._factored = True
        if phase in PHASES.analyses + PHASES.factorisations:
            self._phases = (phase,) if phase in PHASES.analyses else (*self._phases, phase)
        elif phase == PHASES.release:
            self._handle[:] = 0
            self._factored, self._phases = False, ()

    def _enter_child(self) -> None:
        """Continue in a forked process, with one thread."""
        # Two-level factors, and those with an analysis for more of them, keep the threads.
        bound = self._given_iparm[23] or self._phases[:1] == (11,)
        if self._threads > 1 and bound and self._phases:
            self._anew, self._phases, self._factored = self._phases, (), False
            self._handle[:] = 0  # the child's copy of the parent's factors is not usable
        self._threads = 1

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs: the matrix and the phases, but neither factors nor lock."""
        with self._lock:
            state = self.__dict__ | {"_anew": self._anew or self._phases, "_phases": ()}
        for name in ("_handle", "_lock", "_iparm", "_factored"):
            del state[name]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._handle, self._lock = np.zeros(64, dtype=np.int64), threading.Lock()
        self._iparm, self._perm = self._given_iparm.copy(), self._perm.copy()
        self._factored = False
        _watch(self)

    def __del__(self) -> None:
        # While the interpreter shuts down, even the module's globals may be None.
        if np is None or sys is None or sys.is_finalizing():
            return
        if getattr(self, "_handle", np.zeros(1)).any():
            with self._lock:
                self._run(PHASES.release)


# A fork copies PARDISO's memory but not its threads, so no call may be running: the hooks below
# hold all locks during a fork. Starting another program does not run these hooks.
_alive: weakref.WeakSet[Pardiso] = weakref.WeakSet()
_registering = threading.Lock()
_held: list[Pardiso] = []
_forked = False


def _watch(solver: Pardiso) -> None:
    with _registering:
        _alive.add(solver)


def _before_fork() -> None:
    _registering.acquire()
    _held.extend(_alive)
    for solver in _held:
        solver._lock.acquire()


def _after_fork() -> None:
    for solver in _held:
        solver._lock.release()
    _held.clear()
    _registering.release()


def _after_fork_in_child() -> None:
    global _forked
    _forked = True
    for solver in _held:
        solver._enter_child()
    _after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork_in_child
    )


@functools.cache
def _mkl() -> Any:
    """Return MKL as pypardiso has loaded it; cached, because a factor's release must not import."""
    from pypardiso import ps

    return ps.libmkl


@functools.cache
def _library() -> Any:
    """Return MKL's function ``pardiso``."""
    function = _mkl()["pardiso"]  # a new function object: pypardiso's has other argtypes
    function.argtypes, function.restype = None, None
    return function


@functools.cache
def _thread_setter() -> Any:
    """Return MKL's function that sets the number of threads for the caller."""
    return _mkl()["MKL_Set_Num_Threads_Local"]


def _threads() -> int:
    """Return the number of threads that MKL may use for the caller; 1 in a forked process."""
    return 1 if _forked else int(_mkl()["MKL_Get_Max_Threads"]())


@contextmanager
def _held_to(threads: int) -> Iterator[None]:
    """Set MKL's number of threads, inside the context, to that of the factors' layout. With another
    number of threads PARDISO misreads two-level factors and returns no error."""
    set_threads = _thread_setter()
    before = set_threads(ctypes.c_int(threads))
    try:
        yield
    finally:
        set_threads(ctypes.c_int(before))
