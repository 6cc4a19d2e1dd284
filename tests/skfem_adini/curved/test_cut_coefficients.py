"""Strongly varying conductivity on a cut domain keeps the full order."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, Functional, LinearForm
from skfem.helpers import dot, grad

from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini, nitsche

STEEP = 5.0


def k(x):
    """Conductivity that varies by a factor of about 300 over the disk."""
    return np.exp(STEEP * (x[0] + x[1]))


def u(x):
    return np.sin(5 * x[0] + 0.3) * np.exp(2 * x[1])


def gradient(x):
    e = np.exp(2 * x[1])
    return np.array([5 * np.cos(5 * x[0] + 0.3) * e, 2 * np.sin(5 * x[0] + 0.3) * e])


stiffness = BilinearForm(lambda u, v, w: k(w.x) * dot(grad(u), grad(v)))
# -div (k grad u) = k (21 u - STEEP (u_x + u_y))
source = LinearForm(lambda v, w: k(w.x) * (21 * u(w.x) - STEEP * gradient(w.x).sum(axis=0)) * v)
square = Functional(lambda w: (w.x_h - u(w.x)) ** 2)
energy = Functional(lambda w: ((w.x_h.grad - gradient(w.x)) ** 2).sum(axis=0))


@pytest.mark.turns(4)
def test_orders_with_a_steep_conductivity(cut_problems, convergence_order):
    element, cells, found = ElementQuadAdini(), [12, 16, 24, 32, 48], []
    for n in cells:
        mesh = cut_problems.unit_square(n)
        domain = CutDomain(mesh, cut_problems.LEVEL_SETS["disk"], q=6)
        B, b = nitsche(domain.boundary(element), u, coefficient=k)
        A = domain.assemble(stiffness, element, 10) + B
        extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
        x = extension.solve(A, b + domain.assemble(source, element, 10))
        found.append(
            [
                np.sqrt(
                    sum(
                        norm.assemble(basis, x_h=basis.interpolate(x))
                        for basis in domain.groups(element, 10)
                    )
                )
                for norm in (square, energy)
            ]
        )
    l2, h1 = (convergence_order(cells, error) for error in np.transpose(found))
    assert 3.9 <= l2 <= 4.5
    assert 2.9 <= h1 <= 3.4
