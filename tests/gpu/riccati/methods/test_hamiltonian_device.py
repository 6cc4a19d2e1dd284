"""The inverse Hamiltonian and its gains with CuPy: what NumPy gives, to rounding."""

import numpy as np
import pytest
from scipy import sparse

from gpu import hamiltonian_inverse
from gpu.riccati.methods.hamiltonian import solve as algorithm5
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import check_lqr

pytestmark = pytest.mark.gpu


def heat(N):
    k = np.arange(N)
    norm = np.where(k > 0, np.sqrt(2), 1.0)
    wave = np.maximum(k, 1) * np.pi
    c = np.where(k > 0, norm * (np.sin(0.77 * wave) - np.sin(0.3 * wave)) / wave, 0.47)
    near = c[:, None, None] * c[:, None] * norm
    A = -(np.pi**2) * (k[:, None, None] ** 2.0 + k[:, None] ** 2 + k**2).ravel()
    return A, np.stack([near.ravel(), (near * (-1.0) ** k).ravel()], axis=1)


def on_device(A):
    import cupy
    from cupyx.scipy import sparse as device

    return device.csr_matrix(A) if sparse.issparse(A) else cupy.asarray(A)


STORED = {"diagonal": lambda a: a, "dense": np.diag, "sparse": lambda a: sparse.diags(a).tocsr()}


@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
def test_inverse(stored):
    A, B = heat(6)
    A = stored(A)
    v = np.random.default_rng(0).standard_normal(2 * len(B))
    here = hamiltonian_inverse(A, B, 1.0)
    there = hamiltonian_inverse(on_device(A), on_device(B), 1.0)
    for name in ("matvec", "rmatvec"):
        x, y = getattr(here, name)(v), getattr(there, name)(on_device(v))
        assert type(y).__module__.startswith("cupy")
        assert np.linalg.norm(x - y.get()) < 1e-11 * np.linalg.norm(x)


@pytest.mark.parametrize("pi", ["printed", "symmetric"])
@pytest.mark.parametrize("stored", [np.diag, np.array], ids=["dense", "diagonal"])
def test_algorithm5(pi, stored):
    A, B = heat(7)
    # Apart: of repeated eigenvalues rounding decides which copies are met, and which cut off.
    A = stored(A * np.random.default_rng(3).uniform(1.0, 1.5, A.size))
    options = {"modes": 30, "pi": pi, "start": "random"}
    here = algorithm5(check_lqr(A, B, 1.0, np.eye(2)), **options)
    there = algorithm5(check_lqr(on_device(A), on_device(B), 1.0, np.eye(2)), **options)
    K = there.gain.get()
    assert np.linalg.norm(here.gain - K) < 1e-7 * np.linalg.norm(K)


@pytest.mark.parametrize("Q", ["identity", "diagonal", "factor"])
def test_reduced(Q):
    A, B = heat(6)
    n = len(A)
    Q = {
        "identity": 1.0,
        "diagonal": np.linspace(0.5, 2.0, n),
        "factor": np.ones((1, n)) / np.arange(1, n + 1),
    }[Q]
    moved = Q if np.ndim(Q) == 0 else on_device(Q)
    factored = np.ndim(Q) == 2
    here = reduced(check_lqr(A, B, Q, np.eye(2), factored=factored))
    there = reduced(check_lqr(on_device(A), on_device(B), moved, np.eye(2), factored=factored))
    K = there.gain.get()
    assert np.linalg.norm(here.gain - K) < 1e-8 * np.linalg.norm(K)
