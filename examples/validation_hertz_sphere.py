"""Hertz' point contact in three dimensions: a rigid sphere on an elastic half space.

With E* = E / (1 - nu^2), under the force P,

    a^3 = 3 P R / (4 E*),   p(r) = p0 sqrt(1 - r^2 / a^2),   p0 = 3 P / (2 pi a^2)

(H. Hertz, J. reine angew. Math. 92 (1882); K. L. Johnson, Contact Mechanics, Cambridge 1985,
section 4.2). A quarter of the half space is cut off at 12 a and loaded there with the stress of a
point force (J. Boussinesq, 1885; Johnson, section 3.2): in cylindrical coordinates, z into the
body, tension positive, rho = |x|,

    s_zz = -3 P z^3 / 2 pi rho^5,   s_rz = -3 P r z^2 / 2 pi rho^5,
    s_rr = P / 2 pi [(1 - 2 nu) / rho (rho + z) - 3 r^2 z / rho^5],
    s_tt = -P (1 - 2 nu) / 2 pi [1 / rho (rho + z) - z / rho^3].

    python examples/validation_hertz_sphere.py --cells 8
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from half_space import graded
from numpy.typing import NDArray
from skfem import ElementHex2, MeshHex

from contact import ContactProblem, ContactResult, ElasticBody, Parabola

Array = NDArray[np.float64]
E, NU, A, R, FAR = 1.0, 0.3, 1.0, 20.0, 12.0
STAR = E / (1 - NU**2)
P = 4 * STAR * A**3 / (3 * R)
P0 = 3 * P / (2 * np.pi * A**2)


def boussinesq(x: Array, force: float = P) -> Array:
    """Stress (3, 3, ...) of a point force into the half space z > 0."""
    r, z, rho = np.hypot(x[0], x[1]), x[2], np.sqrt(np.sum(x**2, axis=0))
    e = x[:2] / np.maximum(r, 1e-300)
    p = force / (2 * np.pi)
    soft = (1 - 2 * NU) / (rho * (rho + z))
    rr = p * (soft - 3 * r**2 * z / rho**5)
    tt = -p * (soft - (1 - 2 * NU) * z / rho**3)
    rz, zz = -3 * p * r * z**2 / rho**5, -3 * p * z**3 / rho**5
    s = np.zeros((3, 3, *r.shape))
    hoop = np.array([-e[1], e[0]])
    s[:2, :2] = rr * e[:, None] * e[None] + tt * hoop[:, None] * hoop[None]
    s[:2, 2] = s[2, :2] = rz * e
    s[2, 2] = zz
    return s


def sphere(cells: int, growth: float = 1.7) -> SimpleNamespace:
    """Solve on a quarter; force, pressure at the centre and half-width, relative to Hertz."""
    across = graded(A / cells, 1.25 * A, FAR, growth)
    down = graded(A / cells, 0.0, FAR, min(growth, 1.45))
    mesh = MeshHex.init_tensor(across, across, down)
    named = {"x0": (0, 0.0), "y0": (1, 0.0), "z0": (2, 0.0)}
    named |= {"x1": (0, FAR), "y1": (1, FAR), "z1": (2, FAR)}
    mesh = mesh.with_boundaries(
        {name: lambda x, a=a, v=v: np.abs(x[a] - v) < 1e-9 for name, (a, v) in named.items()}
    )
    body = ElasticBody.from_mesh(mesh, ElementHex2(), E=E, nu=NU).fix("x0", "x").fix("y0", "y")
    for axis in range(3):
        n = np.eye(3)[axis]
        side = f"{'xyz'[axis]}1"
        body.load(side, lambda x, n=n: np.einsum("ij...,j->i...", boussinesq(x), n))
    result = ContactProblem(body, "z0", Parabola((0.0, 0.0, 0.0), R)).solve()
    r = np.hypot(*result.x[:2])
    near = r < 0.5 * A
    # p^2 is linear in r^2.
    p0 = np.sqrt(np.polyfit(r[near] ** 2, result.pressure[near] ** 2, 1)[1])
    a = np.sqrt(2.5 * (result.mu @ r**2) / result.mu.sum())  # second moment: 2 a^2 / 5
    return SimpleNamespace(result=result, p0=p0 / P0, a=a / A, force=4 * result.mu.sum() / P)


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print force, centre pressure and contact radius over those of Hertz, draw the pressure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=4, help="cells in the radius a")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for VTU and PNG")
    options = parser.parse_args(argv)
    found = sphere(options.cells)
    body = found.result.system.body
    print(f"{body.mesh.nelements} quadratic hexahedra, {body.basis.N} unknowns")
    print(f"force {found.force:.6f}, p0 {found.p0:.4f}, a {found.a:.4f}, each over Hertz' value")
    options.output.mkdir(parents=True, exist_ok=True)
    found.result.to_pyvista().save(options.output / "validation_hertz_sphere.vtu")
    picture(found.result, options.output)
    return found


def picture(result: ContactResult, output: Path) -> None:
    """Draw the pressure over the radius on Hertz' ellipse, and on the surface."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    r, s = np.hypot(*result.x[:2]) / A, np.sin(np.linspace(0, np.pi / 2, 200))
    near = np.all(result.x[:2] < 1.5 * A, axis=0)
    left.plot(s, np.sqrt(1 - s**2), "k", lw=1, label="Hertz")
    left.plot(r[near], result.pressure[near] / P0, "o", ms=4, mfc="none", label="ours")
    left.set(xlim=(0, 1.4), xlabel="r / a", ylabel="pressure / $p_0$")
    left.legend()
    signs = np.array([[1, 1, -1, -1], [1, -1, 1, -1]])  # the other quarters by symmetry
    points = (signs[:, :, None] * result.x[:2, None, near] / A).reshape(2, -1)
    p = np.tile(result.pressure[near] / P0, 4)
    drawn = right.tripcolor(*points, p, shading="gouraud")
    angle = np.linspace(0, 2 * np.pi, 200)
    right.plot(np.cos(angle), np.sin(angle), "w--", label="Hertz' circle, r = a")
    right.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3), aspect="equal", xlabel="x / a", ylabel="y / a")
    right.legend(facecolor="0.3", labelcolor="w", loc="upper right")
    figure.colorbar(drawn, ax=right, label="pressure / $p_0$")
    figure.savefig(output / "validation_hertz_sphere.png", dpi=120)


if __name__ == "__main__":
    main()
