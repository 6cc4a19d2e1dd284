r"""The 12 functions of Adini's rectangle, and what its matrix looks like.

On the unit square, with L(s) = 1 - s, B(s) = s (1 - s) (1 - 2 s) and S(s) = s (1 - s)^2, the
functions of the vertex at the origin are

    N  = L(x) L(y) + B(x) L(y) + L(x) B(y)     for u,
    Hx = S(x) L(y)                             for u_x,
    Hy = L(x) S(y)                             for u_y,

and those of the other vertices are their mirror images. Each has one dof equal to one and eleven
equal to zero; they span the cubics, x^3 y and x y^3.

The picture of the stiffness matrix of -lap u groups the dofs by kind. A vertex couples with its
eight neighbours, so there is room for 27 numbers in a row; but the derivatives u_x and u_y do not
couple with each other, and no more than 21 are left.

    python examples/shape_functions.py [--output out]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace

from skfem_adini import ElementQuadAdini
from skfem_adini.plot import plot_matrix, plot_shape_function


def dofs_of_functions(element: Any) -> np.ndarray:
    """Return the 12 dofs of each of the 12 functions, those of a function in one column."""
    corners = element.doflocs[::3].T
    columns = []
    for i in range(12):
        value, gradient = element.lbasis(corners, i)
        columns.append(np.vstack([value, gradient]).T.ravel())
    return np.array(columns).T


def main(argv: list[str] | None = None) -> tuple[float, int]:
    """Write both pictures; return the distance to duality and the most entries in a row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=6, help="a side, for the matrix")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNGs")
    options = parser.parse_args(argv)

    import matplotlib.pyplot as plt

    element = ElementQuadAdini()
    distance = np.abs(dofs_of_functions(element) - np.eye(12)).max()
    functions, axes = plt.subplots(
        4, 3, figsize=(9, 11), layout="constrained", subplot_kw={"projection": "3d"}
    )
    for i, ax in enumerate(axes.flat):
        plot_shape_function(element, i, ax)

    ticks = np.linspace(0, 1, options.cells + 1)
    basis = Basis(MeshQuad.init_tensor(ticks, ticks), element)
    A = laplace.assemble(basis)
    entries = int((np.abs(A.toarray()) > 1e-13).sum(axis=1).max())
    matrix, ax = plt.subplots(figsize=(6.4, 5.4), layout="constrained")
    plot_matrix(A, basis, ax).set_title(
        f"stiffness matrix, {options.cells} x {options.cells} cells"
    )

    print(f"dofs of the functions: the identity up to {distance:.0e}")
    print(f"most entries in a row of the matrix: {entries}")
    options.output.mkdir(parents=True, exist_ok=True)
    functions.savefig(options.output / "shape_functions.png", dpi=130)
    matrix.savefig(options.output / "stiffness_matrix.png", dpi=160)
    print(f"written to {options.output}: shape_functions.png, stiffness_matrix.png")
    return float(distance), entries


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
