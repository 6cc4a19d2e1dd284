"""Friction and Young's modulus from the noisy force curve of a block that is pressed and dragged.

The misfit of both forces over the noise is minimised; one backward pass through the history, with
friction's memory, gives its gradient by both unknowns.

    python examples/identify_friction.py
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize
from skfem import MeshQuad

from contact import ContactProblem, ElasticBody, LoadStepper

# Modulus and friction, true and guessed.
TIMES, NOISE, TRUTH, FIRST = np.linspace(0.1, 1.0, 10), 5e-4, (2.0, 0.35), (1.0, 0.2)


def history(E, friction):
    """Pressed, then dragged to and fro."""
    body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=E, nu=0.3)
    problem = ContactProblem(body.fix("top", "xy"), "bottom", 0.0, friction)
    stepper = LoadStepper(problem).move("top", "y", -0.02, lambda t: min(1.0, 4 * t))
    stepper.move("top", "x", 0.05, lambda t: np.sin(5 * t))
    return problem, stepper.run(TIMES)


def main(argv=None):
    """Identify both, print them, draw the curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    output = parser.parse_args(argv).output
    data = np.random.default_rng(1).normal(history(*TRUTH)[1].resultant, NOISE)

    def misfit(logarithms):
        # The problem has the factors, which serve the gradient too.
        _problem, run = history(*np.exp(logarithms))
        off = (run.resultant - data) / NOISE
        gradient = run.vjp(resultant=off / NOISE)
        return 0.5 * np.sum(off**2), np.exp(logarithms) * [gradient.E, gradient.friction.sum()]

    found = minimize(misfit, np.log(FIRST), jac=True, method="L-BFGS-B")
    E, friction = np.exp(found.x)
    print(f"E = {E:.4f}, friction = {friction:.4f} after {found.nfev} histories")
    curves = {"first guess": history(*FIRST)[1], "identified": history(E, friction)[1]}
    axes = plt.figure(figsize=(8, 3.2), layout="constrained").subplots(1, 2)
    for c, (ax, name) in enumerate(zip(axes, ("tangential", "normal"), strict=True)):
        ax.plot(TIMES, data[:, c], "k.", label="measured")
        for label, run in curves.items():
            ax.plot(TIMES, run.resultant[:, c], label=label)
        ax.set(xlabel="time", ylabel=f"{name} force")
        ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    plt.savefig(output / "identify_friction.png", dpi=120)
    return E, friction


if __name__ == "__main__":
    main()
