r"""Zalesak's slotted disk after one revolution, 628 steps.

    u_t + 2 pi (1/2 - y) u_x + 2 pi (x - 1/2) u_y = 0 on the unit square,

disk of radius .15 at (.5, .75) with a slot of width .05 up to y = .85 (Zalesak, J. Comput. Phys.
31, 1979). The initial slopes are zero. The error is sum |u - u0| / sum u0. The rotation is known:
the last line of the table is a single step of length 1, the lines above say what 628 interpolations
cost.

    python examples/cip_zalesak.py --cells 100 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from cip import Grid, Solver, State, Velocity

SCHEMES = (
    ("adini", None), ("adini", "clamp"), ("adini", "eno"), ("bicubic", None), ("csl2", "bounds"),
)  # fmt: skip


ONE_STEP = ("adini", None, 1)


def disk(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return 1 in the slotted disk, 0 outside."""
    inside = np.hypot(x - 0.5, y - 0.75) <= 0.15
    return (inside & ~((np.abs(x - 0.5) < 0.025) & (y < 0.85))).astype(float)


def solver(n: int, profile: str, limiter: str | None) -> Solver:
    """Set up the rotation on n x n cells."""
    split = profile.startswith("csl")
    return Solver(
        Grid([(0, 1)] * 2, (n, n)),
        Velocity.from_expression("2*pi*(0.5 - x2)", "2*pi*(x1 - 0.5)"),
        "advection" if split else "transport",
        profile,
        limiter,
        "strang" if split else None,
        boundary=0.0,
        bounds=(0.0, 1.0),
    )


def start(scheme: Solver) -> State:
    """Return the disk with slopes zero."""
    names = {"adini": ["u_x", "u_y"], "bicubic": ["u_x", "u_y", "u_xy"]}.get(scheme.profile, [])
    return scheme.state(disk, {name: lambda x, y: 0 * x for name in names})


def main(argv: list[str] | None = None) -> dict[tuple[str, str | None], dict[str, float]]:
    """Print the table, draw the picture, return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=100)
    parser.add_argument("--steps", type=int, default=628)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    rows, runs = {}, {}
    print("profile   limiter    error     under      over      mass")
    for profile, limiter, steps in [(*scheme, options.steps) for scheme in SCHEMES] + [ONE_STEP]:
        scheme = solver(options.cells, profile, limiter)
        begin = start(scheme)
        run = scheme.run(begin, 1.0, dt=1 / steps)
        u = run.final["u"]
        row = {
            "error": float(np.abs(u - begin["u"]).sum() / begin["u"].sum()),
            "under": float(u.min()),
            "over": float(u.max() - 1),
            "mass": run.final.mass / begin.mass - 1,
        }
        if steps > 1:
            rows[profile, limiter], runs[profile, limiter] = row, run
        print(
            f"{profile:9s} {limiter or ('-' if steps > 1 else '1 step'):7s} {row['error']:8.3f} "
            f"{row['under']:9.1e} {row['over']:9.1e} {row['mass']:9.1e}"
        )
    options.output.mkdir(parents=True, exist_ok=True)
    picture(runs).savefig(options.output / "cip_zalesak.png", dpi=160)
    return rows


def picture(runs: dict[tuple[str, str | None], Any]) -> Any:
    """Draw the disks."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(runs), figsize=(3.2 * len(runs), 3), layout="constrained")
    for ax, (key, run) in zip(axes, runs.items(), strict=True):
        run.plot(ax)
        ax.set(title=" ".join(part for part in key if part), xlim=(0.3, 0.7), ylim=(0.55, 0.95))
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
