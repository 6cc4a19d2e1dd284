r"""Poisson's equation with a peaked source, on a locally refined mesh with hanging nodes.

On the unit square, with a peak of width w = 1/20 at the centre c,

    -(u_xx + u_yy) = f,   u = 0 on the boundary,   u = exp(-|x - c|^2 / w^2).

Cells near the peak are halved again and again, and their neighbours left alone, so some vertices
lie in the middle of a neighbour's edge. There u and the tangential derivative follow from the ends
of that edge, the normal derivative stays free, and the field is continuous to round-off.

    python examples/hanging_nodes.py [--output out]
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from skfem import Basis, BilinearForm, FacetBasis, Functional, LinearForm, MeshQuad
from skfem.helpers import dot, grad

from skfem_adini import ElementQuadAdini, essential_constraints, factorize, hanging_constraints

WIDTH = 1 / 20


def square_and_peak(x):
    """Return |x - c|^2 and u."""
    squared = (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2
    return squared, np.exp(-squared / WIDTH**2)


@BilinearForm
def stiffness(u, v, _):
    """Return the integrand of the energy."""
    return dot(grad(u), grad(v))


@LinearForm
def load(v, w):
    """Return f v."""
    squared, u = square_and_peak(w.x)
    return 4 * (1 - squared / WIDTH**2) / WIDTH**2 * u * v


@Functional
def squared_error(w):
    """Return (u_h - u)^2."""
    return (w["u"] - square_and_peak(w.x)[1]) ** 2


def uniform(n):
    """Return n x n cells."""
    points = np.linspace(0, 1, n + 1)
    return MeshQuad.init_tensor(points, points)


def refined_near_peak(n, levels):
    """Return n x n cells, those within 1/4, 1/8, ... of the centre halved once more each time."""
    mesh = uniform(n)
    for level in range(levels):
        away = np.abs(mesh.p[:, mesh.t].mean(axis=1) - 0.5).max(axis=0)
        near = np.flatnonzero(away < 0.25 / 2**level)
        mesh = mesh.remove_elements(near) + mesh.restrict(near).refined()
    return mesh


def solve_poisson(mesh):
    """Return the basis, the dofs of u_h, how many of them are free, and the error in L2."""
    basis = Basis(mesh, ElementQuadAdini(), intorder=10)
    boundary = essential_constraints(basis, lambda x: np.isin(x, (0, 1)).any(axis=0))
    T, x0 = hanging_constraints(basis, boundary)
    K, f = stiffness.assemble(basis), load.assemble(basis)
    x = T @ factorize(T.T @ K @ T).solve(T.T @ (f - K @ x0)) + x0
    return basis, x, T.shape[1], np.sqrt(squared_error.assemble(basis, u=basis.interpolate(x)))


def largest_jump(basis, x):
    """Compare u_h from both sides of every edge that a vertex divides, over its maximum there."""
    mesh = basis.mesh
    single = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, single]].mean(axis=1)
    inner = single[((middle > 0) & (middle < 1)).all(axis=0)]
    divided = (mesh.p[:, None] == mesh.p[:, mesh.facets[:, inner]].mean(axis=1)[:, :, None]).all(0)
    coarse = divided.any(axis=1)
    sides = []
    for edges, s in (
        (inner[coarse], [1 / 8, 3 / 8, 5 / 8, 7 / 8]),
        (inner[~coarse], [1 / 4, 3 / 4]),
    ):
        rule = np.array([s]), np.ones(len(s))
        trace = FacetBasis(mesh, basis.elem, facets=edges, quadrature=rule)
        points = np.array(trace.global_coordinates()).reshape(2, -1)
        order = np.lexsort(np.round(points, 9))
        sides.append((points[:, order], np.array(trace.interpolate(x)).ravel()[order]))
    (points, u), (same_points, v) = sides
    assert np.allclose(points, same_points, atol=1e-12)
    return np.abs(u - v).max() / np.abs(u).max()


def main(argv=()):
    """Print and draw errors over dofs; return them, rows (dofs, error), and the largest jump."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    tables = []
    print("mesh          cells   free dofs     L2 error")
    for name, meshes in {
        "uniform": [uniform(n) for n in (16, 32, 64)],
        "refined": [refined_near_peak(n, 2) for n in (4, 8, 16)],
    }.items():
        rows = []
        for mesh in meshes:
            basis, x, free, error = solve_poisson(mesh)
            rows.append((free, error))
            print(f"{name:10s} {mesh.nelements:8d}  {free:10d}  {error:11.3e}")
        tables.append(np.array(rows))
    jump = largest_jump(basis, x)
    print(f"largest jump across edges with hanging nodes, relative: {jump:.1e}")
    assert jump < 1e-13
    picture(*tables, basis, x, options.output)
    return *tables, jump


def picture(uniform_rows, refined_rows, basis, x, output):
    """Draw the solution with the cells of the finest refined mesh, and the errors over dofs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    drawn = left.tripcolor(*basis.mesh.p, x[basis.nodal_dofs[0]], shading="gouraud")
    figure.colorbar(drawn, ax=left, label="$u_h$ at the vertices, arbitrary units")
    sides = basis.mesh.p[:, basis.mesh.facets]
    sides = np.pad(sides, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
    left.plot(*sides.reshape(2, -1, order="F"), "w", lw=0.3)
    left.set(aspect="equal", xlim=(0, 1), ylim=(0, 1), xlabel="x", ylabel="y")
    for name, rows in (("uniform cells", uniform_rows), ("refined near the peak", refined_rows)):
        right.loglog(*rows.T, "o-", label=name)
    right.set(xlabel="free dofs", ylabel="error in L2, arbitrary units")
    right.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "hanging_nodes.png", dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
