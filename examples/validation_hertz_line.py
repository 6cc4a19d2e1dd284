"""Hertz' line contact: a rigid cylinder on an elastic half plane, and NAFEMS' benchmark CGS-1.

A parabola x^2 / 2R is pressed by the force P per unit depth. With E* = E / (1 - nu^2),

    a = sqrt(4 P R / (pi E*)),   p(x) = p0 sqrt(1 - x^2 / a^2),   p0 = 2 P / (pi a)

(H. Hertz, J. reine angew. Math. 92 (1882); K. L. Johnson, Contact Mechanics, Cambridge 1985,
section 4.2). The half-width is found from the second moment of the pressure, a^2 / 4.

CGS-1: a steel cylinder (R = 50 mm, E = 210 GPa) on an aluminium block (E = 70 GPa), nu = .3, under
35 kN/mm: a = 6.21 mm and p0 = 3585 MPa (A. Konter, Advanced Finite Element Contact Benchmarks,
NAFEMS 2006). Here the pair is one rigid cylinder on a block with the E* of both, 1/E* = sum of
(1 - nu^2) / E: small strains, equal friction-free surfaces.

    python examples/validation_hertz_line.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from half_space import half_plane, load_far_field, quarter

from contact import ContactProblem, ContactResult, Cylinder, Parabola

E, NU = 1.0, 0.3
STEEL, ALUMINIUM, FORCE, RADIUS = 210e3, 70e3, 35e3, 50.0  # MPa, N/mm, mm


def pressed(
    a: float, cells: int, force: float, obstacle: object, modulus: float, functional: str
) -> ContactResult:
    """A quarter of the block: half the contact, cells of size a / cells under it."""
    body = half_plane(quarter(a / cells, 1.25 * a, 100 * a), modulus, NU).fix("left", "x")
    load_far_field(body, (0.0, force), "right top")
    return ContactProblem(body, "bottom", obstacle, functional=functional).solve()


def line(cells: int, functional: str = "bernstein", a: float = 1.0, R: float = 20.0) -> dict:
    """Errors of the force, of the pressure (rms over |x| < .8 a, over p0) and of the half-width."""
    star = E / (1 - NU**2)
    force = np.pi * star * a**2 / (4 * R)
    result = pressed(a, cells, force, Parabola((0.0, 0.0), R), E, functional)
    x, mu = result.x[0], result.mu
    inside = np.abs(x) < 0.8 * a
    p0 = 2 * force / (np.pi * a)
    exact = np.sqrt(1 - (x[inside] / a) ** 2)
    return {
        "result": result,
        "p0": p0,
        "force": 2 * mu.sum() / force - 1,
        "pressure": float(np.sqrt(np.mean((result.pressure[inside] / p0 - exact) ** 2))),
        "half_width": 2 * np.sqrt(mu @ x**2 / mu.sum()) / a - 1,
    }


def cgs1(cells: int) -> tuple[float, float, ContactResult]:
    """Half-width in mm and largest pressure in MPa of the NAFEMS cylinder, and the result."""
    star = 1 / ((1 - NU**2) * (1 / STEEL + 1 / ALUMINIUM))
    a = float(np.sqrt(4 * FORCE * RADIUS / (np.pi * star)))
    cylinder = Cylinder((0.0, -RADIUS), RADIUS)
    result = pressed(a, cells, FORCE, cylinder, star * (1 - NU**2), "bernstein")
    half_width = 2 * np.sqrt(result.mu @ result.x[0] ** 2 / result.mu.sum())
    return float(half_width), float(result.pressure.max()), result


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print both tables, draw both pressures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    rows = [line(cells) for cells in options.cells]
    print("a / h   force error   rms pressure error   half-width error")
    for cells, row in zip(options.cells, rows, strict=True):
        print(
            f"{cells:5d}   {row['force']:+.1e}      {row['pressure']:.1e}              "
            f"{row['half_width']:+.1e}"
        )
    a, p, steel = cgs1(options.cells[-1])
    print(f"\nNAFEMS CGS-1: a = {a:.3f} mm (6.21), largest pressure {p:.0f} MPa (3585)")
    picture(dict(zip(options.cells, rows, strict=True)), steel, options.output)
    return SimpleNamespace(rows=rows, cgs1=(a, p))


def picture(rows: dict[int, dict], steel: ContactResult, output: Path) -> None:
    """Draw the pressures on Hertz' and on NAFEMS' ellipse."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    s = np.sin(np.linspace(0, np.pi / 2, 200))
    left.plot(s, np.sqrt(1 - s**2), "k", lw=1, label="Hertz")
    for (cells, row), marker in zip(rows.items(), "sdo^v<>" * len(rows), strict=False):
        result = row["result"]
        p = result.pressure / row["p0"]
        left.plot(result.x[0], p, marker, ms=4, mfc="none", label=f"a / h = {cells}")
    left.set(
        xlim=(0, 1.25),
        xlabel="x / a",
        ylabel="pressure / $p_0$",
        title="rigid cylinder on a half plane",
    )
    right.plot(6.21 * s, 3585 * np.sqrt(1 - s**2), "k", lw=1, label="published: 6.21 mm, 3585 MPa")
    right.plot(steel.x[0], steel.pressure, "o", ms=4, mfc="none", label="ours")
    right.set(xlim=(0, 1.25 * 6.21), xlabel="x, mm", ylabel="pressure, MPa", title="NAFEMS CGS-1")
    for ax in (left, right):
        ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_hertz_line.png", dpi=120)


if __name__ == "__main__":
    main()
