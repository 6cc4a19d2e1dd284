"""What is continuous across edges: u and its tangential derivative, not the normal one."""

import numpy as np
import pytest
from skfem import ElementVector, InteriorFacetBasis

from skfem_adini import ElementQuadAdini


def jumps(mesh, x, element):
    """Return the jumps of u and, over the largest gradient, of its derivatives."""
    sides = [InteriorFacetBasis(mesh, element, side=side) for side in (0, 1)]
    u, v = (basis.interpolate(x) for basis in sides)
    n = np.array(sides[0].normals)
    t = np.array([-n[1], n[0]])
    jump = u.grad - v.grad
    size = np.abs(u.grad).max()
    value = np.abs(np.array(u) - np.array(v)).max()
    along = np.abs(np.einsum("...iep,iep->...ep", jump, t)).max() / size
    across = np.abs(np.einsum("...iep,iep->...ep", jump, n)).max() / size
    return value, along, across


@pytest.mark.parametrize("vector", [False, True], ids=["scalar", "vector"])
def test_jumps_of_random_fields(any_quads, vector):
    element = ElementVector(ElementQuadAdini()) if vector else ElementQuadAdini()
    basis = InteriorFacetBasis(any_quads, element)
    x = np.random.default_rng(0).uniform(-1, 1, basis.N)
    value, along, across = jumps(any_quads, x, element)
    assert value < 1e-13
    assert along < 1e-13
    assert across > 0.1


def test_gradient_is_continuous_at_vertices(any_quads):
    element = ElementQuadAdini()
    mapping = any_quads._mapping()
    corners = np.array([[0.0, 1, 1, 0], [0, 0, 1, 1]])
    x = np.random.default_rng(0).uniform(-1, 1, 3 * any_quads.nvertices)
    basis = InteriorFacetBasis(any_quads, element)
    gradient = sum(
        x[basis.dofs.element_dofs[i]][:, None] * element.gbasis(mapping, corners, i)[0].grad
        for i in range(12)
    )
    for component in range(2):
        at_vertex = x[basis.nodal_dofs[component + 1]][any_quads.t.T]
        np.testing.assert_allclose(gradient[component], at_vertex, rtol=0, atol=1e-13)
