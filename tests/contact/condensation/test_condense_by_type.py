"""The type of a body says how it is condensed, and another kind may bring its own way."""

import numpy as np
import pytest
from skfem import ElementQuad2, MeshQuad

from contact import CondensedContact, ContactProblem, ElasticBody, InputError, LayeredBlock
from contact.body.basis_solid import BasisSolid
from contact.condensation.condense import condense
from contact.condensation.layers import CondensedLayers
from contact.condensation.sparse import SparseBody


def square(kind):
    mesh = MeshQuad().refined(2).with_defaults()
    return kind.from_mesh(mesh, ElementQuad2(), E=2.0, nu=0.3).fix("top", "xy", -0.1)


def test_each_kind_has_its_way():
    block = LayeredBlock(1.0, [(1.0, 4, 2.0, 0.3)], top="xy")
    for body, way in ((block, CondensedLayers), (square(ElasticBody), SparseBody)):
        condensed = ContactProblem(body, "bottom", 0.0).condense()
        assert type(condensed) is CondensedContact
        assert [type(part) for part in condensed.parts] == [way]


def test_another_kind_registers_its_own():
    class Another(ElasticBody):
        pass

    asked = []

    @condense.register(Another)
    def _(body, rows, solver, device):
        asked.append((solver, device))
        return condense.dispatch(BasisSolid)(body, rows, solver, device)

    result = ContactProblem(square(Another), "bottom", 0.05, solver="superlu").solve()
    expected = ContactProblem(square(ElasticBody), "bottom", 0.05, solver="superlu").solve()
    assert asked == [("superlu", "cpu")]
    np.testing.assert_array_equal(result.u, expected.u)


def test_a_kind_that_is_not_known_is_refused_by_name():
    rows = ContactProblem(square(ElasticBody), "bottom", 0.0).rows
    with pytest.raises(InputError, match="condense a MeshQuad"):
        condense(MeshQuad(), rows, "auto", "cpu")
