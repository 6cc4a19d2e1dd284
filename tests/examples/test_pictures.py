"""Every script draws; those that others import do so when they are run by themselves."""

import re

import pytest
from example_scripts import EXAMPLES


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_script_names_a_picture_for_the_gallery(script):
    assert re.search(r'"\w+\.(png|gif)"', script.read_text())


@pytest.mark.parametrize("name", ["half_space", "heat_model"])
def test_picture_is_drawn_where_it_is_asked_for(example, name, tmp_path):
    example(name).main(["--output", str(tmp_path / "new")])
    assert (tmp_path / "new" / f"{name}.png").stat().st_size > 10_000
