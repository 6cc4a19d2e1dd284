"""A press fit that yields: a shaft warmed inside a hub until this flows, and cooled again.

The hub is a tube that is plastic up to the radius c. In plane strain, incompressible and with the
yield stress k in shear, the pressure on its bore and the displacement there are

    p = k (2 ln(c/a) + 1 - c^2/b^2),    u = k c^2 / (2 G a)

(R. Hill, The Mathematical Theory of Plasticity, Oxford 1950, chapter V). Cooling is elastic: the
pressure falls along the line of an elastic tube, and what is left is that of the fit.

    python examples/press_fit.py
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure
from skfem import ElementQuad1, MeshQuad

from contact import ContactProblem, NonlinearBody, NonlinearStepper, Pair, Plasticity, SaintVenant

A, B, G, K, STEEL = 1.0, 2.0, 1000.0 / 2.9998, 3**-0.5, SaintVenant(E=3000.0, nu=0.3)
HUB = Plasticity(E=1000.0, nu=0.4999, yield_stress=1.0)
SOFT = 1.3 * 0.4 / 3000.0  # displacement of the shaft's surface under pressure 1


def warm(F, state, dt):
    """The stress of the shaft, which grows until the time 1 and shrinks again."""
    now = state["time"] + dt
    return STEEL(F / (1 + EXPANSION * np.minimum(now, 2.0 - now))), {"time": now}


def closed_form(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interference and pressure of a hub that is plastic up to c."""
    p = K * (2 * np.log(c / A) + 1 - (c / B) ** 2)
    return K * c**2 / (2 * G * A) + SOFT * p, p


EXPANSION = closed_form(1.6)[0] / 1.3  # in plane strain a shaft grows 1 + nu times as much


def ring(inner: float, outer: float, n: int, stress, state=None) -> NonlinearBody:
    """A disk of a tube in plane strain."""
    mesh = MeshQuad.init_tensor(np.linspace(inner, outer, n + 1), [0.0, 1.0 / n]).with_defaults()
    kind = {"plane": "axisymmetric", "dilatation": "mean", "state": state}
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=stress, **kind)
    return body.fix(["bottom", "top"], "y")


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Warm and cool the shaft, print pressures, draw them and the hoop stress of the hub."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=12, help="along the wall of the hub")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    shaft = ring(0.0, A, options.cells, warm, {"time": 0.0}).fix("left", "x")
    hub = ring(A, B, options.cells, HUB)
    problem = ContactProblem([shaft, hub], [Pair(shaft, "right", hub, "left")])
    history = NonlinearStepper(problem).run([0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4])
    pressure = np.array([result.pressure.mean() for result in history])
    way = 1.3 * EXPANSION * np.minimum(history.times, 2.0 - history.times)
    (most, peak), slope = closed_form(1.6), 1 / (1 / (2 * G * (1 - (A / B) ** 2)) + SOFT)
    left = peak - slope * (most - way[-1])
    print(f"hot: {pressure[4]:.4f} (exact {peak:.4f}), left: {pressure[-1]:.4f} ({left:.4f})")
    curve, wall = Figure(figsize=(9, 3.6), layout="constrained").subplots(1, 2)
    path = np.column_stack(([0.0, 0.0], closed_form(np.linspace(A, 1.6, 50)), [way[-1], left]))
    curve.plot(*path, "k", lw=0.8, label="closed form")
    curve.plot(way, pressure, "o", label="computed")
    curve.set(xlabel="interference / radius", ylabel="pressure / yield stress")
    for result, name in ((history[4], "hot"), (history[-1], "cooled")):
        hoop = result[hub].cell_stress()[2, 2]
        wall.plot(hub.mesh.p[0][hub.mesh.t].mean(axis=0), hoop, label=name)
    wall.set(xlabel="radius / bore", ylabel="hoop stress in the hub / yield stress")
    curve.legend(), wall.legend()
    options.output.mkdir(parents=True, exist_ok=True)
    curve.figure.savefig(options.output / "press_fit.png", dpi=120)
    return SimpleNamespace(pressure=pressure, peak=peak, left=left, way=way, history=history)


if __name__ == "__main__":
    main()
