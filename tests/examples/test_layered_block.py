"""The example of the layered block asserts what it shows, and what it writes can be opened."""

import pytest
import pyvista


@pytest.mark.turns(4)
def test_the_example_holds_and_writes_its_window(example, tmp_path):
    example("layered_block").main(tmp_path)
    grid = pyvista.read(tmp_path / "layered_block.vti")
    assert grid.point_data["von_mises"].min() >= 0
    assert grid.point_data["displacement"].shape == (grid.n_points, 3)
    assert (tmp_path / "layered_block.png").stat().st_size > 10_000
