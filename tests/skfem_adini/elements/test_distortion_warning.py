"""The message in the log on cells that are not parallelograms: when it comes, what it says."""

import logging

import numpy as np
import pytest
from skfem import Basis, ElementDG, ElementVector, FacetBasis, MeshQuad
from skfem.models.poisson import laplace

from skfem_adini import ElementQuadAdini, assemble


def trapezoid():
    """A new mesh, of which nothing has been said yet."""
    return MeshQuad(np.array([[0.0, 2, 1, 0], [0, 0, 1, 1]]), np.array([[0, 1, 2, 3]]).T)


@pytest.fixture
def logged(caplog):
    """Return a function that gives what is logged when a basis is made."""

    def messages(mesh, element):
        caplog.clear()
        Basis(mesh, element)
        assert {record.levelno for record in caplog.records} <= {logging.WARNING}
        assert {record.name.split(".")[0] for record in caplog.records} <= {"skfem_adini"}
        return caplog.messages

    return messages


def test_silent_on_parallelograms(parallelograms, logged):
    assert not logged(parallelograms, ElementQuadAdini())


ELEMENTS = {
    "scalar": ElementQuadAdini(),
    "vector": ElementVector(ElementQuadAdini()),
    "composite": ElementQuadAdini() * ElementQuadAdini(),
    "discontinuous": ElementDG(ElementQuadAdini()),
}


@pytest.mark.parametrize("kind", ELEMENTS)
def test_once_for_each_mesh(kind, logged):
    """However many bases and elements it gets; a mesh made later is spoken of again."""
    for _ in range(2):
        mesh = trapezoid()
        assert len(logged(mesh, ELEMENTS[kind])) == 1
        for element in ELEMENTS.values():
            assert not logged(mesh, element)


def test_assembly_speaks_of_the_mesh_once(caplog):
    """It evaluates a few cells at a time, as meshes of their own."""
    p = MeshQuad().refined(3).p
    p = p + 0.01 * np.random.default_rng(0).uniform(-1, 1, p.shape)
    mesh = MeshQuad(p, MeshQuad().refined(3).t)
    for _ in range(2):
        assemble(laplace, mesh, ElementQuadAdini())
    Basis(mesh, ElementQuadAdini())
    assert len(caplog.messages) == 1


def test_probes_and_facets_are_silent(caplog):
    basis = Basis(trapezoid(), ElementQuadAdini())
    caplog.clear()
    basis.probes(np.array([[0.2, 0.3], [0.4, 0.5]]))
    basis.interpolator(basis.zeros())(np.array([[0.2], [0.4]]))
    FacetBasis(trapezoid(), ElementQuadAdini())
    assert not caplog.messages


def test_no_python_warning():
    """Warnings are errors here; a loop over meshes stays free of them."""
    Basis(trapezoid(), ElementQuadAdini())


def test_says_what_is_lost_and_when_it_is_not(logged):
    (message,) = logged(trapezoid(), ElementQuadAdini())
    assert "twist t = 0.5" in message
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in message
    assert "uniform refinement of a coarse quadrilateral mesh" in message


def test_twist_falls_with_uniform_refinement(logged):
    twists = [
        float(logged(trapezoid().refined(k), ElementQuadAdini())[0].split()[8]) for k in range(4)
    ]
    assert twists == pytest.approx([1 / 2, 1 / 3, 1 / 5, 1 / 9], rel=0.05)


def test_silent_when_negligible(logged):
    p = MeshQuad().p.copy()
    p[0, 2] += 5e-4
    assert not logged(MeshQuad(p, MeshQuad().t), ElementQuadAdini())


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_rounding_is_no_twist(offset):
    """A rotated mesh far from the origin still counts as parallelograms."""
    mesh = MeshQuad().refined(3)
    c, s = np.cos(0.7), np.sin(0.7)
    p = np.array([[c, -s], [s, c]]) @ mesh.p + offset
    element = ElementQuadAdini(derivatives=3)
    assert Basis(MeshQuad(p, mesh.t), element).basis[0][0].grad3 is not None
