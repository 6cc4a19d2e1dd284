"""The shape functions are dual to the dofs, and their value functions add up to one."""

import numpy as np
import pytest

from skfem_adini import ElementQuadAdini

CORNERS = np.array([[0.0, 1, 1, 0], [0, 0, 1, 1]])


def test_dofs_of_functions_are_the_identity(any_quads):
    mapping = any_quads._mapping()
    dofs = []
    for i in range(12):
        (field,) = ElementQuadAdini().gbasis(mapping, CORNERS, i)
        dofs.append(np.array([np.array(field), *field.grad]).transpose(1, 2, 0).reshape(-1, 12))
    identity = np.broadcast_to(np.eye(12)[:, None], np.shape(dofs))
    np.testing.assert_allclose(dofs, identity, rtol=0, atol=1e-13)


def test_value_functions_are_a_partition_of_unity(any_quads):
    mapping = any_quads._mapping()
    points = np.random.default_rng(0).uniform(0, 1, (2, 30))
    fields = [ElementQuadAdini().gbasis(mapping, points, i)[0] for i in (0, 3, 6, 9)]
    np.testing.assert_allclose(sum(np.array(f) for f in fields), 1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(sum(f.grad for f in fields), 0, rtol=0, atol=1e-13)


def test_reference_value_functions_are_a_partition_of_unity():
    points = np.random.default_rng(0).uniform(0, 1, (2, 30))
    value = sum(ElementQuadAdini().lbasis(points, i)[0] for i in (0, 3, 6, 9))
    np.testing.assert_allclose(value, 1, rtol=0, atol=1e-15)


@pytest.mark.parametrize("i", [-1, 12, 100])
def test_there_are_twelve_functions(i):
    with pytest.raises(ValueError, match="Index larger"):
        ElementQuadAdini().lbasis(CORNERS, i)
