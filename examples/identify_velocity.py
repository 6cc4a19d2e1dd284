r"""A wave speed from three snapshots, with its deviations and what the data cannot tell.

    u_t + c(x) u_x = 0 on a period,  u(x, 0) = sin 2 pi x + cos(6 pi x) / 2 known,
    c = 1 + .35 sin 2 pi x + .2 cos 4 pi x + .1 sin 6 pi x unknown:

24 splines of degree five for c, begun at c = 1; the data at t = .1, .17 and .26 are exact values at
the feet of the characteristics (DOP853 at 1e-11) with noise of the deviation sigma. The weight of
the second derivatives of c is chosen by the discrepancy principle, without the truth:

    sigma    error of c    error / deviation    parameters determined
    0           1.3e-05                 0.29                     24.0
    0.001       6.7e-04                 0.87                     19.6
    0.01        6.9e-03                 0.96                     19.5

Errors are relative, in the root mean square, as are those over stated deviations.
On the right of the picture is what cannot be seen; c = 1 / (1 + .3 sin 8 pi x) returns each wave of
a quarter of the period to its place at t = .25. One snapshot there fits c = 1 within the noise; the
singular values of the sensitivity tell so, and a warning names the waves. With --problems a second
picture is the histogram of errors over stated deviations in random problems.

    python examples/identify_velocity.py --problems 100 --output out
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cip import (
    Grid,
    IdentifiabilityWarning,
    IdentifiedVelocity,
    Solver,
    SplineVelocity,
    identify_velocity,
)

TIMES = (0.1, 0.17, 0.26)


def speed(x: Any) -> Any:
    """Return the speed with three waves."""
    angle = 2 * np.pi * x
    return 1 + 0.35 * np.sin(angle) + 0.2 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)


def quick(x: Any) -> Any:
    """Return a speed that a snapshot at t = .25 cannot tell from 1."""
    return 1 / (1 + 0.3 * np.sin(8 * np.pi * x))


def start(x: Any) -> Any:
    """Return the field at t = 0."""
    return np.sin(2 * np.pi * x) + 0.5 * np.cos(6 * np.pi * x)


def snapshots(
    c: Any, times: Any, grid: Grid, noise: float, rng: np.random.Generator, u: Any = start
) -> dict[float, np.ndarray]:
    """Return the exact fields at some times, with noise."""
    (x,) = grid.coordinates
    run = solve_ivp(lambda _, y: -c(y), (0, max(times)), x, "DOP853", times, rtol=1e-11, atol=1e-12)
    return {
        t: u(foot) + noise * rng.standard_normal(x.size)
        for t, foot in zip(times, run.y.T, strict=True)
    }


def relative(found: IdentifiedVelocity, c: Any) -> float:
    """Return the relative error of the speed in the root mean square."""
    exact = c(found.grid.coordinates[0])
    return float(np.linalg.norm(found.values[0] - exact) / np.linalg.norm(exact))


def random_error(seed: int) -> float:
    """Return the error at a node over its deviation in a random problem."""
    rng = np.random.default_rng(seed)
    grid = Grid((0, 1), 64, periodic=True)
    a, phase, weights = rng.normal(0, 0.15, 2), rng.uniform(0, 1, 3), rng.normal(0, 1, 3)

    def c(x: Any) -> Any:
        return 1.1 + a[0] * np.sin(2 * np.pi * x) + a[1] * np.cos(2 * np.pi * x)

    def u(x: Any) -> Any:
        return sum(w * np.sin(2 * np.pi * ((k + 1) * x + phase[k])) for k, w in enumerate(weights))

    noise = 10 ** rng.uniform(-2.5, -1.5)
    data = snapshots(c, TIMES, grid, noise, rng, u)
    solver = Solver(grid, SplineVelocity(grid, 10, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = identify_velocity(solver, solver.state(u), data, dt=0.05, noise=noise)
    node = rng.integers(grid.size)
    error = found.values[0, node] - c(grid.coordinates[0][node])
    return float(error / found.value_deviations[0, node])


def picture(found: dict[float, IdentifiedVelocity], lost: IdentifiedVelocity, path: Path) -> None:
    """Draw the speeds with two deviations, and the part that cannot be seen."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 3.3), layout="constrained")
    axes = figure.subplots(1, 3)
    for ax, noise in zip(axes, [n for n in found if n], strict=False):
        found[noise].plot(ax)
        x = found[noise].grid.coordinates[0]
        ax.plot(x, speed(x), "k--", lw=1, label="truth")
        ax.set_title(f"noise {noise:g}")
        ax.legend()
    x = lost.grid.coordinates[0]
    axes[2].plot(x, lost.values[0], label="identified")
    axes[2].plot(x, quick(x), "k--", lw=1, label="truth")
    hidden = lost.identifiability.patterns[-1, 0]
    axes[2].plot(x, 1 + 0.2 * hidden, ":", label="a part not seen")
    axes[2].set(title="one snapshot at t = 0.25", xlabel="x", ylim=(0.1, 1.5))
    axes[2].legend(loc="lower center")
    figure.savefig(path, dpi=120)


def histogram(errors: np.ndarray, path: Path) -> None:
    """Draw errors over deviations beside the normal distribution."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    ax = figure.subplots()
    ax.hist(errors, bins=np.linspace(-4, 4, 25), density=True, alpha=0.6, label="problems")
    z = np.linspace(-4, 4, 200)
    ax.plot(z, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), "k--", label="normal distribution")
    ax.set(xlabel="error / stated deviation", ylabel="density")
    ax.legend()
    figure.savefig(path, dpi=120)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Identify with three levels of noise and where data cannot tell; write pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=200)
    parser.add_argument("--problems", type=int, default=0, help="random problems of the histogram")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the files")
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    grid, rng = Grid((0, 1), options.cells, periodic=True), np.random.default_rng(1)
    solver = Solver(grid, SplineVelocity(grid, 24, 1.0))
    first, found = solver.state(start), {}
    print("   sigma    error of c    error / deviation    parameters determined")
    for noise in (0.0, 1e-3, 1e-2):
        data = snapshots(speed, TIMES, grid, noise, rng)
        one = identify_velocity(solver, first, data, dt=0.01, noise=noise, bounds=(0.05, np.inf))
        found[noise] = one
        ratio = (one.values[0] - speed(grid.coordinates[0])) / one.value_deviations[0]
        print(
            f"{noise:8.3g} {relative(one, speed):13.1e} {np.sqrt(np.mean(ratio**2)):20.2f} "
            f"{one.degrees_of_freedom:24.1f}"
        )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        data = snapshots(quick, [0.25], grid, 1e-3, rng)
        lost = identify_velocity(solver, first, data, dt=0.01, noise=1e-3, bounds=(0.05, np.inf))
    print(f"one snapshot at t = 0.25: error of c {relative(lost, quick):.2f}; {lost.explained=}")
    said = [str(one.message) for one in caught if one.category is IdentifiabilityWarning]
    print(*said)
    picture(found, lost, options.output / "identify_velocity.png")
    errors = np.array([random_error(seed) for seed in range(options.problems)])
    if errors.size:
        outside = [float(np.mean(np.abs(errors) > size)) for size in (1, 2)]
        print(
            f"{errors.size} problems: outside one deviation {outside[0]:.3f}, two {outside[1]:.3f}"
        )
        histogram(errors, options.output / "identify_velocity_histogram.png")
    return {
        "errors": {noise: relative(one, speed) for noise, one in found.items()},
        "lost": relative(lost, quick),
        "explained": lost.explained,
        "said": said,
        "z": errors,
    }


if __name__ == "__main__":
    main()
