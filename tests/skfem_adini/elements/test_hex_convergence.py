"""The brick's orders: L2 4 and H1 3 for Poisson's equation, and eigenvalues of the cube."""

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, splu
from skfem import Basis, LinearForm, MeshHex
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, essential_constraints, essential_dofs

pi = np.pi


def symmetric_solve(A, b):
    options = {"SymmetricMode": True}
    return splu(A.tocsc(), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(b)


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


def quadratic(x):
    """A harmonic one, so there is no load; on parallelepipeds it is reproduced."""
    return x[0] ** 2 - 2 * x[1] ** 2 + x[2] ** 2 + x[0] * x[1]


def quadratic_gradient(x):
    return np.array([2 * x[0] + x[1], x[0] - 4 * x[1], 2 * x[2]])


def poisson_errors(mesh, u_exact=u_exact, gradient_exact=gradient_exact, load=source):
    basis = Basis(mesh, ElementHexAdini())
    T, x0 = essential_constraints(basis, mesh.boundary_facets(), u_exact)
    K = laplace.assemble(basis)
    f = basis.zeros() if load is None else load.assemble(basis)
    x = T @ symmetric_solve(T.T @ K @ T, T.T @ (f - K @ x0)) + x0
    u, points = basis.interpolate(x), np.array(basis.global_coordinates())
    l2 = np.sum((np.array(u) - u_exact(points)) ** 2 * basis.dx)
    h1 = np.sum((u.grad - gradient_exact(points)) ** 2 * basis.dx)
    return np.sqrt(l2), np.sqrt(h1)


def cube(n):
    x = np.linspace(0, 1, n + 1)
    return MeshHex.init_tensor(x, x, x)


def orders(fit, cells, meshes, *solution):
    l2, h1 = np.transpose([poisson_errors(mesh, *solution) for mesh in meshes])
    return fit(cells, l2), fit(cells, h1)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("sheared", [False, True], ids=["bricks", "parallelepipeds"])
def test_poisson(sheared, convergence_order):
    """On parallelepipeds the Dirichlet data come through faces in every direction."""
    cells = [3, 5, 8]
    A = np.array([[1, 0.3, 0], [0, 1, -0.2], [0.1, 0, 1]]) if sheared else np.eye(3)
    meshes = [MeshHex(A @ cube(n).p, cube(n).t) for n in cells]
    l2, h1 = orders(convergence_order, cells, meshes)
    assert l2 == pytest.approx(4, abs=0.15)
    assert h1 == pytest.approx(3, abs=0.15)


@pytest.mark.slow
def test_poisson_on_finer_meshes(convergence_order):
    cells = [4, 8, 12]
    l2, h1 = orders(convergence_order, cells, [cube(n) for n in cells])
    assert l2 == pytest.approx(4, abs=0.1)
    assert h1 == pytest.approx(3, abs=0.12)


@pytest.mark.turns(4)
def test_uniform_refinement_of_a_coarse_mesh_keeps_the_order(convergence_order):
    mesh = MeshHex().refined(1)
    p = mesh.p + 0.06 * np.random.default_rng(2).uniform(-1, 1, mesh.p.shape)
    mesh = MeshHex(p, mesh.t)
    l2, h1 = orders(convergence_order, [2, 4, 8], [mesh.refined(k) for k in range(3)])
    assert l2 == pytest.approx(4, abs=0.2)
    assert h1 == pytest.approx(3, abs=0.15)


def frusta(n):
    """Return similar truncated pyramids at every level: planes tilt up and down in turn."""
    mesh = cube(n)
    index = np.rint(mesh.p * n).astype(int)
    p = mesh.p.copy()
    tilt = np.where(index[0] % 2 == 1, 0.25, -0.25) / n
    p[2] += np.where(index[2] % 2 == 1, tilt, 0)
    return MeshHex(p, mesh.t)


@pytest.mark.turns(4)
def test_similar_frusta_lose_what_the_warning_says(convergence_order, caplog):
    """Seen alone with a quadratic, whose error is all due to the twist."""
    cells, exact = [4, 6, 8], (quadratic, quadratic_gradient, None)
    l2, h1 = orders(convergence_order, cells, [frusta(n) for n in cells], *exact)
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in caplog.text
    assert l2 == pytest.approx(2, abs=0.2)
    assert h1 == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(("n", "expected"), [(2, 1.366e-4), (4, 3.778e-6), (8, 8.78e-8)])
def test_first_neumann_eigenvalue_of_the_cube(n, expected):
    """The eigenvalue pi^2 is triple; nothing is imposed on the boundary."""
    basis = Basis(cube(n), ElementHexAdini())
    K, M = laplace.assemble(basis), mass.assemble(basis)
    start = np.random.default_rng(0).uniform(-1, 1, basis.N)
    values = np.sort(eigsh(K, k=4, M=M, sigma=5.0, v0=start, return_eigenvectors=False))
    assert abs(values[0]) < 1e-9
    np.testing.assert_allclose(values[1:] / pi**2 - 1, expected, rtol=0.01)


def test_first_dirichlet_eigenvalue_of_the_cube(convergence_order):
    """Order 6 is reached from above; on these meshes the fit gives 5.4."""
    cells, errors = [2, 4, 8], []
    for n in cells:
        basis = Basis(cube(n), ElementHexAdini())
        free = basis.complement_dofs(essential_dofs(basis, basis.mesh.boundary_facets()))
        K, M = (form.assemble(basis)[free][:, free] for form in (laplace, mass))
        start = np.random.default_rng(0).uniform(-1, 1, len(free))
        value = eigsh(K, k=1, M=M, sigma=25.0, v0=start, return_eigenvectors=False)[0]
        errors.append(value / (3 * pi**2) - 1)
    np.testing.assert_allclose(errors, [1.706e-2, 5.048e-4, 1.012e-5], rtol=1e-3)
    assert 5.2 < convergence_order(cells, errors) < 6
