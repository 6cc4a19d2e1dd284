"""The brick's orders: L2 4 and H1 3 for Poisson's equation, and eigenvalues of the cube."""

import warnings

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, spsolve
from skfem import Basis, LinearForm, MeshHex
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, ReducedOrderWarning, essential_constraints

pi = np.pi


def u_exact(x):
    return np.sin(pi * x[0]) * np.sin(pi * x[1]) * np.cos(2 * x[2]) * np.exp(x[0])


def gradient_exact(x):
    s, c, e = np.sin(pi * x[:2]), np.cos(pi * x[:2]), np.exp(x[0])
    bottom, slope = np.cos(2 * x[2]), -2 * np.sin(2 * x[2])
    return np.array(
        [
            (pi * c[0] + s[0]) * s[1] * bottom * e,
            pi * s[0] * c[1] * bottom * e,
            s[0] * s[1] * slope * e,
        ]
    )


@LinearForm
def source(v, w):
    """Minus the Laplacian: (2 pi^2 + 3) u - 2 pi cos(pi x) sin(pi y) cos(2 z) e^x."""
    x = np.array(w.x)
    rest = np.cos(pi * x[0]) * np.sin(pi * x[1]) * np.cos(2 * x[2]) * np.exp(x[0])
    return ((2 * pi**2 + 3) * u_exact(x) - 2 * pi * rest) * v


def poisson_errors(mesh):
    basis = Basis(mesh, ElementHexAdini())
    T, x0 = essential_constraints(basis, mesh.boundary_facets(), u_exact)
    K, f = laplace.assemble(basis), source.assemble(basis)
    x = T @ spsolve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0), permc_spec="MMD_AT_PLUS_A") + x0
    u, points = basis.interpolate(x), np.array(basis.global_coordinates())
    l2 = np.sum((np.array(u) - u_exact(points)) ** 2 * basis.dx)
    h1 = np.sum((u.grad - gradient_exact(points)) ** 2 * basis.dx)
    return np.sqrt(l2), np.sqrt(h1)


def cube(n):
    x = np.linspace(0, 1, n + 1)
    return MeshHex.init_tensor(x, x, x)


def orders(fit, cells, meshes):
    l2, h1 = np.transpose([poisson_errors(mesh) for mesh in meshes])
    return fit(cells, l2), fit(cells, h1)


@pytest.mark.parametrize("sheared", [False, True], ids=["bricks", "parallelepipeds"])
def test_poisson(sheared, convergence_order):
    """On parallelepipeds the Dirichlet data come through faces in every direction."""
    cells = [3, 5, 8]
    A = np.array([[1, 0.3, 0], [0, 1, -0.2], [0.1, 0, 1]]) if sheared else np.eye(3)
    meshes = [MeshHex(A @ cube(n).p, cube(n).t) for n in cells]
    l2, h1 = orders(convergence_order, cells, meshes)
    assert l2 == pytest.approx(4, abs=0.15)
    assert h1 == pytest.approx(3, abs=0.15)


def warped(strength):
    mesh = MeshHex().refined(1)
    p = mesh.p + strength * np.random.default_rng(2).uniform(-1, 1, mesh.p.shape)
    return MeshHex(p, mesh.t)
