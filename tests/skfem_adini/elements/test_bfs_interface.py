"""What scikit-fem and this package do with the BFS element."""

import numpy as np
import pytest
from skfem import Basis, ElementDG, ElementVector, FacetBasis, Functional, MeshQuad
from skfem.helpers import dot

from skfem_adini import ElementQuadBFS, essential_constraints, essential_dofs, project_trace

POINTS = np.random.default_rng(0).uniform(0.05, 0.95, (2, 40))


def bicubic(x):
    return x[0] ** 3 * x[1] ** 2 - 2 * x[0] * x[1] ** 3 + x[1] + 1


@pytest.fixture(scope="module")
def unit_basis():
    return Basis(MeshQuad().refined(2).with_defaults(), ElementQuadBFS())


def test_project_then_probe(unit_basis):
    x = unit_basis.project(bicubic)
    np.testing.assert_allclose(unit_basis.probes(POINTS) @ x, bicubic(POINTS), atol=1e-12)
    np.testing.assert_allclose(unit_basis.interpolator(x)(POINTS), bicubic(POINTS), atol=1e-12)
    X, Y = unit_basis.mesh.p
    np.testing.assert_allclose(x[unit_basis.nodal_dofs[3]], 6 * X**2 * Y - 6 * Y**2, atol=1e-10)


def test_vector_field(unit_basis):
    basis = unit_basis.with_element(ElementVector(ElementQuadBFS()))
    assert basis.elem.dofnames[-2:] == ["u_xy^1", "u_xy^2"]
    x = basis.project(lambda p: np.array([bicubic(p), p[0] * p[1]]))
    expected = [bicubic(POINTS), POINTS.prod(axis=0)]
    np.testing.assert_allclose(basis.interpolator(x)(POINTS), expected, atol=1e-12)


def test_facet_basis(unit_basis):
    x = unit_basis.project(bicubic)
    basis = FacetBasis(unit_basis.mesh, ElementQuadBFS(), facets="right")
    flux = Functional(lambda w: dot(w["u"].grad, w.n)).assemble(basis, u=basis.interpolate(x))
    # The integral of 3 y^2 - 2 y^3.
    assert flux == pytest.approx(1 / 2, abs=1e-12)


def test_discontinuous_copy(unit_basis):
    basis = unit_basis.with_element(ElementDG(ElementQuadBFS()))
    x = basis.project(bicubic)
    np.testing.assert_allclose(
        basis.interpolate(x), bicubic(basis.global_coordinates()), atol=1e-11
    )


def test_dirichlet_conditions_leave_the_normal_derivatives(unit_basis):
    names = np.array(unit_basis.elem.dofnames)
    fixed = essential_dofs(unit_basis, "bottom")
    assert set(names[fixed % 4]) == {"u", "u_x"}
    clamped = essential_dofs(unit_basis, "bottom", clamp_normal=True)
    assert set(names[clamped % 4]) == set(names)
    T, x0 = essential_constraints(unit_basis, "bottom", bicubic)
    assert T.shape[1] == unit_basis.N - len(fixed)
    for x in (
        T @ np.random.default_rng(0).uniform(-1, 1, T.shape[1]) + x0,
        project_trace(unit_basis, "bottom", bicubic),
    ):
        trace = FacetBasis(unit_basis.mesh, unit_basis.elem, facets="bottom")
        points = np.array(trace.global_coordinates())
        np.testing.assert_allclose(trace.interpolate(x), bicubic(points), atol=1e-12)
