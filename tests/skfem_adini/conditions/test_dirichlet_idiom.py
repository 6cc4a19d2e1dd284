"""One call for Dirichlet conditions: what it gives, what `get_dofs` costs, where it leads."""

import re

import numpy as np
import pytest
from skfem import Basis, Functional, LinearForm, MeshQuad, condense, solve
from skfem.models.poisson import laplace

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadBFS,
    InputError,
    essential_constraints,
    essential_dofs,
    project_trace,
)

CELLS = (4, 8, 16)
ANGLE = 0.3


def turned(x):
    """Return the coordinates along the sides of the turned square."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    return c * x[0] + s * x[1], c * x[1] - s * x[0]


def exact(x):
    return np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])


def error(basis, u, exact):
    square = Functional(lambda w: (w["u"] - exact(w.x)) ** 2)
    return np.sqrt(square.assemble(basis, u=basis.interpolate(u)))


def system(n, element, turn=False):
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
    if turn:
        c, s = np.cos(ANGLE), np.sin(ANGLE)
        mesh = MeshQuad(np.array([[c, -s], [s, c]]) @ mesh.p, mesh.t)
    basis = Basis(mesh, element)
    u = (lambda x: exact(turned(x))) if turn else exact
    f = LinearForm(lambda v, w: 2 * np.pi**2 * u(w.x) * v).assemble(basis)
    return basis, laplace.assemble(basis), f, u


@pytest.mark.parametrize("element", [ElementQuadAdini(), ElementQuadBFS()], ids=["Adini", "BFS"])
def test_orders_of_both_idioms(element, convergence_order):
    right, wrong = [], []
    for n in CELLS:
        basis, K, f, u = system(n, element)
        right.append(error(basis, solve(*condense(K, f, D=essential_dofs(basis))), u))
        wrong.append(error(basis, solve(*condense(K, f, D=basis.get_dofs())), u))
    assert convergence_order(CELLS, right) == pytest.approx(4, abs=0.15)
    assert convergence_order(CELLS, wrong) == pytest.approx(1, abs=0.25)


def test_slanted_edges(convergence_order):
    errors = []
    for n in CELLS:
        basis, K, f, u = system(n, ElementQuadAdini(), turn=True)
        with pytest.raises(InputError) as refusal:
            essential_dofs(basis)
        # The recipe in the message, as it stands there.
        recipe = str(refusal.value)
        assert "T, x0 = essential_constraints(basis, facets, value)" in recipe
        assert "(T.T @ K @ T) z = T.T @ (f - K @ x0)" in re.sub(r"\s+", " ", recipe)
        T, x0 = essential_constraints(basis)
        z = solve(T.T @ K @ T, T.T @ (f - K @ x0))
        errors.append(error(basis, T @ z + x0, u))
    assert convergence_order(CELLS, errors) == pytest.approx(4, abs=0.15)


def test_whole_boundary_is_the_default():
    basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    facets = basis.mesh.boundary_facets()
    np.testing.assert_array_equal(essential_dofs(basis), essential_dofs(basis, facets))
    T, x0 = essential_constraints(basis, value=1.0)
    same, x1 = essential_constraints(basis, facets, 1.0)
    assert abs(T - same).max() == 0
    np.testing.assert_array_equal(x0, x1)


def test_what_the_idiom_of_lagrange_elements_adds_is_the_normal_derivative():
    basis = Basis(MeshQuad().refined(2).with_defaults(), ElementQuadAdini())
    extra = np.setdiff1d(basis.get_dofs("left").all(), essential_dofs(basis, "left"))
    np.testing.assert_array_equal(extra, np.sort(basis.get_dofs("left").all(["u_x"])))


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHexAdini, ElementQuadBFS])
def test_docstrings_say_so(element):
    text = re.sub(r"\s+", " ", element.__doc__)
    assert "D=essential_dofs(basis)" in text
    assert "basis.get_dofs()" in text
    assert "three orders" in text


def test_inhomogeneous_data_with_the_projected_trace():
    basis = Basis(MeshQuad().refined(3), ElementQuadAdini())

    def g(x):
        return x[0] ** 3 - 3 * x[0] * x[1] ** 2

    x = project_trace(basis, None, g)
    u = solve(*condense(laplace.assemble(basis), basis.zeros(), x=x, D=essential_dofs(basis)))
    assert error(basis, u, g) < 1e-12
