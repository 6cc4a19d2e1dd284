"""A rigid flat punch with sharp edges: infinite pressure at its ends.

On |x| < a a flat rigid punch is pressed into an elastic half plane without friction by the force P
per unit depth (M. Sadowsky, Z. angew. Math. Mech. 8 (1928); K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 2.8):

    p(x) = P / (pi sqrt(a^2 - x^2)),   p(0) = P / (pi a).

Every cell under the punch is in contact, and the order is that of the singularity. Which functional
to choose at sharp edges: "gauss", whose pressures are values at points between the nodes, is ten
times as accurate at the centre as "bernstein", which pays for never penetrating.

    python examples/validation_flat_punch.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from half_space import half_plane, load_far_field, quarter

from contact import ContactProblem, ContactResult

E, NU, A, P = 1.0, 0.3, 1.0, 0.02


def pressed(cells: int, functional: str) -> ContactResult:
    """Half the punch, cells of size a / cells under it."""
    body = half_plane(quarter(A / cells, 2 * A, 100 * A), E, NU).fix("left", "x")
    load_far_field(body, (0.0, P), "right top")
    mesh = body.mesh
    middle = mesh.p[:, mesh.facets[:, body.facets("bottom")]].mean(axis=1)
    under = body.facets("bottom")[middle[0] < A]
    return ContactProblem(body, under, 0.0, functional=functional).solve()


def centre_pressure(result: ContactResult) -> float:
    """Pressure at the centre over P / (pi a), extrapolated evenly to x = 0."""
    near = np.argsort(result.x[0])[1:4]  # the first point sits on the plane of symmetry
    x, p = result.x[0][near], result.pressure[near]
    return float(np.polyfit(x**2, p * np.sqrt(A**2 - x**2), 1)[1] * np.pi / P)


def main(argv: list[str] | None = None) -> dict[str, list[float]]:
    """Print the pressure at the centre for both functionals, draw all of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    results = {f: [pressed(n, f) for n in options.cells] for f in ("bernstein", "gauss")}
    found = {f: [centre_pressure(result) for result in row] for f, row in results.items()}
    print("a / h   bernstein   gauss      (centre pressure over P / pi a)")
    for row in zip(options.cells, *found.values(), strict=True):
        print(f"{row[0]:5d}   {row[1]:.4f}      {row[2]:.4f}")
    picture({f: row[-1] for f, row in results.items()}, options.cells[-1], options.output)
    return found


def picture(results: dict[str, ContactResult], cells: int, output: Path) -> None:
    """Draw the pressures on the closed form, and how far they are off."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    s = np.linspace(0, 0.998, 400)
    left.plot(s, 1 / np.sqrt(1 - s**2), "k", lw=1, label="closed form")
    for (functional, result), marker in zip(results.items(), "so", strict=True):
        x, p = result.x[0] / A, result.pressure * np.pi * A / P
        left.plot(x, p, marker, ms=4, mfc="none", label=f"{functional}, a / h = {cells}")
        inside = x < A
        off = np.abs(p * np.sqrt(np.maximum(1 - x**2, 0)) - 1)[inside]
        right.semilogy(x[inside], off, marker + "-", ms=4, mfc="none", label=functional)
    left.set(xlim=(0, 1.02), xlabel="x / a", ylabel=r"pressure / ($P / \pi a$)")
    right.set(xlim=(0, 1.02), xlabel="x / a", ylabel="relative error of the pressure")
    for ax in (left, right):
        ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_flat_punch.png", dpi=120)


if __name__ == "__main__":
    main()
