"""A ball jumps onto an adhesive half space and is pulled off; Maugis (1992) has -1.601 pi w R."""

import argparse
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from contact import Adhesion, GridContact, HalfSpace, JumpWarning, Parabola, Rigid

SIDE, POINTS, WORK = 10.0, 128, 4 / 3 / np.pi  # lengths in radii, work with E* = 1


def main(arguments=None):
    """Run the example, print and return the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"))
    (output := parser.parse_args(arguments).output).mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", JumpWarning)  # the jumps are what this is about
    ball = Parabola((SIDE / 2, SIDE / 2, 0.0), 1.0)
    way = [*np.arange(-1.2, 0.45, 0.15), *np.arange(0.3, -1.25, -0.1)]
    steps = [Rigid(ball, displacement=(0.0, 0.0, d)) for d in way]
    ground = HalfSpace((SIDE, SIDE), (POINTS, POINTS), E=0.91, nu=0.3)
    glue = Adhesion(tension=2 / 3, work=WORK, ramp=0.2)  # of Maugis' parameter 1
    results = GridContact(ground, steps[0], adhesion=glue).history(steps)
    force = [r.forces[0].sum() / np.pi / WORK for r in results]
    print(f"pull-off at {min(force):.3f} pi w R; jumps:", [r.jump for r in results if r.jump])
    left, right = plt.figure(figsize=(9, 3.8), layout="constrained").subplots(1, 2)
    left.plot(way[:11], force[:11], "o-", way[10:], force[10:], "s--", ms=4)
    left.set(xlabel="approach (dashed: back)", ylabel="force / $\\pi w R$")
    pressure = results[force.index(min(force))].pressure / glue.tension
    box = (-SIDE / 2, SIDE / 2) * 2
    drawn = right.imshow(pressure.T, cmap="RdBu_r", vmin=-1, vmax=1, extent=box, origin="lower")
    right.set(xlabel="x / R", ylabel="y / R")
    plt.colorbar(drawn, label="pressure / $\\sigma_0$ at the least force")
    plt.savefig(output / "adhesion.png", dpi=120)
    return results, force


if __name__ == "__main__":
    main()
