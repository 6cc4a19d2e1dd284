"""Penalties tend to multipliers.

Section 6.1 of the 2012 dissertation begins with the penalty form of

    min 1/2 x'Px + q'x  subject to  Ax = b, Gx <= h,

which is, for a large number beta, corrected for the signs of (6.2) and (6.3),

    Px + q + beta A'(Ax - b) + beta G' max(0, Gx - h) = 0,

and says that lambda = beta (Ax - b), mu = beta max(0, Gx - h) tend to the multipliers. They do so
like 1/beta where the active rows are independent, as the pictures and the assertion show.
Newton's method on the equation is an active set again: with the rows B that are violated,

    (P  B') (x )   (-q)
    (B -I/beta) (nu) = (r ),    solved as it stands, it is well conditioned for every beta.

    python examples/qp_penalty.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpu import QPResult, solve_qp

Array = np.ndarray


def problem(n: int = 60, m: int = 5, l: int = 40, seed: int = 0) -> tuple[Array, ...]:
    """A random strictly convex problem: P, q, G, h, A, b."""
    rng = np.random.default_rng(seed)
    M, x = rng.standard_normal((n, n)), rng.standard_normal(n)
    G, A = rng.standard_normal((l, n)), rng.standard_normal((m, n))
    return M @ M.T / n + np.eye(n), rng.standard_normal(n), G, G @ x + rng.random(l), A, A @ x


def penalised(data: tuple[Array, ...], beta: float) -> tuple[Array, Array, Array]:
    """x, lambda and mu of the penalty form, by Newton's method."""
    P, q, G, h, A, b = data
    n, m = len(q), len(b)
    violated = np.zeros(len(h), dtype=bool)
    for _ in range(50):
        B, r = np.vstack([A, G[violated]]), np.concatenate([b, h[violated]])
        K = np.block([[P, B.T], [B, -np.eye(len(r)) / beta]])
        solution = np.linalg.solve(K, np.concatenate([-q, r]))
        x, nu = solution[:n], solution[n:]
        before, violated = violated, G @ x > h
        if np.array_equal(before, violated):
            mu = np.zeros(len(h))
            mu[violated] = nu[m:]
            return x, nu[:m], mu
    raise RuntimeError(f"Newton's method has not settled for beta = {beta:g}")


def main(output: Path = Path("out"), picture: bool = True) -> tuple[Array, Array, QPResult]:
    """Print the errors over beta, assert their order, draw them."""
    data = problem()
    exact = solve_qp(*data)
    betas = 10.0 ** np.arange(1, 9)
    errors = np.array(
        [
            [
                np.linalg.norm(value - limit) / np.linalg.norm(limit)
                for value, limit in zip(
                    penalised(data, beta), (exact.x, exact.y, exact.z), strict=True
                )
            ]
            for beta in betas
        ]
    )
    print(f"{int((exact.z > 0).sum())} of {len(exact.z)} inequality rows are active; {exact.kkt}")
    print("    beta   error of x    of lambda        of mu")
    for beta, row in zip(betas, errors, strict=True):
        print(f"{beta:8.0e}  " + "  ".join(f"{e:11.2e}" for e in row))
    slopes = [np.polyfit(np.log10(betas[2:]), np.log10(e), 1)[0] for e in errors[2:].T]
    print("orders in 1/beta: " + ", ".join(f"{-slope:.3f}" for slope in slopes))
    assert np.allclose(slopes, -1.0, atol=0.05)
    if picture:
        draw(betas, errors, output)
    return betas, errors, exact


def draw(betas: Array, errors: Array, output: Path) -> None:
    """Errors over beta, both axes logarithmic."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(5, 4), layout="constrained")
    for values, name in zip(errors.T, ("$x$", r"$\lambda$", r"$\mu$"), strict=True):
        ax.loglog(betas, values, "o-", label=name)
    ax.loglog(betas, 3.0 / betas, "k--", label=r"$3/\beta$")
    ax.set(xlabel=r"penalty $\beta$", ylabel="relative error")
    ax.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "qp_penalty.png", dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
