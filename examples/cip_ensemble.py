r"""The CIP model in an ensemble Kalman filter of DAPPER, beside weak-constraint 4D-Var.

    u_t + (1 + .3 sin 2 pi x) u_x = 0 on the periodic unit interval,

seen by six sensors at ten times, with model errors between them. Filters are not part of `cip`:
DAPPER (Raanes, Chen and Grudzien, J. Open Source Softw. 9(94), 2024, 5150) takes any function that
advances an ensemble, and has EnKF, LETKF, smoothers and particle filters. All that it needs from
here is `advance`, the rows of the sensors and the covariances. The problem is linear and
Gaussian, so the mean of a large ensemble tends to the end of the 4D-Var window. The truth is no run
of the model: start and model errors are taken at the feet of characteristics that SciPy integrates
(DOP853, tolerance 1e-11).

    pip install 'skfem-adini[ensemble]'
    python examples/cip_ensemble.py --members 400 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from cip import Covariance, Grid, Sensors, Solver, State, Velocity, four_d_var

STEP = 0.05
TIMES = np.arange(1, 11) * 2 * STEP


def function(error: State) -> CubicSpline:
    """The periodic spline through the values of a drawn error, which has its slopes too."""
    (x,), u = error.grid.coordinates, error["u"]
    return CubicSpline(np.append(x, 1.0), np.append(u, u[0]), bc_type="periodic")


def truth(points: np.ndarray, start: Any, errors: list[Any]) -> np.ndarray:
    """The exact field at points and at 0 and all times, after an error of the model before each."""
    run = solve_ivp(
        lambda _, x: -(1 + 0.3 * np.sin(2 * np.pi * x)), (0, TIMES[-1]), points,
        "DOP853", TIMES, rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    feet = [points, *run.y.T]  # after no interval, one, two and so on
    return np.stack(
        [
            start(feet[k]) + sum(error(feet[k - m]) for m, error in enumerate(errors[:k], 1))
            for k in range(len(feet))
        ]
    )


def problem(cells: int) -> tuple[Solver, State, Covariance, Covariance, Sensors, list[State]]:
    """Solver, background, both covariances, reports, and the true states that they are of."""
    grid = Grid((0, 1), cells, periodic=True)
    solver = Solver(grid, Velocity.from_expression("1 + 0.3*sin(2*pi*x1)"))
    background = solver.state("sin(2*pi*x1)")
    B = Covariance.diffusion(grid, "cubic", deviation=0.5, length=0.15)
    Q = Covariance.diffusion(grid, "cubic", deviation=0.05, length=0.15)
    first = function(B.draw(seed=1))
    errors = [function(Q.draw(seed=10 + k)) for k in range(len(TIMES))]

    def start(x: np.ndarray) -> Any:
        return np.sin(2 * np.pi * x) + first(x)

    exact = truth(grid.coordinates[0], start, errors)
    states = [State.from_function(u, grid, "cubic") for u in exact]
    plan = Sensors(np.arange(6) / 6 + 0.01, TIMES, deviations=0.05)
    reports = plan.with_values(truth(plan.points[0], start, errors)[1:]).perturbed(seed=2)
    return solver, background, B, Q, reports, states


def hidden_markov_model(
    solver: Solver, background: State, B: Covariance, Q: Covariance, sensors: Sensors
) -> Any:
    """What DAPPER asks for: dynamics, observations, times, the distribution of the start."""
    import dapper.mods as modelling
    from dapper.tools.chronos import Chronology
    from dapper.tools.randvars import RV, GaussRV

    shape, size = background.data.shape, background.data.size

    def advance(ensemble: np.ndarray, t: float, dt: float) -> np.ndarray:
        members = [State(solver.grid, solver.profile, x.reshape(shape), t) for x in
                   np.atleast_2d(ensemble)]  # fmt: skip
        after = np.stack([solver.step(member, dt).data.ravel() for member in members])
        return after.reshape(ensemble.shape)

    def random(covariance: Covariance, mean: Any) -> Any:
        rng = np.random.default_rng(5)
        rank = covariance.root.shape[1]
        return RV(size, func=lambda N: mean + (covariance.root @ rng.standard_normal((rank, N))).T)

    rows = sensors.rows(solver.grid, solver.profile).toarray()
    noise = GaussRV(C=sensors.deviations[0] ** 2, M=len(rows))
    step = TIMES[0]
    S = Q.root @ np.eye(Q.root.shape[1])
    return modelling.HiddenMarkovModel(
        {"M": size, "model": advance, "noise": GaussRV(C=S @ S.T / step)},
        {"M": len(rows), "model": lambda x: x @ rows.T, "linear": lambda x: rows, "noise": noise},
        Chronology(dt=step, dko=1, Ko=len(TIMES) - 1, BurnIn=0),
        random(B, background.data.ravel()),
    )


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run both, print and draw the states at the end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--members", type=int, default=400)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    try:
        import dapper.da_methods as methods
    except ImportError:
        print("skipped: DAPPER is not installed; pip install 'skfem-adini[ensemble]'")
        return {}
    solver, background, B, Q, sensors, states = problem(options.cells)
    HMM = hidden_markov_model(solver, background, B, Q, sensors)
    filtered = methods.EnKF("Sqrt", N=options.members, fnoise_treatm="Stoch")
    moments = np.stack([state.data.ravel() for state in states])
    filtered.assimilate(HMM, moments, sensors.values, liveplots=False)
    mean, spread = filtered.stats.mu.a[-1], filtered.stats.spread.a[-1]
    analysis = four_d_var(solver, background, B, sensors, dt=STEP / 4, model_error=Q)
    n = options.cells
    end, exact = analysis.states[-1]["u"], states[-1]["u"]
    found = {
        "between": float(np.sqrt(np.mean((mean[:n] - end) ** 2))),
        "filter": float(np.sqrt(np.mean((mean[:n] - exact) ** 2))),
        "4D-Var": float(np.sqrt(np.mean((end - exact) ** 2))),
        "spread": float(np.sqrt(np.mean(spread[:n] ** 2))),
    }
    print(
        "rms of the nodal values at the end: " + ", ".join(f"{k} {v:.4f}" for k, v in found.items())
    )
    draw(options.output / "cip_ensemble.png", solver.grid, mean[:n], spread[:n], end, exact)
    return found


def draw(path: Path, grid: Grid, mean: Any, spread: Any, end: Any, exact: Any) -> None:
    """Draw truth, ensemble and 4D-Var."""
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    x = grid.coordinates[0]
    ax.fill_between(x, mean - 2 * spread, mean + 2 * spread, alpha=0.3, label="2 deviations")
    ax.plot(x, mean, label="mean of the ensemble")
    ax.plot(x, end, "--", label="4D-Var")
    ax.plot(x, exact, "k:", label="truth")
    ax.set(xlabel="x", ylabel="u at the end")
    ax.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
