r"""A disk on a Cartesian grid pressed on a rigid plane: Hertz on cells that the circle cuts.

The lower half of a disk of radius R = 1, its flat side a mesh line that moves down by a given
amount, its arc anywhere in the cells; they are halved towards the contact, down to the size h.
With P the force that results and E* = E / (1 - nu^2), in the limit a << R,

    a = sqrt(4 P R / (pi E*)),   p(x) = p0 sqrt(1 - x^2 / a^2),   p0 = 2 P / (pi a)

(H. Hertz, J. reine angew. Math. 92 (1882)). Then the flat side moves sideways with friction F = .3
(nu = .49: shear and pressure hardly couple). With Q the tangential force, |x| < c sticks,

    c = a sqrt(1 - Q / (F P)),   q(x) = F (p(x) - (c / a) p(a x / c))

(C. Cattaneo, Rend. Accad. Lincei 27 (1938); R. D. Mindlin, J. Appl. Mech. 16 (1949)). Linear
elasticity on the undeformed disk differs from both by about (1 - 2 nu) a / R: .5 % here.

The pressure acts along the plane's normal (`ClosestPoint`): along the body's, which the arc turns
by x / R, it would push sideways with p x / R, and pressing alone would leave a shear of a fifth of
F p0. What remains is the resolution of the hats, 1.5 times the L2 error of the best of their width:
the shear rises vertically at the ends of the stick zone, so the points next to them are off by up
to .13 F p0 at h / a = 1/16, those beyond .2 a from them by .03.

    python examples/cut_hertz.py --cells 4 8 16 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from skfem import MeshQuad

from contact import ClosestPoint, ContactProblem, ContactResult, CutBody, Plane, Status
from skfem_adini import refined_at_boundary

E, COARSE = 1.0, 0.1
FLOOR = ClosestPoint(Plane((0.0, -1.0), (0.0, 1.0)))


def disk(x: Any) -> Any:
    """Return the level set, negative inside."""
    return x[0] ** 2 + x[1] ** 2 - 1


def grid(a: float, cells: int) -> tuple[MeshQuad, float]:
    """Return a mesh with at least `cells` cells on the half-width a, and their size."""
    levels = int(np.ceil(np.log2(COARSE * cells / a) - 1e-9))
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 23), np.linspace(-1.1, 0, 12))
    for k in range(levels):
        reach = 4 * a * 2.0 ** (levels - 1 - k)
        mesh = refined_at_boundary(
            mesh, disk, layers=3, where=lambda x, r=reach: np.hypot(x[0], x[1] + 1) < r
        )
    flat = mesh.facets_satisfying(lambda x: np.abs(x[1]) < 1e-9)
    return mesh.with_boundaries({"flat": flat}), COARSE / 2**levels


def press(
    a: float, cells: int, nu: float, friction: float = 0.0, turn: float = 0.0
) -> tuple[ContactResult, float]:
    """Press until the half-width is about a; then, with turn > 0, shift to Q of about turn F P."""
    mesh, h = grid(a, cells)
    down = a**2 / 4 * (2 * np.log(4 / a) - 1)

    def moved(sideways: float) -> ContactProblem:
        body = CutBody(mesh, disk, E, nu).fix("flat", "x", sideways).fix("flat", "y", -down)
        arc = body.arc(where=lambda x: np.hypot(x[0], x[1] + 1) < 1.5 * a)
        return ContactProblem(body, arc, FLOOR, friction)

    result = moved(0.0).solve()
    if turn > 0:
        result = moved(2 * turn * friction * down).solve(after=result)
    return result, h


def compare(result: ContactResult, h: float, nu: float) -> SimpleNamespace:
    """Compare with Hertz at the same force: half-width (from the second moment), peak, pressure."""
    force = float(result.resultant[1])
    a = np.sqrt(4 * force * (1 - nu**2) / (np.pi * E))
    p0 = 2 * force / (np.pi * a)
    x = np.linspace(*result.x[0, [0, -1]], 20_001)
    p = np.interp(x, result.x[0], result.pressure)  # hats: the pressure is linear in between
    exact = np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
    inner = np.abs(x) < 0.8 * a
    return SimpleNamespace(
        a=a,
        p0=p0,
        h=h / a,
        unknowns=result.system.body.constraint[0].shape[1],
        half_width=2 * np.sqrt(p @ x**2 / p.sum()) / a - 1,
        peak=p.max() / p0 - 1,
        pressure=float(np.sqrt(np.mean((p - p0 * exact)[inner] ** 2))) / p0,
    )


def cattaneo(result: ContactResult, fit: SimpleNamespace, friction: float) -> SimpleNamespace:
    """Return Cattaneo's shear over F p0 as a function of x / a, and his and our stick zone."""
    sideways, force = np.abs(result.resultant)
    c = float(np.sqrt(1 - sideways / (friction * force)))

    def shear(x: Any) -> Any:
        whole, stuck = (np.sqrt(np.maximum(1 - (x / half) ** 2, 0)) for half in (1.0, c))
        return whole - c * stuck

    stick = result.system.rows.weights[result.status == Status.STICK].sum() / 2
    return SimpleNamespace(shear=shear, exact=c, found=stick / fit.a)


