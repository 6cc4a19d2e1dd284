"""A small SQP method: a nonlinear program as a sequence of quadratic ones.

Problem 71 of W. Hock and K. Schittkowski (Test Examples for Nonlinear Programming Codes, 1981):

    min  x1 x4 (x1 + x2 + x3) + x3
    s.t. x1 x2 x3 x4 >= 25,   |x|^2 = 40,   1 <= x <= 5,

with the solution x = (1, 4.74299963, 3.82114998, 1.37940829), f = 17.0140173. At x_k, d solves

    min 1/2 d'B d + f'(x_k) d   s.t.  c(x_k) + c'(x_k) d >= 0,  e(x_k) + e'(x_k) d = 0,  bounds,

where B follows the Hessian of the Lagrangian by damped BFGS steps and stays positive definite
(M. J. D. Powell 1978); a step is halved until the l1 merit function falls. Each subproblem begins
at the active set of the one before.

    python examples/qp_sqp.py [--output out]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpu import QPFactor, QPResult, solve_qp

Array = np.ndarray
KNOWN = np.array([1.0, 4.74299963, 3.82114998, 1.37940829])
LOW, HIGH = np.ones(4), np.full(4, 5.0)


def objective(x: Array) -> tuple[float, Array]:
    """f and its gradient."""
    s = x[0] + x[1] + x[2]
    gradient = [x[3] * (s + x[0]), x[0] * x[3], x[0] * x[3] + 1.0, x[0] * s]
    return x[0] * x[3] * s + x[2], np.array(gradient)


def inequality(x: Array) -> tuple[float, Array]:
    """c >= 0 and its gradient."""
    return float(np.prod(x)) - 25.0, np.prod(x) / x


def equality(x: Array) -> tuple[float, Array]:
    """e = 0 and its gradient."""
    return float(x @ x) - 40.0, 2.0 * x


def merit(x: Array, weight: float) -> float:
    """f plus weighted violations."""
    return objective(x)[0] + weight * (max(0.0, -inequality(x)[0]) + abs(equality(x)[0]))


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Powell's update: `change` of the gradient, bent until B stays positive definite."""
    Bs, curvature = B @ step, step @ B @ step
    theta = 1.0
    if step @ change < 0.2 * curvature:
        theta = 0.8 * curvature / (curvature - step @ change)
    r = theta * change + (1.0 - theta) * Bs
    return B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / (step @ r)


def sqp(x: Array, tol: float = 1e-10) -> tuple[Array, QPResult, list[float]]:
    """All iterates, last subproblem, and the lengths of the steps."""
    B, weight, start, lengths, path = np.eye(len(x)), 1.0, None, [], [x]
    for _ in range(50):
        (_, df), (c, dc), (e, de) = objective(x), inequality(x), equality(x)
        start = solve_qp(
            QPFactor(B), df, G=-dc[None], h=[c], A=de[None], b=[-e],
            lb=LOW - x, ub=HIGH - x, start=start,
        )  # fmt: skip
        d = start.x
        lengths.append(float(np.linalg.norm(d)))
        if lengths[-1] <= tol:
            return np.array(path), start, lengths
        weight = max(weight, 2.0 * abs(start.y[0]), 2.0 * abs(start.z[0]))
        t, here = 1.0, merit(x, weight)
        while t > 1e-8 and merit(x + t * d, weight) > here:
            t *= 0.5
        step = t * d

        def lagrangian(at: Array, y: float = start.y[0], z: float = start.z[0]) -> Array:
            return objective(at)[1] + y * equality(at)[1] - z * inequality(at)[1]

        change = lagrangian(x + step) - lagrangian(x)
        x, B = np.clip(x + step, LOW, HIGH), damped_bfgs(B, step, change)
        path.append(x)
    raise RuntimeError(f"no convergence: the last step has length {lengths[-1]:.1e}")


def main(argv: Sequence[str] = ()) -> tuple[Array, QPResult, list[float]]:
    """Solve, print, draw, and compare with the published solution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    path, last, lengths = sqp(np.array([1.0, 5.0, 5.0, 1.0]))
    x = path[-1]
    for k, length in enumerate(lengths, 1):
        print(f"{k:3d}  |d| = {length:.2e}")
    print(f"x = {x.round(8)}, f = {objective(x)[0]:.7f}")
    print(f"multipliers: equality {last.y[0]:.6f}, inequality {last.z[0]:.6f}, bounds {last.z_box}")
    assert np.abs(x - KNOWN).max() < 1e-8
    assert abs(objective(x)[0] - 17.0140173) < 1e-7
    assert abs(inequality(x)[0]) < 1e-9
    assert abs(equality(x)[0]) < 1e-9
    picture(path, lengths, options.output)
    return x, last, lengths


def picture(path: Array, lengths: list[float], output: Path) -> None:
    """Draw the steps and the distances from the published solution."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    ax = figure.subplots()
    k = np.arange(1, len(lengths) + 1)
    ax.semilogy(k, lengths, "o-", label="length of the step |d|")
    ax.semilogy(
        k, np.linalg.norm(path - KNOWN, axis=1), "s-", label="distance from the published x"
    )
    ax.axhline(5e-9, color="0.5", ls="--", lw=1, label="half a unit of the last published digit")
    ax.set(xlabel="subproblem", ylabel="length, arbitrary units", xticks=k)
    ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "qp_sqp.png", dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
