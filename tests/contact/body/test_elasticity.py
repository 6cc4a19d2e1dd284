"""Stiffness and stress agree with scikit-fem's own elasticity and with closed forms."""

import numpy as np
import pytest
from families import PLANE, STRAIGHT
from skfem import (
    Basis,
    ElementHex1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP2,
    ElementVector,
)
from skfem.models.elasticity import lame_parameters, linear_elasticity, plane_stress

from contact import ContactProblem, ElasticBody, InputError
from contact.body.elasticity import lame, stress
from skfem_adini import ElementQuadAdini

TICKS = np.array([0.0, 0.3, 1.0, 1.4])


def basis_of(element):
    mesh_class = STRAIGHT[element]
    dim = mesh_class().dim()
    ticks = TICKS if dim == 2 else TICKS[:3]
    return Basis(mesh_class.init_tensor(*(ticks,) * dim), ElementVector(element()))


def worst_entry(S, expected):
    """Largest difference of entries over the largest entry."""
    return abs(S - expected).max() / abs(expected).max()


@pytest.mark.parametrize("element", PLANE)
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_plane_stiffness(element, plane):
    basis = basis_of(element)
    moduli = {"strain": lame_parameters, "stress": plane_stress}[plane](2.0, 0.3)
    expected = linear_elasticity(*moduli).assemble(basis)
    # A few sums of products of order one.
    assert worst_entry(ElasticBody(basis, 2.0, 0.3, plane).stiffness, expected) < 1e-14


@pytest.mark.parametrize("element", [ElementTetP1, ElementTetP2, ElementHex1])
def test_solid_stiffness(element):
    basis = basis_of(element)
    expected = linear_elasticity(*lame_parameters(2.0, 0.3)).assemble(basis)
    # A few sums of products of order one.
    assert worst_entry(ElasticBody(basis, 2.0, 0.3).stiffness, expected) < 1e-14


@pytest.mark.parametrize("element", [*PLANE, ElementTetP1, ElementHex1])
def test_material_of_each_cell(element):
    basis = basis_of(element)
    rng = np.random.default_rng(5)
    E, nu = rng.uniform(1, 3, basis.mesh.nelements), rng.uniform(-0.3, 0.45, basis.mesh.nelements)
    lam, mu = lame_parameters(E[:, None], nu[:, None])
    expected = linear_elasticity(lam, mu).assemble(basis)
    # A few sums of products of order one.
    assert worst_entry(ElasticBody(basis, E, nu).stiffness, expected) < 1e-14


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_stress_agrees_with_the_textbook_matrix(plane):
    strain = np.array([[0.3, -0.2], [-0.2, 0.7]])
    lam, mu = lame(2.0, 0.3, plane)
    ours = stress(strain, lam, mu)
    if plane == "strain":
        C = np.array([[0.7, 0.3, 0], [0.3, 0.7, 0], [0, 0, 0.2]]) * 2.0 / (1.3 * 0.4)
    else:
        C = np.array([[1, 0.3, 0], [0.3, 1, 0], [0, 0, 0.35]]) * 2.0 / (1 - 0.09)
    voigt = C @ np.array([strain[0, 0], strain[1, 1], 2 * strain[0, 1]])
    # Rounding of a handful of operations.
    np.testing.assert_allclose([ours[0, 0], ours[1, 1], ours[0, 1]], voigt, rtol=1e-14)


@pytest.mark.parametrize(
    ("E", "nu"),
    [(0.0, 0.3), (-1.0, 0.3), (np.nan, 0.3), (np.inf, 0.3), (1, 0.5), (1, -1), (1, np.nan)],
)
def test_inadmissible_material(E, nu):
    with pytest.raises(InputError, match="E=" if not (np.isfinite(E) and E > 0) else "nu="):
        lame(E, nu)


GRADIENT = {2: np.array([[0.01, 0.03], [-0.02, -0.04]])}
GRADIENT[3] = np.array([[0.01, 0.03, 0.0], [-0.02, -0.04, 0.01], [0.005, 0.02, 0.03]])


@pytest.mark.parametrize(
    ("element", "plane"),
    [
        (ElementTriP2, "strain"),
        (ElementQuadAdini, "strain"),
        (ElementQuadAdini, "stress"),
        (ElementQuad2, "stress"),
        (ElementHex1, None),
        (ElementTetP1, None),
    ],
)
def test_stress_of_an_affine_displacement(element, plane, make):
    """Stress and von Mises of u = A x, prescribed on the whole outline but the contact side."""
    dim = element().dim
    A = GRADIENT[dim]
    mesh = make.box(element, *(TICKS,) * dim)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3, plane=plane)
    lam, mu = 2 * 0.3 / (1.3 * 0.4), 1 / 1.3  # textbook, three-dimensional
    strain = np.zeros((3, 3))
    strain[:dim, :dim] = 0.5 * (A + A.T)
    if plane == "stress":
        strain[2, 2] = -lam * np.trace(strain) / (lam + 2 * mu)  # from sigma_zz = 0
    sigma = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)

    sides = [name for name in mesh.boundaries if name != "bottom"]
    for c in range(dim):
        body.fix(sides, c, lambda x, c=c: np.tensordot(A[c], x, axes=1))
    down = -np.eye(dim)[-1]
    body.load("bottom", sigma[:dim, :dim] @ down)
    result = ContactProblem(body, "bottom", 1e3).solve()  # far out of reach

    points = np.random.default_rng(2).uniform(0, 1.4, (dim, 20))
    everywhere = (result.stress(), result.von_mises())
    for sigma_h, mises in (everywhere, (result.stress(points), result.von_mises(points))):
        expected = sigma[:dim, :dim].reshape(dim, dim, *(1,) * (sigma_h.ndim - 2))
        # One linear solve with a matrix of condition 1e3.
        assert np.abs(sigma_h - expected).max() < 1e-12
        assert np.abs(mises - np.sqrt(1.5 * np.sum(deviator**2))).max() < 1e-12
