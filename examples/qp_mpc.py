"""Model predictive control: one matrix, a sequence of quadratic programs, warm starts.

A mass is moved by a force |u| <= 1 to the origin; its speed must not exceed 0.6. In steps of dt,

    s_{k+1} = F s_k + g u_k,   s = (position, speed),

and each time the force of the next N steps is planned that minimises sum s'Qs + R u^2 + a final
term. With the states eliminated, s = S s_0 + T u, this is a problem for u alone,

    min 1/2 u'Pu + (W s_0)'u   subject to   |u| <= 1,  |(S s_0 + T u)_speed| <= 0.6,

in which P never changes: it is factored once, and every problem begins at the active set of the
one before, shifted by one step. OSQP solves the same problems for comparison.

    python examples/qp_mpc.py
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import qpsolvers
from scipy import sparse
from scipy.linalg import solve_discrete_are

from gpu import QPFactor, QPResult, solve_qp

Array = np.ndarray
DT, FASTEST = 0.1, 0.6
# One plan in so many is also computed cold and by OSQP.
COMPARED = 3


def model(N: int) -> tuple[Array, Array, Array, Array]:
    """P, W, and the rows of the speeds: over u, and over the present state."""
    F, g = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[DT**2 / 2], [DT]])
    Q, R = np.diag([1.0, 0.1]), np.array([[0.02]])
    final = solve_discrete_are(F, g, Q, R)
    powers = [np.eye(2)]
    for _ in range(N):
        powers.append(F @ powers[-1])
    S = np.vstack(powers[1:])
    T = np.zeros((2 * N, N))
    for k in range(N):
        for j in range(k + 1):
            T[2 * k : 2 * k + 2, j] = (powers[k - j] @ g).ravel()
    weights = np.kron(np.eye(N), Q)
    weights[-2:, -2:] = final
    P = T.T @ weights @ T + R[0, 0] * np.eye(N)
    return (P + P.T) / 2, T.T @ weights @ S, T[1::2], S[1::2]


def shifted(result: QPResult) -> QPResult:
    """The plan of the last step as a first guess of the next: everything one step earlier."""
    from dataclasses import replace

    def earlier(v: Array) -> Array:
        return np.append(v[1:], v[-1:])

    return replace(
        result, x=earlier(result.x), z=earlier(result.z), active=earlier(result.active),
        active_rows=earlier(result.active_rows),
    )  # fmt: skip


def main(output: Path = Path("out"), N: int = 50, picture: bool = True) -> dict[str, Any]:
    """Drive the mass to the origin, print, compare, draw."""
    P, W, G, speeds = model(N)
    state, factor, previous = np.array([3.0, 0.0]), QPFactor(P), None
    step = np.array([[1.0, DT], [0.0, 1.0]])
    path, forces, counts, gaps, clock = [state], [], [], [], np.zeros(2)
    for k in range(75):
        q, free = W @ state, speeds @ state
        begin = time.perf_counter()
        plan = solve_qp(
            factor, q, G, FASTEST - free, lb=-1.0, ub=1.0, h_low=-FASTEST - free, start=previous
        )
        clock[0] += (time.perf_counter() - begin) * (k % COMPARED == 0)
        if k % COMPARED == 0:
            cold = solve_qp(
                factor, q, G, FASTEST - free, lb=-1.0, ub=1.0, h_low=-FASTEST - free
            ).iterations
            counts.append((plan.iterations, cold))
            both = np.concatenate([FASTEST - free, FASTEST + free])
            other = qpsolvers.Problem(
                sparse.csc_matrix(P), q, sparse.csc_matrix(np.vstack([G, -G])), both,
                lb=-np.ones(N), ub=np.ones(N),
            )  # fmt: skip
            begin = time.perf_counter()
            theirs = qpsolvers.solve_problem(
                other, "osqp", eps_abs=1e-7, eps_rel=1e-7, max_iter=50_000, polishing=False
            )
            clock[1] += time.perf_counter() - begin
            gaps.append(np.abs(plan.x - theirs.x).max())
        assert plan.kkt.worst < 1e-9
        u, previous = plan.x[0], shifted(plan)
        state = step @ state + np.array([DT**2 / 2, DT]) * u
        path.append(state)
        forces.append(u)
    path, forces, counts = np.array(path), np.array(forces), np.array(counts)
    print(f"{len(forces)} problems of {N} unknowns and {N} rows; at the end s = {state.round(4)}")
    print(f"active-set steps a problem: {counts.mean(axis=0)[0]:.1f} warm, "
          f"{counts.mean(axis=0)[1]:.1f} cold")  # fmt: skip
    print(f"seconds for one in {COMPARED}: {clock[0]:.3f}, OSQP {clock[1]:.3f}; "
          f"plans differ by {max(gaps):.1e} at most")  # fmt: skip
    assert np.abs(state).max() < 1e-2
    assert path[:, 1].min() > -FASTEST - 1e-9
    assert np.abs(forces).max() <= 1.0
    if picture:
        draw(path, forces, output)
    return {"path": path, "forces": forces, "counts": counts, "gaps": np.array(gaps)}


def draw(path: Array, forces: Array, output: Path) -> None:
    """Position, speed and force over time, with the bounds."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 1, figsize=(6, 6), sharex=True, layout="constrained")
    t = DT * np.arange(len(path))
    axes[0].plot(t, path[:, 0])
    axes[1].plot(t, path[:, 1])
    axes[1].axhline(-FASTEST, color="k", ls="--", lw=0.8)
    axes[2].step(t[:-1], forces, where="post")
    for bound in (-1.0, 1.0):
        axes[2].axhline(bound, color="k", ls="--", lw=0.8)
    for ax, name in zip(axes, ("position", "speed", "force"), strict=True):
        ax.set_ylabel(name)
    axes[-1].set_xlabel("time")
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "qp_mpc.png", dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
