"""Example scripts are loaded from their files, as a user runs them."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def example():
    """Load examples/NAME.py as a module."""

    def load(name: str) -> ModuleType:
        path = Path(__file__).parents[2] / "examples" / f"{name}.py"
        spec = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def validation(example):
    """Load examples/validation_*.py, which share `half_space.py` beside them."""
    import sys

    folder = str(Path(__file__).parents[2] / "examples")

    def load(name: str) -> ModuleType:
        sys.path.insert(0, folder)
        try:
            return example(name)
        finally:
            sys.path.remove(folder)

    return load