def picture(plain: ContactResult, rubbed: ContactResult, friction: float) -> Any:
    """Draw the body, and the tractions beside the closed forms."""
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection

    figure, (whole, near, left, right) = plt.subplots(
        1, 4, figsize=(16, 3.6), width_ratios=[1.3, 1.2, 1, 1], layout="constrained"
    )
    solid = plain.to_pyvista(subdivide=4).triangulate()
    p, triangles = np.asarray(solid.points), solid.cells.reshape(-1, 4)[:, 1:]
    fit = compare(plain, 1.0, 0.3)
    scale = np.asarray(solid.point_data["nodal_von_mises"]) / fit.p0
    cells = plain.system.body.mesh
    for ax in (whole, near):
        image = ax.tripcolor(p[:, 0], p[:, 1], triangles, scale, vmin=0, vmax=0.6, cmap="magma",
                             shading="gouraud")  # fmt: skip
        edges = cells.p[:, cells.facets].transpose(2, 1, 0)
        ax.add_collection(LineCollection(edges, colors="w", linewidths=0.3, alpha=0.6))
        ax.axhline(-1, color="0.3", lw=2)
        ax.set_aspect("equal")
    whole.set(
        title="half a disk, cells of the grid",
        xlim=(-1.1, 1.1),
        ylim=(-1.15, 0.05),
        xticks=[-1, 0, 1],
        yticks=[-1, 0],
    )
    a = fit.a
    near.set(title="under the contact", xlim=(-2.5 * a, 2.5 * a), ylim=(-1 - 0.4 * a, -1 + 4 * a))
    figure.colorbar(image, ax=near, label="von Mises stress / $p_0$", shrink=0.8)

    x = np.linspace(-1.3, 1.3, 400)
    left.plot(x, np.sqrt(np.maximum(1 - x**2, 0)), color="0.6", label="Hertz")
    left.plot(plain.x[0] / a, plain.pressure / fit.p0, "o", ms=3, label="on cut cells")
    left.set(title="pressure, no friction", xlabel="x / a", ylabel="$p / p_0$", xlim=(-1.4, 1.4))
    left.legend(frameon=False)

    fit = compare(rubbed, 1.0, 0.49)
    theory = cattaneo(rubbed, fit, friction)
    x, unit = rubbed.x[0] / fit.a, friction * fit.p0
    right.fill_between(x, friction * rubbed.pressure / unit, color="0.92", label="$F p$")
    fine = np.linspace(-1.3, 1.3, 400)
    right.plot(fine, theory.shear(fine), color="0.6", label="Cattaneo")
    for status, name in ((Status.STICK, "stick"), (Status.SLIP, "slip")):
        at = rubbed.status == status
        right.plot(x[at], np.abs(rubbed.shear[at, 0]) / unit, "o", ms=3, label=name)
    right.set(title="shear after a shift", xlabel="x / a", ylabel="$q / F p_0$", xlim=(-1.4, 1.4))
    right.legend(frameon=False)
    return figure


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print both comparisons, write the picture and VTK files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16], help="on a half-width")
    parser.add_argument("--output", type=Path, default=Path("out"))
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)

    print("  h / a   unknowns   half-width     peak   rms pressure, |x| < .8 a")
    rows = []
    for cells in options.cells:
        plain, h = press(0.025, cells, 0.3)
        rows.append(compare(plain, h, 0.3))
        row = rows[-1]
        print(f"{row.h:7.3f}{row.unknowns:11}{row.half_width:+13.4f}{row.peak:+9.4f}"
              f"{row.pressure:12.4f}")  # fmt: skip
    friction = 0.3
    rubbed, h = press(0.025, options.cells[-1], 0.49, friction, turn=0.7)
    stick = cattaneo(rubbed, compare(rubbed, h, 0.49), friction)
    print(f"stick zone c / a: Cattaneo {stick.exact:.3f}, found {stick.found:.3f}")

    picture(plain, rubbed, friction).savefig(options.output / "cut_hertz.png", dpi=150)
    plain.to_pyvista().save(options.output / "cut_hertz.vtu")
    rubbed.boundary_to_pyvista().save(options.output / "cut_hertz_arc.vtp")
    print(f"written to {options.output}: cut_hertz.png, cut_hertz.vtu, cut_hertz_arc.vtp")
    return SimpleNamespace(rows=rows, stick=stick, plain=plain, rubbed=rubbed)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
