r"""Poisson's equation with Adini's element.

On the unit square,

    -(u_xx + u_yy) = f,   u = g on the boundary,   u = sin(pi x) sin(pi y) e^(x + y/2).

The dofs are u, u_x, u_y at the vertices. Along an edge u is the cubic of u and u_t at its ends,
so the Dirichlet condition fixes u and the tangential derivative and leaves the normal one free.
The errors fall like h^4 in L2 and h^3 in H1, with 3 dofs a vertex.

    python examples/poisson_adini.py [cells per side ...]
"""

import sys

import numpy as np
from skfem import Basis, BilinearForm, Functional, LinearForm, MeshQuad, condense, solve
from skfem.helpers import dot, grad

from skfem_adini import ElementQuadAdini, essential_dofs

pi = np.pi


def exact(x):
    """Return u and its gradient."""
    s, c, e = np.sin(pi * x), np.cos(pi * x), np.exp(x[0] + x[1] / 2)
    return s[0] * s[1] * e, (pi * c[0] + s[0]) * s[1] * e, s[0] * (pi * c[1] + s[1] / 2) * e


@BilinearForm
def stiffness(u, v, _):
    """Return the integrand of the energy."""
    return dot(grad(u), grad(v))


@LinearForm
def load(v, w):
    """Return f v."""
    s, c, e = np.sin(pi * w.x), np.cos(pi * w.x), np.exp(w.x[0] + w.x[1] / 2)
    f = (2 * pi**2 - 5 / 4) * s[0] * s[1] - 2 * pi * c[0] * s[1] - pi * s[0] * c[1]
    return f * e * v


@Functional
def squared_errors(w):
    """Return (u_h - u)^2 and |grad(u_h - u)|^2."""
    u, u_x, u_y = exact(w.x)
    gradient = w["u"].grad
    return np.array([(w["u"] - u) ** 2, (gradient[0] - u_x) ** 2 + (gradient[1] - u_y) ** 2])


def errors(n):
    """Solve on n x n cells; return the errors in L2 and in the H1 seminorm."""
    points = np.linspace(0, 1, n + 1)
    mesh = MeshQuad.init_tensor(points, points)
    basis = Basis(mesh, ElementQuadAdini(), intorder=8)
    fixed = essential_dofs(basis, mesh.boundary_facets())
    x = solve(*condense(stiffness.assemble(basis), load.assemble(basis), D=fixed))
    return np.sqrt(squared_errors.elemental(basis, u=x).sum(axis=-1))


def main(argv=()):
    """Print errors and orders; return the fitted orders in L2 and H1."""
    cells = [int(n) for n in argv] or [8, 16, 32]
    table = np.array([errors(n) for n in cells])
    print("   n     L2 error     H1 error")
    for n, (l2, h1) in zip(cells, table, strict=True):
        print(f"{n:4d}  {l2:11.3e}  {h1:11.3e}")
    l2, h1 = -np.polyfit(np.log(cells), np.log(table), 1)[0]
    print(f"order {l2:8.2f}     {h1:8.2f}")
    return l2, h1


if __name__ == "__main__":
    main(sys.argv[1:])
