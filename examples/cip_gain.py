r"""One Kalman gain for all times: the stationary filter of a steady flow, by `gpu.lqe`.

    u_t + (1 + .3 sin 2 pi x) u_x = noise on the periodic unit interval, read by four sensors.

The step of the scheme is a matrix M that never changes, so the covariance before each analysis
tends to the solution of the discrete Riccati equation

    P = M P M' - M P H' (H P H' + R)^-1 H P M' + Q .

Cayley's transform, xi = (x_n + x_n+1) / sqrt 2 and eta = (x_n+1 - x_n) / sqrt 2, turns it into a
continuous one with the same solution, which `lqe` solves and certifies (Mehrmann, SIAM J. Matrix
Anal. Appl. 17, 1996, treats the transform). SciPy's discrete solver is shown beside it. The truth
is no run of the model: in the time tau that the flow takes from 0 to x it is a Fourier series,
which every step shifts.

    python examples/cip_gain.py --cells 40 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import solve_discrete_are

from cip import Covariance, Grid, Sensors, Solver, State, Velocity
from gpu import lqe

STEP = 0.1
SENSORS = np.array([0.11, 0.33, 0.62, 0.85])


def matrices(cells: int) -> tuple[Solver, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The solver, M, H, a square root of Q, and R."""
    grid = Grid((0, 1), cells, periodic=True)
    solver = Solver(grid, Velocity.from_expression("1 + 0.3*sin(2*pi*x1)"))
    size = 2 * cells
    units = np.eye(size).reshape(size, 2, cells)
    M = np.stack([solver.step(State(grid, "cubic", u), STEP).data.ravel() for u in units], axis=1)
    H = Sensors(SENSORS, [STEP]).rows(grid, "cubic").toarray()
    errors = Covariance.diffusion(grid, "cubic", deviation=0.1, length=0.2)
    return solver, M, H, errors.root @ np.eye(cells), 0.05**2 * np.eye(4)


def stationary_covariance(M: Any, H: Any, S: Any, R: Any) -> tuple[np.ndarray, Any]:
    """The covariance before an analysis, and what `lqe` says of it."""
    F = np.linalg.inv(M + np.eye(len(M)))  # M has no eigenvalue -1: a step does not flip signs
    A = F @ (M - np.eye(len(M)))
    G, C = np.sqrt(2) * F @ S, np.sqrt(2) * H @ F
    through = H @ F @ S
    found = lqe(A, G, C, np.eye(S.shape[1]), R + through @ through.T, -through.T)
    return np.asarray(found.S), found


class Truth:
    """The exact field: coefficients of exp(2 pi i k tau / T), with T the period of the flow."""

    def __init__(self) -> None:
        self.period, self.waves = 1 / np.sqrt(1 - 0.3**2), np.fft.fftfreq(256, 1 / 256)
        times = np.arange(256) / 256 * self.period
        self.places = solve_ivp(
            lambda _, x: 1 + 0.3 * np.sin(2 * np.pi * x), (0, self.period), [0.0], "DOP853", times,
            rtol=1e-11, atol=1e-12,
        ).y[0]  # fmt: skip
        self.coefficients = np.zeros(256, dtype=complex)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Rows that map the coefficients to the values at increasing points in [0, 1)."""
        times = solve_ivp(
            lambda x, _: [1 / (1 + 0.3 * np.sin(2 * np.pi * x))], (0, 1), [0.0], "DOP853", points,
            rtol=1e-11, atol=1e-12,
        ).y[0]  # fmt: skip
        return np.exp(2j * np.pi / self.period * np.multiply.outer(times, self.waves))

    def step(self, error: CubicHermiteSpline) -> None:
        """Let the flow act for a step, then add an error."""
        self.coefficients *= np.exp(-2j * np.pi * self.waves * STEP / self.period)
        self.coefficients += np.fft.fft(error(self.places)) / 256


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Compute the gain, filter with it, print and draw the errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    solver, M, H, S, R = matrices(options.cells)
    P, certificate = stationary_covariance(M, H, S, R)
    peer = solve_discrete_are(M.T, H.T, S @ S.T, R)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    after = P - K @ H @ P
    rng = np.random.default_rng(1)
    truth, estimate, errors = Truth(), np.zeros(len(M)), []
    (x,) = solver.grid.coordinates
    nodes, sensors = truth.at(x), truth.at(SENSORS)
    for _ in range(400):
        values, slopes = (S @ rng.standard_normal(S.shape[1])).reshape(2, -1)
        truth.step(
            CubicHermiteSpline(
                np.append(x, 1.0), *np.pad((values, slopes), ((0, 0), (0, 1)), mode="wrap")
            )
        )
        forecast = State(solver.grid, "cubic", estimate.reshape(2, -1))
        estimate = solver.step(forecast, STEP).data.ravel()
        report = (sensors @ truth.coefficients).real + np.sqrt(np.diag(R)) * rng.standard_normal(4)
        estimate = estimate + K @ (report - H @ estimate)
        errors.append(estimate[: options.cells] - (nodes @ truth.coefficients).real)
    found = {
        "to SciPy": float(np.abs(P - peer).max() / np.abs(peer).max()),
        "slowest": float(np.abs(np.linalg.eigvals(M - M @ K @ H)).max()),
        "expected": float(
            np.sqrt(np.trace(after[: options.cells, : options.cells]) / options.cells)
        ),
        "filtered": float(np.sqrt(np.mean(np.square(errors[20:])))),
    }
    print(certificate)
    print(", ".join(f"{name} {value:.3g}" for name, value in found.items()))
    draw(options.output / "cip_gain.png", solver.grid, K[: options.cells], np.array(errors), after)
    return found


def draw(path: Path, grid: Grid, K: Any, errors: Any, after: Any) -> None:
    """Draw the columns of the gain, and errors beside their deviation."""
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    x = grid.coordinates[0]
    left.plot(x, K)
    left.set(title="gain: what each sensor corrects", xlabel="x", ylabel="u for a report of 1")
    right.plot(x, np.sqrt(np.mean(errors[20:] ** 2, axis=0)), label="rms of 380 analyses")
    right.plot(x, np.sqrt(np.diag(after)[: x.size]), "k--", label="stationary covariance")
    right.set(title="error of the values", xlabel="x", ylim=0)
    right.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
