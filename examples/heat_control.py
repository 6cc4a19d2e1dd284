r"""Boundary control of the heat equation: Table 6.2 with the accuracy that was left out.

The model is that of `heat_model.py`: modes of (0, 1)^3, or of the square for the animation, heated
and cooled on a patch of two opposite sides. The gain K of u = -K y comes

* from the L eigenvectors of the inverse Hamiltonian nearest to zero: Algorithm 5 as printed, and
  its symmetric form, which has the same eigenvectors;
* from the default method, a projection onto a rational Krylov space of about 25 vectors.

The table gives the error of the gain, |K_L - K| / |K|, the largest relative loss of cost over all
initial states among the slowest 120 modes, and the slowest pole of the closed loop, without control
0. The pictures: a hot corner of the square spreads, once left alone, once controlled; and the
errors of the gains over L.

    python examples/heat_control.py --modes 8 --subspaces 30 60 120 --output out
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import linalg

from gpu import lqr

sys.path.insert(0, str(Path(__file__).parent))
from heat_model import heat_modes

INPUTS = np.eye(2)  # R
ONES = np.ones((3, 3, 1), dtype=np.uint8)  # a pixel becomes nine


def loss_of_cost(A: np.ndarray, B: np.ndarray, K: np.ndarray, best: np.ndarray) -> float:
    """Return the largest (x.P_K x - x.P x) / x.P x over initial states x.

    P_K - P solves a Lyapunov equation of the closed loop with (K - K*)^T (K - K*).
    """
    slow = np.argsort(-A)[:120]
    A, B, K, best = np.diag(A[slow]), B[slow], K[:, slow], best[:, slow]
    D = K - best
    excess = linalg.solve_continuous_lyapunov((A - B @ K).T, -D.T @ D)
    value = linalg.solve_continuous_lyapunov((A - B @ best).T, -np.eye(len(A)) - best.T @ best)
    return float(linalg.eigh(excess, value, eigvals_only=True)[-1])


def table(N: int, subspaces: Sequence[int]) -> dict[str, Any]:
    """Print the errors of the gains on N^3 modes and return them by method and L."""
    A, B = heat_modes(N)
    begin = time.perf_counter()
    best = lqr(A, B, 1.0, INPUTS)
    spent = time.perf_counter() - begin
    newton = lqr(A, B, 1.0, INPUTS, refine=True)
    error = np.linalg.norm(best.K - newton.K) / np.linalg.norm(newton.K)
    print(f"{N}^3 = {N**3} modes       gain error   loss of cost   slowest pole   seconds")
    print(
        f"rank {best.info['rank']:3d}, default   {error:12.1e}   {'':12s} {best.abscissa:13.6f}"
        f"   {spent:8.2f}"
    )
    rows: dict[str, Any] = {"default": (0, error, best.abscissa)}
    for L in subspaces:
        for pi in ("printed", "symmetric"):
            begin = time.perf_counter()
            result = lqr(A, B, 1.0, INPUTS, method="hamiltonian", modes=L, pi=pi)
            spent = time.perf_counter() - begin
            error = np.linalg.norm(result.K - best.K) / np.linalg.norm(best.K)
            loss = loss_of_cost(A, B, result.K, best.K)
            print(
                f"L = {L:3d}, {pi:10s}  {error:10.2e}   {loss:12.2e} {result.abscissa:13.6f}"
                f"   {spent:8.2f}"
            )
            rows[f"{pi} {L}"] = (L, error, result.abscissa)
    return rows


def simulate(
    N: int, times: np.ndarray, controlled: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return temperatures on a grid of the square, inputs, and |y|^2, at the times.

    The closed loop is linear: its eigenvectors carry the modes from frame to frame.
    """
    A, B = heat_modes(N, dim=2)
    K = lqr(A, B, 1.0, INPUTS).K * controlled
    points = np.linspace(0, 1, 81)
    waves = np.cos(np.pi * np.outer(points, np.arange(N))) * np.r_[1, np.full(N - 1, np.sqrt(2))]
    weights = np.full(points.size, points[1])
    weights[[0, -1]] /= 2
    hot = np.exp(-((points[:, None] - 0.2) ** 2 + (points - 0.25) ** 2) / 0.02)
    y = ((waves.T * weights) @ (4 * hot) @ (waves.T * weights).T).ravel()
    poles, vectors = np.linalg.eig(np.diag(A) - B @ K)
    decay = np.exp(np.outer(times, poles)) * np.linalg.solve(vectors, y + 0j)
    states = (decay @ vectors.T).real
    fields = np.einsum("xk,tkl,yl->txy", waves, states.reshape(-1, N, N), waves)
    return fields, -states @ K.T, (states**2).sum(axis=1)


