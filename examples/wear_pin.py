"""A round pin is worn flat on a moving plane: Archard's law in steps, pressure and profile."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from skfem import MeshQuad

from contact import ContactProblem, ElasticBody, LoadStepper

K, LOAD, CELLS = 1e-2, 4e-3, 60


def main(arguments=None):
    """Run the example, print and return the history."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"))
    (output := parser.parse_args(arguments).output).mkdir(parents=True, exist_ok=True)
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, CELLS + 1), np.linspace(0, 1, 16))
    pin = ElasticBody.from_mesh(mesh.with_defaults(), E=1.0, nu=0.3)
    pin.fix("top", "x").load("top", (0.0, -LOAD / 2))
    problem = ContactProblem(pin, "bottom", lambda x: 0.02 * x[0] ** 2, wear=K)
    plane = LoadStepper(problem).obstacle(lambda t: problem.obstacle, motion=lambda t: (t, 0.0))
    history = plane.run([1.0, 3.0, 10.0, 30.0, 60.0, 100.0])
    print(f"{history.results[-1].worn_volume[0]:.9f} worn, k F s {K * LOAD * 100:.9f}")
    upper, lower = plt.figure(figsize=(7, 6), layout="constrained").subplots(2, 1, sharex=True)
    for t, result in zip(history.times, history.results, strict=True):
        x = result.x_nominal[0]
        upper.plot(x, result.pressure, label=f"slid by {t:g}")
        lower.plot(x, problem.rows.gap + result.worn[0])
    upper.legend()
    upper.set(ylabel="pressure / E")
    lower.set(xlabel="x", ylabel="profile of the pin")
    plt.savefig(output / "wear_pin.png", dpi=120)
    return history


if __name__ == "__main__":
    main()
