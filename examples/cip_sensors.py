r"""A tracer with unknown start and wind, from a few noisy sensors whose places were chosen.

    u_t + (U + a sin 2 pi y) u_x + (V + b sin 2 pi x) u_y = 0 on the periodic unit square.

The start and the four numbers of the wind are unknown. Greedy A-optimality chooses the places among
49 candidates and says how far the choice can be from the best one; 4D-Var then estimates start and
wind with their deviations, from reports of which a tenth is lost. The truth is no run of the model:
it is the start at the feet of characteristics that SciPy integrates (DOP853, tolerance 1e-10).

    python examples/cip_sensors.py --cells 32 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cip import Covariance, Grid, Sensors, Solver, Velocity, four_d_var, place_sensors

WIND = {"U": 0.6, "V": 0.3, "a": 0.4, "b": -0.3}
GUESS = {"U": 0.5, "V": 0.4, "a": 0.3, "b": -0.2}
SPREAD = dict.fromkeys(WIND, 0.15)
NOISE = 0.03
TIMES = np.arange(1, 9) / 10


def background(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What is believed before any report."""
    return np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y)


def beginning(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The true start."""
    more = np.cos(2 * np.pi * (x + y)) + np.sin(2 * np.pi * (2 * x - y)) - np.cos(4 * np.pi * y)
    return background(x, y) + 0.3 * more


def truth(points: np.ndarray, t: float) -> np.ndarray:
    """The exact field at points of shape (2, m)."""

    def wind(_: float, z: np.ndarray) -> np.ndarray:
        x, y = z.reshape(2, -1)
        across = WIND["U"] + WIND["a"] * np.sin(2 * np.pi * y)
        return np.concatenate([across, WIND["V"] + WIND["b"] * np.sin(2 * np.pi * x)])

    feet = solve_ivp(wind, (t, 0.0), points.ravel(), method="DOP853", rtol=1e-10, atol=1e-10)
    return beginning(*feet.y[:, -1].reshape(2, -1))


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Place the sensors, estimate start and wind, print and draw what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=32)
    parser.add_argument("--sensors", type=int, default=12)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    grid = Grid([(0, 1)] * 2, (options.cells,) * 2, periodic=True)
    wind = Velocity.from_expression("U + a*sin(2*pi*x2)", "V + b*sin(2*pi*x1)", parameters=GUESS)
    solver = Solver(grid, wind, profile="adini")
    start = solver.state(background)
    B = Covariance.diffusion(grid, "adini", deviation=0.5, length=0.15)
    places = np.stack(np.meshgrid(*[np.arange(7) / 7] * 2)).reshape(2, -1)
    candidates = Sensors(places, TIMES[[1, 4, 7]], deviations=NOISE)
    chosen = place_sensors(solver, start, B, candidates, budget=options.sensors, dt=0.05)
    print(chosen)
    random = np.random.default_rng(0).choice(places.shape[1], options.sensors, replace=False)
    found: dict[str, Any] = {"placement": chosen, "wind": {}, "error": {}}
    for name, numbers in {"chosen": list(chosen.chosen), "random": random}.items():
        plan = Sensors(places[:, numbers], TIMES, deviations=NOISE)
        reports = plan.with_values([truth(plan.points, t) for t in TIMES])
        sensors = reports.perturbed(seed=1, dropouts=0.1)
        analysis = four_d_var(solver, start, B, sensors, dt=0.05, parameters=SPREAD, tol=1e-4)
        error = analysis.start["u"] - beginning(*grid.mesh())
        found["error"][name] = float(np.sqrt(np.mean(error**2)))
        found[name] = analysis
        print(
            f"{name:7} rms error of the start {found['error'][name]:.3f}, expected "
            f"{np.sqrt(np.mean(analysis.deviations**2)):.3f}; before "
            f"{np.sqrt(np.mean((start['u'] - beginning(*grid.mesh())) ** 2)):.3f}"
        )
    best = found["chosen"]
    for name, value in best.parameters.items():
        spread = best.parameter_deviations[name]
        print(f"{name} = {value:.4f} +- {spread:.4f}, true {WIND[name]}, guess {GUESS[name]}")
    draw(options.output / "cip_sensors.png", grid, start, best, chosen.sensors.points)
    return found


def draw(path: Path, grid: Grid, start: Any, analysis: Any, points: np.ndarray) -> None:
    """Draw background, truth, analysis and deviations, with the sensors."""
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    fields = {
        "background": start["u"],
        "truth": beginning(*grid.mesh()),
        "analysis": analysis.start["u"],
        "posterior deviation": analysis.deviations,
    }
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained", sharey=True)
    lines = [np.append(line, 1.0) for line in grid.coordinates]  # closed, as the field is periodic
    for ax, (title, u) in zip(axes, fields.items(), strict=True):
        kind = {} if title.startswith("post") else {"vmin": -1.6, "vmax": 1.6, "cmap": "RdBu_r"}
        closed = np.pad(u, (0, 1), mode="wrap").T
        image = ax.pcolormesh(*lines, closed, shading="gouraud", **kind)
        ax.plot(
            *points, "k^", markersize=7, markeredgecolor="w", clip_on=False, label="sensors"
        )  # fmt: skip
        ax.set(title=title, xlabel="x", aspect="equal", xlim=(0, 1), ylim=(0, 1))
        if title in ("analysis", "posterior deviation"):
            over = axes[:3] if title == "analysis" else ax
            figure.colorbar(image, ax=over, shrink=0.75, label="u")
    axes[0].legend(loc="upper right", framealpha=0.9)
    axes[0].set_ylabel("y")
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
