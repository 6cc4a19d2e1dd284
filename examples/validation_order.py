"""How fast contact solutions converge: order 3/2, whatever the degree of the element.

Where contact ends in the middle of a boundary, the solution has a term r^(3/2) there (the pressure
goes to zero like a square root), so it lies in H^(5/2 - eps) and no uniform refinement gives more
than order 3/2 in H1 and 3 in energy (F. Ben Belgacem and Y. Renard, Math. Comp. 72 (2003); G.
Drouet and P. Hild, SIAM J. Numer. Anal. 53 (2015)). Without contact, or with all of the boundary in
contact, Adini's cubics give order 3.

A block between smooth walls, pressed by its top on the periodic hill d = .05 (1 - cos 2 pi x): by
reflection everything but the ends of contact is smooth. H1 is measured by the L2 norm of the
stress against a fine solution. Where in a cell contact ends changes the error by a factor of
two, so that fits over few meshes scatter between 1.5 and 2.

Isolated, it is 3/2: Hertz' line contact with its end on a vertex of a uniform mesh, the stress
compared with the closed form (McEwen's, see `validation_far_field.py`) in the square of 1.2 a at
the origin (1.56), and within .2 a of that end (1.48); farther than a / 2 from it the order is 2.1.

    python examples/validation_order.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import validation_far_field
import validation_hertz_line
from skfem import MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody, Parabola
from skfem_adini import ElementQuadAdini


def hill(x: np.ndarray) -> np.ndarray:
    """Gap over the block's lower side."""
    return 0.05 * (1 - np.cos(2 * np.pi * x[0]))


def solve(n: int, press: float) -> ContactResult:
    """N x n cells, the top pressed down smoothly."""
    ticks = np.linspace(0, 1, n + 1)
    mesh = MeshQuad.init_tensor(ticks, ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=1.0, nu=0.3)
    body.fix(["left", "right"], "x").fix("top", "y", -press)
    return ContactProblem(body, "bottom", hill).solve()


def distances(cells: list[int], fine: int, press: float) -> tuple[np.ndarray, np.ndarray]:
    """Relative L2 norms of the stress errors, and errors of the energy."""
    reference = solve(fine, press)
    s = (np.arange(fine) + 0.5) / fine
    points = np.array(np.meshgrid(s, s)).reshape(2, -1)
    exact, energy = reference.stress(points), reference.system.energy(reference.u)
    stress, energies = [], []
    for n in cells:
        result = solve(n, press)
        stress.append(np.linalg.norm(result.stress(points) - exact) / np.linalg.norm(exact))
        energies.append(abs(result.system.energy(result.u) - energy))
    return np.array(stress), np.array(energies)


def hertz(cells: list[int], R: float = 20.0) -> dict[str, np.ndarray]:
    """L2 errors of the stress with a / h cells under half the contact, whose end is a vertex."""
    force = np.pi / (1 - 0.3**2) / (4 * R)
    s = (np.arange(96) + 0.5) / 80  # middles of equal parts of a cell, if a / h divides 80
    x = np.array(np.meshgrid(s, s)).reshape(2, -1)
    exact = validation_far_field.hertz(x, 2 * force / np.pi)
    distance = np.hypot(x[0] - 1, x[1])
    parts = {"all": distance >= 0, "end": distance < 0.2, "away": distance > 0.5}
    errors: dict[str, list[float]] = {name: [] for name in parts}
    for n in cells:
        obstacle = Parabola((0.0, 0.0), R)
        result = validation_hertz_line.pressed(1.0, n, force, obstacle, 1.0, "bernstein")
        off = result.stress(x) - exact
        for name, part in parts.items():
            errors[name].append(np.linalg.norm(off[..., part]) / np.linalg.norm(exact))
    return {name: np.array(values) for name, values in errors.items()}


def order(cells: list[int], errors: np.ndarray) -> float:
    """Slope of the fit over all meshes."""
    return float(-np.polyfit(np.log(cells), np.log(errors), 1)[0])


def main(argv: list[str] | None = None) -> dict[str, float]:
    """Print and draw errors and orders with part and with all of the boundary in contact."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 12, 18, 27])
    parser.add_argument("--fine", type=int, default=72)
    parser.add_argument("--hertz", type=int, nargs="*", default=[5, 10, 20])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    found, hilly = {}, {}
    for name, press in (("part", 0.1), ("all", 0.6)):
        stress, energies = distances(options.cells, options.fine, press)
        hilly[name] = stress
        found[name] = order(options.cells, stress)
        found[f"{name}, energy"] = order(options.cells, energies)
        print(f"{name} of the boundary in contact: order {found[name]:.2f} in H1")
        print("   ", " ".join(f"{n}: {e:.1e}" for n, e in zip(options.cells, stress, strict=True)))
    isolated = hertz(options.hertz) if options.hertz else {}
    for name, errors in isolated.items():
        found[f"hertz, {name}"] = order(options.hertz, errors)
        print(f"Hertz, {name}: order {found[f'hertz, {name}']:.2f} in H1")
        print("   ", " ".join(f"{n}: {e:.1e}" for n, e in zip(options.hertz, errors, strict=True)))
    picture((options.cells, hilly), (options.hertz, isolated), options.output)
    return found


def picture(hilly: tuple, isolated: tuple, output: Path) -> None:
    """Draw the errors of the stress on the hill and below Hertz' contact."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    panels = [(hilly, {"part": 1.5, "all": 3.0}, "hill, against a fine solution", "cells a side")]
    if isolated[1]:
        panels += [(isolated, {"end": 1.5}, "Hertz, against the closed form", "a / h")]
    all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, ((cells, errors), slopes, title, xlabel) in zip(all_axes, panels, strict=True):
        for name, values in errors.items():
            ax.loglog(cells, values, "o-", label=f"{name}: order {order(cells, values):.2f}")
        for (name, slope), style in zip(slopes.items(), ("k--", "k:"), strict=False):
            line = 0.7 * errors[name][0] * (np.array(cells) / cells[0]) ** -slope
            ax.loglog(cells, line, style, lw=1, label=f"order {slope:g}")
        ax.set(title=title, xlabel=xlabel, ylabel="relative L2 error of the stress")
        ax.set_xticks(cells, [str(n) for n in cells])
        ax.minorticks_off()
        ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_order.png", dpi=120)


if __name__ == "__main__":
    main()
