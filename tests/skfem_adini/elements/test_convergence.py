"""Orders: L2 4 and H1 3 on parallel sides, what is lost and kept elsewhere; plates, stresses."""

import numpy as np
import pytest
import sympy
from convergence import order
from skfem import Basis, BilinearForm, ElementVector, LinearForm, MeshHex, MeshQuad, condense, solve
from skfem.helpers import ddot, dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

import skfem_adini
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, essential_constraints

pi = np.pi
X = sympy.symbols("x y z")
x, y, z = X
PLANE = sympy.sin(sympy.pi * x) * sympy.sin(sympy.pi * y) * sympy.exp(x + y / 2)
SOLID = sympy.sin(sympy.pi * x) * sympy.sin(sympy.pi * y) * sympy.cos(2 * z) * sympy.exp(x)
HARMONIC = x**2 - 2 * y**2 + z**2 + x * y  # reproduced on parallelepipeds


def numeric(expressions, dim):
    """The function of points, shape (dim, ...), that evaluates an expression or a list of them."""
    f = sympy.lambdify(X[:dim], expressions)
    if not isinstance(expressions, list):
        return lambda p: f(*p)
    return lambda p: np.array(np.broadcast_arrays(*f(*p), p[0])[:-1])


def square(n, A=((1, 0), (0, 1))):
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
    return MeshQuad(np.array(A) @ mesh.p, mesh.t)


def cube(n, A=((1, 0, 0), (0, 1, 0), (0, 0, 1))):
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return MeshHex(np.array(A) @ mesh.p, mesh.t)


def graded(n):
    t = np.linspace(0, 1, n + 1)
    return MeshQuad.init_tensor(t + 0.1 * np.sin(pi * t) ** 2, t**1.2)


def refined(coarse, seed=2):
    """Move the vertices of a coarse mesh, in the plane the inner ones, and refine uniformly."""
    p = coarse.p.copy()
    moved = coarse.interior_nodes() if coarse.dim() == 2 else np.arange(p.shape[1])
    p[:, moved] += 0.06 * np.random.default_rng(seed).uniform(-1, 1, (len(p), len(moved)))
    mesh = type(coarse)(p, coarse.t)
    return lambda n: mesh.refined(int(np.log2(n)))


def tilted(n, dim):
    """Similar trapezoids or truncated pyramids at every level, as in the source of the warning."""
    mesh = square(n) if dim == 2 else cube(n)
    index = np.rint(mesh.p * n).astype(int)
    p = mesh.p.copy()
    tilt = np.where(index[0] % 2 == 1, 0.25, -0.25) / n
    p[-1] += np.where(index[-1] % 2 == 1, tilt, 0)
    return type(mesh)(p, mesh.t)


def poisson_errors(mesh, element, expression):
    """Errors in L2 and H1; Dirichlet data come through facets in every direction."""
    dim = mesh.dim()
    slopes = [sympy.diff(expression, t) for t in X[:dim]]
    load = -sum(sympy.diff(expression, t, 2) for t in X[:dim])
    u_exact, gradient, f = (numeric(e, dim) for e in (expression, slopes, load))
    basis = Basis(mesh, element, intorder=8 if dim == 2 else None)
    T, x0 = essential_constraints(basis, mesh.boundary_facets(), u_exact)
    K, b = laplace.assemble(basis), LinearForm(lambda v, w: f(w.x) * v).assemble(basis)
    x = T @ skfem_adini.factorize(T.T @ K @ T).solve(T.T @ (b - K @ x0)) + x0
    u, points = basis.interpolate(x), np.array(basis.global_coordinates())
    l2 = np.sum((np.array(u) - u_exact(points)) ** 2 * basis.dx)
    h1 = np.sum((u.grad - gradient(points)) ** 2 * basis.dx)
    return np.sqrt(l2), np.sqrt(h1)


def orders(cells, make, element, expression):
    errors = [poisson_errors(make(n), element, expression) for n in cells]
    return tuple(order(cells, error) for error in np.transpose(errors))


ADINI, BRICK, BFS = ElementQuadAdini(), ElementHexAdini(), ElementQuadBFS()
CELLS, SOLID_CELLS = [8, 16, 32], [3, 5, 8]
PARALLEL = [[1, 0.3, 0], [0, 1, -0.2], [0.1, 0, 1]]
slow, turns = pytest.mark.slow, pytest.mark.turns(4)
CASES = {
    "rectangles": (ADINI, square, CELLS, 0.1, 0.1),
    "graded rectangles": (ADINI, graded, CELLS, 0.1, 0.1),
    "parallelograms": (ADINI, lambda n: square(n, [[1, 0.4], [0, 1]]), CELLS, 0.1, 0.1),
    "refined quadrilaterals": (ADINI, refined(MeshQuad().refined(2)), [2, 4, 8], 0.1, 0.1),
    "bicubic": (BFS, square, CELLS, 0.1, 0.1),
    # A monomial basis loses its order beyond 20 to 40 cells a side.
    "bicubic, fine": (BFS, square, [32, 64, 128], 0.1, 0.1),
    "bricks": (BRICK, cube, SOLID_CELLS, 0.15, 0.15),
    "parallelepipeds": (BRICK, lambda n: cube(n, PARALLEL), SOLID_CELLS, 0.15, 0.15),
    "bricks, fine": (BRICK, cube, [4, 8, 12], 0.1, 0.12),
    "refined hexahedra": (BRICK, refined(MeshHex().refined(1)), [1, 2, 4], 0.2, 0.15),
}
MARKS = {"bicubic, fine": slow, "bricks, fine": slow, "refined hexahedra": turns}
MARKS |= {"bricks": pytest.mark.turns(2), "parallelepipeds": pytest.mark.turns(2)}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=MARKS[name]) if name in MARKS else name for name in CASES]
)
def test_poisson(name):
    element, make, cells, l2_off, h1_off = CASES[name]
    expression = SOLID if element is BRICK else PLANE
    l2, h1 = orders(cells, make, element, expression)
    assert l2 == pytest.approx(4, abs=l2_off)
    assert h1 == pytest.approx(3, abs=h1_off)


