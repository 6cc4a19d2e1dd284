"""Finite-time Lyapunov exponents of the double gyre: lines that water does not cross for a while.

Two vortices side by side whose border swings with the period 10 (Shadden, Lekien and Marsden,
Physica D 212, 2005, 271-304). Ridges of the map forward in time repel what lies beside them,
ridges of the map backward attract it.

    python examples/cip_lyapunov.py --cells 200 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cip import FlowMap, Grid, flow_map


def gyre(x: np.ndarray, y: np.ndarray, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocity of the double gyre."""
    a = 0.25 * np.sin(0.2 * np.pi * t)
    f, slope = a * x**2 + (1 - 2 * a) * x, 2 * a * x + 1 - 2 * a
    u = -0.1 * np.pi * np.sin(np.pi * f) * np.cos(np.pi * y)
    return u, 0.1 * np.pi * np.cos(np.pi * f) * np.sin(np.pi * y) * slope


def main(argv: list[str] | None = None) -> list[FlowMap]:
    """Draw the exponents of both maps and return these."""
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=120)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    grid = Grid([(0, 2), (0, 1)], (options.cells, options.cells // 2))
    maps = [flow_map(gyre, grid, 0.0, end, tolerance=1e-5) for end in (10.0, -10.0)]
    figure, axes = plt.subplots(2, 1, figsize=(6, 6.4), layout="constrained")
    for ax, found in zip(axes, maps, strict=True):
        found.plot(ax)
        inner = found.lyapunov[1:-1, 1:-1].max()
        print(f"t = 0 to {found.t_end:g}: exponents up to {inner:.3f} away from the walls")
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "cip_lyapunov.png", dpi=160)
    return maps


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
