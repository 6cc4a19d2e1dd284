"""Orders of convergence: L2 4 and H1 3 on parallelograms, what is lost and kept elsewhere."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, LinearForm, MeshQuad, solve
from skfem.helpers import dot, grad

from skfem_adini import ElementQuadAdini, essential_constraints

pi = np.pi


def u_exact(x):
    return np.sin(pi * x[0]) * np.sin(pi * x[1]) * np.exp(x[0] + x[1] / 2)


def gradient_exact(x):
    s, c, e = np.sin(pi * x), np.cos(pi * x), np.exp(x[0] + x[1] / 2)
    return np.array([(pi * c[0] + s[0]) * s[1] * e, s[0] * (pi * c[1] + s[1] / 2) * e])


def load(x):
    s, c, e = np.sin(pi * x), np.cos(pi * x), np.exp(x[0] + x[1] / 2)
    u_xx = (-(pi**2) * s[0] + 2 * pi * c[0] + s[0]) * s[1] * e
    u_yy = s[0] * (-(pi**2) * s[1] + pi * c[1] + s[1] / 4) * e
    return -(u_xx + u_yy)


@BilinearForm
def laplace(u, v, _):
    return dot(grad(u), grad(v))


@LinearForm
def source(v, w):
    return load(np.array(w.x)) * v


def poisson_errors(mesh):
    basis = Basis(mesh, ElementQuadAdini(), intorder=8)
    T, x0 = essential_constraints(basis, mesh.boundary_facets(), u_exact)
    K, f = laplace.assemble(basis), source.assemble(basis)
    x = T @ solve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0
    u, points = basis.interpolate(x), np.array(basis.global_coordinates())
    l2 = np.sum((np.array(u) - u_exact(points)) ** 2 * basis.dx)
    h1 = np.sum((u.grad - gradient_exact(points)) ** 2 * basis.dx)
    return np.sqrt(l2), np.sqrt(h1)


def orders(fit, cells, meshes):
    l2, h1 = np.transpose([poisson_errors(mesh) for mesh in meshes])
    return fit(cells, l2), fit(cells, h1)


CELLS = [8, 16, 32]


def graded(n):
    x = np.linspace(0, 1, n + 1)
    return MeshQuad.init_tensor(x + 0.1 * np.sin(pi * x) ** 2, x**1.2)


@pytest.mark.parametrize("name", ["uniform", "graded"])
def test_poisson_on_rectangles(name, convergence_order):
    make = {"uniform": lambda n: MeshQuad().refined(int(np.log2(n))), "graded": graded}[name]
    l2, h1 = orders(convergence_order, CELLS, [make(n) for n in CELLS])
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.1)


def test_poisson_on_parallelograms(convergence_order):
    meshes = []
    for n in CELLS:
        mesh = MeshQuad().refined(int(np.log2(n)))
        meshes.append(MeshQuad(np.array([mesh.p[0] + 0.4 * mesh.p[1], mesh.p[1]]), mesh.t))
    l2, h1 = orders(convergence_order, CELLS, meshes)
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.1)


def test_uniform_refinement_of_a_coarse_quad_mesh_keeps_the_order(convergence_order):
    mesh = MeshQuad().refined(2)
    inside = mesh.interior_nodes()
    p = mesh.p.copy()
    p[:, inside] += 0.06 * np.random.default_rng(2).uniform(-1, 1, (2, len(inside)))
    mesh = MeshQuad(p, mesh.t)
    l2, h1 = orders(convergence_order, CELLS, [mesh.refined(k) for k in (1, 2, 3)])
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.1)


def trapezoids(n):
    """Similar trapezoids at every level, as in the reference of the warning."""
    mesh = MeshQuad().refined(int(np.log2(n)))
    column, row = np.rint(mesh.p * n).astype(int)
    p = mesh.p.copy()
    p[1] += np.where(row % 2 == 1, np.where(column % 2 == 1, 0.25, -0.25) / n, 0)
    return MeshQuad(p, mesh.t)


def test_similar_trapezoids_lose_what_the_warning_says(convergence_order, caplog):
    cells = [16, 32, 64]
    l2, h1 = orders(convergence_order, cells, [trapezoids(n) for n in cells])
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in caplog.text
    assert l2 == pytest.approx(2, abs=0.35)
    assert h1 == pytest.approx(1, abs=0.25)
