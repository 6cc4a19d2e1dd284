"""Extension on meshes that are finer at the boundary: hanging vertices inside, outside, in cuts."""

import numpy as np
import pytest
from skfem import Basis, LinearForm
from skfem.models.poisson import laplace

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    Polygon,
    hanging_constraints,
    lowest_eigenpairs,
    nitsche,
    refined_at_boundary,
)

ELEMENT = ElementQuadAdini()
PENTAGON = Polygon([[0.12, 0.81, 0.93, 0.6, 0.15], [0.1, 0.07, 0.6, 0.93, 0.7]])
WHERE = {
    "all around": None,
    "ends in cut cells": lambda x: x[0] + 0.3 * x[1] < 0.63,
    "single cells": lambda x: np.hypot(x[0] - 0.8, x[1] - 0.6) < 0.15,
}


def cubic(x):
    return x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[1]


def exact_dofs(basis):
    found = basis.zeros()
    x, y = basis.mesh.p
    found[basis.nodal_dofs[0]] = cubic(basis.mesh.p)
    found[basis.nodal_dofs[1]], found[basis.nodal_dofs[2]] = 3 * x**2 - 2 * y**2, 1 - 4 * x * y
    return found


@pytest.mark.parametrize(
    ("where", "levels"), [("all around", 1), ("ends in cut cells", 2), ("single cells", 1)]
)
def test_cubics_are_exact(cut_problems, where, levels):
    """-lap (x^3 - 2 x y^2 + y) = -2 x in a pentagon, where all integrals are exact."""
    level_set = PENTAGON
    base = cut_problems.unit_square(7)
    mesh = refined_at_boundary(base, level_set, levels, layers=1, where=WHERE[where])
    assert mesh.t.shape[1] > base.t.shape[1]
    domain = CutDomain(mesh, level_set, q=4)
    basis = Basis(mesh, ELEMENT, intorder=1)
    B, b = nitsche(domain.boundary(ELEMENT), cubic)
    extension = AdiniExtension(basis, domain)
    A = domain.assemble(laplace, ELEMENT) + B
    b = b + domain.assemble(LinearForm(lambda v, w: -2 * w.x[0] * v), ELEMENT)
    x = extension.solve(A, b)
    active = domain.active_dofs(basis)
    np.testing.assert_allclose(x[active], exact_dofs(basis)[active], atol=1e-9)
    spectrum = np.linalg.eigvalsh(extension.apply(A)[0].toarray())
    assert spectrum[0] > 0


def test_functions_of_the_extension_are_continuous_across_hanging_vertices(cut_problems):
    level_set = cut_problems.LEVEL_SETS["mild flower"]
    mesh = refined_at_boundary(
        cut_problems.unit_square(7), level_set, 2, layers=1, where=WHERE["ends in cut cells"]
    )
    domain, basis = CutDomain(mesh, level_set, q=3), Basis(mesh, ELEMENT, intorder=1)
    extension = AdiniExtension(basis, domain)
    z = np.random.default_rng(0).uniform(-1, 1, extension.P.shape[1])
    x = extension.expand(z)
    T, _ = hanging_constraints(basis)
    # x lies in the range of T: the dofs of hanging vertices are those of their edges.
    free = np.flatnonzero(np.diff(T.tocsr().indptr) == 1)
    y = np.zeros(T.shape[1])
    y[T.tocsr()[free].indices] = x[free]
    active = domain.active_dofs(basis)
    np.testing.assert_allclose((T @ y)[active], x[active], atol=1e-12 * np.abs(x).max())


@pytest.mark.slow
def test_flower_with_half_of_its_boundary_refined_keeps_order_six(
    cut_problems, boundary_integrals, convergence_order
):
    level_set = cut_problems.LEVEL_SETS["mild flower"]

    def petals(t):
        return 0.5 + 0.5j + (0.35 + 0.03 * np.cos(5 * (t - 0.1))) * np.exp(1j * t)

    exact = boundary_integrals.eigenvalue([boundary_integrals.Curve(petals, 100)], 49.0)
    cells, errors = [12, 16, 24, 32], []
    for n in cells:
        base = cut_problems.unit_square(n)
        mesh = refined_at_boundary(base, level_set, where=WHERE["ends in cut cells"])
        A, _, M = cut_problems.extended(mesh, level_set)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / exact - 1))
    assert errors[-1] < 5e-7
    # The cells that are not refined set the error; how they are cut changes from mesh to mesh.
    assert convergence_order(cells, errors) == pytest.approx(5.7, abs=0.8)
