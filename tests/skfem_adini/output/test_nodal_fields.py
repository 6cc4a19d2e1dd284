"""Gradients and stresses at the vertices, from the dofs alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skfem import Basis, ElementVector, MeshHex, MeshQuad

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    nodal_gradient,
    nodal_stress,
    von_mises,
)

TICKS = np.array([0, 0.3, 0.5, 1.1])
PLANE = Basis(MeshQuad.init_tensor(TICKS, TICKS[:3]), ElementVector(ElementQuadAdini()))
SPACE = Basis(MeshHex.init_tensor(TICKS[:3], TICKS, TICKS[:2]), ElementVector(ElementHexAdini()))
numbers = st.floats(-2, 2)


def linear_field(basis, gradient, shift=0.0):
    """Return the dofs of u = gradient x + shift, without the functions under test."""
    dim = basis.mesh.dim()
    x = basis.zeros()
    dofs = basis.nodal_dofs.reshape(-1, dim, basis.mesh.nvertices)
    x[dofs[0]] = gradient @ basis.mesh.p + shift
    for j in range(dim):
        x[dofs[1 + j]] = gradient[:, j : j + 1]
    return x


@pytest.mark.parametrize(
    "element",
    [ElementQuadAdini(), ElementQuadBFS(), ElementHexAdini()],
    ids=lambda element: type(element).__name__,
)
def test_gradient_of_a_cubic(element):
    mesh = SPACE.mesh if isinstance(element, ElementHexAdini) else PLANE.mesh
    basis = Basis(mesh, element)
    x = basis.project(lambda p: p[0] ** 3 * p[1] - p[1] ** 2 + p[-1])
    X, Y, last = mesh.p[0], mesh.p[1], np.eye(mesh.dim())[-1]
    expected = np.zeros((mesh.dim(), mesh.nvertices)) + last[:, None]
    expected[:2] += [3 * X**2 * Y, X**3 - 2 * Y]
    np.testing.assert_allclose(nodal_gradient(basis, x), expected, atol=1e-10)


@pytest.mark.parametrize("basis", [PLANE, SPACE], ids=["plane", "space"])
@given(angle=numbers, shift=numbers, E=st.floats(0.1, 10), nu=st.floats(-0.9, 0.49))
def test_small_rotations_have_no_stress(basis, angle, shift, E, nu):
    spin = np.zeros((basis.mesh.dim(),) * 2)
    spin[0, 1], spin[1, 0] = angle, -angle
    stress = nodal_stress(basis, linear_field(basis, spin, shift), E, nu)
    np.testing.assert_array_equal(stress, 0)


@given(stretch=numbers, E=st.floats(0.1, 10), nu=st.floats(-0.9, 0.49))
def test_uniaxial_tension(stretch, E, nu):
    """With free sides only sigma_xx = E e is left; between rigid plates sigma_zz is nu of it."""
    for basis, plane in ((PLANE, "stress"), (SPACE, "strain")):
        gradient = np.diag([stretch, *[-nu * stretch] * (basis.mesh.dim() - 1)])
        stress = nodal_stress(basis, linear_field(basis, gradient), E, nu, plane=plane)
        expected = np.zeros((3, 3, 1))
        expected[0, 0] = E * stretch
        scale = E * abs(stretch) / ((1 - 2 * nu) * (1 + nu))
        np.testing.assert_allclose(stress - expected, 0, atol=1e-13 * scale + 1e-300)
    gradient = np.diag([stretch, -nu / (1 - nu) * stretch])
    stress = nodal_stress(PLANE, linear_field(PLANE, gradient), E, nu)
    expected[0, 0] = E / (1 - nu**2) * stretch
    expected[2, 2] = nu * expected[0, 0]
    np.testing.assert_allclose(stress - expected, 0, atol=1e-13 * scale + 1e-300)


def test_von_mises():
    assert von_mises(np.diag([5.0, 0, 0])) == pytest.approx(5)
    assert von_mises(np.eye(3) * 7) == pytest.approx(0)
    shear = np.zeros((3, 3, 2))
    shear[0, 2] = shear[2, 0] = [1, 2]
    np.testing.assert_allclose(von_mises(shear), np.sqrt(3) * np.array([1, 2]))
    sigma = np.random.default_rng(0).uniform(-1, 1, (3, 3))
    a, b, c = np.linalg.eigvalsh(sigma + sigma.T)
    principal = np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)
    assert von_mises(sigma + sigma.T) == pytest.approx(principal)


def test_mean_over_materials():
    """At a vertex of the interface half the cells are stiff; elsewhere the value is one-sided."""
    middle = PLANE.mesh.p[0, PLANE.mesh.t].mean(axis=0)
    E = np.where(middle < 0.3, 1.0, 9.0)
    u = linear_field(PLANE, np.array([[0.0, 1.0], [0.0, 0.0]]))
    shear = nodal_stress(PLANE, u, E, 0.0)[0, 1]
    px = PLANE.mesh.p[0]
    np.testing.assert_allclose(shear, np.select([px < 0.3, px == 0.3], [0.5, 2.5], 4.5))


def test_law():
    """Any law of the gradient; here the first Piola-Kirchhoff stress of Saint Venant-Kirchhoff."""

    def law(gradient):
        F = gradient + np.eye(2)[..., None]
        green = 0.5 * (np.einsum("kin,kjn->ijn", F, F) - np.eye(2)[..., None])
        return np.einsum("ikn,kjn->ijn", F, 2 * green)

    x = linear_field(PLANE, np.diag([1.0, 0.0]))
    expected = np.broadcast_to(np.diag([6.0, 0.0])[..., None], (2, 2, PLANE.mesh.nvertices))
    np.testing.assert_allclose(nodal_stress(PLANE, x, law=law), expected)
