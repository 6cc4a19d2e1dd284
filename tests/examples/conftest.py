"""Example scripts are loaded from their files, as a user runs them."""

import example_scripts
import pytest


@pytest.fixture(scope="session")
def example():
    """Load examples/NAME.py as a module."""
    return example_scripts.load


@pytest.fixture
def run(example, tmp_path, capsys):
    """What an example returns; it must print some words and leave some files, pictures or not."""

    def found(name, *arguments, says="", files=()):
        numbers = example(name).main([*arguments, "--output", str(tmp_path / "new")])
        assert says in capsys.readouterr().out
        for file in files:
            assert (tmp_path / "new" / file).stat().st_size > 10_000 * file.endswith(
                (".png", ".gif")
            )
        return numbers

    return found
