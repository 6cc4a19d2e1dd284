"""A finite block that behaves like a half plane: meshes, and what the far field asks of its sides.

The half plane y > 0 (plane strain) carries on its edge, at the origin, a force f per unit depth.
With r = |x| and e = x / r (Flamant 1892; S. P. Timoshenko and J. N. Goodier, Theory of Elasticity,
3rd ed., McGraw-Hill 1970, articles 36 and 37) the stress is

    sigma = s e e^T,   s = -2 (f . e) / (pi r).

A contact of half-width a is such a force up to terms of order (a / r)^2. The validation examples
cut a block out of the half plane and load its sides with sigma n. Run by itself the script
draws mesh, stress and displacement near the origin.

    python examples/half_space.py [--output out]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshQuad

from contact import ElasticBody
from skfem_adini import ElementQuadAdini

Array = NDArray[np.float64]
NORMALS = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "top": (0.0, 1.0)}


def graded(step: float, fine: float, far: float, ratio: float = 1.25) -> Array:
    """Ticks from 0 to far: equal steps up to `fine`, then growing by the ratio."""
    ticks = list(np.arange(round(fine / step) + 1) * step)
    while ticks[-1] < far:
        step *= ratio
        ticks.append(ticks[-1] + step)
    ticks[-1] = far
    if len(ticks) > 2 and ticks[-1] - ticks[-2] < 0.5 * (ticks[-2] - ticks[-3]):
        del ticks[-2]
    return np.array(ticks)


def quarter(h: float, fine: float, far: float, flat: float = 1.0) -> MeshQuad:
    """0 < x < far, 0 < y < far, with cells of size h up to `fine` from the origin.

    With flat < 1 cells have the height ``flat * h`` at the surface and grow from there on.
    """
    ticks = graded(h, fine, far)
    return MeshQuad.init_tensor(
        ticks, ticks if flat == 1.0 else graded(flat * h, flat * h, far)
    ).with_defaults()


def half(h: float, fine: float, far: float) -> MeshQuad:
    """-far < x < far, 0 < y < far."""
    ticks = graded(h, fine, far)
    return MeshQuad.init_tensor(np.r_[-ticks[:0:-1], ticks], ticks).with_defaults()


def half_plane(mesh: MeshQuad, E: float, nu: float) -> ElasticBody:
    """An elastic body of Adini elements on the mesh."""
    return ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=E, nu=nu)


def stress(x: ArrayLike, force: ArrayLike) -> Array:
    """Flamant's stress at points x, shape (2, 2, ...), of a force on the body at the origin."""
    x, f = np.asarray(x, dtype=float), np.asarray(force, dtype=float)
    square = x[0] ** 2 + x[1] ** 2
    s = -2.0 / np.pi * (f[0] * x[0] + f[1] * x[1]) / square**2
    return s * x[:, None] * x[None, :]


def load_far_field(body: ElasticBody, force: ArrayLike, sides: str = "left right top") -> None:
    """Load the sides with Flamant's tractions."""
    for side in sides.split():
        n = np.array(NORMALS[side])
        body.load(side, lambda x, n=n: np.einsum("ij...,j->i...", stress(x, force), n))


def displacement(x: ArrayLike, force: float, E: float, nu: float) -> Array:
    """Displacement (2, ...) of a tangential force along x at the origin; u_y is odd in x.

    Timoshenko and Goodier, equation (70), in plane strain, up to a motion along x.
    """
    x = np.asarray(x, dtype=float)
    modulus, ratio = E / (1 - nu**2), nu / (1 - nu)
    r, theta = np.hypot(*x), np.arctan2(x[1], x[0])
    c, s, turned = np.cos(theta), np.sin(theta), theta - 0.5 * np.pi
    p = force / (np.pi * modulus)
    radial = -2 * p * c * np.log(r) - (1 - ratio) * p * turned * s
    hoop = 2 * ratio * p * s + 2 * p * s * np.log(r) - (1 - ratio) * p * (turned * c - s)
    return np.array([radial * c - hoop * s, radial * s + hoop * c])


def main(argv: list[str] | None = None) -> None:
    """Draw the stress of a normal force and the displacement of a tangential one on a mesh."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    output = parser.parse_args(argv).output
    mesh = half(0.5, 2.0, 8.0)
    figure = Figure(figsize=(12, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    x = np.array(np.meshgrid(np.linspace(-8, 8, 321), np.linspace(0.02, 8, 200)))
    drawn = left.pcolormesh(
        *x, -np.trace(stress(x, (0.0, 1.0))), norm=LogNorm(1e-2, 1), shading="gouraud"
    )
    figure.colorbar(drawn, ax=left, shrink=0.8, extend="both", label="compression, P / length")
    left.set_title("normal force P: Flamant's stress, and the cells")
    p = np.where(np.hypot(*mesh.p) > 0, mesh.p, np.nan)  # at the force nothing is bounded
    moved = p + displacement(p, 1.0, 1.0, 0.3)
    for ax, place, style, label in (
        (left, mesh.p, "w", None),
        (right, mesh.p, "0.8", "undeformed"),
        (right, moved, "C0", "deformed"),
    ):
        sides = np.pad(place[:, mesh.facets], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
        ax.plot(*sides.reshape(2, -1, order="F"), style, lw=0.6, label=label)
    right.set_title("tangential force E, nu = .3: displacements to scale 1")
    right.legend(loc="upper left", bbox_to_anchor=(1, 1))
    for ax in (left, right):
        ax.set(aspect="equal", xlabel="x, arbitrary units", ylabel="depth y, arbitrary units")
        ax.invert_yaxis()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "half_space.png", dpi=120)


if __name__ == "__main__":
    main()
