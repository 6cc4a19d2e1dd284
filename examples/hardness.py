"""Brinell's test: a hard ball is pressed into metal, and its force over the area is the hardness.

Metal that does not harden carries about three times its yield stress once it flows all around the
ball (D. Tabor, The Hardness of Metals, Oxford 1951). The body is axisymmetric, of large strain,
with the mean dilatation of each cell; the ball is rigid and rubs.

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

BALL, METAL, FRICTION = 1.0, FinitePlasticity(E=1000.0, nu=0.3, yield_stress=1.0), 0.2


def radius(result) -> float:
    """Radius of the impression: the line through the next two gaps ends there."""
    order = np.argsort(result.x[0])
    (r, gap), k = (v[order] for v in (result.x[0], result.gap)), np.sum(result.mu > 0)
    edge = r[k] - gap[k] * (r[k + 1] - r[k]) / (gap[k + 1] - gap[k])
    return float(np.clip(edge, r[k - 1], r[k]))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press the ball in, print hardness over yield stress, draw it and the plastic strain."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=18, help="along the largest impression")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    near, size = np.linspace(0.0, 0.14, options.cells + 1), 0.14 / options.cells
    x = np.r_[near, 0.14 + np.cumsum(size * 1.4 ** np.arange(1, 13))]
    y = -np.r_[0.0, np.cumsum(size * 1.15 ** np.arange(24))]
    mesh = MeshQuad.init_tensor(x, y[::-1]).with_defaults()
    kind = {"stress": METAL, "plane": "axisymmetric", "dilatation": "mean"}
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), **kind).fix("left", "x").fix("bottom")
    stepper = NonlinearStepper(ContactProblem(body, "top", Sphere((0.0, BALL), BALL), FRICTION))
    stepper.obstacle(lambda depth: Sphere((0.0, BALL - depth), BALL))
    history = stepper.run(0.006 * np.linspace(0.125, 1.0, 8))
    a = np.array([radius(result) for result in history])
    hardness = -history.resultant[:, 1] / (np.pi * a**2)
    print("hardness over yield stress:", np.round(hardness, 2), "at a / R", np.round(a / BALL, 3))
    section, curve = Figure(figsize=(9, 3.6), layout="constrained").subplots(1, 2)
    history[-1].plot(section, colour="alpha").set(xlim=(0, 0.3), ylim=(-0.28, 0.05))
    section.add_patch(Circle((0.0, BALL - 0.006), BALL, fc="0.85", ec="k"))
    section.set_title("plastic strain below the ball")
    curve.axhspan(2.8, 3.1, color="0.9")
    curve.plot(a / BALL, hardness, "o-")
    curve.set(xlabel="radius of the impression over that of the ball", ylim=(0, 3.5))
    curve.set_title("force over area and yield stress")
    options.output.mkdir(parents=True, exist_ok=True)
    curve.figure.savefig(options.output / "hardness.png", dpi=120)
    return SimpleNamespace(hardness=hardness, a=a, history=history)


if __name__ == "__main__":
    main()
