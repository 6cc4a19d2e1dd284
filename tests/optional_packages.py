"""Marks of the tests that need what an installation may be without."""

import importlib.util

import pytest


def _needs(package):
    missing = importlib.util.find_spec(package) is None
    return pytest.mark.skipif(missing, reason=f"{package} is not installed")


PARDISO = _needs("pypardiso")
AMG = _needs("pyamg")
