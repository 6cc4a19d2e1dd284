"""A buffer of rubber: a nearly incompressible cylinder between plates, with and without grease.

Between greased plates it stays a cylinder, and the force has a closed form; friction lets it bulge
and makes it stiffer. The material is neo-Hooke with a bulk modulus a thousand times the shear
modulus mu; the mean dilatation of each cell keeps it from locking. The lower half is computed.

    python examples/rubber.py
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from skfem import ElementQuad1, MeshQuad

from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane
from contact.plot import plot_tractions

LAW, FLOOR, DEPTHS = NeoHooke(1.0, 1000.0), Plane((0.0, 0.0), (0.0, 1.0)), np.linspace(0.0, 0.3, 11)


def pressed(friction: float, cells: int):
    """A cylinder of radius and half height one, whose middle plane comes down."""
    mesh = MeshQuad.init_tensor(*[np.linspace(0.0, 1.0, cells + 1)] * 2).with_defaults()
    kind = {"stress": LAW, "plane": "axisymmetric", "dilatation": "mean"}
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), **kind).fix("top", "y")
    problem = ContactProblem(body, ["bottom", "right"], FLOOR, friction)
    return NonlinearStepper(problem).move("top", "y", -1.0).run(DEPTHS[1:])


def closed_form(height: float) -> float:
    """Force on a cylinder that widens until its side carries no stress."""
    wide = brentq(lambda w: w**2 - 1 + LAW.lam * np.log(height * w * w), 0.9, 1.4, xtol=1e-15)
    return -np.pi * (height - 1 / height + LAW.lam * np.log(height * wide**2) / height)


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press by 30 %, print forces, draw the bulging buffer, its tractions and both curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=12, help="along the radius")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    (shape, pressure, curve), histories = figure.subplots(1, 3), {}
    for friction, name in ((0.0, "greased"), (0.4, "friction .4")):
        histories[friction] = pressed(friction, options.cells)
        curve.plot(DEPTHS[1:], -histories[friction].curve("top")[:, 1], "o", label=name)
    exact = np.array([closed_form(1.0 - depth) for depth in DEPTHS])
    curve.plot(DEPTHS, exact, "k", lw=0.8, label="closed form, greased")
    curve.set(xlabel="compression over height", ylabel=r"force / $\mu$ radius$^2$")
    curve.legend(fontsize=8)
    last = histories[0.4][-1]
    last.plot(shape, "von_mises").set(xlabel="r / radius", ylabel="z / radius", title="friction .4")
    plot_tractions(last, pressure, last.x[0], "r / radius").set(ylabel=r"contact traction / $\mu$")
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "rubber.png", dpi=120)
    forces = {friction: -history.curve("top")[-1, 1] for friction, history in histories.items()}
    print(f"greased {forces[0.0]:.4f} (exact {exact[-1]:.4f}), with friction {forces[0.4]:.4f}")
    return SimpleNamespace(forces=forces, exact=exact[-1], histories=histories)


if __name__ == "__main__":
    main()
