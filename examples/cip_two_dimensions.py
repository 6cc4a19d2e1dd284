r"""The two-dimensional experiments of King (2012), section 3.3, with figures 3.2 and 3.3.

Example 1:  u_t + y u_x + x u_y = 0,  u(x, y, 0) = exp(-10 (x^2 + y^2)),  h = dt = .04, t = 1.2;
exact: u0(x cosh t - y sinh t, y cosh t - x sinh t). Printed is .0035, the l2 error of a slice at
x = -.02, which is no node of this grid; ours are sqrt(h^2 sum e^2) over the whole square.

Example 2:  u_t + y u_x - x u_y = 0, the slotted disk of radius 1.4 after four and eight revolutions
in steps of 2 pi / 200 on 100 x 100 cells (printed: dx = .01, but x = -.84 is node 29 of 101). Its
smoothing is not printed; here the edges are tanh profiles of width .16, and the number is that of
the slice x = -.84, sqrt(h sum e^2). Printed is .0048.

The velocities are known for all time, so a single step follows the characteristics to the end and
interpolates once (in example 2, not at all): the last line of example 1 says what the steps cost.
They are for data that come on a grid, for velocities that depend on the solution, and for sources.

    python examples/cip_two_dimensions.py --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from cip import Grid, Solver, Velocity

WIDTH = 0.16
SCHEMES = (("adini", None), ("bicubic", None), ("cubic", "strang"))


def bell(x: Any, y: Any) -> Any:
    """Return the start of example 1."""
    return np.exp(-10 * (x**2 + y**2))


def blade(x: Any, y: Any, t: float) -> Any:
    """Return the exact solution of example 1."""
    return bell(x * np.cosh(t) - y * np.sinh(t), y * np.cosh(t) - x * np.sinh(t))


def edge(s: Any) -> Any:
    """Return 0 below and 1 above an edge, smoothed."""
    return (1 + np.tanh(s / WIDTH)) / 2


def disk(x: Any, y: Any) -> Any:
    """Return the smoothed slotted disk of example 2."""
    radius = np.sqrt(x**2 + y**2 + 1e-30)
    slot = edge(0.25 - np.sqrt(x**2 + 1e-30)) * edge(0.8 + y)
    return edge(1.4 - radius) * (1 - slot)


def solver(velocity: tuple[str, str], profile: str, splitting: str | None) -> Solver:
    """Set up 100 x 100 cells on [-2, 2]^2 with zero inflow."""
    grid = Grid([(-2, 2)] * 2, (100, 100))
    field = Velocity.from_expression(*velocity)
    return Solver(grid, field, profile=profile, splitting=splitting, boundary=0.0)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the errors, draw the figures, return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--revolutions", type=int, default=8)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNGs")
    options = parser.parse_args(argv)
    results: dict[str, Any] = {}
    print("example 1, t = 1.2, whole square (printed for a slice: .0035)")
    for profile, splitting in SCHEMES:
        scheme = solver(("x2", "x1"), profile, splitting)
        run = scheme.run(scheme.state(bell), 1.2, dt=0.04, snapshots=[0.3, 0.6, 0.9])
        final = scheme.run(scheme.state(bell), 1.2, dt=0.04).final  # no landing between the steps
        e = final["u"] - blade(*scheme.grid.mesh(), 1.2)
        results["1", profile] = run, 0.04 * float(np.sqrt(np.sum(e**2)))
        print(f"  {profile:8s} {splitting or 'direct':8s} {results['1', profile][1]:.2e}")
    scheme = solver(("x2", "x1"), "bicubic", None)
    e = scheme.step(scheme.state(bell), 1.2)["u"] - blade(*scheme.grid.mesh(), 1.2)
    results["1", "one step"] = 0.04 * float(np.sqrt(np.sum(e**2)))
    print(f"  bicubic  one step {results['1', 'one step']:.2e}")
    half = options.revolutions // 2
    print(f"\nexample 2, slice x = -.84 after {half} and {options.revolutions} revolutions")
    for profile in ("adini", "bicubic"):
        scheme = solver(("x2", "-x1"), profile, None)
        start = scheme.state(disk)
        times = [2 * np.pi * half]
        end = 2 * np.pi * options.revolutions
        run = scheme.run(start, end, dt=2 * np.pi / 200, snapshots=times)
        slices = [run[place]["u"][29] - start["u"][29] for place in (1, 2)]
        found = [float(np.sqrt(0.04 * np.sum(e**2))) for e in slices]
        results["2", profile] = run, found
        print(f"  {profile:8s} {found[0]:.2e} {found[1]:.2e}   (printed after four: 4.8e-03)")
    options.output.mkdir(parents=True, exist_ok=True)
    pictures(options.output, results)
    return results


def pictures(folder: Path, results: dict[str, Any]) -> None:
    """Draw Figures 3.2 and 3.3."""
    import matplotlib.pyplot as plt

    run, _ = results["1", "bicubic"]
    figure, axes = plt.subplots(2, 3, figsize=(12, 7), layout="constrained")
    for place, ax in enumerate(axes.flat[:5]):
        run.plot(ax, [place])
    y = np.linspace(-2, 2, 801)
    line = np.array([np.full_like(y, -0.02), y])
    axes[1, 2].plot(y, blade(line[0], y, 1.2), "0.75", lw=3, label="exact")
    axes[1, 2].plot(y, run.sample(line), lw=1, label="bicubic")
    axes[1, 2].set(title="x = -.02, t = 1.2", xlabel="y")
    axes[1, 2].legend()
    figure.savefig(folder / "cip_figure_3_2.png", dpi=140)

    figure, axes = plt.subplots(2, 2, figsize=(9, 7.5), layout="constrained")
    run, _ = results["2", "bicubic"]
    for place, ax in enumerate(axes.flat[:3]):
        run.plot(ax, [place])
    y = run.solver.grid.coordinates[1]
    axes[1, 1].plot(y, run[0]["u"][29], "0.75", lw=3, label="exact")
    for profile in ("adini", "bicubic"):
        axes[1, 1].plot(y, results["2", profile][0][1]["u"][29], lw=1, label=profile)
    axes[1, 1].set(title="x = -.84, first of the two times", xlabel="y")
    axes[1, 1].legend()
    figure.savefig(folder / "cip_figure_3_3.png", dpi=140)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
