"""Boundary data that reduce over places are refused where these come padded with others."""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, ElementVector

from skfem_adini import CutDomain, ElementQuadAdini, InputError, nitsche

REDUCTIONS = {
    "mean": lambda k: k - k.mean() + 5,
    "max": lambda k: 1 + (k / k.max()) ** 2,
    "median": lambda k: np.where(k > np.median(k), 2.0, 1.0),
    "points of a cell": lambda k: 5 + k - k.mean(axis=-1, keepdims=True),
    "cumsum": lambda k: np.cumsum(k**2, axis=0) + 1,
    "norm": lambda k: 2 + k / np.linalg.norm(k),
    "number": lambda k: (2 + k) * k.shape[-1],
    "one number": lambda k: k.max(),
}


@pytest.fixture
def disk(cut_problems):
    return CutDomain(cut_problems.unit_square(9), cut_problems.LEVEL_SETS["disk"], q=4)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_scalar_data(disk, name):
    boundary = disk.boundary(ElementQuadAdini())
    mixed = lambda x: REDUCTIONS[name](x[0])  # noqa: E731
    for data in ({"value": mixed}, {"coefficient": mixed}):
        with pytest.raises(InputError, match=f"{next(iter(data))}: .* each place alone"):
            nitsche(boundary, **data)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_vector_data(disk, name):
    boundary = disk.boundary(ElementVector(ElementQuad1()))
    mixed = lambda x: REDUCTIONS[name](x[1])  # noqa: E731
    both = lambda x: np.array([0 * x[0], mixed(x) + 0 * x[0]])  # noqa: E731
    for value in (both, [0.0, mixed]):
        with pytest.raises(InputError, match=r"value: .* each place alone"):
            nitsche(boundary, value, lame=(1.0, 1.0))
    for lame in ((mixed, 1.0), (1.0, mixed)):
        with pytest.raises(InputError, match=r"lame: .* each place alone"):
            nitsche(boundary, lame=lame)


def test_ordinary_data(disk):
    """Of places, constant, and numbers of one's own at the basis's points."""
    boundary = disk.boundary(ElementQuad2())
    x = np.asarray(boundary.global_coordinates())
    expected = nitsche(boundary, lambda x: 1e9 * np.sin(x[0]) * x[1] ** 3)[1]
    kept = 1e9 * np.sin(x[0]) * x[1] ** 3
    found = nitsche(boundary, lambda x: kept)[1]
    np.testing.assert_array_equal(found, expected)
    largest = np.abs(x).max()
    nitsche(boundary, lambda x: x[0] / largest, coefficient=lambda x: np.where(x[0] > 0.5, 1e6, 1))
    one, same = (nitsche(boundary, value)[1] for value in (lambda x: 3.0, 3.0))
    np.testing.assert_array_equal(one, same)
