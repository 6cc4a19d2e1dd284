"""Adini on a disk cut from a Cartesian grid, beside triangles that fit it.

The lowest ten eigenvalues of -lap u = lambda u in the disk of radius 0.411, u = 0 on the circle:

* Adini with Nitsche's method, stabilised by extension or by a ghost penalty;
* Adini times a weight function;
* P2 and P3 on curved (isoparametric quadratic) triangles of scikit-fem that fit the disk;
* cubic triangles of NGSolve that fit the disk, and ngsxfem's cubic elements on squares that the
  circle cuts, where both are installed (``pip install ngsolve xfem``).

Errors are those of the first and the worst of ten eigenvalues. Seconds are those of the quadrature
(with the search for cut cells), the assembly of stiffness, mass and Nitsche's matrix, the
reduction, and the eigenvalues; the kernels are compiled before. The table of time has n up to 128.

With ``--parts materials`` the tables of `curved_materials` for nearly incompressible bodies and
strongly varying conductivities; what is not measured stays in the file.

    python benchmarks/curved.py --repeats 3
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import curved_materials
import ngsolve_disk
import numpy as np
from machine import describe
from scipy.special import jn_zeros
from skfem import Basis, ElementTriP2, ElementTriP3, MeshQuad, MeshTri2
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    ElementQuadAdiniWeighted,
    ghost_penalty,
    lowest_eigenpairs,
    nitsche,
)

RADIUS = 0.411
EXACT = np.sort(np.repeat([jn_zeros(m, 4) for m in range(8)], [1] + [2] * 7, axis=0).ravel())[:10]
EXACT = (EXACT / RADIUS) ** 2
CELLS = [8, 16, 32, 64, 128]
TRIANGLES = [2, 3, 4, 5, 6]


class Clock:
    """Seconds between calls, by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()

    def __call__(self, name: str) -> None:
        """Note the seconds since the last call."""
        now = time.perf_counter()
        self.seconds[name], self.last = now - self.last, now


def disk(x: Any) -> Any:
    """Return the level set."""
    return (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - RADIUS**2


def grid(n: int) -> MeshQuad:
    """Return n x n cells of the unit square."""
    return MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)


def extension(n: int, clock: Clock) -> tuple[Any, Any]:
    """Return stiffness and mass matrix of the extension."""
    mesh, element = grid(n), ElementQuadAdini()
    clock("mesh")
    domain = CutDomain(mesh, disk, q=6)
    clock("quadrature")
    K, M = (domain.assemble(form, element) for form in (laplace, mass))
    clock("assembly")
    reduce = AdiniExtension(Basis(mesh, element, intorder=1), domain)
    clock("reduction")
    B, _ = nitsche(domain.boundary(element), extension=reduce)
    clock("nitsche")
    matrices = reduce.apply(K + B, M)
    clock("product")
    return matrices


def ghost(n: int, clock: Clock) -> tuple[Any, Any]:
    """Return stiffness and mass matrix with ghost penalty."""
    mesh, element = grid(n), ElementQuadAdini()
    clock("mesh")
    domain = CutDomain(mesh, disk, q=6)
    clock("quadrature")
    K, M = (domain.assemble(form, element) for form in (laplace, mass))
    A = K + nitsche(domain.boundary(element))[0] + ghost_penalty(domain, element)
    M = M + ghost_penalty(domain, element, matrix="mass")
    clock("assembly")
    active = domain.active_dofs(Basis(mesh, element, intorder=1))
    A, M = (matrix.tocsr()[active][:, active] for matrix in (A, M))
    clock("reduction")
    return A, M


def weighted(n: int, clock: Clock) -> tuple[Any, Any]:
    """Return stiffness and mass matrix of the weighted element."""
    mesh = grid(n)
    element = ElementQuadAdiniWeighted(lambda x: -disk(x), lambda x: 1 - 2 * x)
    clock("mesh")
    domain = CutDomain(mesh, disk, q=6)
    clock("quadrature")
    K, M = (domain.assemble(form, element) for form in (laplace, mass))
    clock("assembly")
    matrices = AdiniExtension(Basis(mesh, element, intorder=1), domain).apply(K, M)
    clock("reduction")
    return matrices


