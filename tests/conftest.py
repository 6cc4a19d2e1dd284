"""Hypothesis profiles: `ci` is the fast lane, `slow` runs with `make test-slow`."""

import os

import matplotlib
import pyvista
from hypothesis import HealthCheck, settings

matplotlib.use("Agg")
pyvista.OFF_SCREEN = True

_shared = {
    "deadline": None,
    "derandomize": True,
    "suppress_health_check": [HealthCheck.too_slow],
    "database": None,
}
settings.register_profile("ci", max_examples=50, **_shared)
settings.register_profile("slow", max_examples=1000, **_shared)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))
