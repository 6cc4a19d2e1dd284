"""A wheel, pressed on a block by a force, rolls freely and is braked until it nearly slides."""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from skfem import MeshQuad

from contact import ContactProblem, Cylinder, ElasticBody, LoadStepper, Rigid
from contact.plot import plot_cells

R, P, F, AXLE = 1.0, 0.02, 0.3, (0.6, 1.0)


def wheel(t):
    """Its axle is led along, the force P presses it, and a moment brakes it from t = .55 on."""
    way, brake, force = 1.8 * max(t - 0.1, 0), 1.9 * max(t - 0.55, 0), (None, -P * min(10 * t, 1))
    return Rigid(Cylinder(AXLE, R), (way, None), force, moment=brake * F * P * R, centre=AXLE)


def main(arguments=None):
    """Roll, compare friction and moment, draw."""
    (parser := argparse.ArgumentParser()).add_argument("--output", type=Path, default=Path("out"))
    (output := parser.parse_args(arguments).output).mkdir(parents=True, exist_ok=True)
    mesh = MeshQuad.init_tensor(np.linspace(0, 3, 61), np.linspace(-0.6, 0, 13)).with_defaults()
    block = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("bottom", "xy")
    stepper = LoadStepper(ContactProblem(block, "top", wheel(0), friction=F), sliding="finite")
    history = stepper.obstacle(wheel).run(np.linspace(0.05, 1.0, 20))
    x, turned, rub = np.array([[r.motion[0], -r.motion[2], r.t.sum() / F / P] for r in history]).T
    assert np.allclose(rub, 1.9 * np.maximum(history.times - 0.55, 0), atol=1e-9)  # M / R
    above, below = (figure := Figure(figsize=(9, 5.5), layout="constrained")).subplots(2)
    plot_cells(history[-1], above, label="von Mises stress / E")
    below.plot(x, rub, ".-", x[2:], R * np.diff(turned)[1:] / np.diff(x)[1:], ".-")
    below.set(xlabel="way of the axle", ylabel="blue: brake / (F P), orange: turn / way")
    figure.savefig(output / "rolling.png", dpi=120)


if __name__ == "__main__":
    main()
