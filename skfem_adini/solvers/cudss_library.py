"""The shared library of NVIDIA's cuDSS: where it lies, its version, its errors."""

from __future__ import annotations

import ctypes
import functools
import importlib
import importlib.util
import operator
from pathlib import Path
from typing import Any

from skfem_adini.errors import AdiniError, InputError, MissingDependency

_VERSION = 1  # major version whose numbers the bindings use; those of 0.x differ
_STATUSES = (
    *("success", "not initialized", "allocation failed", "invalid value", "not supported"),
    *("execution failed", "internal error", "refinement failed"),
)
_ALLOCATION_FAILED = 2
_LESS = "take fewer unknowns to keep, hybrid_memory=True, or solver='pardiso' on the host"
_MISSING = "cuDSS needs CuPy and nvidia-cudss-cu13: pip install 'skfem-adini[cudss]'"


class CudssError(AdiniError):
    """cuDSS returned an error status from a call.
    `pivot` tells whether a pivot was zero, or not positive in a matrix said to be definite."""

    def __init__(self, call: str, status: int, pivot: bool = False) -> None:
        known = 0 <= status < len(_STATUSES)
        text = (
            "a pivot is zero or not positive"
            if pivot
            else _STATUSES[status]
            if known
            else "unknown"
        )
        if status == _ALLOCATION_FAILED and not pivot:
            text += f"; the factors do not fit into the memory of the device; {_LESS}"
        super().__init__(f"{call} of cuDSS returned status {status}: {text}")
        self.call, self.status, self.pivot = call, status, pivot


class DeviceMemory(CudssError):
    """The analysis tells that the factors, in bytes, will not fit into the memory of the device.
    `hybrid` is what the device needs with `hybrid_memory` (None: too much as well), `kept` the
    part of the estimate for the dense complement of kept unknowns."""

    def __init__(self, estimate: int, free: int, hybrid: int | None, kept: int) -> None:
        super().__init__("cudssDataGet", _ALLOCATION_FAILED)
        remedies = [f"fewer kept unknowns, whose complement takes {_gib(kept)}"] if kept else []
        if hybrid is not None:
            remedies.append(f"hybrid_memory=True, which needs {_gib(hybrid)} of the device")
        remedies.append("solver='pardiso' on the host")
        self.args = (
            f"cuDSS: the factorisation needs {_gib(estimate)} of the memory of the device, "
            f"{_gib(free)} are free; take {', or '.join(remedies)}",
        )
        self.estimate, self.free, self.hybrid, self.kept = estimate, free, hybrid, kept

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the numbers: the text follows from them."""
        return type(self), (self.estimate, self.free, self.hybrid, self.kept)


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
    """Return how many CUDA devices answer; None for NumPy, which has none."""
    return int(xp.cuda.runtime.getDeviceCount()) if hasattr(xp, "cuda") else None


def device_arrays() -> Any:
    """Return CuPy, if there is a device."""
    try:
        cupy = importlib.import_module("cupy")
    except ImportError as error:
        raise MissingDependency(_MISSING) from error
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
    """Load cuDSS, after the libraries that it needs and that may lie beside it."""
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
    if major.value != _VERSION:
        raise MissingDependency(f"cuDSS has version {major.value}, not {_VERSION}: {_MISSING}")
    return library
