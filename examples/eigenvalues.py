r"""Eigenvalues with Adini's element: order 6, down to round-off.

Section 5.1.2 of the 2012 dissertation, on the unit square with n x n cells:

* Table 5.1, -lap u = lambda u with u_n = 0:   lambda = pi^2 (k^2 + l^2), k, l >= 0;
* Table 5.2, -lap u = lambda u with u = 0:     lambda = pi^2 (k^2 + l^2), k, l >= 1;
* Table 5.3, -div sigma(u) = lambda u, free of stress, with the Lame constants lambda = mu = 1.

The natural condition u_n = 0 leaves all dofs free; u = 0 fixes u and the tangential derivative.
The tables give relative errors and stand beside the dissertation's, whose last columns hold
rounding errors: here every eigenvalue is the Rayleigh quotient in extended precision. The elastic
eigenvalues are not known in closed form, so their rates come from the finest mesh; the
dissertation counts a double eigenvalue once. The last table is that of the cube.

    python examples/eigenvalues.py --cells 4 8 16 32 64 --output out
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Basis, BilinearForm, ElementVector, MeshHex, MeshQuad
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementHexAdini,
    ElementQuadAdini,
    essential_dofs,
    lowest_eigenpairs,
    refine_eigenpair,
)

NEUMANN = {
    (1, 0): [3.8083e-6, 8.7959e-8, 1.6405e-9, 3.7556e-11, 1.2961e-11],
    (1, 1): [8.9036e-5, 2.3275e-6, 4.5774e-8, 7.8850e-10, 3.0473e-11],
    (2, 0): [2.0115e-4, 5.0876e-6, 1.0148e-7, 1.7570e-9, 3.8138e-11],
    (2, 1): [7.7840e-4, 2.0755e-5, 4.3074e-7, 7.5863e-9, 1.3291e-10],
    (2, 2): [5.4814e-3, 1.3377e-4, 2.8081e-6, 4.9887e-8, 8.1512e-10],
    (3, 0): [1.6684e-3, 4.9626e-5, 1.0946e-6, 1.9680e-8, 3.1876e-10],
}
DIRICHLET = {
    (1, 1): [1.7520e-4, 3.2782e-6, 5.3965e-8, 8.6487e-10, 1.0645e-11],
    (2, 1): [1.1614e-3, 2.7884e-5, 5.0444e-7, 8.2056e-9, 1.2010e-10],
    (2, 2): [7.2218e-3, 1.7520e-4, 3.2782e-6, 5.3967e-8, 8.6395e-10],
    (3, 1): [3.5719e-3, 1.1969e-4, 2.5367e-6, 4.3395e-8, 6.9228e-10],
    (3, 2): [1.8746e-2, 5.3439e-4, 1.1077e-5, 1.8910e-7, 3.0259e-9],
}
ELASTIC_RATES = np.array(
    [
        [4.9181, 5.3406, 5.3245],
        [4.5546, 5.1730, 5.4569],
        [5.3312, 5.7216, 5.9098],
        [5.3829, 5.7365, 5.8982],
        [4.8280, 5.4208, 5.6167],
        [5.0492, 5.5053, 5.5596],
    ]
)
CUBE = ((1, 0, 0), (1, 1, 0), (1, 1, 1))
PUBLISHED_CELLS = [4, 8, 16, 32, 64]
PI = 4 * np.arctan(np.longdouble(1))


def laplace_errors(
    n: int, modes: list[tuple[int, ...]], dirichlet: bool
) -> dict[tuple[int, ...], float]:
    """Return the relative errors of eigenvalues of the unit square or cube on n cells a side."""
    dim, ticks = len(modes[0]), np.linspace(0, 1, n + 1)
    mesh = (MeshQuad if dim == 2 else MeshHex).init_tensor(*[ticks] * dim)
    basis = Basis(mesh, ElementQuadAdini() if dim == 2 else ElementHexAdini())
    fixed = essential_dofs(basis, mesh.boundary_facets()) if dirichlet else None

    waves = product(range(int(dirichlet), 8), repeat=dim)
    squares = sorted(sum(k * k for k in wave) for wave in waves)
    places = {mode: squares.index(sum(k * k for k in mode)) for mode in modes}
    count = max(places.values()) + dim
    _, x = lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), count, fixed)
    errors = {}
    for mode, place in places.items():
        exact = PI**2 * sum(k * k for k in mode)
        value = refine_eigenpair(basis, x[:, place], fixed).value
        errors[mode] = float(abs(value / exact - 1))
    return errors


def elastic_eigenvalues(n: int) -> np.ndarray:
    """Return the six lowest non-zero eigenvalues of the free square, double ones once."""
    ticks = np.linspace(0, 1, n + 1)
    basis = Basis(MeshQuad.init_tensor(ticks, ticks), ElementVector(ElementQuadAdini()))
    inertia = BilinearForm(lambda u, v, _: dot(u, v))
    stiffness = linear_elasticity(Lambda=1.0, Mu=1.0).assemble(basis)
    values, _ = lowest_eigenpairs(stiffness, inertia.assemble(basis), 11)
    rigid, values = values[:3], values[3:]
    assert np.abs(rigid).max() < 1e-6
    return values[np.diff(values, prepend=0) > 1e-6 * values][:6]


def print_table(title: str, cells: list[int], errors: dict, published: dict | None = None) -> None:
    """Print errors, the dissertation's in parentheses, and the order from the last two meshes."""
    print(f"\n{title}\n{'mode':10}" + "".join(f"{f'n = {n}':>25}" for n in cells) + "   order")
    for mode, row in errors.items():
        line = f"{','.join(map(str, mode)):10}"
        for n, error in zip(cells, row, strict=True):
            theirs = (
                published and n in PUBLISHED_CELLS and published[mode][PUBLISHED_CELLS.index(n)]
            )
            line += f"{error:13.4e}" + (f" ({theirs:.4e})" if theirs else " " * 12)
        order = np.log(row[-2] / row[-1]) / np.log(cells[-1] / cells[-2])
        print(f"{line}{order:8.3f}")


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the tables, write the picture, return errors and rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=PUBLISHED_CELLS, help="per side")
    parser.add_argument("--cube", type=int, nargs="+", default=[2, 4, 8], help="cells, 3-D")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    cells, finest = options.cells, max(options.cells)

    results: dict[str, Any] = {"cells": cells}
    for name, published in (("Neumann", NEUMANN), ("Dirichlet", DIRICHLET)):
        rows = [laplace_errors(n, list(published), name == "Dirichlet") for n in cells]
        results[name] = {mode: [row[mode] for row in rows] for mode in published}
        table = "Table 5.1" if name == "Neumann" else "Table 5.2"
        title = f"{table}, {name}: relative error (dissertation)"
        print_table(title, cells, results[name], published)

    values = np.array([elastic_eigenvalues(n) for n in cells])
    coarse = values[np.array(cells) != finest]
    errors = np.abs(coarse - values[np.argmax(cells)]) / coarse
    results["elastic"] = errors
    results["rates"] = np.log2(errors[:-1] / errors[1:]).T
    print(f"\nTable 5.3, free elastic square: rates against n = {finest} (dissertation)")
    for value, rates, theirs in zip(values[-1], results["rates"], ELASTIC_RATES, strict=True):
        pairs = zip(rates, theirs, strict=False)
        print(f"{value:11.6f}" + "".join(f"{ours:10.4f} ({their:.4f})" for ours, their in pairs))

    rows = [laplace_errors(n, list(CUBE), False) for n in options.cube]
    results["cube"] = {mode: [row[mode] for row in rows] for mode in CUBE}
    print_table("Cube, Neumann: relative error", options.cube, results["cube"])

    options.output.mkdir(parents=True, exist_ok=True)
    picture(results).savefig(options.output / "eigenvalues.png", dpi=160)
    print(f"\nwritten to {options.output}: eigenvalues.png")
    return results


