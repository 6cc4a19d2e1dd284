"""Two hills on the globe, drawn out to filaments by a flow that turns back (Nair and Lauritzen, J.
Comput. Phys. 229, 2010, case 4), with the mass of each kept to rounding.

    python examples/cip_sphere.py --cells 90 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cip import Sphere, SphereSolver, Trajectory

T = 5.0


def wind(lon: np.ndarray, lat: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds to the east and to the north, on a sphere of radius 1."""
    wave, a = 2 * np.cos(np.pi * t / T), lon - 2 * np.pi * t / T
    u = wave * np.sin(a) ** 2 * np.sin(2 * lat) + 2 * np.pi / T * np.cos(lat)
    return u, wave * np.sin(2 * a) * np.cos(lat)


def hill(centre: float) -> object:
    """Return a Gaussian hill on the equator."""
    return lambda lon, lat: 0.95 * np.exp(10 * (np.cos(lat) * np.cos(lon - centre) - 1))


def main(argv: list[str] | None = None) -> Trajectory:
    """Draw both hills at the start, at half time and in the end; return the run."""
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=48, help="from pole to pole")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    solver = SphereSolver(Sphere(2 * options.cells, options.cells), wind, "conservative")
    start = solver.state({"west": hill(5 / 6 * np.pi), "east": hill(7 / 6 * np.pi)})
    run = solver.run(start, T, dt=1.2 * T / options.cells, snapshots=2)
    figure, axes = plt.subplots(3, 1, figsize=(5.4, 7.6), layout="constrained", sharex=True)
    for ax, state in zip(axes, run.states, strict=True):
        lon, lat = (np.degrees(line) for line in state.grid.edges)
        both = state["west_mean"] + state["east_mean"]
        ax.pcolormesh(lon, lat, both.T, vmin=0, vmax=1)
        ax.set(title=f"t = {state.t:g}", ylabel="latitude", aspect="equal", yticks=[-90, 0, 90])
    axes[-1].set(xlabel="longitude", xticks=range(0, 361, 90))
    error = np.abs(run.final.data - start.data).max() / start.data.max()
    lost = max(abs(run.final.mass[name] / mass - 1) for name, mass in start.mass.items())
    print(f"{len(start.fields)} hills: largest error {error:.1e} of the height, mass {lost:.0e}")
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "cip_sphere.png", dpi=160)
    return run


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
