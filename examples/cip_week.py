r"""Five tracers in the winds of a week: six-hourly dates, sources, restarts, and an animation.

    p_t + div(c p) = s - k p for smoke, dust, pollen, radon and a trace gas,

with winds as a file of a weather service has them, an xarray.Dataset with dates and units, here of
two travelling waves over a steady wind to the east. All tracers share the paths of the winds; radon
has a source and decays, dust settles. Each snapshot is written as soon as it is reached: stopped at
any time, the script goes on from the last one. Dates and units of the winds are those of the run.

    python examples/cip_week.py --output out
"""

import argparse
from pathlib import Path

import numpy as np
import xarray

from cip import Solver, Velocity

DAY = 86400.0


def winds():
    """Both components in m/s on an ocean of 12,000 by 6,000 km."""
    time = np.datetime64("2026-03-01", "ns") + np.arange(29) * np.timedelta64(6, "h")
    axes = {"time": time, "x": 125e3 * np.arange(96), "y": 125e3 * np.arange(48)}
    day, x, y = np.ix_(np.arange(29) / 4, np.arange(96) / 96, np.arange(48) / 48)
    a, b = 2 * np.pi * (x + y) - 0.9 * day, 2 * np.pi * (2 * x - y) + 0.7 * day
    speeds = {"u": 6 + 8 * np.cos(a) - 5 * np.cos(b), "v": -4 * np.cos(a) - 5 * np.cos(b)}
    return xarray.Dataset({name: (list(axes), c) for name, c in speeds.items()}, axes)


def main(arguments=None):
    """Run the week; returns the mass that is left of what the start had, and the run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"))
    output = parser.parse_args(arguments).output
    wind = Velocity.from_xarray(winds(), ("u", "v"), ("x", "y"), periodic=True)
    puff = "exp(-3e-12*((x - {}e6)**2 + (y - {}e6)**2))".format
    solver = Solver(
        wind.grid, wind, "conservative", "csl4", "bounds",
        source={"radon": f"1e-5*{puff(9, 2)}"}, decay={"radon": 2.1e-6, "dust": 0.1 / DAY},
    )  # fmt: skip
    tracers = {"smoke": puff(3, 2), "dust": puff(6, 4), "pollen": puff(8, 2.5)}
    start = solver.state(tracers | {"radon": 0.0, "gas": 1.0})
    run = solver.run(start, 7 * DAY, dt=DAY / 8, snapshots=14, save=output / "week", resume=True)
    run.animate(output / "cip_week.gif")
    run.plot()[0].figure.savefig(output / "cip_week.png", dpi=80)
    left = {name: run.final.mass[name] / start.mass[name] for name in tracers}
    print(f"on {run.to_xarray().t.values[-1]:.10} the masses are, relative to the start: {left}")
    return left, run


if __name__ == "__main__":
    main()
