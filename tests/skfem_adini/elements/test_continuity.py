"""What is continuous across edges and faces: u and its derivatives along them, not across."""

import numpy as np
import pytest
from skfem import ElementVector, InteriorFacetBasis


@pytest.mark.sampled(4)
@pytest.mark.parametrize("vector", [False, True], ids=["scalar", "vector"])
def test_jumps_of_random_fields(any_cells, adini, vector):
    element = ElementVector(adini(any_cells)) if vector else adini(any_cells)
    order = {2: None, 3: 5}[any_cells.dim()]
    sides = [InteriorFacetBasis(any_cells, element, side=side, intorder=order) for side in (0, 1)]
    x = np.random.default_rng(0).uniform(-1, 1, sides[0].N)
    u, v = (basis.interpolate(x) for basis in sides)
    assert np.abs(np.array(u) - np.array(v)).max() < 1e-13

    n = np.array(sides[0].normals)
    jump = u.grad - v.grad
    across = np.einsum("...iep,iep->...ep", jump, n)
    along = jump - np.einsum("...ep,iep->...iep", across, n)
    size = np.abs(u.grad).max()
    assert np.linalg.norm(along, axis=-3).max() < 1e-13 * size
    assert np.abs(across).max() > 0.1 * size


def test_gradient_is_continuous_at_vertices(any_cells, adini):
    element, mapping, dim = adini(any_cells), any_cells._mapping(), any_cells.dim()
    basis = InteriorFacetBasis(any_cells, element, intorder=1)
    x = np.random.default_rng(0).uniform(-1, 1, basis.N)
    functions = range(len(basis.dofs.element_dofs))
    assert len(functions) == {2: 12, 3: 32}[dim]
    gradient = sum(
        x[basis.dofs.element_dofs[i]][:, None]
        * element.gbasis(mapping, element.refdom.p, i)[0].grad
        for i in functions
    )
    for component in range(dim):
        at_vertex = x[basis.nodal_dofs[component + 1]][any_cells.t.T]
        tolerance = {2: 1e-13, 3: 1e-12}[dim]
        np.testing.assert_allclose(gradient[component], at_vertex, rtol=0, atol=tolerance)
