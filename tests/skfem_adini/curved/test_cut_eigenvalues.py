"""Eigenvalues on curved domains, against Bessel roots and the method of particular solutions."""

from functools import cache

import numpy as np
import pytest
from scipy.special import jn_zeros
from skfem import Basis, BilinearForm, ElementVector
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    ghost_penalty,
    lowest_eigenpairs,
    nitsche,
    refined_at_boundary,
)
from tests.skfem_adini.boundary_integrals import Curve, eigenvalue
from tests.skfem_adini.cut_problems import (
    LEVEL_SETS,
    R,
    disk_eigenvalues,
    elastic_radial_number,
    ellipse,
    ellipse_eigenvalue,
    extended,
    flower_eigenvalue,
    matrices,
    unit_square,
)


@cache
def of_disk(n):
    """Relative errors of the first ten eigenvalues, Dirichlet and Neumann."""
    A, K, M = extended(unit_square(n), LEVEL_SETS["disk"])
    dirichlet = lowest_eigenpairs(A, M, 10, shift=0.0)[0]
    neumann = lowest_eigenpairs(K, M, 10)[0]
    assert abs(neumann[0]) < 1e-9
    exact = disk_eigenvalues(10), disk_eigenvalues(10, neumann=True)[1:]
    return np.abs(dirichlet / exact[0] - 1), np.abs(neumann[1:] / exact[1] - 1)


@pytest.mark.parametrize("condition", [0, 1], ids=["Dirichlet", "Neumann"])
def test_disk_order_six(condition, convergence_order):
    cells = [16, 32, 64]
    worst = [of_disk(n)[condition].max() for n in cells]
    assert convergence_order(cells, worst) == pytest.approx(6, abs=0.3)
    assert worst[1] <= (2e-6, 5e-7)[condition]
    assert of_disk(64)[0].max() <= 3e-8
    assert of_disk(32)[0][0] <= 3e-9
    assert of_disk(64)[0][0] <= 5e-11


def test_disk_with_ghost_penalty():
    mesh, element = unit_square(32), ElementQuadAdini()
    domain, K, M, B = matrices(mesh, LEVEL_SETS["disk"])
    active = domain.active_dofs(Basis(mesh, element, intorder=1))
    A = (K + B + ghost_penalty(domain, element)).tocsr()[active][:, active]
    M = (M + ghost_penalty(domain, element, matrix="mass")).tocsr()[active][:, active]
    errors = np.abs(lowest_eigenpairs(A, M, 10, shift=0.0)[0] / disk_eigenvalues(10) - 1)
    assert errors[0] <= 3e-9
    assert errors.max() <= 2e-6


def test_the_references_are_right():
    """Boundary integrals agree with themselves, however many points, and with Bessel's roots."""
    assert ellipse_eigenvalue(80) == pytest.approx(ellipse_eigenvalue(60), rel=1e-11)
    assert flower_eigenvalue(140) == pytest.approx(flower_eigenvalue(110), rel=1e-10)
    circle = [Curve(lambda t: R * np.exp(1j * t), 60)]
    for robin, exact in ((None, disk_eigenvalues(1)[0]), (0.0, disk_eigenvalues(2, True)[1])):
        assert eigenvalue(circle, 1.02 * exact, robin) == pytest.approx(exact, rel=1e-12)


def test_ellipse(convergence_order):
    errors = []
    for n in (16, 24, 32):
        A, _, M = extended(unit_square(n), ellipse)
        value = lowest_eigenpairs(A, M, 1, shift=0.0)[0][0]
        errors.append(abs(value / ellipse_eigenvalue() - 1))
    assert errors[-1] <= 1e-8
    assert convergence_order([16, 24, 32], errors) == pytest.approx(6, abs=0.5)


@pytest.mark.turns(4)
def test_strongly_curved_flower_with_a_refined_boundary():
    """The base grid alone leaves 3.8e-5; two levels of cells at the boundary 8e-8."""
    level_set, reference = LEVEL_SETS["flower"], flower_eigenvalue()
    errors = []
    for levels in (0, 2):
        mesh = refined_at_boundary(unit_square(32), level_set, levels)
        A, _, M = extended(mesh, level_set)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / reference - 1))
    assert errors[0] > 1e-5
    assert errors[1] <= 1e-6


@pytest.mark.sampled(2)
@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
def test_elastic_disk(held, convergence_order):
    """Torsion mu (j / R)^2 and breathing (lambda + 2 mu) k^2, in closed form."""
    lame, mu = 1.5, 1.0
    if held:
        exact = (mu * (jn_zeros(1, 1)[0] / R) ** 2, (lame + 2 * mu) * (jn_zeros(1, 1)[0] / R) ** 2)
    else:
        breathing = elastic_radial_number(lame, mu)
        exact = (mu * (jn_zeros(2, 1)[0] / R) ** 2, (lame + 2 * mu) * breathing**2)
    element = ElementVector(ElementQuadAdini())
    inertia = BilinearForm(lambda u, v, _: dot(u, v))
    cells, errors = [12, 16, 24], []
    for n in cells:
        mesh = unit_square(n)
        domain = CutDomain(mesh, LEVEL_SETS["disk"], q=5)
        A = domain.assemble(linear_elasticity(Lambda=lame, Mu=mu), element)
        if held:
            A = A + nitsche(domain.boundary(element), lame=(lame, mu))[0]
        extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
        A, M = extension.apply(A, domain.assemble(inertia, element))
        values = lowest_eigenpairs(A, M, 16)[0]
        if not held:
            assert np.abs(values[:3]).max() < 1e-8 * values[3]
            assert values[3] > 1
        errors.append([np.abs(values / value - 1).min() for value in exact])
    for error in np.transpose(errors):
        assert 5.4 <= convergence_order(cells, error) <= 6.8
