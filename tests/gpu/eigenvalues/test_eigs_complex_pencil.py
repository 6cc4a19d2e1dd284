"""A complex A beside a real M: eigenvalues of the pencil, however M is stored."""

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator

from gpu import eigs

N = 300  # beyond the order that is decomposed fully


@pytest.mark.parametrize("sigma", [None, 0.5])
@pytest.mark.parametrize("store", [np.asarray, sparse.csr_array], ids=["dense", "sparse"])
def test_complex_beside_real(store, sigma):
    rng = np.random.default_rng(8)
    A = np.diag(np.linspace(1.0, 2.0, N) * np.exp(1j * np.arange(N)))
    A[0, 0], A[1, 1], A[2, 2], A[3, 3] = 9.0j, -8.0, 7.0 + 1.0j, 5.0
    A[:-1, 1:] += 0.1 * np.diag(rng.standard_normal(N - 1))
    M = np.diag(1.0 + rng.random(N))
    w, v = eigs(store(A), 3, M=store(M), sigma=sigma)
    assert np.linalg.norm(A @ v - M @ v * w, axis=0).max() < 1e-10
    true = linalg.eigvals(A, M)
    order = -np.abs(true) if sigma is None else np.abs(true - sigma)
    np.testing.assert_allclose(w, true[np.argsort(order)[:3]], atol=1e-10)


def test_complex_operator_beside_real():
    d = np.linspace(1.0, 2.0, N) * np.exp(1j * np.arange(N))
    d[:3] *= np.array([9.0, 8.0, 7.0])
    m = 1.0 + np.arange(N) / N
    A = LinearOperator((N, N), matvec=lambda x: d * np.ravel(x), dtype=complex)
    w, _ = eigs(A, 2, M=sparse.diags_array(m, format="csr"))
    np.testing.assert_allclose(w, (d / m)[np.argsort(-np.abs(d / m))[:2]], atol=1e-10)
