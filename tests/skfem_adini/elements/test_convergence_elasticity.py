"""Plane elasticity: L2 order 4, H1 order 3, and nodal stress of order 3 with no recovery."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementVector, LinearForm, MeshQuad, solve
from skfem.helpers import ddot, dot, sym_grad, trace

from skfem_adini import ElementQuadAdini, essential_constraints, nodal_stress

LAMBDA, MU = 1.5, 1.0
POISSON = LAMBDA / (2 * (LAMBDA + MU))


def displacement(x):
    return np.array([np.sin(2 * x[0]) * np.cos(x[1]), np.cos(x[0] - x[1]) * x[0]])


def displacement_gradient(x):
    s, c = np.sin(x[0] - x[1]), np.cos(x[0] - x[1])
    return np.array(
        [
            [2 * np.cos(2 * x[0]) * np.cos(x[1]), -np.sin(2 * x[0]) * np.sin(x[1])],
            [c - x[0] * s, x[0] * s],
        ]
    )


def stress(gradient):
    strain = (gradient + gradient.swapaxes(0, 1)) / 2
    identity = np.eye(2).reshape(2, 2, *(1,) * (strain.ndim - 2))
    return 2 * MU * strain + LAMBDA * (strain[0, 0] + strain[1, 1]) * identity


def body_force(x, step=1e-4):
    """Minus the divergence of the stress, by fourth-order differences."""
    force = 0
    for k in range(2):
        for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            moved = x.copy()
            moved[k] += shift * step
            force = force - weight * stress(displacement_gradient(moved))[:, k] / (12 * step)
    return force


@BilinearForm
def elasticity(u, v, _):
    e, d = sym_grad(u), sym_grad(v)
    return 2 * MU * ddot(e, d) + LAMBDA * trace(e) * trace(d)


@LinearForm
def force(v, w):
    return dot(body_force(np.array(w.x)), v)


@LinearForm
def traction(v, w):
    return np.einsum("ijep,jep,iep->ep", stress(displacement_gradient(np.array(w.x))), w.n, v)


def test_plane_elasticity_and_nodal_stress(convergence_order):
    """Displacement on the left, tractions elsewhere; the stress is read from the dofs."""
    cells, l2, h1, nodal = [8, 16, 32], [], [], []
    for n in cells:
        mesh = MeshQuad().refined(int(np.log2(n))).with_defaults()
        basis = Basis(mesh, ElementVector(ElementQuadAdini()), intorder=6)
        T, x0 = essential_constraints(basis, "left", displacement)
        K = elasticity.assemble(basis)
        f = force.assemble(basis) + traction.assemble(basis.boundary(["right", "top", "bottom"]))
        x = T @ solve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0

        u, points = basis.interpolate(x), np.array(basis.global_coordinates())
        l2.append(np.sqrt(np.sum((np.array(u) - displacement(points)) ** 2 * basis.dx)))
        h1.append(np.sqrt(np.sum((u.grad - displacement_gradient(points)) ** 2 * basis.dx)))
        found = nodal_stress(basis, x, E=MU * (3 * LAMBDA + 2 * MU) / (LAMBDA + MU), nu=POISSON)
        nodal.append(np.abs(found[:2, :2] - stress(displacement_gradient(mesh.p))).max())
    assert convergence_order(cells, l2) == pytest.approx(4, abs=0.1)
    assert convergence_order(cells, h1) == pytest.approx(3, abs=0.1)
    assert convergence_order(cells, nodal) == pytest.approx(3, abs=0.15)
