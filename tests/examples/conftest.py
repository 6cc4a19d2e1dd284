"""Example scripts are loaded from their files, as a user runs them."""

import example_scripts
import pytest


@pytest.fixture(scope="session")
def example():
    """Load examples/NAME.py as a module."""
    return example_scripts.load
