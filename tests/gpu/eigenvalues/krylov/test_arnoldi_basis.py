"""The basis stays orthogonal over many restarts."""

import importlib

import numpy as np
import pytest

from gpu import eigs
from gpu.eigenvalues.krylov.arnoldi import Arnoldi


def unitary(n, rng, c=0.5):
    """Its Hessenberg form takes little away a step and lets rounding grow by a constant factor."""
    s = np.sqrt(1.0 - c * c)
    U = np.eye(n)
    for j in range(n - 1):
        U[:, j : j + 2] = U[:, j : j + 2] @ [[-c, s], [s, c]]
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return Q @ U @ Q.T


def toeplitz(n):
    return np.diag(np.ones(n - 1), -1) - 0.495 * sum(np.diag(np.ones(n - j), j) for j in range(4))


def stays_orthogonal(monkeypatch, A, k, xp=np, **options):
    """Before every restart: what lies beyond the spanned rows afterwards belongs to no basis."""
    kept, errors = [], []

    class Watched(Arnoldi):
        def __init__(self, *arguments, **named):
            super().__init__(*arguments, **named)
            kept.append(self)

        def rotate(self, Q, residual, first=0):
            V = self.V[: first + len(Q)]
            errors.append(float(xp.abs(V @ V.T - xp.eye(len(V))).max()))
            super().rotate(Q, residual, first)

    monkeypatch.setattr(
        importlib.import_module("gpu.eigenvalues.krylov.krylov_schur"), "Arnoldi", Watched
    )
    w, v = eigs(xp.asarray(A), k, **options)
    assert kept[-1].matvecs > 500
    assert len(errors) > 5
    assert max(errors) < 1e-12
    assert float(xp.abs(xp.asarray(A) @ v - v * w).max()) < 1e-7


@pytest.mark.parametrize("module", ["numpy", pytest.param("cupy", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("name", ["unitary", "toeplitz"])
def test_over_many_restarts(monkeypatch, name, module):
    xp, rng = importlib.import_module(module), np.random.default_rng(0)
    if name == "unitary":
        A, k, options = unitary(400, rng), 6, {"tol": 1e-8, "maxiter": 300}
    else:
        v0 = xp.asarray(rng.standard_normal(400))
        A, k, options = toeplitz(400), 40, {"v0": v0, "ncv": 80, "maxiter": 100}
    stays_orthogonal(monkeypatch, A, k, xp, **options)
