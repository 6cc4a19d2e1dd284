r"""Poisson's equation with Adini's element.

On the unit square,

    -(u_xx + u_yy) = f,   u = g on the boundary,   u = sin(pi x) sin(pi y) e^(x + y/2).

The dofs are u, u_x, u_y at the vertices. Along an edge u is the cubic of u and u_t at its ends,
so the Dirichlet condition fixes u and the tangential derivative and leaves the normal one free.
The errors fall like h^4 in L2 and h^3 in H1, with 3 dofs a vertex.

    python examples/poisson_adini.py [cells per side ...] [--output out]
"""

import argparse
import sys
from pathlib import Path

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


def solved(n):
    """Solve on n x n cells; return basis and dofs."""
    points = np.linspace(0, 1, n + 1)
    mesh = MeshQuad.init_tensor(points, points)
    basis = Basis(mesh, ElementQuadAdini(), intorder=8)
    fixed = essential_dofs(basis, mesh.boundary_facets())
    return basis, solve(*condense(stiffness.assemble(basis), load.assemble(basis), D=fixed))


def errors(basis, x):
    """Return the errors in L2 and in the H1 seminorm."""
    return np.sqrt(squared_errors.elemental(basis, u=x).sum(axis=-1))


def main(argv=()):
    """Print and draw errors; return the fitted orders in L2 and H1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cells", type=int, nargs="*", default=[8, 16, 32], help="per side")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    cells, solutions = options.cells, [solved(n) for n in options.cells]
    table = np.array([errors(*solution) for solution in solutions])
    print("   n     L2 error     H1 error")
    for n, (l2, h1) in zip(cells, table, strict=True):
        print(f"{n:4d}  {l2:11.3e}  {h1:11.3e}")
    l2, h1 = -np.polyfit(np.log(cells), np.log(table), 1)[0]
    print(f"order {l2:8.2f}     {h1:8.2f}")
    picture(cells, table, *solutions[0], options.output)
    return l2, h1


def picture(cells, table, basis, x, output):
    """Draw the coarsest solution with its cells, and the errors."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    s = np.linspace(0, 1, 101)
    u = basis.probes(np.array(np.meshgrid(s, s)).reshape(2, -1)) @ x
    drawn = left.pcolormesh(s, s, u.reshape(s.size, s.size), shading="gouraud")
    figure.colorbar(drawn, ax=left, label="$u_h$, arbitrary units")
    left.vlines(np.unique(basis.mesh.p[0]), 0, 1, color="w", lw=0.3)
    left.hlines(np.unique(basis.mesh.p[1]), 0, 1, color="w", lw=0.3)
    left.set(aspect="equal", xlabel="x", ylabel="y", title=f"{cells[0]} cells a side")
    for name, error, order, style in zip(("L2", "H1"), table.T, (4, 3), ("k--", "k:"), strict=True):
        right.loglog(cells, error, "o-", label=f"error in {name}")
        line = 0.6 * error[0] * (np.array(cells) / cells[0]) ** -float(order)
        right.loglog(cells, line, style, lw=1, label=f"$h^{order}$")
    right.set(xlabel="cells a side", ylabel="error, arbitrary units")
    right.set_xticks(cells, [str(n) for n in cells])
    right.minorticks_off()
    right.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "poisson_adini.png", dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
