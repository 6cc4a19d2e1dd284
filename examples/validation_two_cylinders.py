"""Two elastic cylinders: Hertz' pressure on meshes that do not match, and NAFEMS' benchmark CGS-1.

Two bodies with E in the ratio 1:3 and cells in the ratio 1:1.37 are pressed together by the force P
per unit depth; between them is the gap x^2 / 2R. With 1/E* = sum of (1 - nu^2) / E,

    a = sqrt(4 P R / (pi E*)),   p(x) = p0 sqrt(1 - x^2 / a^2),   p0 = 2 P / (pi a)

(H. Hertz, J. reine angew. Math. 92 (1882); K. L. Johnson, Contact Mechanics, Cambridge 1985,
section 4.2).

CGS-1: a steel cylinder (R = 50 mm, E = 210 GPa) on an aluminium block (E = 70 GPa), nu = .3, under
35 kN/mm: a = 6.21 mm and p0 = 3585 MPa (A. Konter, Advanced Finite Element Contact Benchmarks,
NAFEMS 2006). Here both bodies are meshed, the cylinder as half of a ring with a bore far from the
contact, by straight cells and by cells of second order; the gap is that between the meshes.

    python examples/validation_two_cylinders.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from half_space import graded
from skfem import ElementQuad2, MeshQuad, MeshQuad2

from contact import ContactProblem, ContactResult, ElasticBody
from skfem_adini import ElementQuadAdini

SOFT, NU, RATIO, RADIUS, FAR = 1.0, 0.3, 1.37, 50.0, 300.0  # lengths in half-widths a
ELEMENTS = {"Q2": ElementQuad2, "Adini": ElementQuadAdini}
STEEL, ALUMINIUM, FORCE, STEEL_RADIUS = 210e3, 70e3, 35e3, 50.0  # MPa, N/mm, mm


def named(mesh: MeshQuad, x: np.ndarray, y: np.ndarray) -> MeshQuad:
    """Names of the sides of a tensor mesh, which may then be bent."""
    at = {"left": (0, x[0]), "right": (0, x[-1]), "bottom": (1, y[0]), "top": (1, y[-1])}
    size = np.array([np.ptp(x), np.ptp(y)])
    return mesh.with_boundaries(
        {
            name: (lambda p, k=k, v=v: np.abs(p[k] - v) < 1e-9 * size[k])
            for name, (k, v) in at.items()
        }
    )


def hertz(cells: int, element: type) -> SimpleNamespace:
    """Half of two blocks; errors of the pressure over p0 where |x| < .8 a, and of its largest."""
    bodies = []
    for step, E, up in ((1 / cells, SOFT, True), (RATIO / cells, 3 * SOFT, False)):
        x, y = graded(step, 1.5, FAR), graded(step, 0.8, FAR)
        y = y if up else -y[::-1]
        mesh = named(MeshQuad.init_tensor(x, y), x, y)
        bodies.append(ElasticBody.from_mesh(mesh, element(), E=E, nu=NU).fix("left", "x"))
    upper, lower = bodies
    star = 1 / ((1 - NU**2) * (1 / SOFT + 1 / (3 * SOFT)))
    force = np.pi * star / (4 * RADIUS)
    upper.load("top", (0.0, -force / (2 * FAR)))
    surface = lower.fix("bottom", "y").surface("top", lambda x: x[0] ** 2 / (2 * RADIUS))
    result = ContactProblem(upper, "bottom", surface).solve()
    p0, x, w = 2 * force / np.pi, result.x[0], result.system.rows.weights
    off = result.pressure / p0 - np.sqrt(np.maximum(1 - x**2, 0))
    inside = np.abs(x) < 0.8
    rms = float(np.sqrt(w[inside] @ off[inside] ** 2 / w[inside].sum()))
    # At the plane of symmetry the largest pressure: a parabola through the first three points.
    near = np.argsort(x)[:4]
    peak = np.polyfit(x[near] ** 2, result.pressure[near] / p0, 1)[1]
    return SimpleNamespace(result=result, p0=p0, rms=rms, peak=float(peak - 1))


def cgs1(cells: int, curved: bool) -> SimpleNamespace:
    """Half-width in mm and largest pressure in MPa of the NAFEMS pair."""
    star = 1 / ((1 - NU**2) * (1 / STEEL + 1 / ALUMINIUM))
    a = float(np.sqrt(4 * FORCE * STEEL_RADIUS / (np.pi * star)))
    R, h = STEEL_RADIUS, a / cells
    r, angle = R - graded(h, 0.8 * a, 0.7 * R)[::-1], graded(h, 1.5 * a, 0.5 * np.pi * R) / R
    ring = named(MeshQuad.init_tensor(angle, r), angle, r)
    x, y = graded(RATIO * h, 1.5 * a, 2 * R), -graded(RATIO * h, 0.8 * a, 4 * R)[::-1]
    block = named(MeshQuad.init_tensor(x, y), x, y)
    names = dict(ring.boundaries)
    if curved:
        ring = MeshQuad2.from_mesh(ring)
    turn, radius = ring.doflocs
    p = np.array([radius * np.sin(turn), R - radius * np.cos(turn)])
    ring = type(ring)(p, ring.t, sort_t=False).with_boundaries(names)
    cylinder = ElasticBody.from_mesh(ring, ElementQuad2(), E=STEEL, nu=NU).named("cylinder")
    plate = ElasticBody.from_mesh(block, ElementQuad2(), E=ALUMINIUM, nu=NU).named("block")
    cylinder.fix("left", "x").load("right", (0.0, -0.5 * FORCE / (0.7 * R)))
    plate.fix("left", "x").fix("bottom", "y")
    result = ContactProblem(cylinder, "top", plate.surface("top")).solve()
    half_width = 2 * np.sqrt(result.mu @ result.x[0] ** 2 / result.mu.sum())
    return SimpleNamespace(result=result, a=float(half_width), p=float(result.pressure.max()))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print both tables, draw both pressures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 16, 32])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    lines, orders = {}, {}
    print("Hertz, E 1:3, cells 1:1.37: a / h, rms pressure error, error of the largest")
    for name, element in ELEMENTS.items():
        lines[name] = [hertz(cells, element) for cells in options.cells]
        rms = [found.rms for found in lines[name]]
        orders[name] = float(-np.polyfit(np.log(options.cells), np.log(rms), 1)[0])
        for cells, found in zip(options.cells, lines[name], strict=True):
            print(f"{name:>6} {cells:4d}   {found.rms:.1e}   {found.peak:+.1e}")
        print(f"{name:>6}, order {orders[name]:.2f}")
    pairs = {curved: cgs1(16, curved) for curved in (False, True)}
    for curved, found in pairs.items():
        kind = "second-order" if curved else "straight"
        print(f"CGS-1, {kind} cells: a = {found.a:.3f} mm (6.21), p0 = {found.p:.0f} MPa (3585)")
    print(f"\n{pairs[True].result.certificate()}")
    picture(dict(zip(options.cells, lines["Adini"], strict=True)), pairs, options.output)
    return SimpleNamespace(lines=lines, orders=orders, cgs1=pairs)


def picture(lines: dict, pairs: dict, output: Path) -> None:
    """Draw the pressures on Hertz' and on NAFEMS' ellipse."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    s = np.sin(np.linspace(0, np.pi / 2, 200))
    left.plot(s, np.sqrt(1 - s**2), "k", lw=1, label="Hertz")
    for (cells, found), marker in zip(lines.items(), "sdo^v" * len(lines), strict=False):
        result: ContactResult = found.result
        p = result.pressure / found.p0
        left.plot(result.x[0], p, marker, ms=4, mfc="none", label=f"Adini, a / h = {cells}")
    left.set(xlim=(0, 1.25), xlabel="x / a", ylabel="pressure / $p_0$", title="E 1:3, cells 1:1.37")
    right.plot(6.21 * s, 3585 * np.sqrt(1 - s**2), "k", lw=1, label="published: 6.21 mm, 3585 MPa")
    for (curved, found), marker in zip(pairs.items(), "so", strict=True):
        kind = "second-order cells" if curved else "straight cells"
        result = found.result
        right.plot(result.x[0], result.pressure, marker, ms=4, mfc="none", label=kind)
    right.set(xlim=(0, 7.8), xlabel="x, mm", ylabel="pressure, MPa", title="NAFEMS CGS-1")
    for ax in (left, right):
        ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_two_cylinders.png", dpi=120)


if __name__ == "__main__":
    main()
