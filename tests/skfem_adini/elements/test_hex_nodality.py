"""The brick's functions are dual to the dofs, and its value functions add up to one."""

import numpy as np
import pytest
from skfem.refdom import RefHex

from skfem_adini import ElementHexAdini


def test_dofs_of_functions_are_the_identity(any_hexes):
    mapping = any_hexes._mapping()
    dofs = []
    for i in range(32):
        (field,) = ElementHexAdini().gbasis(mapping, RefHex.p, i)
        dofs.append(np.array([np.array(field), *field.grad]).transpose(1, 2, 0).reshape(-1, 32))
    identity = np.broadcast_to(np.eye(32)[:, None], np.shape(dofs))
    np.testing.assert_allclose(dofs, identity, rtol=0, atol=1e-13)


def test_value_functions_are_a_partition_of_unity(any_hexes):
    mapping = any_hexes._mapping()
    points = np.random.default_rng(0).uniform(0, 1, (3, 30))
    fields = [ElementHexAdini().gbasis(mapping, points, i)[0] for i in range(0, 32, 4)]
    np.testing.assert_allclose(sum(np.array(f) for f in fields), 1, rtol=0, atol=2e-15)
    np.testing.assert_allclose(sum(f.grad for f in fields), 0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("i", [-1, 32, 100])
def test_there_are_32_functions(i):
    with pytest.raises(ValueError, match="Index larger"):
        ElementHexAdini().lbasis(RefHex.p, i)
