"""Ten eigenvalues of a matrix that is known by its products only, and how they come.

A Gaussian matrix G of order n has its spectrum in a disc of radius sqrt(n) (Girko's circular law),
the hardest case for Krylov spaces: nothing sets the largest moduli apart. Five large
diagonal entries add separated values,

    A = G / sqrt(n) + diag(2.2, 2.0, 1.8, 1.6, 1.4, 0, ..., 0),

so that five eigenvalues come quickly and five slowly. Left: all eigenvalues by LAPACK and the ten
that `eigs` finds. Right: how many have converged after how many products, for three dimensions of
the space; a run that is cut off raises NotConverged, which carries what did converge. The last
steps are the search that shows that none was missed.

    python examples/eigs_spectrum.py --order 250 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.sparse.linalg import LinearOperator

from gpu import NotConverged, eigs

WANTED = 10


def matrix(n: int) -> np.ndarray:
    """Return A."""
    G = np.random.default_rng(1).standard_normal((n, n)) / np.sqrt(n)
    return G + np.diag(np.r_[2.2, 2.0, 1.8, 1.6, 1.4, np.zeros(n - 5)])


def history(A: np.ndarray, ncv: int) -> tuple[list[int], list[int]]:
    """Products and converged eigenvalues of runs with more and more restarts."""
    products, converged = [0], [0]
    while converged[-1] < WANTED:
        count = [0]

        def product(x: np.ndarray, count: list[int] = count) -> np.ndarray:
            count[0] += 1
            return A @ x

        operator = LinearOperator(A.shape, matvec=product, dtype=float)
        restarts = int(1.3 * len(products))
        try:
            found = eigs(
                operator, WANTED, ncv=ncv, maxiter=restarts, return_eigenvectors=False, tol=1e-10
            )
            done = len(found)
        except NotConverged as error:
            done = min(len(error.eigenvalues), WANTED - 1)
        products.append(count[0])
        converged.append(done)
    return products, converged


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Compute, compare with LAPACK, draw; return the errors and the products of each space."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--order", type=int, default=250)
    parser.add_argument("--output", type=Path, default=Path("out"))
    order, output = vars(parser.parse_args(arguments)).values()
    A = matrix(order)
    w, v = eigs(LinearOperator(A.shape, matvec=lambda x: A @ x, dtype=float), WANTED, tol=1e-10)
    true = np.linalg.eigvals(A)
    true = true[np.argsort(-np.abs(true))]
    shown = {
        "residual": float(np.linalg.norm(A @ v - v * w, axis=0).max()),
        "distance to LAPACK's": float(np.abs(w[:, None] - true[: WANTED + 1]).min(axis=1).max()),
    }

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    left.plot(true.real, true.imag, ".", color="0.6", markersize=3, label="LAPACK")
    left.plot(w.real, w.imag, "o", mfc="none", mec="C3", label=f"eigs, k = {WANTED}")
    left.set(aspect="equal", xlabel="real part", ylabel="imaginary part")
    left.legend(loc="lower right")
    for ncv in (25, 40, 60):
        products, converged = history(A, ncv)
        right.step(products, converged, where="post", label=f"ncv = {ncv}")
        shown[f"products, ncv = {ncv}"] = products[-1]
    right.set(xlabel="products", ylabel="eigenvalues returned", ylim=(0, WANTED + 0.5))
    right.legend(loc="lower right")
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "eigs_spectrum.png", dpi=120)
    plt.close(figure)
    for name, value in shown.items():
        print(f"{name}: {value:.3g}")
    return shown


if __name__ == "__main__":
    main()
