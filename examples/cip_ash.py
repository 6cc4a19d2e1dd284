r"""A volcano's ash: where, when and how much was emitted, from snapshots of a satellite.

    u_t + c . grad u = q(t) g(x - x_s) in a known wind c without divergence.

Place x_s and strength q(t) are unknown: the model has a source of width .15 at each of 15 places,
which emits a puff of unknown strength every .05, as the model error of weak-constraint 4D-Var. Six
snapshots have noise, and clouds hide a third of their pixels. The truth is no run of the model: it
is an integral along characteristics that SciPy integrates (DOP853), with a source that emits
continuously and stands at none of the places.

    python examples/cip_ash.py --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cip import Analysis, Covariance, Grid, Sensors, Solver, Velocity, four_d_var

BOX = [(0.0, 4.0), (0.0, 2.0)]
WIND = ("1 + 0.4*sin(pi*x2)", "0.5*sin(pi*x1)")
PUFF = 0.05  # time between two puffs of the model
SNAPSHOTS = (0.3, 0.5, 0.7, 0.9, 1.1, 1.3)
PLACE, WIDTH = np.array([0.66, 1.06]), 0.15
NOISE = 0.02


def emission(t: Any) -> Any:
    """The true strength: an eruption between t = .15 and .75."""
    return 2.0 * np.sin(np.pi * np.clip((t - 0.15) / 0.6, 0.0, 1.0)) ** 2


def plume(x: Any, y: Any, place: np.ndarray) -> Any:
    """The shape of a source, periodic up to rounding."""
    dx = (x - place[0] + 2.0) % 4.0 - 2.0
    dy = (y - place[1] + 1.0) % 2.0 - 1.0
    return np.exp(-(dx**2 + dy**2) / (2.0 * WIDTH**2))


def truth(points: np.ndarray, t: float) -> np.ndarray:
    """The exact field at points of shape (2, m): the source, integrated along the way there."""
    m = points.shape[1]

    def back(s: float, z: np.ndarray) -> np.ndarray:
        x, y = z[: 2 * m].reshape(2, m)
        added = -emission(s) * plume(x, y, PLACE)
        return np.concatenate([1 + 0.4 * np.sin(np.pi * y), 0.5 * np.sin(np.pi * x), added])

    start = np.concatenate([points.ravel(), np.zeros(m)])
    way = solve_ivp(back, (t, 0.0), start, method="DOP853", rtol=1e-7, atol=1e-8, max_step=0.05)
    return way.y[2 * m :, -1]


def reports(count: tuple[int, int], times: np.ndarray) -> Sensors:
    """Pixels of the snapshots, with noise, a third of them below clouds; none at other times."""
    axes = [
        low + (np.arange(n) + 0.5) / n * (high - low)
        for n, (low, high) in zip(count, BOX, strict=True)
    ]
    pixels = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    values = np.full((times.size, pixels.shape[1]), np.nan)
    rng = np.random.default_rng(2)
    for t in SNAPSHOTS:
        seen = truth(pixels, t) + NOISE * rng.standard_normal(pixels.shape[1])
        x, y = np.pi * pixels
        shapes = [np.sin(x), np.cos(y), np.cos(0.5 * x), np.sin(2 * y)]
        waves = rng.standard_normal(4) @ shapes
        seen[waves > np.quantile(waves, 2 / 3)] = np.nan
        values[np.argmin(np.abs(times - t))] = seen
    return Sensors(pixels, times, values, NOISE)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Estimate the source, print and draw it, and animate truth and analysis."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs=2, default=[64, 32])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder of the pictures")
    options = parser.parse_args(argv)
    grid = Grid(BOX, options.cells, periodic=True)
    solver = Solver(grid, Velocity.from_expression(*WIND), profile="adini")
    times = np.arange(1, 27) * PUFF
    places = np.array([(x, y) for x in 0.4 + 0.2 * np.arange(3) for y in 0.6 + 0.2 * np.arange(5)])
    puffs = [solver.state(lambda x, y, p=p: plume(x, y, p)) for p in places]
    sources = Covariance.patterns(puffs, 0.4 * PUFF)  # strengths of .4, more or less
    clean = Covariance.diffusion(grid, "adini", deviation=1e-3, length=0.3)
    found = four_d_var(
        solver, solver.state(0.0), clean, reports((40, 20), times), dt=PUFF, tol=1e-6,
        model_error=sources, vectors=400,
    )  # fmt: skip
    strength = 0.4 * np.stack(found.amplitudes)  # by time and place
    weight = strength.sum(axis=0)
    where = weight @ places / weight.sum()
    total, true = PUFF * weight.sum(), 0.6
    rate = strength.sum(axis=1)
    when = float(times @ rate / rate.sum())
    print(found)
    print(f"where: ({where[0]:.3f}, {where[1]:.3f}), true ({PLACE[0]}, {PLACE[1]})")
    print(f"when:  mean time {when:.3f}, true 0.45")
    print(f"how much: {total:.3f}, true {true}")
    options.output.mkdir(parents=True, exist_ok=True)
    draw(options.output / "cip_ash.png", places, times, strength)
    animate(options.output / "cip_ash.gif", grid, found)
    return {"analysis": found, "where": where, "when": when, "total": total}


def draw(path: Path, places: np.ndarray, times: np.ndarray, strength: np.ndarray) -> None:
    """Draw the estimated source in space and in time."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=(1, 2)
    )
    lines = [np.unique(line) for line in places.T]
    emitted = PUFF * strength.sum(axis=0).reshape([line.size for line in lines])
    image = left.pcolormesh(*lines, emitted.T, shading="nearest", vmin=0, cmap="cividis")
    left.plot(*places.T, ".", color="0.6", markersize=4, label="places of the model")
    left.plot(*PLACE, "r*", markersize=13, markeredgecolor="w", label="true place")
    left.set(title="emitted near each place", xlabel="x", ylabel="y", aspect="equal")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), fontsize="x-small")
    figure.colorbar(image, ax=left)
    right.axhline(0, color="0.8", lw=1)
    right.step(times, strength.sum(axis=1), where="pre", label="estimated, all places")
    right.plot(times, emission(times), "r", label="true")
    right.set(title="strength", xlabel="t")
    right.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def animate(path: Path, grid: Grid, found: Analysis) -> None:
    """Animate truth and analysis side by side."""
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    figure, axes = plt.subplots(2, 1, figsize=(5, 5.4), layout="constrained", sharex=True)
    points = np.stack(grid.mesh()).reshape(2, -1)
    images = []
    for ax, title in zip(axes, ("truth", "analysis from snapshots"), strict=True):
        images.append(
            ax.imshow(
                np.zeros(grid.nodes[::-1]), origin="lower", extent=[0, 4, 0, 2], vmin=0, vmax=0.6
            )
        )
        ax.set(title=title, ylabel="y")
    label = figure.suptitle("")

    def frame(k: int) -> list[Any]:
        state = found.states[k]
        exact = truth(points, state.t).reshape(grid.nodes) if state.t > 0 else 0.0 * state["u"]
        for image, u in zip(images, (exact, state["u"]), strict=True):
            image.set_data(u.T)
        label.set_text(f"t = {state.t:.2f}")
        return images

    film = FuncAnimation(figure, frame, frames=range(0, len(found.states), 2))
    film.save(path, writer=PillowWriter(fps=5))
    plt.close(figure)


if __name__ == "__main__":
    main()
