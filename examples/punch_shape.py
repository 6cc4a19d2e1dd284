"""The shape of a punch whose pressure on an elastic block is uniform under a given force.

The heights of its face are the unknowns; the misfit of the pressure has one gradient by all of
them, from one transposed substitution on the factors that all shapes share.

    python examples/punch_shape.py
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize
from skfem import ElementQuad2, MeshQuad

from contact import ContactProblem, ElasticBody, Rigid

HALF, PRESSURE = 0.5, 0.05  # half width of the punch, wanted pressure


def main(argv=None):
    """Shape the punch, print how uniform its pressure is, draw both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    output = parser.parse_args(argv).output
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 33), np.linspace(0, 1, 9)).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.3).fix("bottom", "xy")
    face = mesh.facets_satisfying(lambda x: (x[1] > 0.999) & (abs(x[0]) < HALF))
    problem = ContactProblem(body, face, 0.0)
    x, weights = problem.rows.x[0], problem.rows.weights

    def pressed(heights):
        problem.obstacle = Rigid(0.01 * heights, (0.0, None), (None, -PRESSURE * weights.sum()))
        return problem.solve()

    def misfit(heights):
        result = pressed(heights)
        off = result.pressure / PRESSURE - 1.0
        by_gap = result.vjp(pressure=weights * off / PRESSURE).gap
        return 0.5 * np.sum(weights * off**2), 0.01 * by_gap

    flat = np.zeros(x.size)
    found = minimize(misfit, flat, jac=True, method="BFGS", options={"gtol": 1e-9})
    results = {"flat": pressed(flat), "shaped": pressed(found.x)}
    spread = [float(np.ptp(r.pressure)) / PRESSURE for r in results.values()]
    print(f"pressure from least to most, over the wanted: {spread[0]:.3g}, then {spread[1]:.1e}")
    one, two = plt.figure(figsize=(8, 3.2), layout="constrained").subplots(1, 2)
    for name, result in results.items():
        one.plot(x, result.pressure, ".-", label=name)
    one.set(xlabel="x", ylabel="pressure", ylim=(0, None))
    one.legend(results)
    two.plot(x, 0.01 * (found.x - found.x.mean()), ".-")
    two.set(xlabel="x", ylabel="height of the face")
    output.mkdir(parents=True, exist_ok=True)
    plt.savefig(output / "punch_shape.png", dpi=120)
    return spread


if __name__ == "__main__":
    main()