def picture(results: dict[str, Any]) -> Any:
    """Draw the errors over n, the dissertation's as crosses, and lines of order 6."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained", sharey=True)
    cells = np.array(results["cells"])
    for ax, name, published in zip(
        axes, ("Neumann", "Dirichlet"), (NEUMANN, DIRICHLET), strict=False
    ):
        for i, (mode, errors) in enumerate(results[name].items()):
            ax.loglog(cells, errors, "o-", color=f"C{i}", ms=4, label="$({}, {})$".format(*mode))
            ax.loglog(PUBLISHED_CELLS, published[mode], "x", color=f"C{i}", ms=7)
        ax.set_title(f"Laplace, {name}")
    coarse = cells[cells != cells.max()]
    for i, errors in enumerate(results["elastic"].T):
        axes[2].loglog(coarse, errors, "o-", color=f"C{i}", ms=4, label=rf"$\lambda_{i + 4}$")
    axes[2].set_title(f"elastic, free of stress; against n = {cells.max()}")
    for ax in axes:
        ax.loglog(cells, 0.06 * (cells / 4.0) ** -6, "k--", lw=1, label="$n^{-6}$")
        ax.set(xlabel="cells a side n", xticks=cells, xticklabels=cells)
        ax.minorticks_off()
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8, loc="lower left")
    axes[0].set_ylabel("relative error (crosses: dissertation)")
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
