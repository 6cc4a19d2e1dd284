"""A rough surface with a hardness is loaded, unloaded and loaded again: area, indentation."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from contact import GridContact, HalfSpace, Rigid, self_affine

POINTS, HARDNESS = 96, 0.03


def main(arguments=None):
    """Run the example, print and return the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"))
    (output := parser.parse_args(arguments).output).mkdir(parents=True, exist_ok=True)
    heights = self_affine(POINTS, hurst=0.8, rms=5e-3, cutoffs=(2, 16), seed=3)
    ground = HalfSpace((1.0, 1.0), (POINTS, POINTS), E=1.0, nu=0.3)
    share = np.array([*np.linspace(0.1, 0.7, 7), 0.5, 0.3, 0.1, 0.02, 0.3, 0.5, 0.7])
    steps = [Rigid(heights, force=(None, None, HARDNESS * s)) for s in share]
    plastic = GridContact(ground, 0.0, hardness=HARDNESS).history(steps)
    elastic = GridContact(ground, 0.0).history(steps[:7])
    area = [r.area for r in plastic]
    print(f"share in contact {area[6]:.3f} under .7 H, {area[9]:.3f} back at .1 H")
    left, right = plt.figure(figsize=(9, 3.8), layout="constrained").subplots(1, 2)
    left.plot(share[:7], area[:7], "o-", label="loading")
    left.plot(share[6:11], area[6:11], "s--", ms=4, label="unloading")
    left.plot(share[:7], [r.area for r in elastic], "^-", ms=4, label="elastic")
    left.plot([0, 0.7], [0, 0.7], "k:", label="F / H")
    left.legend()
    left.set(xlabel="mean pressure / hardness", ylabel="share in contact")
    drawn = right.imshow(plastic[-1].indentation / np.std(heights), extent=(0, 1, 0, 1))
    plt.colorbar(drawn, label="indentation / rms height")
    plt.savefig(output / "hard_surface.png", dpi=120)
    return plastic


if __name__ == "__main__":
    main()
