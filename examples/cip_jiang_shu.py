r"""The Jiang-Shu profile through four periods: which schemes keep jumps, bounds and mass.

    u_t + u_x = 0 on [-1, 1], periodic, T = 8,

with a sum of Gaussians, a square, a triangle and a half ellipse (Jiang and Shu, J. Comput. Phys.
126, 1996, example 8). The nodes lie at the middles -1 + (i + 1/2) h, so that no node is on a jump.
The velocity is constant, so one step of length T would be exact; the table is what steps cost.

    python examples/cip_jiang_shu.py --cells 200 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from cip import Grid, Solver, State

SCHEMES = (
    ("cubic", None), ("cubic", "clamp"), ("cubic", "rational"), ("cubic", "eno"),
    ("piecewise_linear", None), ("csl2", None), ("csl2", "rational"), ("csl2", "bounds"),
    ("csl4", None), ("csl4", "bounds"),
)  # fmt: skip
A, Z, DELTA, ALPHA, BETA = 0.5, -0.7, 0.005, 10.0, np.log(2) / (36 * 0.005**2)


def _pieces(x: np.ndarray, slope: bool) -> np.ndarray:
    x = (np.asarray(x) + 1) % 2 - 1

    def bell(z: float) -> np.ndarray:
        value = np.exp(-BETA * (x - z) ** 2)
        return -2 * BETA * (x - z) * value if slope else value

    def arc(a: float) -> np.ndarray:
        root = np.sqrt(np.maximum(1 - ALPHA**2 * (x - a) ** 2, 0))
        if not slope:
            return root
        return np.where(root > 1e-6, -(ALPHA**2) * (x - a) / np.maximum(root, 1e-6), 0)

    bells = (bell(Z - DELTA) + bell(Z + DELTA) + 4 * bell(Z)) / 6
    arcs = (arc(A - DELTA) + arc(A + DELTA) + 4 * arc(A)) / 6
    triangle = -10 * np.sign(x - 0.1) if slope else 1 - np.abs(10 * (x - 0.1))
    square = np.zeros_like(x) if slope else np.ones_like(x)
    places = [abs(x - middle) <= 0.1 for middle in (-0.7, -0.3, 0.1, 0.5)]
    return np.select(places, [bells, square, triangle, arcs], 0.0)


def exact(x: np.ndarray) -> np.ndarray:
    """Return the profile."""
    return _pieces(x, slope=False)


def grid(n: int) -> Grid:
    """Place the nodes at the middles of the cells of [-1, 1]."""
    return Grid((-1 + 1 / n, 1 + 1 / n), n, periodic=True)


def solver(where: Grid, profile: str, limiter: str | None) -> Solver:
    """Set up u_t + u_x = 0, in the form that the profile is for."""
    form = "advection" if profile.startswith("csl") else "transport"
    return Solver(where, 1.0, form, profile, limiter, bounds=(0.0, 1.0))


def start(scheme: Solver) -> State:
    """Return the moments of the profile, with its own slopes: it cannot be differenced."""
    slopes = {} if scheme.profile == "csl2" else {"u_x": lambda x: _pieces(x, slope=True)}
    return scheme.state(exact, slopes)


def main(argv: list[str] | None = None) -> dict[tuple[str, str | None], dict[str, float]]:
    """Print the table, draw the picture, return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=200)
    parser.add_argument("--cfl", type=float, default=0.4)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    where, h = grid(options.cells), 2 / options.cells
    rows, ends = {}, {}
    print(f"N = {options.cells}, CFL {options.cfl:g}, T = 8")
    print("profile           limiter       L1   TV/TV0      over     under      mass")
    for profile, limiter in SCHEMES:
        scheme = solver(where, profile, limiter)
        begin = start(scheme)
        run = scheme.run(begin, 8.0, dt=options.cfl * h)
        u, found = run.final["u"], run.diagnostics
        row = {
            "l1": h * float(np.abs(u - begin["u"]).sum()),
            "variation": found.total_variation[-1] / found.total_variation[0],
            "over": float(u.max() - 1),
            "under": float(u.min()),
            "mass": float(found.mass[-1] - found.mass[0]),
        }
        rows[profile, limiter], ends[profile, limiter] = row, u
        print(
            f"{profile:17s} {limiter or '-':8s} {row['l1']:7.4f} {row['variation']:8.3f} "
            f"{row['over']:9.1e} {row['under']:9.1e} {row['mass']:9.1e}"
        )
    options.output.mkdir(parents=True, exist_ok=True)
    picture(where, ends).savefig(options.output / "cip_jiang_shu.png", dpi=160)
    return rows


def picture(where: Grid, ends: dict[tuple[str, str | None], np.ndarray]) -> Any:
    """Draw the exact profile behind three of the results."""
    import matplotlib.pyplot as plt

    x = where.coordinates[0]
    figure, axes = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
    for ax, key in zip(axes, (("cubic", None), ("cubic", "eno"), ("csl4", "bounds")), strict=True):
        ax.plot(x, exact(x), "0.6", lw=1)
        ax.plot(x, ends[key], "o", ms=2.5)
        ax.set(title=" ".join(part for part in key if part), ylabel="u")
    axes[-1].set_xlabel("x")
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
