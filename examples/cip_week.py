r"""Five tracers in the winds of a week: gridded winds, an interruption, and an animation.

    p_t + div(c p) = s - k p for smoke, dust, pollen, radon and a trace gas,

with winds every six hours on a grid, the velocities of a random stream function of travelling waves
over a steady wind to the east. All tracers share the paths of the winds; radon has a source and
decays, dust settles. The run stops on its fourth day and goes on from its last snapshot. Unit of
length are 1000 km, of time days.

    python examples/cip_week.py --output out
"""

from __future__ import annotations

import argparse
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cip import Grid, Solver, State, Velocity


def winds(grid: Grid, times: np.ndarray) -> np.ndarray:
    """Both components at the nodes and times, shape (times, 2, *nodes)."""
    (x, y), rng = grid.mesh(), np.random.default_rng(3)
    found = np.zeros((times.size, 2, *grid.nodes)) + np.array([0.5, 0.0])[:, None, None]
    for k, l in product(range(-2, 3), range(1, 4)):
        size, phase, speed = rng.normal(size=3) * (0.08, 9.0, 0.5)
        wave = np.cos(2 * np.pi * (k * x / 12 + l * y / 6) + speed * times[:, None, None] + phase)
        found += size * np.stack([l * wave, -k / 2 * wave], axis=1)
    return found


def power_cut(state: State) -> None:
    """The callback that ends the first part."""
    if state.t > 3.2:
        raise StopIteration


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Run the week; returns the change of mass of each tracer that has no source."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"))
    output = parser.parse_args(arguments).output
    grid, times = Grid([(0, 12), (0, 6)], (96, 48), periodic=True), np.linspace(0, 7, 29)
    solver = Solver(
        grid, Velocity.from_snapshots(times, winds(grid, times), grid), "conservative", "csl4",
        "bounds", source={"radon": "0.3*exp(-4*(x1 - 9)**2 - 4*(x2 - 2)**2)"},
        decay={"radon": np.log(2) / 3.8, "dust": 0.1},
    )  # fmt: skip
    puff = "exp(-3*(x1 - {})**2 - 3*(x2 - {})**2)".format
    start = solver.state(
        {"smoke": puff(3, 2), "dust": puff(6, 4), "pollen": puff(8, 2.5), "radon": 0.0, "gas": 1.0}
    )
    week = partial(
        solver.run, start, 7.0, dt=1 / 8, snapshots=14, gauges=[[6.0], [3.0]], progress=True,
        save=output / "cip_week", resume=True,
    )  # fmt: skip
    week(callback=power_cut)
    run = week()
    run.animate(output / "cip_week.gif", fps=4)
    run.plot()[0].figure.savefig(output / "cip_week.png", dpi=80)
    lost = {name: run.final.mass[name] - start.mass[name] for name in ("smoke", "pollen", "gas")}
    print(*(f"mass of {name}: change {change:.1e}" for name, change in lost.items()), sep="\n")
    return {"lost": lost, "dust": run.final.mass["dust"] / start.mass["dust"], "gauges": run.gauges}


if __name__ == "__main__":
    main()
