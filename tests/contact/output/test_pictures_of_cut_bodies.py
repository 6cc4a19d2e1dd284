"""Pictures of a body that a curve cuts show the part inside."""

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from skfem import MeshQuad

from contact import ContactProblem, CutBody, Plane
from contact.plot import plot_cells, plot_field

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def result():
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    disk = CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)
    disk = disk.fix("top", "x").fix("top", "y", -0.05)
    return ContactProblem(disk, disk.arc(), Plane((0.0, -1.02), (0.0, 1.0)), 0.3).solve()


def test_cells(result):
    """Clipped cells have three or four corners; a bare ValueError of NumPy was raised."""
    ax = plot_cells(result, magnification=0.0)
    (cells,) = (part for part in ax.collections if isinstance(part, PolyCollection))
    outlines = [path.vertices[:-1] for path in cells.get_paths()]
    assert {len(corners) for corners in outlines} == {3, 4}
    assert cells.get_array().size == len(outlines)
    x = np.vstack(outlines)
    assert np.hypot(*x.T).max() <= 1 + 1e-2  # the level set is linear within a sub-cell
    area = sum(_area(corners) for corners in outlines)
    assert area == pytest.approx(np.pi / 2, rel=2e-3)
    plt.close(ax.figure)


@pytest.mark.parametrize("nodal", [False, True])
def test_fields(result, nodal):
    """What the extension gives outside is no displacement of the body, and was drawn."""
    ax = plot_field(result, 1, magnification=0.0, nodal=nodal)
    drawn = ax.collections[0]
    triangulation = drawn._triangulation
    x = np.stack((triangulation.x, triangulation.y))[:, np.unique(triangulation.triangles)]
    assert np.hypot(*x).max() <= 1 + 1e-2
    plt.close(ax.figure)


def _area(corners):
    x, y = corners.T
    return abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
