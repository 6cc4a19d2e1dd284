"""Whether the factors will fit into the memory of the device, from the estimate of cuDSS."""

from __future__ import annotations

import ctypes
from typing import Any

from skfem_adini.solvers.cudss_handles import on_device
from skfem_adini.solvers.cudss_library import DeviceMemory

# cuDSS's number of the estimates, how many they are, and which of them are the largest use of the
# device, that of the host, and the least use of the device in hybrid mode.
_ESTIMATES, _COUNT = 13, 16
_PEAK, _HOST, _HYBRID = 1, 3, 4


def check_memory(
    cudss: Any, hybrid: bool, more: int, devices: tuple[int, ...] | None = None
) -> None:
    """Raise if the factorisation needs more memory than is free; call it after the analysis.

    Parameters
    ----------
    cudss
        The handles, after the analysis.
    hybrid
        Whether the factors may lie on the host.
    more
        Bytes on the device that are needed beside the factors.
    devices
        Numbers of the devices that share the factors; what is free on all of them counts.

    Raises
    ------
    DeviceMemory
    """
    estimates = _estimates(cudss)
    least = int(estimates[_HYBRID]) + more
    needed = least if hybrid else int(estimates[_PEAK]) + more
    if devices is None and needed <= _unused(cudss.xp):
        return
    each = free_memories(cudss.xp, devices)
    if each is None:
        return
    free = sum(each)
    if needed > free:
        raise DeviceMemory(needed, free, None if hybrid or least > free else least, more)


def memory(cudss: Any) -> dict[str, int]:
    """The most bytes of the device and of the host, after the analysis."""
    estimates = _estimates(cudss)
    return {"device": int(estimates[_PEAK]), "host": int(estimates[_HOST])}


def _estimates(cudss: Any) -> Any:
    return cudss.get(_ESTIMATES, (ctypes.c_int64 * _COUNT)())


def _unused(xp: Any) -> int:
    """Bytes of the device that nobody keeps; -1 where there is no device.

    To release what CuPy keeps takes milliseconds, and so does to allocate it again.
    """
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
    """Bytes of the device that are free, those that CuPy keeps for later among them."""
    if not hasattr(xp, "cuda"):
        return None
    xp.get_default_memory_pool().free_all_blocks()
    return int(xp.cuda.runtime.memGetInfo()[0])