def triangles(element: Any) -> Callable[[int, Clock], tuple[Any, Any]]:
    """Return the problem on triangles that fit."""

    def matrices(levels: int, clock: Clock) -> tuple[Any, Any]:
        mesh = MeshTri2.init_circle(levels).scaled((RADIUS, RADIUS))
        clock("mesh")
        basis = Basis(mesh, element, intorder=2 * element.maxdeg + 2)
        K, M = (form.assemble(basis).tocsr() for form in (laplace, mass))
        clock("assembly")
        inner = basis.complement_dofs(basis.get_dofs(mesh.boundary_facets()))
        K, M = K[inner][:, inner], M[inner][:, inner]
        clock("reduction")
        return K, M

    return matrices


METHODS: dict[str, tuple[Callable[[int, Clock], tuple[Any, Any]], list[int]]] = {
    "extension": (extension, CELLS),
    "ghost penalty": (ghost, CELLS),
    "weighted": (weighted, CELLS),
    "P2, fitted": (triangles(ElementTriP2()), TRIANGLES),
    "P3, fitted": (triangles(ElementTriP3()), TRIANGLES),
}
if ngsolve_disk.INSTALLED:
    METHODS["NGSolve P3, fitted"] = (ngsolve_disk.fitted(3, RADIUS), [1, 2, 3, 4, 5])
    METHODS["ngsxfem Q3, cut"] = (ngsolve_disk.unfitted(3, RADIUS), CELLS[:4])


def measure(name: str, size: int, repeats: int) -> dict[str, Any]:
    """Return errors, dofs and median seconds."""
    make, _ = METHODS[name]
    clocks = []
    for _ in range(repeats):
        clock = Clock()
        A, M = make(size, clock)
        values = lowest_eigenpairs(A, M, 10, shift=0.0)[0]
        clock("eigenvalues")
        clocks.append(clock.seconds)
    errors = np.abs(values / EXACT - 1)
    seconds = {key: statistics.median(found[key] for found in clocks) for key in clocks[0]}
    return {
        "size": size,
        "dofs": A.shape[0],
        "first": float(errors[0]),
        "worst": float(errors.max()),
        "seconds": seconds,
        "total": sum(seconds.values()),
    }


def report(runs: dict[str, list[dict[str, Any]]]) -> None:
    """Print the table."""
    for name, rows in runs.items():
        print(f"\n{name}\n size    dofs   lambda_1   worst of 10   total s   of which")
        for row in rows:
            parts = ", ".join(f"{key} {value:.3f}" for key, value in row["seconds"].items())
            print(f"{row['size']:5}{row['dofs']:8}{row['first']:11.1e}{row['worst']:14.1e}"
                  f"{row['total']:10.2f}   {parts}")  # fmt: skip


def picture(runs: dict[str, list[dict[str, Any]]]) -> Any:
    """Draw errors over dofs and over seconds."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    for ax, what in zip(axes, ("dofs", "total"), strict=True):
        for name, rows in runs.items():
            ax.loglog([row[what] for row in rows], [row["worst"] for row in rows], "o-", label=name)
        ax.set_xlabel("unknowns" if what == "dofs" else "seconds, all steps")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("worst relative error of ten eigenvalues")
    axes[0].legend(fontsize=8)
    return figure


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/curved.json and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=["methods", "materials"], default=["methods"])
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--most", type=int, default=5, help="meshes of each method")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--output", type=Path, default=Path("out"))
    options = parser.parse_args(argv)
    target = options.results / "curved.json"
    record = json.loads(target.read_text()) if target.exists() else {"benchmark": "curved"}
    if "methods" in options.parts:
        if not ngsolve_disk.INSTALLED:
            print("without NGSolve and ngsxfem: pip install ngsolve xfem")
        runs: dict[str, list[dict[str, Any]]] = {}
        for name in options.methods:
            sizes = METHODS[name][1][: options.most]
            measure(name, sizes[0], 1)  # compiled, libraries loaded
            runs[name] = [measure(name, size, options.repeats) for size in sizes]
        report(runs)
        record |= {"machine": describe(), "repeats": options.repeats, "runs": runs}
        options.output.mkdir(parents=True, exist_ok=True)
        picture(runs).savefig(options.output / "curved.png", dpi=130)
        print(f"\nwritten to {options.output}: curved.png")
    if "materials" in options.parts:
        tables = curved_materials.measure(curved_materials.CELLS[: options.most])
        record["materials"] = {"machine": describe()} | tables
    options.results.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
