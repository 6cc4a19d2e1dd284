"""The shared library of NVIDIA's cuDSS: its location, version and errors."""

from __future__ import annotations

import ctypes
import functools
import importlib
import importlib.util
import operator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from skfem_adini.errors import InputError, MissingDependency, SolverError
from skfem_adini.ground.errors import optional

CODES = SimpleNamespace(  # of cuDSS 1.0 (cudss_data_types.h); those of 0.x differ
    version=1, allocation_failed=2, int32=10, float64=1,
    # Kinds of matrices; symmetric and definite ones are given by the upper triangle.
    general=0, symmetric=1, definite=3, full=0, upper=2, zero_based=0, column_major=0,
    # Settings.
    refinements=5, hybrid_memory=11, memory_limit=12, levels=17, devices=21, device_numbers=22,
    schur_mode=23, deterministic=24,
    # Data, and the indices of those of the 16 estimates for the peak on the device, the peak on the
    # host, and the least use of the device in hybrid mode.
    info=0, fill=1, pivots=2, order=9, estimates=13, chosen=18, schur_shape=19, schur=20, tree=21,
    interrupt=23, peak=1, host_peak=3, hybrid_least=4,
    # Phases.
    analysis=0b11, factorisation=0b100, refactorisation=0b1000, solution=0b11_1111_0000,
    forward=0b11_0000, backward=0b1_1000_0000,
)  # fmt: skip
_MISSING = "cuDSS needs CuPy and nvidia-cudss-cu13: pip install 'skfem-adini[cudss]'"


def failed(call: str, status: int, pivot: bool = False) -> SolverError:
    """The error of a call of cuDSS that returned this status."""
    texts = (
        *("success", "not initialized", "allocation failed", "invalid value", "not supported"),
        *("execution failed", "internal error", "refinement failed"),
    )
    known = 0 <= status < len(texts)
    text = "a pivot is zero or not positive" if pivot else texts[status] if known else "unknown"
    if status == CODES.allocation_failed and not pivot:
        text += (
            "; the factors do not fit into the memory of the device; take fewer unknowns to keep, "
            "hybrid_memory=True, or solver='pardiso' on the host"
        )
    return SolverError(f"{call} of cuDSS returned status {status}: {text}", status, pivot)


def too_large(estimate: int, free: int, hybrid: int | None, kept: int) -> SolverError:
    """The error of factors that, by the analysis, do not fit into a device. In bytes: their peak,
    the free memory, that with which `hybrid_memory` works, and the complement of kept unknowns."""
    remedies = [f"fewer kept unknowns, whose complement takes {_gib(kept)}"] if kept else []
    if hybrid is not None:
        remedies.append(f"hybrid_memory=True, which needs {_gib(hybrid)} of the device")
    remedies.append("solver='pardiso' on the host")
    return SolverError(
        f"cuDSS: the factorisation needs {_gib(estimate)} of the memory of the device, "
        f"{_gib(free)} are free; take {', or '.join(remedies)}",
        CODES.allocation_failed,
        free=free,
        hybrid=hybrid,
    )


def _gib(size: int) -> str:
    return f"{size / 2**30:.3g} GiB"


def chosen_devices(xp: Any, devices: Any) -> tuple[int, ...] | None:
    """Return the different numbers of devices that share a factorisation; None: the present
    device."""
    if devices is None:
        return None
    try:
        numbers = tuple(operator.index(device) for device in devices)
    except TypeError:
        numbers = ()
    if not numbers or min(numbers) < 0 or len(set(numbers)) < len(numbers):
        raise InputError(
            f"devices={devices!r}: expected different numbers of CUDA devices, (0, 1) for instance"
        )
    count = device_count(xp)
    if count is not None and max(numbers) >= count:
        raise InputError(
            f"devices={devices!r}: device {max(numbers)} is not there, {count} answer; take "
            f"numbers below {count}"
        )
    return numbers


def device_count(xp: Any) -> int | None:
    """Return the number of CUDA devices that respond; None for NumPy, which has none."""
    return int(xp.cuda.runtime.getDeviceCount()) if hasattr(xp, "cuda") else None


def device_arrays() -> Any:
    """Return CuPy, if there is a device."""
    cupy = optional("cupy", _MISSING)
    try:
        cupy.cuda.runtime.getDeviceCount()
    except cupy.cuda.runtime.CUDARuntimeError as error:
        raise MissingDependency(f"cuDSS needs a CUDA device, none answers ({error})") from error
    return cupy


def _folders() -> list[Path]:
    """Return the folders into which NVIDIA's wheels put their libraries."""
    if importlib.util.find_spec("nvidia") is None:
        return []
    roots = importlib.import_module("nvidia").__path__
    return [folder for root in roots for folder in sorted(Path(root).glob("cu1[23]/lib"))]


def threading_layer() -> Path | None:
    """Return the library by which the reordering runs on several threads of the host."""
    found = (p for folder in _folders() for p in folder.glob("libcudss_mtlayer_gomp.so*"))
    return next(found, None)


@functools.cache
def load_cudss() -> Any:
    """Load cuDSS, after the libraries that it needs, which may be in the same folder."""
    folders = _folders()
    for name in ("libcublasLt.so.*", "libcublas.so.*", "libnvrtc.so.*"):
        for path in (p for folder in folders for p in sorted(folder.glob(name))):
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    found = [p for folder in folders for p in sorted(folder.glob("libcudss.so.*"))]
    try:
        library = ctypes.CDLL(str(found[0]) if found else "libcudss.so.1")
    except OSError as error:
        raise MissingDependency(f"{_MISSING} ({error})") from error
    major = ctypes.c_int()
    library.cudssGetProperty(0, ctypes.byref(major))
    if major.value != CODES.version:
        raise MissingDependency(f"cuDSS has version {major.value}, not {CODES.version}: {_MISSING}")
    return library
