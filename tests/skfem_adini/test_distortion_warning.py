"""The warning on cells that are not parallelograms: when it comes and what it says."""

import warnings

import numpy as np
import pytest
from skfem import Basis, ElementVector, MeshQuad

from skfem_adini import ElementQuadAdini, ReducedOrderWarning

TRAPEZOID = MeshQuad(np.array([[0.0, 2, 1, 0], [0, 0, 1, 1]]), np.array([[0, 1, 2, 3]]).T)


def caught(mesh, element):
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        Basis(mesh, element)
    return [r for r in records if r.category is ReducedOrderWarning]


def test_silent_on_parallelograms(parallelograms):
    assert not caught(parallelograms, ElementQuadAdini())


def test_once_for_a_basis():
    assert len(caught(TRAPEZOID, ElementQuadAdini())) == 1


def test_says_what_is_lost_and_when_it_is_not():
    with pytest.warns(ReducedOrderWarning) as record:
        Basis(TRAPEZOID, ElementQuadAdini())
    message = str(record[0].message)
    assert "twist t = 0.5" in message
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in message
    assert "uniform refinement of a coarse quadrilateral mesh" in message


def test_twist_falls_with_uniform_refinement():
    twists = [
        float(str(caught(TRAPEZOID.refined(k), ElementQuadAdini())[0].message).split()[8])
        for k in range(4)
    ]
    assert twists == pytest.approx([1 / 2, 1 / 3, 1 / 5, 1 / 9], rel=0.05)


def test_silent_when_negligible():
    p = MeshQuad().p.copy()
    p[0, 2] += 5e-4
    assert not caught(MeshQuad(p, MeshQuad().t), ElementQuadAdini())


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_rounding_is_no_twist(offset):
    """A rotated mesh far from the origin still counts as parallelograms."""
    mesh = MeshQuad().refined(3)
    c, s = np.cos(0.7), np.sin(0.7)
    p = np.array([[c, -s], [s, c]]) @ mesh.p + offset
    element = ElementQuadAdini(derivatives=3)
    assert Basis(MeshQuad(p, mesh.t), element).basis[0][0].grad3 is not None


def test_vector_element_warns_too():
    assert caught(TRAPEZOID, ElementVector(ElementQuadAdini()))
