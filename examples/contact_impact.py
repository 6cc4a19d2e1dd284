"""A soft disc is thrown askew at a rough floor: it leaves with spin, and waves ring on in it.

The midpoint rule with massless contact nodes: the ledger of energy closes in every step, and what
the disc loses is what friction takes and what is lost where points close.

    python examples/contact_impact.py
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure
from skfem import MeshTri

from contact import ContactProblem, DynamicStepper, ElasticBody, Plane
from contact.plot import plot_cells


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Throw the disc, print the summary, draw its stress while it touches and its energies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    output = parser.parse_args(argv).output
    mesh = MeshTri.init_circle(4).with_boundaries({"rim": lambda x: np.hypot(*x) > 0.9})
    disc = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
    problem = ContactProblem(disc, "rim", Plane((0.0, -1.01), (0.0, 1.0)), friction=0.2)
    stepper = DynamicStepper(problem, density=1.0, dt=0.05, velocity=(0.03, -0.05), keep=10)
    history = stepper.run(240)
    print(history.summary())
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    hit = max(history, key=lambda step: step.result.contact_force)
    plot_cells(hit.result, left, label="von Mises stress / E")
    left.set(title=f"at t = {hit.time - 0.5 * history.dt:.2f}", xlabel="x", ylabel="y")
    history.plot(right)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "contact_impact.png", dpi=120)
    return SimpleNamespace(history=history)


if __name__ == "__main__":
    main()
