"""Scripts that others import draw what they define when they are run by themselves."""

import pytest


@pytest.mark.parametrize("name", ["half_space", "heat_model"])
def test_picture_is_drawn_where_it_is_asked_for(example, name, tmp_path):
    example(name).main(["--output", str(tmp_path / "new")])
    assert (tmp_path / "new" / f"{name}.png").stat().st_size > 10_000
