"""Everything scikit-fem does with an element works with this one."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementDG,
    ElementVector,
    FacetBasis,
    Functional,
    LinearForm,
    MeshQuad,
)
from skfem.helpers import ddot, dot
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementQuadAdini


def cubic(x):
    return x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[1] + 1


POINTS = np.random.default_rng(0).uniform(0.05, 0.95, (2, 40))


@pytest.fixture
def unit_basis():
    return Basis(MeshQuad().refined(2).with_defaults(), ElementQuadAdini())


def test_vector_interpolator_and_split(unit_basis):
    basis = unit_basis.with_element(ElementVector(ElementQuadAdini()))
    assert basis.elem.dofnames == ["u^1", "u^2", "u_x^1", "u_x^2", "u_y^1", "u_y^2"]
    x = basis.project(lambda p: np.array([cubic(p), p[0] * p[1]]))
    values = basis.interpolator(x)(POINTS)
    np.testing.assert_allclose(values, [cubic(POINTS), POINTS[0] * POINTS[1]], atol=1e-12)
    (first, scalar), (second, _) = basis.split(x)
    np.testing.assert_allclose(scalar.interpolator(first)(POINTS), cubic(POINTS), atol=1e-12)
    np.testing.assert_allclose(scalar.interpolator(second)(POINTS), POINTS.prod(0), atol=1e-12)


def test_point_source_is_the_value_of_the_functions(unit_basis):
    x = unit_basis.project(cubic)
    point = np.array([0.31, 0.62])
    assert unit_basis.point_source(point) @ x == pytest.approx(cubic(point), abs=1e-12)


def test_named_dofs(unit_basis):
    view = unit_basis.get_dofs("left")
    assert set(view.nodal) == {"u", "u_x", "u_y"}
    nodes = np.flatnonzero(unit_basis.mesh.p[0] == 0)
    np.testing.assert_array_equal(np.sort(view.nodal["u_y"]), 3 * nodes + 2)
    np.testing.assert_array_equal(np.sort(view.all(["u"])), 3 * nodes)


def test_facet_basis_integrates_traces(unit_basis):
    x = unit_basis.project(cubic)
    for name, normal in (("left", (-1, 0)), ("top", (0, 1))):
        basis = FacetBasis(unit_basis.mesh, ElementQuadAdini(), facets=name)
        flux = Functional(lambda w: dot(w["u"].grad, w.n)).assemble(basis, u=basis.interpolate(x))
        s, weight = np.polynomial.legendre.leggauss(4)
        s, weight = (s + 1) / 2, weight / 2
        p = np.array([np.zeros(4), s]) if name == "left" else np.array([s, np.ones(4)])
        gradient = np.array([3 * p[0] ** 2 - 2 * p[1] ** 2, -4 * p[0] * p[1] + 1])
        assert flux == pytest.approx(np.array(normal) @ gradient @ weight, abs=1e-12)


def test_green_formula_on_every_mesh(parallelograms):
    """Stiffness of a cubic against all functions equals volume and boundary terms."""
    basis = Basis(parallelograms, ElementQuadAdini())
    x = basis.project(cubic)
    volume = LinearForm(lambda v, w: -2 * w.x[0] * v).assemble(basis)
    boundary = FacetBasis(parallelograms, ElementQuadAdini(), intorder=8)
    flux = LinearForm(
        lambda v, w: (
            ((3 * w.x[0] ** 2 - 2 * w.x[1] ** 2) * w.n[0] + (1 - 4 * w.x[0] * w.x[1]) * w.n[1]) * v
        )
    ).assemble(boundary)
    np.testing.assert_allclose(laplace.assemble(basis) @ x, volume + flux, atol=1e-10)


def test_refinterp_gives_values(unit_basis):
    mesh, values = unit_basis.refinterp(unit_basis.project(cubic), nrefs=1)
    np.testing.assert_allclose(values, cubic(mesh.p), atol=1e-12)


def test_discontinuous_copy(unit_basis):
    basis = unit_basis.with_element(ElementDG(ElementQuadAdini()))
    assert 12 * unit_basis.mesh.nelements == basis.N
    x = basis.project(cubic)
    np.testing.assert_allclose(basis.interpolate(x), cubic(basis.global_coordinates()), atol=1e-11)


def test_elements_subset(unit_basis):
    part = unit_basis.with_elements(np.array([1, 5, 6]))
    assert mass.assemble(part).sum() > 0
    assert part.dx.sum() == pytest.approx(3 / 16)


def test_hessian_form_is_symmetric(convex_quads):
    basis = Basis(convex_quads, ElementQuadAdini())
    K = BilinearForm(lambda u, v, _: ddot(u.hess, v.hess)).assemble(basis)
    linear = basis.project(lambda x: 1 + x[0] - 2 * x[1])
    assert np.abs(K @ linear).max() < 1e-9
