"""A buffer of rubber: a nearly incompressible cylinder between plates, with and without grease.

Between greased plates it stays a cylinder, and the force has a closed form; friction lets it bulge
and makes it stiffer. The material is neo-Hooke with a bulk modulus a thousand times the shear
modulus; the mean dilatation of each cell keeps it from locking.

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

LAW, FLOOR = NeoHooke(mu=1.0, lam=1000.0), Plane((0.0, 0.0), (0.0, 1.0))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press by 30 %, print forces, draw the bulging buffer and both curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=8, help="along the radius")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    figure = Figure(figsize=(9, 4), layout="constrained")
    (shape, curve), histories, n = figure.subplots(1, 2), {}, options.cells
    for friction, held in ((0.0, "y"), (0.4, "xy")):
        mesh = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
        kind = {"stress": LAW, "plane": "axisymmetric", "dilatation": "mean"}
        body = NonlinearBody.from_mesh(mesh.with_defaults(), ElementQuad1(), **kind)
        body.fix("top", held)
        stepper = NonlinearStepper(ContactProblem(body, ["bottom", "right"], FLOOR, friction))
        histories[friction] = stepper.move("top", "y", -0.3).run(np.linspace(0.1, 1.0, 10))
        force = -histories[friction].curve("top")[:, 1]
        curve.plot(0.3 * histories[friction].times, force, "o-", label=f"friction {friction}")
    wide = brentq(lambda w: w**2 - 1 + LAW.lam * np.log(0.7 * w * w), 0.9, 1.4, xtol=1e-15)
    exact = -np.pi * ((0.7 - 1 / 0.7) + LAW.lam * np.log(0.7 * wide**2) / 0.7)
    forces = {friction: -h.curve("top")[-1, 1] for friction, h in histories.items()}
    print({f"friction {key}": round(float(value), 4) for key, value in forces.items()}, exact)
    histories[0.4].results[-1].plot(shape).set(xlabel="radius", ylabel="height")
    curve.axhline(exact, color="k", lw=0.8, label="closed form, greased")
    curve.set(xlabel="compression", ylabel="force")
    curve.legend()
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "rubber.png", dpi=120)
    return SimpleNamespace(forces=forces, exact=exact, histories=histories)


if __name__ == "__main__":
    main()
