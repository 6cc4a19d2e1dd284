"""What a benchmark's JSON says about where and on what it ran."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

_PACKAGES = (
    "numpy", "scipy", "scikit-fem", "pypardiso", "mkl", "qpsolvers", "osqp", "piqp", "quadprog",
    "daqp", "clarabel", "proxsuite", "pyamg", "numba", "ngsolve", "xfem", "pymor", "tamaas",
)  # fmt: skip

_MEASURED = ("skfem_adini", "contact", "cip", "gpu", "benchmarks/*.py")


def describe() -> dict[str, Any]:
    """Processor, cores, versions and commit; no name of a host."""
    root = Path(__file__).parents[1]

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True)
        return done.stdout.strip()

    model = platform.processor() or "unknown"
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = [line for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = lines[0].split(":")[1].strip() if lines else model
    versions = {}
    for name in _PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "processor": model,
        "cores": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
        "python": platform.python_version(),
        "versions": versions,
        "commit": git("rev-parse", "--short", "HEAD"),
        "changed_files": len(git("status", "--porcelain", "-uno", "--", *_MEASURED).splitlines()),
    }
