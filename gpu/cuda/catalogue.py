"""The CUDA sources of this package in one table, from which tests compile each by NVRTC for each
architecture, without a GPU or a driver.
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
