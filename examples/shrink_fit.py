"""Shrink fit: a ring shrunk onto another, their meshes not matching, beside Lame's closed form.

The outer ring is too small by the interference d. With E and nu of both and the plane strain
modulus E' = E / (1 - nu^2), the pressure between them is

    p = E' d / b * (b^2 - a^2) (c^2 - b^2) / (2 b^2 (c^2 - a^2)),

where a < b < c are the radii (G. Lame and B. P. E. Clapeyron 1833; S. P. Timoshenko and J. N.
Goodier, Theory of Elasticity, 3rd ed., McGraw-Hill 1970, section 28). Straight facets lie beside
the circle by more than an interference may be, so it is given as a clearance.

    python examples/shrink_fit.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from skfem import ElementQuad1, ElementQuad2, MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody
from skfem_adini import ElementQuadAdini

E, NU = 200.0, 0.3
INNER, MIDDLE, OUTER, INTERFERENCE = 1.0, 1.5, 2.2, 1e-3
ELEMENTS = {"Q1": ElementQuad1, "Q2": ElementQuad2, "Adini": ElementQuadAdini}


def exact() -> float:
    """Lame's pressure."""
    a, b, c = INNER**2, MIDDLE**2, OUTER**2
    stiffness = E / (1 - NU**2) * INTERFERENCE / MIDDLE
    return stiffness * (b - a) * (c - b) / (2 * b * (c - a))


def ring(element: type, low: float, high: float, facets: int) -> ElasticBody:
    """A quarter of a ring of square cells."""
    layers = max(2, round(facets * 2 * (high - low) / (np.pi * low)))
    mesh = MeshQuad.init_tensor(
        np.linspace(low, high, layers + 1), np.linspace(0, np.pi / 2, facets + 1)
    ).with_boundaries(
        {
            "inside": lambda x: x[0] < low * (1 + 1e-9),
            "outside": lambda x: x[0] > high * (1 - 1e-9),
            "below": lambda x: x[1] < 1e-9,
            "aside": lambda x: x[1] > np.pi / 2 - 1e-9,
        }
    )
    names, (r, angle) = dict(mesh.boundaries), mesh.p
    p = np.array([r * np.cos(angle), r * np.sin(angle)])
    mesh = MeshQuad(p, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=NU).fix("below", "y").fix("aside", "x")


def fitted(element: type, facets: int) -> tuple[ContactResult, ElasticBody, ElasticBody]:
    """The two rings; the outer one has facets a third longer, and carries no multipliers."""
    shaft = ring(element, INNER, MIDDLE, facets).named("shaft")
    hub = ring(element, MIDDLE, OUTER, 11 * facets // 8).named("hub")
    surface = hub.surface("inside", clearance=-INTERFERENCE)
    return ContactProblem(shaft, "outside", surface).solve(), shaft, hub


def error(result: ContactResult) -> float:
    """Root mean square of the error of the pressure, relative."""
    w = result.system.rows.weights
    return float(np.sqrt(w @ (result.pressure / exact() - 1) ** 2 / w.sum()))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Print errors and orders, draw the pressure and the stresses over the radius."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--facets", type=int, nargs="+", default=[8, 16, 32])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    errors, orders, results = {}, {}, {}
    print("rms error of the pressure by facets in a quarter, and its order")
    for name, element in ELEMENTS.items():
        found = [fitted(element, n) for n in options.facets]
        errors[name] = [error(result) for result, *_ in found]
        results[name] = found[-1]
        orders[name] = -np.polyfit(np.log(options.facets), np.log(errors[name]), 1)[0]
        print(
            f"{name:>6}  " + "  ".join(f"{e:.1e}" for e in errors[name]) + f"   {orders[name]:.1f}"
        )
    print(f"\n{results['Adini'][0].certificate()}")
    picture(results, options.output)
    return SimpleNamespace(errors=errors, orders=orders, results=results)


def picture(results: dict, output: Path) -> None:
    """Pressure over the angle, stresses along a ray in both rings."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (name, (result, *_)), marker in zip(results.items(), "sdo", strict=True):
        angle = np.degrees(np.arctan2(result.x[1], result.x[0]))
        left.plot(angle, result.pressure / exact() - 1, marker + "-", ms=3, lw=0.8, label=name)
    left.axhline(0.0, color="k", lw=0.8)
    left.set(xlabel="angle, degrees", ylabel="pressure / Lame's - 1", title="pressure")
    left.legend()
    result, shaft, hub = results["Adini"]
    p, a, b, c = exact(), INNER, MIDDLE, OUTER
    for body, low, high in ((shaft, a, b), (hub, b, c)):
        r = np.linspace(low * 1.002, high * 0.998, 60)
        ray = np.array([np.cos(0.6), np.sin(0.6)])
        sigma = result[body].stress(ray[:, None] * r)
        radial = np.einsum("i,ijn,j->n", ray, sigma, ray)
        hoop = np.trace(sigma) - radial
        factor = -p * b**2 / (b**2 - a**2) if body is shaft else p * b**2 / (c**2 - b**2)
        other = a if body is shaft else c
        for sign, values, colour, name in (
            (-1, radial, "#1f6f8b", "radial"),
            (1, hoop, "#d1495b", "hoop"),
        ):
            label = name if body is shaft else None
            right.plot(r, factor * (1 + sign * other**2 / r**2), color=colour, lw=3, alpha=0.4)
            right.plot(r, values, color=colour, lw=1, label=label)
    right.set(xlabel="radius", ylabel="stress", title="Adini (thin) over Lame (thick)")
    right.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "shrink_fit.png", dpi=120)


if __name__ == "__main__":
    main()
