"""Cells that differ by the rounding of their coordinates are one class; others are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, ElementHex1, ElementQuad1, MeshHex, MeshQuad, asm
from skfem.models.poisson import laplace

from skfem_adini import CongruentCells, assemble
from skfem_adini.assembly import congruence_classes as module


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


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 32), st.sampled_from([0, 1]))
def test_few_cells_are_compared_as_many_are(seed, cells, noise):
    """By pairs, and by sorted differences."""
    rng = np.random.default_rng(seed)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = 10 + rng.integers(0, 3, (cells, 2)) + unit[:, None] * rng.integers(1, 3, (cells, 2))
    corners = corners * (1 + noise * np.finfo(float).eps * rng.integers(-1, 2, corners.shape))
    points = np.ascontiguousarray(corners.reshape(-1, 2).T)
    nodes = np.arange(4 * cells).reshape(4, cells)
    words = rng.integers(0, 2, (cells, 1)).astype(np.uint64)
    few = module.congruence_classes(points, nodes, words)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LIMITS", module.LIMITS._replace(few=0))
        many = module.congruence_classes(points, nodes, words)
    np.testing.assert_array_equal(few.labels, many.labels)
    np.testing.assert_array_equal(few.representatives, many.representatives)
