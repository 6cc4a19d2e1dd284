"""What scikit-fem does with an element works with each of ours."""

import pickle
from typing import NamedTuple

import numpy as np
import pytest
from skfem import Basis, BilinearForm, MeshHex, MeshQuad, condense, enforce, solve
from skfem.helpers import dot, grad
from skfem.models.poisson import laplace, unit_load

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, essential_dofs


def plane_cubic(x):
    return x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[1] + 1


def bicubic(x):
    return x[0] ** 3 * x[1] ** 2 - 2 * x[0] * x[1] ** 3 + x[1] + 1


def cubic(x):
    return x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[1] * x[2] + 1


class Case(NamedTuple):
    """An element, a field that it holds, and cells for each side of the unit square or cube."""

    element: object
    mesh: object
    field: object
    twice: object
    centre: float  # the series solution of -laplace(u) = 1 at the centre
    rtol: float


SQUARE, CUBE = MeshQuad().refined(2), MeshHex().refined(1)
CASES = {
    "Adini": Case(ElementQuadAdini(), SQUARE, plane_cubic, SQUARE, 0.0736713, 1e-3),
    "BFS": Case(ElementQuadBFS(), SQUARE, bicubic, SQUARE, 0.0736713, 1e-3),
    "brick": Case(ElementHexAdini(), CUBE, cubic, CUBE.refined(), 0.0562128, 2e-3),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture(scope="module")
def basis(case):
    return Basis(case.mesh, case.element)


def test_project_then_probe(case, basis):
    points = np.random.default_rng(0).uniform(0.05, 0.95, (case.mesh.dim(), 40))
    x = basis.project(case.field)
    np.testing.assert_allclose(basis.probes(points) @ x, case.field(points), atol=1e-12)
    np.testing.assert_allclose(basis.interpolator(x)(points), case.field(points), atol=1e-12)
    np.testing.assert_allclose(x[basis.nodal_dofs[0]], case.field(basis.mesh.p), atol=1e-12)


def test_condense_and_enforce_agree(case):
    basis = Basis(case.twice, case.element)
    fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    K, f = laplace.assemble(basis), unit_load.assemble(basis)
    condensed = solve(*condense(K, f, D=fixed))
    np.testing.assert_allclose(solve(*enforce(K, f, D=fixed)), condensed, atol=1e-12)
    centre = np.full((case.mesh.dim(), 1), 0.5)
    assert basis.probes(centre) @ condensed == pytest.approx(case.centre, rel=case.rtol)


def test_refinement_reproduces_the_coarse_field(case, basis):
    fine = Basis(case.mesh.refined(), case.element)
    x = basis.project(case.field)
    # Mixed derivatives, dofs of BFS alone, hold the rounding of the values over h^2.
    atol = 1e-9 if "u_xy" in case.element.dofnames else 1e-10
    again = fine.project(basis.interpolator(x))
    np.testing.assert_allclose(again, fine.project(case.field), atol=atol)


def test_pickle_after_use(basis):
    copy = pickle.loads(pickle.dumps(basis.elem))
    assert copy.derivatives == basis.elem.derivatives
    for a, b in zip(basis.with_element(copy).basis, basis.basis, strict=True):
        np.testing.assert_array_equal(a[0].grad, b[0].grad)


def test_composite_element(case):
    mesh = case.mesh if case.mesh.dim() == 2 else MeshHex()
    basis = Basis(mesh, case.element * case.element, intorder=None if mesh.dim() == 2 else 4)
    K = BilinearForm(lambda u, p, v, q, _: dot(grad(u), grad(v)) + p * q).assemble(basis)
    assert K.shape == (basis.N, basis.N)
    assert np.abs(K - K.T).max() < 1e-13


def reproduced(element, meshes, field, atol):
    """Whether one instance holds a field on each of the meshes in turn."""
    for mesh in meshes:
        basis = Basis(mesh, element)
        values = field(np.array(basis.global_coordinates()))
        np.testing.assert_allclose(basis.interpolate(basis.project(field)), values, atol=atol)


def test_one_instance_on_several_meshes_of_parallelograms(parallelograms):
    meshes = MeshQuad(), parallelograms, MeshQuad().refined(1)
    reproduced(ElementQuadAdini(), meshes, plane_cubic, 1e-10)


def test_one_instance_on_several_meshes_of_parallelepipeds(parallelepipeds):
    reproduced(ElementHexAdini(), (MeshHex(), parallelepipeds), cubic, 1e-10)


def test_one_instance_on_several_meshes_of_rectangles():
    graded = MeshQuad.init_tensor(*[np.linspace(2, 3, 4)] * 2)
    meshes = MeshQuad(), MeshQuad().refined(1), graded
    reproduced(ElementQuadBFS(), meshes, lambda x: x[0], 1e-11)
