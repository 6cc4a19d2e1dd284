"""Brinell's test: a hard ball is pressed into metal, and its force over the area is the hardness.

Metal that does not harden carries about three times its yield stress Y once it flows all around the
ball (D. Tabor, The Hardness of Metals, Oxford 1951), and a little less without friction. The body
is axisymmetric, of large strain, with the mean dilatation of each cell; the ball is rigid and rubs.

    python examples/hardness.py
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from skfem import ElementQuad1, MeshQuad

from contact import ContactProblem, FinitePlasticity, NonlinearBody, NonlinearStepper, Sphere

METAL = FinitePlasticity(E=1000.0, nu=0.3, yield_stress=1.0)  # the ball has the radius 1
DEPTHS = 0.006 * np.linspace(0.125, 1.0, 8)


def radius(result) -> float:
    """Radius of the impression: the line through the next two gaps ends there."""
    order = np.argsort(result.x[0])
    (r, gap), k = (v[order] for v in (result.x[0], result.gap)), np.sum(result.mu > 0)
    edge = r[k] - gap[k] * (r[k + 1] - r[k]) / (gap[k + 1] - gap[k])
    return float(np.clip(edge, r[k - 1], r[k]))


def pressed(cells: int, friction: float):
    """The steps of a ball that sinks into a cylinder, whose cells grow away from it."""
    size = 0.14 / cells
    x = np.r_[np.linspace(0.0, 0.14, cells + 1), 0.14 + np.cumsum(size * 1.4 ** np.arange(1, 13))]
    y = -np.r_[0.0, np.cumsum(size * 1.15 ** np.arange(24))]
    mesh = MeshQuad.init_tensor(x, y[::-1]).with_defaults()
    kind = {"stress": METAL, "plane": "axisymmetric", "dilatation": "mean"}
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), **kind).fix("left", "x").fix("bottom")
    stepper = NonlinearStepper(ContactProblem(body, "top", Sphere((0.0, 1.0), 1.0), friction))
    return stepper.obstacle(lambda depth: Sphere((0.0, 1.0 - depth), 1.0)).run(DEPTHS)


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press the ball in, print hardness over yield stress, draw it and the plastic strain."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=18, help="along the largest impression")
    parser.add_argument("--friction", type=float, default=0.2)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    history = pressed(options.cells, options.friction)
    a = np.array([radius(result) for result in history])
    hardness = -history.resultant[:, 1] / (np.pi * a**2)
    print("hardness over yield stress:", np.round(hardness, 2), "at a / R", np.round(a, 3))
    section, curve = Figure(figsize=(10, 3.8), layout="constrained").subplots(1, 2)
    history[-1].plot(section, colour="alpha").set(xlim=(0, 0.3), ylim=(-0.25, 0.05))
    section.add_patch(Circle((0.0, 1.0 - DEPTHS[-1]), 1.0, fc="0.85", ec="k"))
    section.set(xlabel="r / R", ylabel="z / R", title="equivalent plastic strain alpha")
    curve.axhspan(2.8, 3.1, color="0.9", label="Tabor")
    curve.plot(a, hardness, "o-", label=f"friction {options.friction}")
    curve.set(xlabel="radius of the impression a / R", ylim=(0, 3.5))
    curve.set_ylabel(r"hardness, force / $\pi a^2 Y$")
    curve.legend(loc="lower right")
    options.output.mkdir(parents=True, exist_ok=True)
    curve.figure.savefig(options.output / "hardness.png", dpi=120)
    return SimpleNamespace(hardness=hardness, a=a, history=history)


if __name__ == "__main__":
    main()