def pictures(N: int, folder: Path) -> tuple[float, float]:
    """Write the animation; return the final |y| without and with control."""
    import matplotlib.pyplot as plt
    from PIL import Image

    times = 4 * np.linspace(0, 1, 41) ** 2  # mixing is fast, control is slow
    free, _, left = simulate(N, times, controlled=False)
    driven, u, right = simulate(N, times, controlled=True)
    top = 2 * free[-1].mean()
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.4), layout="constrained")
    for ax, field, i, title in zip(
        axes, (free, free, driven), (4, 20, 20), ("left alone", "left alone", "controlled"),
        strict=False,
    ):  # fmt: skip
        image = ax.imshow(
            field[i].T, origin="lower", extent=(0, 1, 0, 1), cmap="inferno", vmin=0, vmax=top
        )
        ax.set(title=f"{title}, $t = {times[i]:.2g}$", xlabel="$x$", ylabel="$z$")
        for side in (0, 1):
            ax.plot((0.3, 0.77), (side, side), "c", lw=5, solid_capstyle="butt", clip_on=False)
    figure.colorbar(image, ax=axes[2], label="temperature")
    for k, side in enumerate(("$z = 0$", "$z = 1$")):
        axes[3].plot(times, u[:, k], "--" if k else "-", label=f"heat flux through {side}")
    axes[3].plot(times, np.sqrt(left), "k:", label="$|y|$, left alone")
    axes[3].plot(times, np.sqrt(right), "k", label="$|y|$, controlled")
    axes[3].set(xlabel="time", title="inputs and norm")
    axes[3].legend(fontsize=8)
    figure.savefig(folder / "heat_control.png", dpi=130)
    plt.close(figure)

    paint, frames = plt.get_cmap("inferno"), []
    for pair in zip(free, driven, strict=True):
        squares = [paint(np.clip(field.T[::-1] / top, 0, 1), bytes=True) for field in pair]
        gap = np.full((len(squares[0]), 8, 4), 255, dtype=np.uint8)
        pixels = np.hstack([squares[0], gap, squares[1]])[..., :3]
        frames.append(Image.fromarray(np.ascontiguousarray(np.kron(pixels, ONES))))
    frames[0].save(
        folder / "heat_control.gif", save_all=True, append_images=frames[1:], duration=120, loop=0
    )
    return float(np.sqrt(left[-1])), float(np.sqrt(right[-1]))


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print the table, write the pictures, return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modes", type=int, default=7, help="N modes an axis of the cube")
    parser.add_argument("--subspaces", type=int, nargs="+", default=[30, 60])
    parser.add_argument("--output", type=Path, default=Path("out"))
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    rows = table(options.modes, options.subspaces)
    free, driven = pictures(14, options.output)
    print(f"|y| at time 4: {free:.3f} left alone, {driven:.3f} controlled")
    assert rows["default"][1] < 1e-9
    assert driven < 0.4 * free
    print(f"written to {options.output}: heat_control.png, heat_control.gif")
    return rows | {"free": free, "driven": driven}


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
