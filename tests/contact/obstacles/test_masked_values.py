"""What lies under a mask is no number: masked values are refused, in lists and tuples too."""

import numpy as np
import pytest

from contact import (
    Cone,
    Cylinder,
    GridContact,
    HalfSpace,
    InputError,
    Moved,
    Parabola,
    Plane,
    Rigid,
    Rough,
    Sphere,
    SurfaceMesh,
)

HIDDEN = np.ma.masked_array([0.5, 1.0], [True, False])
PAIRS = [HIDDEN, list(HIDDEN), (np.ma.masked, 1.0), [np.ma.masked_array(0.5, True), 1.0]]
ROWS = [HIDDEN, np.array([0.0, 1.0])]
FLOOR = Plane((0.0, 0.0), (0.0, 1.0))


@pytest.mark.parametrize("pair", PAIRS, ids=["array", "list", "tuple", "of arrays"])
@pytest.mark.parametrize(
    "made",
    [
        lambda v: Plane(v, (0.0, 1.0)),
        lambda v: Plane((0.0, 1.0), v),
        lambda v: Cylinder(v, 1.0),
        lambda v: Sphere((*v, 0.0), 1.0),
        lambda v: Cone(v, (0.0, -1.0), 0.5),
        lambda v: Parabola(v, 1.0),
        lambda v: Moved(FLOOR, v),
        lambda v: Rigid(FLOOR, v).components(2),
        lambda v: Rough([*v, 0.0, 0.0, 0.0], 1.0),
    ],
)
def test_masked_coordinates(made, pair):
    with pytest.raises(InputError, match=r"masked|finite"):
        made(pair)


@pytest.mark.parametrize(
    "made",
    [
        lambda: Sphere((0.0, 0.0, 0.0), np.ma.masked),
        lambda: Cone((0.0, 0.0), (0.0, 1.0), np.ma.masked),
        lambda: Rough([np.ma.masked_array(np.ones(4), [1, 0, 0, 0]), *np.ones((3, 4))], (1, 1)),
        lambda: SurfaceMesh(ROWS, [[0, 1], [1, 0]]),
        lambda: GridContact(HalfSpace((1.0, 1.0), (2, 2), 1.0, 0.3), ROWS).solve(),
    ],
)
def test_masked_numbers_and_heights(made):
    with pytest.raises(InputError, match="masked"):
        made()
