"""The shape functions are dual to the dofs, and their value functions add up to one."""

import numpy as np
import pytest

from skfem_adini import ElementHexAdini, ElementQuadAdini

# Numbers of functions of a quadrilateral and of a brick; u and its gradient at each vertex.
FUNCTIONS = {2: 12, 3: 32}
# Eight functions are added up in space.
ROUNDING = {2: 1e-15, 3: 2e-15}


def test_dofs_of_functions_are_the_identity(any_cells, adini):
    element, mapping = adini(any_cells), any_cells._mapping()
    n = FUNCTIONS[any_cells.dim()]
    dofs = []
    for i in range(n):
        (field,) = element.gbasis(mapping, element.refdom.p, i)
        dofs.append(np.array([np.array(field), *field.grad]).transpose(1, 2, 0).reshape(-1, n))
    identity = np.broadcast_to(np.eye(n)[:, None], np.shape(dofs))
    np.testing.assert_allclose(dofs, identity, rtol=0, atol=1e-13)


def test_value_functions_are_a_partition_of_unity(any_cells, adini):
    element, mapping, dim = adini(any_cells), any_cells._mapping(), any_cells.dim()
    points = np.random.default_rng(0).uniform(0, 1, (dim, 30))
    values = range(0, FUNCTIONS[dim], dim + 1)
    fields = [element.gbasis(mapping, points, i)[0] for i in values]
    np.testing.assert_allclose(sum(np.array(f) for f in fields), 1, rtol=0, atol=ROUNDING[dim])
    np.testing.assert_allclose(sum(f.grad for f in fields), 0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("element", [ElementQuadAdini(), ElementHexAdini()], ids=["quad", "hex"])
def test_reference_value_functions_are_a_partition_of_unity(element):
    dim = element.refdom.p.shape[0]
    points = np.random.default_rng(0).uniform(0, 1, (dim, 30))
    value = sum(element.lbasis(points, i)[0] for i in range(0, FUNCTIONS[dim], dim + 1))
    np.testing.assert_allclose(value, 1, rtol=0, atol=ROUNDING[dim])


@pytest.mark.parametrize(
    ("element", "i"),
    [
        *((ElementQuadAdini(), i) for i in (-1, 12, 100)),
        *((ElementHexAdini(), i) for i in (-1, 32, 100)),
    ],
)
def test_there_are_no_other_functions(element, i):
    with pytest.raises(ValueError, match="Index larger"):
        element.lbasis(element.refdom.p, i)
