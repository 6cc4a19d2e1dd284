"""Cells that differ by the rounding of their coordinates are one class; others are not."""

import numpy as np
import pytest
from skfem import Basis, ElementHex1, ElementQuad1, MeshHex, MeshQuad, asm
from skfem.models.poisson import laplace

from skfem_adini import CongruentCells, assemble


def bricks(n):
    return MeshHex.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)


@pytest.mark.parametrize("n", [3, 7, 10, 12])
def test_bricks_of_any_width_are_one_class(n):
    basis = Basis(bricks(n), ElementHex1())
    assert len(CongruentCells.of(basis).cells) == 1
    expected = asm(laplace, basis)
    found = assemble(laplace, bricks(n), ElementHex1(), fallback=False)
    # 8 eps of the largest coordinate, in widths of a cell.
    assert np.abs(found - expected).max() <= 8 * np.finfo(float).eps * n * expected.max()


@pytest.mark.parametrize("ticks", [1.0, -1.0])
def test_cells_that_are_much_smaller_than_their_coordinates_stay_apart(ticks):
    graded = np.sort(ticks * np.append(0, np.geomspace(1e-10, 1, 40)))
    mesh = MeshQuad.init_tensor(graded + 1.0, np.linspace(0, 1, 3))
    basis = Basis(mesh, ElementQuad1())
    assert len(CongruentCells.of(basis).cells) >= 40
