"""Whether the deviations that `identify_velocity` states are right: errors in random problems.

Field, speed, noise and times of 300 problems are drawn; the data are exact values at the feet of
the characteristics (DOP853), with noise. Half of the problems have three parameters of a formula
unknown, half a speed of ten splines, whose penalty the discrepancy principle weights. Of each
problem one error is taken, of a parameter or of the speed at a node, over its stated deviation: if
the deviations are right, these ratios are normally distributed with variance 1.

    python benchmarks/calibration.py --json benchmarks/results/calibration.json \
        --picture docs/calibration.png
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import binom, kstest

from cip import Grid, Solver, SplineVelocity, Velocity, identify_velocity

GRID = Grid((0, 1), 64, periodic=True)
SPEED = Velocity.from_expression(
    "a + b*sin(2*pi*x1) + d*cos(2*pi*x1)", parameters={"a": 1.0, "b": 0.0, "d": 0.0}
)
# Deviations, and how often a normal variable lies further outside.
OUTSIDE = {1: 0.3173, 2: 0.0455, 3: 0.0027}


def waves(rng: np.random.Generator, sizes: list[float]) -> tuple[Callable[..., Any], Any]:
    """Return a function with random waves of these sizes, and their amplitudes."""
    numbers = rng.standard_normal((2, len(sizes))) * sizes

    def f(x: Any) -> Any:
        angle = 2 * np.pi * np.multiply.outer(np.arange(1, len(sizes) + 1), x)
        return np.tensordot(numbers[0], np.sin(angle), 1) + np.tensordot(
            numbers[1], np.cos(angle), 1
        )

    return f, numbers


def snapshots(
    c: Callable[..., Any], u: Callable[..., Any], times: Any, noise: float, seed: int
) -> dict[float, Any]:
    """Return the fields that the speed has carried to the times, with noise."""
    (x,) = GRID.coordinates
    run = solve_ivp(lambda _, y: -c(y), (0, max(times)), x, "DOP853", times, rtol=1e-11, atol=1e-12)
    rng = np.random.default_rng(seed)
    return {
        t: u(foot) + noise * rng.standard_normal(x.size)
        for t, foot in zip(times, run.y.T, strict=True)
    }


def deviation(seed: int) -> float:
    """Return an error of one random problem in stated deviations.

    Odd seeds have the parameters of a formula unknown, even ones splines.
    """
    rng = np.random.default_rng(seed)
    u, _ = waves(rng, [1.0, 0.7, 0.5])
    bump, numbers = waves(rng, [0.15] if seed % 2 else [0.15, 0.05])
    mean = rng.uniform(0.8, 1.3)
    noise, times = 10 ** rng.uniform(-2.5, -1.5), np.sort(rng.uniform(0.08, 0.3, 3))

    def c(x: Any) -> Any:
        return mean + bump(x)

    data = snapshots(c, u, times, noise, seed)
    solver = Solver(GRID, SPEED if seed % 2 else SplineVelocity(GRID, 10, 1.0))
    found = identify_velocity(solver, solver.state(u), data, dt=0.05, noise=noise)
    if seed % 2:
        name, value = [("a", mean), ("b", numbers[0, 0]), ("d", numbers[1, 0])][rng.integers(3)]
        return float((found.parameters[name] - value) / found.deviations[name])
    node = rng.integers(GRID.size)
    error = found.values[0, node] - c(GRID.coordinates[0])[node]
    return float(error / found.value_deviations[0, node])


def summary(errors: Any) -> dict[str, Any]:
    """Return how many errors lie outside 1, 2 and 3 deviations, and how many may.

    Of right deviations more lie outside than `allowed` with a chance below 1 : 1000.
    """
    sizes = np.abs(errors)
    return {
        "problems": len(errors),
        "outside": {str(z): int(np.sum(sizes > z)) for z in OUTSIDE},
        "expected": {str(z): len(errors) * chance for z, chance in OUTSIDE.items()},
        "allowed": {str(z): int(binom.ppf(0.999, len(errors), p)) for z, p in OUTSIDE.items()},
        "rms": float(np.sqrt(np.mean(np.square(errors)))),
        "kolmogorov_smirnov_p": float(kstest(errors, "norm").pvalue),
    }


def picture(errors: Any, path: Path) -> None:
    """Draw the histogram beside the normal density, and the ordered errors beside its quantiles."""
    from matplotlib.figure import Figure
    from scipy.stats import norm

    errors, kinds = np.asarray(errors), (("splines", 0), ("formulas", 1))
    width, z = 0.5, np.linspace(-4, 4, 401)
    figure = Figure(figsize=(8.4, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.45, 1))
    left.hist(
        [np.clip(errors[part::2], -3.99, 3.99) for _, part in kinds],  # none is left out
        bins=np.arange(-4, 4 + width, width),
        stacked=True,
        label=[name for name, _ in kinds],
        color=("#4c72b0", "#9db8d9"),
        edgecolor="white",
        lw=0.5,
    )
    left.plot(z, errors.size * width * norm.pdf(z), "k--", lw=1.2, label="normal distribution")
    left.set(xlabel="error / stated deviation", ylabel=f"of {errors.size} problems", xlim=(-4, 4))
    left.legend(frameon=False, loc="upper left", fontsize="small")
    ranks = (np.arange(errors.size) + 0.5) / errors.size
    right.plot(norm.ppf(ranks), np.sort(errors), ".", ms=3, color="#4c72b0")
    right.plot([-4, 4], [-4, 4], "k--", lw=1.2)
    right.set(xlabel="normal quantile", ylabel="ordered error / deviation", aspect="equal")
    right.set(xlim=(-4, 4), ylim=(-4, 4), xticks=range(-4, 5, 2), yticks=range(-4, 5, 2))
    figure.savefig(path, dpi=120)


def main() -> None:
    """Solve the problems; print the summary, and write the record and the picture if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=300)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--stored", action="store_true", help="draw the errors in the file --json")
    options = parser.parse_args()
    if options.stored:
        picture(json.loads(options.json.read_text())["errors"], options.picture)
        return
    begin, errors = time.perf_counter(), []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a rare misfit beyond the noise
        for seed in range(options.problems):
            errors.append(deviation(seed))
    found = {**summary(errors), "seconds": time.perf_counter() - begin}
    print(json.dumps(found, indent=1))
    if options.json:
        from machine import describe

        record = {"machine": describe(), **found, "errors": [round(z, 4) for z in errors]}
        options.json.write_text(json.dumps(record, indent=1) + "\n")
    if options.picture:
        picture(errors, options.picture)


if __name__ == "__main__":
    main()
