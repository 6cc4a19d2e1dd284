"""Stress below a contact: Hertz' own field, and far away that of a point force.

Below a line contact (E. McEwen, Phil. Mag. 40 (1949); K. L. Johnson, Contact Mechanics, Cambridge
1985, equations 4.49) with m, n > 0 given by

    m^2, n^2 = sqrt((a^2 - x^2 + z^2)^2 / 4 + x^2 z^2) +- (a^2 - x^2 + z^2) / 2,
    s_xx = -p0/a [m (1 + (z^2 + n^2) / (m^2 + n^2)) - 2 z],
    s_zz = -p0/a  m (1 - (z^2 + n^2) / (m^2 + n^2)),   s_xz = p0/a n (m^2 - z^2) / (m^2 + n^2).

The contact of half-width a enters the far field by its second moment: this field differs from that
of a point force (Flamant) by a^2 / 2 r^2 on the axis, 2 % at r = 5 a and 1 % from 7 a on. In three
dimensions the point force is Boussinesq's. Forces that share the second moment of the pressure, a^2
/ 4 and a^2 / 5 along each axis, come within 1 % at 5 a: halves at +-a / 2 on the line, quarters at
+-sqrt(2/5) a on both axes. Compared along half circles and spheres of radius r, rms of all
components over the rms of the stress.

    python examples/validation_far_field.py
"""

from __future__ import annotations

import argparse
from functools import cache
from pathlib import Path

import numpy as np
import validation_hertz_line
import validation_hertz_sphere
from half_space import stress

from contact import ContactResult, Parabola


def deviation(found: np.ndarray, exact: np.ndarray) -> float:
    """Root mean square, relative."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def hertz(x: np.ndarray, p0: float, a: float = 1.0) -> np.ndarray:
    """McEwen's stress, x along the surface and y into the body."""
    half = 0.5 * (a**2 - x[0] ** 2 + x[1] ** 2)
    root = np.hypot(half, x[0] * x[1])
    m, n = np.sqrt(root + half), np.sign(x[0]) * np.sqrt(np.maximum(root - half, 0.0))
    share = (x[1] ** 2 + n**2) / (m**2 + n**2)
    xx, yy = -m * (1 + share) + 2 * x[1], -m * (1 - share)
    xy = -n * (m**2 - x[1] ** 2) / (m**2 + n**2)
    return p0 / a * np.array([[xx, xy], [xy, yy]])


@cache
def pressed(cells: int) -> tuple[ContactResult, float]:
    """A cylinder on the half plane, contact half-width 1, and its force."""
    star, R = 1 / (1 - 0.3**2), 20.0
    force = np.pi * star / (4 * R)
    obstacle = Parabola((0.0, 0.0), R)
    return validation_hertz_line.pressed(1.0, cells, force, obstacle, 1.0, "bernstein"), force


def line(radii: list[float], cells: int = 8) -> dict[float, tuple[float, float, float]]:
    """Deviations from Hertz' field, the point force and a pair, at distances in half-widths."""
    result, force = pressed(cells)
    angle = (np.arange(40) + 0.5) / 40 * np.pi / 2
    where = np.array([np.cos(angle), np.sin(angle)])
    found = {r: result.stress(r * where) for r in radii}
    return {
        r: (
            deviation(s, hertz(r * where, 2 * force / np.pi)),
            deviation(s, stress(r * where, (0.0, force))),
            deviation(s, pair(r * where, force)),
        )
        for r, s in found.items()
    }


def pair(x: np.ndarray, force: float, a: float = 1.0) -> np.ndarray:
    """Stress of two half forces with the second moment of Hertz' pressure."""
    aside = np.array([0.5 * a, 0.0])[:, None]
    return 0.5 * (stress(x - aside, (0.0, force)) + stress(x + aside, (0.0, force)))


def point(
    radii: list[float], cells: int = 2, growth: float = 1.3
) -> dict[float, tuple[float, float]]:
    """Hertz' point contact on a quarter of the half space: from a point force and from four."""
    script = validation_hertz_sphere
    result = script.sphere(cells, growth).result
    rng = np.random.default_rng(5)
    where = np.abs(rng.standard_normal((3, 200)))
    where /= np.linalg.norm(where, axis=0)
    found = {}
    for r in radii:
        s = result.stress(r * where)
        aside = np.sqrt(0.4) * np.array([[1, -1, 0, 0], [0, 0, 1, -1], [0, 0, 0, 0]])
        four = np.mean([script.boussinesq(r * where - x[:, None]) for x in aside.T], axis=0)
        found[r] = deviation(s, script.boussinesq(r * where)), deviation(s, four)
    return found


def main(argv: list[str] | None = None) -> dict[str, dict]:
    """Print the deviations, draw them and the stress below the contact."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    lines, points = line([0.5, 1.0, 2.0, 5.0, 7.5, 15.0, 40.0]), point([5.0, 7.5])
    for r, (own, far, two) in lines.items():
        print(
            f"line, r = {r:4g} a: from Hertz' field {own:.1e}, from a point force {far:.1e}, from "
            f"a pair {two:.1e}"
        )
    for r, (far, four) in points.items():
        print(f"point, r = {r:4g} a: from a point force {far:.1e}, from four {four:.1e}")
    picture(lines, points, options.output)
    return {"line": lines, "point": points}


def picture(lines: dict, points: dict, output: Path) -> None:
    """Draw the stress on the axis on Hertz' own, and the deviations over the distance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    result, force = pressed(8)
    p0, fine, some = 2 * force / np.pi, np.linspace(0, 3, 200), np.linspace(0, 3, 25)
    exact = hertz(np.array([0 * fine, fine]), p0) / p0
    ours = result.stress(np.array([0 * some, some])) / p0
    for i, name in enumerate(("xx", "yy")):
        left.plot(fine, exact[i, i], f"C{i}", label=rf"$\sigma_{{{name}}}$, closed form")
        left.plot(some, ours[i, i], f"C{i}o", ms=4, mfc="none", label=rf"$\sigma_{{{name}}}$, ours")
    left.set(xlabel="depth / a, on the axis", ylabel="stress / $p_0$", title="below the line")
    r = np.array(list(lines))
    names = ("Hertz' own field", "a point force", "a pair of forces")
    for name, off in zip(names, zip(*lines.values(), strict=True), strict=True):
        right.loglog(r, off, "o-", ms=4, label=f"line, from {name}")
    right.loglog(r, 0.5 / r**2, "k--", lw=1, label="$a^2 / 2 r^2$")
    for name, off in zip(
        ("a point force", "four"), zip(*points.values(), strict=True), strict=True
    ):
        right.loglog(list(points), off, "^:", ms=5, label=f"sphere, from {name}")
    right.set(xlabel="distance r / a", ylabel="relative deviation of the stress, rms")
    for ax in (left, right):
        ax.legend(fontsize=8)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_far_field.png", dpi=120)


if __name__ == "__main__":
    main()
