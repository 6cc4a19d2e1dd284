"""A rigid sphere and a rigid cone on an elastic half space, by meshes of the section alone.

The body is axisymmetric: x is the radius r, y the depth z, and all forces are those of the whole
ring. With E* = E / (1 - nu^2), the contact radius a and the depth d of the tip,

    sphere   a^2 = R d,           P = 4 E* a^3 / 3 R,         p = p0 sqrt(1 - r^2 / a^2),
    cone     a = 2 d tan(t) / pi, P = 2 E* d^2 tan(t) / pi,   p = E* arcosh(a / r) / 2 tan(t),

with p0 = 3 P / 2 pi a^2 and the angle t between the axis and the surface of the cone (H. Hertz, J.
reine angew. Math. 92 (1882); I. N. Sneddon, Int. J. Engng Sci. 3 (1965); K. L. Johnson, Contact
Mechanics, Cambridge 1985, sections 4.2 and 5.2). The half space is cut off at 30 a and loaded there
with the stress of a point force; the depth is that against Boussinesq's displacement far away.

    python examples/validation_axisymmetric.py --cells 16
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from half_space import graded
from numpy.typing import NDArray
from skfem import ElementQuad2, ElementTriP2, MeshQuad
from validation_hertz_sphere import boussinesq

from contact import Cone, ContactProblem, ElasticBody, Parabola
from skfem_adini import ElementQuadAdini

Array = NDArray[np.float64]
E, NU, A, R, FAR = 1.0, 0.3, 1.0, 20.0, 30.0
STAR = E / (1 - NU**2)
ANGLE = np.arctan(10.0)  # of the cone: its surface rises by a tenth
HERTZ = 4 * STAR * A**3 / (3 * R)
SNEDDON = 0.5 * np.pi * STAR * A**2 / np.tan(ANGLE)
ELEMENTS = {"Adini": ElementQuadAdini, "Q2": ElementQuad2, "P2": ElementTriP2}


def sunk(x: Array, force: float) -> Array:
    """Displacement along z of a point force into the half space, at places (r, z)."""
    rho = np.hypot(*x)
    return force * (1 + NU) / (2 * np.pi * E * rho) * (2 * (1 - NU) + (x[1] / rho) ** 2)


def hertz(r: Array) -> Array:
    """Pressure of the sphere for the contact radius A."""
    return 1.5 * HERTZ / (np.pi * A**2) * np.sqrt(np.maximum(1 - (r / A) ** 2, 0.0))


def sneddon(r: Array) -> Array:
    """Pressure of the cone for the contact radius A."""
    return 0.5 * STAR / np.tan(ANGLE) * np.arccosh(A / np.minimum(r, A))


def pressed(name: str, cells: int, obstacle: object, force: float) -> SimpleNamespace:
    """Solve, with `cells` cells in the contact radius; also the depth, and the mean of r^2."""
    across, down = graded(A / cells, 1.5 * A, FAR, 1.3), graded(A / cells, 0.25 * A, FAR, 1.3)
    mesh = MeshQuad.init_tensor(across, down)
    mesh = (mesh.to_meshtri(style="x") if name == "P2" else mesh).with_defaults()
    body = ElasticBody.from_mesh(mesh, ELEMENTS[name](), E=E, nu=NU, plane="axisymmetric")
    for side, row in (("right", 0), ("top", 1)):
        # The plane y = 0 of the space: its axes x and z are r and z here.
        body.load(
            side,
            lambda x, row=row: boussinesq(np.stack([x[0], 0 * x[0], x[1]]), force)[::2, ::2][row],
        )
    result = ContactProblem(body, "bottom", obstacle).solve()
    far = np.array([[0.7 * FAR], [0.7 * FAR]])
    depth = float((sunk(far, force) - result.sample(far)[1])[0])
    square = float(result.mu @ result.x[0] ** 2 / result.mu.sum())
    return SimpleNamespace(result=result, depth=depth, square=square)


def sphere(name: str, cells: int) -> SimpleNamespace:
    """Relative errors of pressure (largest, of p0, up to .8 a), contact radius and force."""
    found = pressed(name, cells, Parabola((0.0, 0.0), R), HERTZ)
    r, p = found.result.x[0], found.result.pressure
    found.pressure = float(np.abs((p - hertz(r))[r < 0.8 * A]).max() / hertz(np.zeros(1))[0])
    found.radius = float(np.sqrt(2.5 * found.square) / A - 1)  # mean of r^2: 2 a^2 / 5
    found.force = float(4 / 3 * STAR * np.sqrt(R) * found.depth**1.5 / HERTZ - 1)
    return found


def cone(name: str, cells: int) -> SimpleNamespace:
    """Relative errors of pressure (rms over its mean, .15 to .8 a), radius and force."""
    found = pressed(name, cells, Cone((0.0, 0.0), (0.0, -1.0), ANGLE), SNEDDON)
    r, p = found.result.x[0], found.result.pressure
    near = (r > 0.15 * A) & (r < 0.8 * A)
    found.pressure = float(np.sqrt(np.mean((p - sneddon(r))[near] ** 2)) * np.pi * A**2 / SNEDDON)
    found.radius = float(np.sqrt(3 * found.square) / A - 1)  # mean of r^2: a^2 / 3
    found.force = float(2 * STAR * found.depth**2 * np.tan(ANGLE) / (np.pi * SNEDDON) - 1)
    return found


def main(argv: list[str] | None = None) -> dict[str, SimpleNamespace]:
    """Print errors of pressure, contact radius and of the force at that depth; draw both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=16, help="cells in the contact radius")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    found = {}
    for name in ELEMENTS:
        for case in (sphere, cone):
            row = case(name, options.cells)
            found[f"{case.__name__}, {name}"] = row
            print(
                f"{case.__name__:6} {name:5}  pressure {row.pressure:.1e}, contact radius "
                f"{row.radius:+.1e}, force for its depth {row.force:+.1e}, relative"
            )
    picture(found, options.output)
    return found


