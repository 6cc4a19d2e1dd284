"""Across the faces of bricks u and its derivatives along the face are continuous."""

import numpy as np
import pytest
from skfem import ElementVector, InteriorFacetBasis
from skfem.refdom import RefHex

from skfem_adini import ElementHexAdini


@pytest.mark.parametrize("vector", [False, True], ids=["scalar", "vector"])
def test_jumps_of_random_fields(any_hexes, vector):
    element = ElementVector(ElementHexAdini()) if vector else ElementHexAdini()
    sides = [InteriorFacetBasis(any_hexes, element, side=side, intorder=5) for side in (0, 1)]
    x = np.random.default_rng(0).uniform(-1, 1, sides[0].N)
    u, v = (basis.interpolate(x) for basis in sides)
    assert np.abs(np.array(u) - np.array(v)).max() < 1e-13

    n = np.array(sides[0].normals)
    jump = u.grad - v.grad
    across = np.einsum("...iep,iep->...ep", jump, n)
    along = jump - np.einsum("...ep,iep->...iep", across, n)
    size = np.abs(u.grad).max()
    assert np.abs(along).max() < 1e-13 * size
    assert np.abs(across).max() > 0.1 * size


def test_gradient_is_continuous_at_vertices(any_hexes):
    element, mapping = ElementHexAdini(), any_hexes._mapping()
    basis = InteriorFacetBasis(any_hexes, element, intorder=1)
    x = np.random.default_rng(0).uniform(-1, 1, basis.N)
    gradient = sum(
        x[basis.dofs.element_dofs[i]][:, None] * element.gbasis(mapping, RefHex.p, i)[0].grad
        for i in range(32)
    )
    for component in range(3):
        at_vertex = x[basis.nodal_dofs[component + 1]][any_hexes.t.T]
        np.testing.assert_allclose(gradient[component], at_vertex, rtol=0, atol=1e-12)
