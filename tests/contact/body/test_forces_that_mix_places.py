"""Forces on cut bodies that reduce over places are refused: their places crowd where cells are cut.

The mean of the places was that of a batch of cells, points of weight zero counted: a body force
``x - x.mean()`` of a half disk was off by more than half of it.
"""

import numpy as np
import pytest
from skfem import MeshQuad

from contact import CutBody, InputError

REDUCTIONS = {
    "mean": lambda x: x - x.mean(),
    "mean of each": lambda x: x - x.mean(axis=tuple(range(1, x.ndim)), keepdims=True),
    "max": lambda x: x / x.max(),
    "sum": lambda x: x / x.sum(),
    "jump at the median": lambda x: np.where(x > np.median(x), 1.0, -1.0),
    "sort": lambda x: np.sort(x, axis=1),
    "norm": lambda x: x / np.linalg.norm(x),
    "number": lambda x: x / x.size,
    "constant": lambda x: x.reshape(2, -1).mean(axis=1),
}


@pytest.fixture(scope="module")
def body():
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 13), np.linspace(-1.1, 0, 7))
    return CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)


@pytest.mark.parametrize("name", REDUCTIONS)
def test_reductions_are_refused(body, name):
    before = body.f.copy()
    with pytest.raises(InputError, match=r"force: .* each place alone"):
        body.body_force(REDUCTIONS[name])
    with pytest.raises(InputError, match=r"traction: .* each place alone"):
        body.load(body.arc(), REDUCTIONS[name])
    np.testing.assert_array_equal(body.f, before)


def test_ordinary_forces(body):
    """Resultants of what acts on each place, and of a mean computed beforehand."""
    mean = np.array([0.0, -4 / (3 * np.pi)])  # of the half disk
    for force, total in (
        (lambda x: x - mean[:, None, None], [0.0, 0.0]),
        (lambda x: np.array([np.where(x[0] > 0, 2.0, 0.0), 0 * x[0]]), [np.pi / 2, 0.0]),
        (lambda x: np.array([0.0, -1.0]), [0.0, -np.pi / 2]),
        ((0.0, -1.0), [0.0, -np.pi / 2]),
    ):
        body.f = 0 * body.f
        body.body_force(force)
        # A jump along a line of the mesh; rules of cut cells are exact to rounding here.
        np.testing.assert_allclose(body.total(body.f)[:2], total, atol=1e-9)
    body.f = 0 * body.f
    body.load(body.arc(), lambda x: np.array([0 * x[0], x[0] ** 2]))
    assert abs(body.total(body.f)[1] - np.pi / 2) < 1e-9


@pytest.mark.parametrize("wrong", [lambda: 1.0, lambda x, y: x])
def test_functions_of_other_arguments_are_named(body, wrong):
    with pytest.raises(InputError, match="force: expected a function of one argument"):
        body.body_force(wrong)
    with pytest.raises(InputError, match="traction: expected a function of one argument"):
        body.load(body.arc(), wrong)
