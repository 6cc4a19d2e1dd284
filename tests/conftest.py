"""Hypothesis profiles: `ci` is the fast lane, `slow` runs with `make test-slow`."""

import os
import sys
from pathlib import Path

import matplotlib
import pytest
import pyvista
from hypothesis import HealthCheck, settings

# The suite imports test modules by path; what packages share lies beside this file.
sys.path.insert(0, str(Path(__file__).parent))
from cuda_compiler import compile_cuda  # noqa: F401

matplotlib.use("Agg")
pyvista.OFF_SCREEN = True

_shared = {
    "deadline": None,
    "derandomize": True,
    "suppress_health_check": [HealthCheck.too_slow],
    "database": None,
}
settings.register_profile("ci", max_examples=30, **_shared)
settings.register_profile("slow", max_examples=1000, **_shared)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_collection_modifyitems(items):
    """Tests marked `gpu` are skipped where there is no device, and say why."""
    reason = _no_device()
    if reason:
        for item in items:
            if item.get_closest_marker("gpu"):
                item.add_marker(pytest.mark.skip(reason=reason))


def _no_device():
    try:
        import cupy
    except ImportError:
        return "no CuPy: pip install 'skfem-adini[cuda13]'"
    return None if cupy.cuda.is_available() else "no CUDA device"
