"""VTK data and pictures are made of arrays: whoever has the fields of `Drawn` can be drawn."""

from types import SimpleNamespace

import numpy as np

from contact.output.contact_runs import arc_length
from contact.output.drawn import Drawn, DrawnBody, DrawnSystem
from contact.output.vtk import body_grid, boundary_grid


def names(protocol):
    return [name for name in vars(protocol) if not name.startswith("_")]


def test_bare_fields_are_drawn_like_a_result(make):
    """Twice the fields of a result, without it: the same places, twice the values."""
    _, result = make.solved()
    system = SimpleNamespace(**{name: getattr(result.system, name) for name in names(DrawnSystem)})
    fields = {name: getattr(result, name) for name in (*names(DrawnBody), *names(Drawn))}
    fields |= {"system": system, "pressure": 2 * result.pressure, "u": 2 * result.u}
    bare = SimpleNamespace(**fields)
    ours, theirs = boundary_grid(bare), boundary_grid(result)
    np.testing.assert_array_equal(ours.points, theirs.points)
    np.testing.assert_array_equal(ours.point_data["pressure"], 2 * theirs.point_data["pressure"])
    ours, theirs = body_grid(bare), body_grid(result)
    moved = theirs.point_data["displacement"]
    np.testing.assert_array_equal(ours.point_data["displacement"], 2 * moved)
    assert np.abs(moved).max() > 0.01
    np.testing.assert_array_equal(arc_length(bare)[0], arc_length(result)[0])