TILTED = [
    (ADINI, [16, 32, 64], PLANE, 0.35, 0.25),
    # Seen alone with a quadratic, whose error is all due to the twist.
    pytest.param(BRICK, [4, 6, 8], HARMONIC, 0.2, 0.2, marks=turns),
]


@pytest.mark.parametrize(("element", "cells", "expression", "l2_off", "h1_off"), TILTED)
def test_similar_twisted_cells_lose_what_the_warning_says(
    element, cells, expression, l2_off, h1_off, caplog
):
    make = lambda n: tilted(n, element.dim)  # noqa: E731
    l2, h1 = orders(cells, make, element, expression)
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in caplog.text
    assert l2 == pytest.approx(2, abs=l2_off)
    assert h1 == pytest.approx(1, abs=h1_off)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS])
def test_clamped_plate(element):
    """Order 2 in the (broken) H2 norm, w = (sin sin)^2, all dofs on the boundary fixed."""
    w = (sympy.sin(sympy.pi * x) * sympy.sin(sympy.pi * y)) ** 2
    load = sum(sympy.diff(w, s, 2, t, 2) for s in X[:2] for t in X[:2])
    pressure = numeric(load, 2)
    exact = [numeric(sympy.diff(w, s, t), 2) for s in X[:2] for t in X[:2]]
    errors = []
    for n in CELLS:
        basis = Basis(square(n), element(derivatives=2), intorder=6)
        A = BilinearForm(lambda u, v, _: ddot(u.hess, v.hess)).assemble(basis)
        b = LinearForm(lambda v, w: pressure(w.x) * v).assemble(basis)
        fixed = skfem_adini.essential_dofs(basis, basis.mesh.boundary_facets(), clamp_normal=True)
        hess = basis.interpolate(solve(*condense(A, b, D=fixed))).hess
        points = np.array(basis.global_coordinates())
        off = hess - np.reshape([each(points) for each in exact], hess.shape)
        errors.append(np.sqrt(np.sum(off**2 * basis.dx)))
    assert order(CELLS, errors) == pytest.approx(2, abs=0.1)


def test_plane_elasticity_and_nodal_stress():
    """Displacement on the left, tractions elsewhere; the stress is read from the dofs."""
    lame, mu = 1.5, 1.0
    u = sympy.Matrix([sympy.sin(2 * x) * sympy.cos(y), sympy.cos(x - y) * x])
    G = u.jacobian(X[:2])
    sigma = mu * (G + G.T) + lame * G.trace() * sympy.eye(2)
    divergence = [sum(sympy.diff(sigma[i, j], X[j]) for j in range(2)) for i in range(2)]
    displacement, gradient, stress, forces = (
        numeric([*e], 2) for e in (u, G, sigma, [-d for d in divergence])
    )
    force = LinearForm(lambda v, w: dot(forces(w.x), v))
    traction = LinearForm(
        lambda v, w: np.einsum("ij...,j...,i...", stress(w.x).reshape(2, 2, *w.x.shape[1:]), w.n, v)
    )
    l2, h1, nodal = [], [], []
    for n in CELLS:
        basis = Basis(square(n).with_defaults(), ElementVector(ElementQuadAdini()), intorder=6)
        T, x0 = essential_constraints(basis, "left", displacement)
        K = linear_elasticity(lame, mu).assemble(basis)
        f = force.assemble(basis) + traction.assemble(basis.boundary(["right", "top", "bottom"]))
        found = T @ solve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0
        field, points = basis.interpolate(found), np.array(basis.global_coordinates())
        l2.append(np.sqrt(np.sum((np.array(field) - displacement(points)) ** 2 * basis.dx)))
        off = field.grad - gradient(points).reshape(field.grad.shape)
        h1.append(np.sqrt(np.sum(off**2 * basis.dx)))
        E, nu = mu * (3 * lame + 2 * mu) / (lame + mu), lame / (2 * (lame + mu))
        at_nodes = skfem_adini.nodal_stress(basis, found, E=E, nu=nu)[:2, :2]
        nodal.append(np.abs(at_nodes - stress(basis.mesh.p).reshape(at_nodes.shape)).max())
    assert order(CELLS, l2) == pytest.approx(4, abs=0.1)
    assert order(CELLS, h1) == pytest.approx(3, abs=0.1)
    assert order(CELLS, nodal) == pytest.approx(3, abs=0.15)
