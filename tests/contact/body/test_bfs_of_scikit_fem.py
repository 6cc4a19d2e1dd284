"""Two packages have a class ElementQuadBFS: bodies of either are held and read alike."""

import numpy as np
import pytest
import skfem
from skfem import Basis, ElementVector, MeshQuad

import skfem_adini
from contact import ContactProblem, ElasticBody, InputError, Plane
from skfem_adini import essential_dofs, nodal_gradient, to_pyvista

BOTH = (skfem.ElementQuadBFS, skfem_adini.ElementQuadBFS)
MESH = MeshQuad().refined(2).with_defaults()


def block(element):
    body = ElasticBody.from_mesh(MESH, element(), E=2.0, nu=0.3)
    # A prescribed displacement that is not zero is no value for the derivatives.
    return body.fix("top", "x").fix("top", "y", -0.05)


def test_supports_contact_and_stresses():
    results = [
        ContactProblem(block(element), "bottom", Plane((0, -0.03), (0, 1)), friction=0.3).solve()
        for element in BOTH
    ]
    theirs, ours = results
    assert theirs.resultant == pytest.approx(ours.resultant, abs=1e-9)
    np.testing.assert_allclose(theirs.pressure, ours.pressure, atol=1e-8)
    np.testing.assert_allclose(theirs.nodal_stress(), ours.nodal_stress(), atol=1e-8)
    assert ours.resultant[1] > 0.04


def test_functions_of_dofs_at_vertices():
    theirs, ours = (Basis(MESH, element()) for element in BOTH)
    x = np.random.default_rng(0).standard_normal(ours.N)
    np.testing.assert_array_equal(essential_dofs(theirs, "left"), essential_dofs(ours, "left"))
    np.testing.assert_array_equal(nodal_gradient(theirs, x), nodal_gradient(ours, x))
    grids = [to_pyvista(basis, x) for basis in (theirs, ours)]
    assert grids[0].n_points == grids[1].n_points
    np.testing.assert_allclose(
        grids[0].point_data["u"], grids[1].point_data["u"], rtol=1e-8, atol=1e-8
    )


def test_messages_say_whose_element_it_is():
    basis = Basis(MESH, ElementVector(skfem.ElementQuad1()))
    with pytest.raises(skfem_adini.InputError, match=r"got skfem\.ElementQuad1"):
        essential_dofs(basis)
    with pytest.raises(skfem_adini.InputError, match=r"got skfem\.ElementQuadBFS"):
        skfem_adini.hanging_constraints(Basis(MESH, skfem.ElementQuadBFS()))


LONG = MeshQuad.init_tensor(3 * np.linspace(0, 1, 5), np.linspace(0, 1, 5))


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_element_used_on_another_mesh_before(wrapped):
    """It keeps the functions of its first mesh; bodies take a copy without them."""
    used = skfem.ElementQuadBFS()
    Basis(MESH, used)
    used = ElementVector(used) if wrapped else used
    theirs = ElasticBody.from_mesh(LONG, used, E=2.0, nu=0.3).stiffness
    ours = ElasticBody.from_mesh(LONG, skfem_adini.ElementQuadBFS(), E=2.0, nu=0.3).stiffness
    assert abs(theirs - ours).max() < 1e-10 * abs(ours).max()
    again = ElasticBody.from_mesh(MESH, used, E=2.0, nu=0.3).stiffness
    fresh = ElasticBody.from_mesh(MESH, skfem.ElementQuadBFS(), E=2.0, nu=0.3).stiffness
    assert abs(again - fresh).max() == 0.0


def test_a_basis_with_functions_of_another_mesh_is_refused():
    used = ElementVector(skfem.ElementQuadBFS())
    ElasticBody(Basis(MESH, used), E=2.0, nu=0.3)
    ElasticBody(Basis(MESH, used), E=2.0, nu=0.3)  # the same mesh again
    basis = Basis(LONG, used)
    with pytest.raises(InputError, match=r"skfem\.ElementQuadBFS has kept the shape functions of"):
        ElasticBody(basis, E=2.0, nu=0.3)
