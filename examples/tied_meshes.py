"""Tied meshes: two bodies whose meshes do not match, bonded, at the full order of their elements.

The displacement (sin ax cos(by + c), cos ax sin(by + c)) with the body force that belongs to it is
solved for on two rectangles with cells in the ratio 3:4, tied along y = 0. All other sides are
held, or the two sides that the interface ends at are free and loaded by the exact traction.
Standard multipliers keep the order of the elements: 2, 3 and 4 in the mean of the displacement, one
less in that of its gradient (C. Bernardi, Y. Maday and A. T. Patera, The mortar element method,
1994).

    python examples/tied_meshes.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from skfem import ElementQuad1, ElementQuad2, MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody, Tie
from skfem_adini import ElementQuadAdini

E, NU, A, B, C = 1.0, 0.3, 2.0, 1.3, 0.6
LAM, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
ELEMENTS = {"Q1": ElementQuad1, "Q2": ElementQuad2, "Adini": ElementQuadAdini}
LIMITS = {"Q1": (1.9, 0.95), "Q2": (2.9, 1.9), "Adini": (3.85, 2.9)}


def displacement(x: np.ndarray) -> np.ndarray:
    """The exact solution."""
    along, up = A * x[0], B * x[1] + C
    return np.array([np.sin(along) * np.cos(up), np.cos(along) * np.sin(up)])


def gradient(x: np.ndarray) -> np.ndarray:
    """Its gradient d u_i / d x_j."""
    along, up = A * x[0], B * x[1] + C
    s, c, t, d = np.sin(along), np.cos(along), np.sin(up), np.cos(up)
    return np.array([[A * c * d, -B * s * t], [-A * s * t, B * c * d]])


def force(x: np.ndarray) -> np.ndarray:
    """The body force in balance with its stress."""
    both = MU * (A**2 + B**2)
    factor = np.array([(LAM + MU) * A * (A + B) + both, (LAM + MU) * B * (A + B) + both])
    return factor.reshape(2, *(1,) * (x.ndim - 1)) * displacement(x)


def traction(x: np.ndarray, sign: float) -> np.ndarray:
    """Traction on a side with the normal (sign, 0)."""
    g = gradient(x)
    return sign * np.array([LAM * (g[0, 0] + g[1, 1]) + 2 * MU * g[0, 0], MU * (g[0, 1] + g[1, 0])])


def block(element: type, cells: int, low: float, held: str, free: bool) -> ElasticBody:
    """A square, its far side held and its sides held or loaded."""
    ticks = np.linspace(0, 1, cells + 1)
    mesh = MeshQuad.init_tensor(ticks, low + ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU).body_force(force)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        if free:
            body.load(side, lambda x, sign=sign: traction(x, sign))
        else:
            held = [held, side] if isinstance(held, str) else [*held, side]
    for c in range(2):
        for side in [held] if isinstance(held, str) else held:
            body.fix(side, c, lambda x, c=c: displacement(x)[c])
    return body


def tied(element: type, cells: int, free: bool) -> tuple[ContactResult, list[ElasticBody]]:
    """Three cells above against four below, times `cells`."""
    upper = block(element, 3 * cells, 0.0, "top", free).named("upper")
    lower = block(element, 4 * cells, -1.0, "bottom", free).named("lower")
    return ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve(), [
        upper,
        lower,
    ]


def errors(result: ContactResult, bodies: list[ElasticBody]) -> tuple[float, float]:
    """Errors of the displacement and of its gradient, root mean squares."""
    sums = np.zeros(2)
    for body in bodies:
        field, x = body.basis.interpolate(result[body].u), body.basis.global_coordinates()
        at = np.asarray(x)
        off = np.asarray(field) - displacement(at), np.asarray(field.grad) - gradient(at)
        sums += [
            float(np.sum(np.sum(part**2, axis=tuple(range(part.ndim - 2))) * body.basis.dx))
            for part in off
        ]
    return tuple(np.sqrt(sums))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print the orders with free and held ends, draw the errors and the stress across the tie."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[2, 4, 8])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    found, orders = {}, {}
    for name, element in ELEMENTS.items():
        for free in (True, False):
            runs = [tied(element, n, free) for n in options.cells]
            table = np.array([errors(*run) for run in runs])
            rates = -np.polyfit(np.log(options.cells), np.log(table), 1)[0]
            found[name, free], orders[name, free] = table, rates
            ends = "free" if free else "held"
            print(f"{name:>6}, {ends} ends: orders {rates[0]:.2f} and {rates[1]:.2f}")
    coarse = tied(ElementQuadAdini, 1, True)
    print(f"\n{coarse[0].certificate()}")
    picture(options.cells, found, coarse, options.output)
    return SimpleNamespace(errors=found, orders=orders)


def picture(cells: list[int], found: dict, coarse: tuple, output: Path) -> None:
    """Errors over the mesh size; the shear stress of the coarsest meshes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    h = 1 / np.array(cells)
    for (name, free), table in found.items():
        colour = {"Q1": "#1f6f8b", "Q2": "#d1495b", "Adini": "#3a7d44"}[name]
        label = name if free else None
        left.loglog(h, table[:, 0], "o-" if free else "s--", color=colour, label=label, ms=4)
        left.loglog(h, table[:, 1], "o-" if free else "s--", color=colour, ms=4, alpha=0.4)
    left.set(xlabel="mesh size", ylabel="error of u (dark) and of its gradient (light)")
    left.set_title("free ends: circles; held ends: squares")
    left.legend()
    result, bodies = coarse
    fields = []
    for body in bodies:
        low = float(body.mesh.p[1].min())
        x, y = np.meshgrid(np.linspace(0, 1, 81), low + np.linspace(0, 1, 81))
        inside = np.array([np.clip(x, 1e-6, 1 - 1e-6), np.clip(y, low + 1e-6, low + 1 - 1e-6)])
        sigma = result[body].stress(inside.reshape(2, -1))[0, 1].reshape(x.shape)
        fields.append((x, y, sigma, body.mesh))
    top = max(np.abs(sigma).max() for _, _, sigma, _ in fields)
    for x, y, sigma, mesh in fields:
        drawn = right.contourf(x, y, sigma, np.linspace(-top, top, 17), cmap="RdBu_r")
        for facet in mesh.facets.T:
            right.plot(*mesh.p[:, facet], color="k", lw=0.5)
    figure.colorbar(drawn, ax=right, label="shear stress", shrink=0.9)
    right.set(aspect="equal", xlabel="x", ylabel="y", title="3 against 4 Adini cells")
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "tied_meshes.png", dpi=120)


if __name__ == "__main__":
    main()
