"""The CUDA sources of this package, in one table for tests that compile them without a device.

Every raw kernel is listed here; the tests compile each for each architecture with NVRTC, on a
machine that needs neither a GPU nor a driver.
"""

from __future__ import annotations

from gpu.cuda import arnoldi, modulus, ritz, symmetric, triangle

OPTIONS = ("--std=c++17",)
ARCHITECTURES = ("sm_75", "sm_80", "sm_86", "sm_89", "sm_90", "sm_100", "sm_120")
SOURCES = {
    "arnoldi": arnoldi.SOURCE,
    "modulus": modulus.SOURCE,
    "ritz": ritz.SOURCE,
    "symmetric": symmetric.SOURCE,
    "triangle": triangle.SOURCE,
}
