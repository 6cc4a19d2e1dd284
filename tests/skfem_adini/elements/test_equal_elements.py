"""Elements made alike are equal, name what they were made with, and survive pickling."""

import pickle

import numpy as np
import pytest
from skfem import Basis, ElementQuad1, ElementVector, MeshHex, MeshQuad
from skfem.element import ElementQuadBFS as ScikitFemBFS

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadAdiniCut,
    ElementQuadAdiniWeighted,
    ElementQuadBFS,
    InputError,
)

KINDS = [ElementQuadAdini, ElementQuadBFS, ElementHexAdini]


def weight(x):
    return 1 - x[0] ** 2 - x[1] ** 2


def slope(x):
    return -2 * x


@pytest.mark.parametrize("kind", KINDS)
def test_equality_is_that_of_class_and_derivatives(kind):
    one, same, other = kind(derivatives=2), kind(), kind(derivatives=3)
    assert one == same
    assert hash(one) == hash(same)
    assert len({one, same, other}) == 2
    assert one != other
    assert all(
        one != another() for another in [*KINDS, ScikitFemBFS, ElementQuad1] if another is not kind
    )
    assert repr(one) == f"{kind.__name__}(derivatives=2)"
    copy = pickle.loads(pickle.dumps(other))
    assert copy == other
    assert copy.derivatives == 3
    mesh = MeshHex() if kind is ElementHexAdini else MeshQuad()
    assert Basis(mesh, ElementVector(one)).elem.elem == same


def test_a_subclass_is_another_element():
    class Mine(ElementQuadAdini):
        pass

    assert Mine() != ElementQuadAdini()
    assert ElementQuadAdini() != Mine()
    assert repr(Mine()) == "Mine(derivatives=2)"


def test_weighted_elements_are_equal_by_their_functions():
    one = ElementQuadAdiniWeighted(weight, slope)
    assert one == ElementQuadAdiniWeighted(weight, slope)
    assert hash(one) == hash(ElementQuadAdiniWeighted(weight, slope))
    assert one != ElementQuadAdiniWeighted(weight, slope, degree=4)
    assert one != ElementQuadAdiniWeighted(weight, lambda x: slope(x))
    assert one != ElementQuadAdini(derivatives=1)
    assert repr(one) == (
        "ElementQuadAdiniWeighted(weight=weight, gradient=slope, hessian=NoneType, "
        "derivatives=1, degree=2)"
    )


def test_the_element_of_cut_cells_names_its_mesh():
    mesh = MeshQuad().refined(3)
    element = ElementQuadAdiniCut(mesh, lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.411**2)
    assert repr(element) == f"ElementQuadAdiniCut(64 cells, {element.inside.sum()} vertices inside)"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("given", [True, False, np.True_, 7, -1, "2", [1]])
def test_other_orders_are_refused(kind, given):
    with pytest.raises(InputError, match="derivatives: expected 0 to 6"):
        kind(derivatives=given)


@pytest.mark.parametrize("kind", KINDS)
def test_third_derivatives_reach_forms_and_solutions(kind):
    """Of x^3, in the functions of a basis, of vector fields, and of interpolated solutions."""
    mesh = (MeshHex if kind is ElementHexAdini else MeshQuad)().refined(1)
    basis = Basis(mesh, kind(derivatives=3))
    x = basis.project(lambda x: x[0] ** 3)
    third = basis.interpolate(x).grad3
    expected = np.zeros(third.shape)
    expected[0, 0, 0] = 6
    np.testing.assert_allclose(third, expected, atol=1e-9)
    vector = basis.with_element(ElementVector(basis.elem))
    y = vector.zeros()
    y[1 :: mesh.dim()] = x[: len(y[1 :: mesh.dim()])]
    np.testing.assert_allclose(vector.interpolate(y).grad3[1], expected, atol=1e-9)