def picture(found: dict[str, SimpleNamespace], output: Path) -> None:
    """Draw the pressures on the closed forms, and the stress below the cone."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    r = np.linspace(1e-3, 1.4 * A, 400)
    for color, name, exact, force in (
        ("C0", "sphere", hertz, HERTZ),
        ("C1", "cone", sneddon, SNEDDON),
    ):
        mean, result = force / (np.pi * A**2), found[f"{name}, Adini"].result
        near = result.x[0] < 1.4 * A
        author = {"sphere": "Hertz", "cone": "Sneddon"}[name]
        left.plot(r / A, exact(r) / mean, color, lw=1, label=f"{name}, {author}")
        x, p = result.x[0, near] / A, result.pressure[near] / mean
        left.plot(x, p, f"{color}o", ms=4, mfc="none", label=f"{name}, ours")
    left.set(xlabel="r / a", ylabel=r"pressure / $(P / \pi a^2)$", xlim=(0, 1.4), ylim=(-0.1, 4))
    left.legend()
    x = np.array(np.meshgrid(np.linspace(0, 2, 161), np.linspace(0, 2, 161)))
    von_mises = found["cone, Adini"].result.von_mises(x.reshape(2, -1)).reshape(x.shape[1:])
    mean = SNEDDON / (np.pi * A**2)
    for sign in (-1, 1):
        drawn = right.pcolormesh(
            sign * x[0], x[1], von_mises / mean, norm=LogNorm(0.05, 2), shading="gouraud"
        )
    right.plot([-A, A], [0, 0], "k", lw=3, solid_capstyle="butt")
    right.set(xlabel="r / a", ylabel="z / a", aspect="equal", title="below the cone")
    right.invert_yaxis()
    figure.colorbar(
        drawn, ax=right, label=r"von Mises stress / $(P / \pi a^2)$", extend="both", shrink=0.6
    )
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_axisymmetric.png", dpi=150)


if __name__ == "__main__":
    main()
