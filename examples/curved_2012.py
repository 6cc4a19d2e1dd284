r"""Why the 2012 construction for curved boundaries stalls, and what does not.

-lap u = lambda u in the disk of radius 0.411 about (0.5, 0.5), u = 0 on the circle, n x n cells:
lambda = (j_{m,k} / 0.411)^2. Relative errors of the lowest eigenvalue:

* Table 5.4 of the dissertation;
* its element (ElementQuadAdiniCut) with exact integration over the cut cells;
* its element on the polygon through the crossings of circle and grid;
* Adini's element with Nitsche's method and AdiniExtension.

The dissertation does not say how cut cells were integrated, nor where its points delta and eta
lie, so its numbers are not reproduced; both integrations show the same first order. It is not the
integration: the functions jump across cut sides, and cells with two vertices inside have no
solution when the boundary is straight, so 1 / sigma_min grows under refinement.

    python examples/curved_2012.py --cells 4 8 16 32 64 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import jn_zeros
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    ElementQuadAdiniCut,
    Polygon,
    lowest_eigenpairs,
    nitsche,
)

RADIUS = 0.411
EXACT = (jn_zeros(0, 1)[0] / RADIUS) ** 2
TABLE = {4: 1.167e-1, 8: 3.690e-2, 16: 3.378e-3, 32: 4.835e-3, 64: 7.966e-4}


def disk(x: Any) -> Any:
    """Return the level set, negative inside."""
    return (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - RADIUS**2


def cut_matrices(mesh: MeshQuad, chords: bool) -> tuple[Any, Any, float]:
    """Return stiffness and mass of the 2012 element, and the largest 1 / sigma_min."""
    element = ElementQuadAdiniCut(mesh, disk)
    domain = CutDomain(mesh, disk)
    if chords:
        points = element.crossings[:, ~np.isnan(element.crossings[0])]
        angle = np.arctan2(points[1] - 0.5, points[0] - 0.5)
        domain = CutDomain(mesh, Polygon(points[:, np.argsort(angle)]))
    K, M = (domain.assemble(form, element).tocsr() for form in (laplace, mass))
    free = element.dirichlet_dofs(Basis(mesh, element, intorder=1))
    return K[free][:, free], M[free][:, free], float(np.nanmax(element.unisolvence))


def extension_matrices(mesh: MeshQuad) -> Any:
    """Return stiffness and mass of the extension."""
    element, domain = ElementQuadAdini(), CutDomain(mesh, disk)
    extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
    B, _ = nitsche(domain.boundary(element), extension=extension)
    return extension.apply(domain.assemble(laplace, element) + B, domain.assemble(mass, element))


def error(K: Any, M: Any) -> float:
    """Return the signed relative error of the lowest eigenvalue."""
    return lowest_eigenpairs(K, M, 1, shift=0.0)[0][0] / EXACT - 1


def main(argv: list[str] | None = None) -> dict[str, list[float]]:
    """Print the table and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16, 32, 64])
    parser.add_argument("--output", type=Path, default=Path("out"))
    options = parser.parse_args(argv)
    found: dict[str, list[float]] = {
        name: [] for name in ("exact", "chords", "extension", "inverse")
    }
    print("   n   Table 5.4   2012, exact  2012, chords   1/sigma_min     extension")
    for n in options.cells:
        mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
        K, M, inverse = cut_matrices(mesh, chords=False)
        chords = error(*cut_matrices(mesh, chords=True)[:2])
        row = (error(K, M), chords, error(*extension_matrices(mesh)), inverse)
        for name, number in zip(found, row, strict=True):
            found[name].append(number)
        print(f"{n:4}{TABLE.get(n, np.nan):12.3e}{row[0]:14.2e}{row[1]:14.2e}"
              f"{inverse:14.1e}{row[2]:14.2e}")  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    picture(options.cells, found).savefig(options.output / "curved_2012.png", dpi=140)
    print(f"written to {options.output}: curved_2012.png")
    return found


def picture(cells: list[int], found: dict[str, list[float]]) -> Any:
    """Draw the errors over n."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6, 4.5), layout="constrained")
    ax.loglog(list(TABLE), list(TABLE.values()), "kx", label="dissertation, Table 5.4")
    for name, label in (
        ("exact", "2012 element, exact cells"),
        ("chords", "2012 element, chords"),
        ("extension", "AdiniExtension"),
    ):
        ax.loglog(cells, np.abs(found[name]), "o-", label=label)
    ax.set(xlabel="cells a side n", ylabel="relative error of the lowest eigenvalue")
    ax.set_xticks(cells, [str(n) for n in cells])
    ax.minorticks_off()
    ax.grid(alpha=0.3)
    ax.legend()
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
