"""The same regulators on a device as on the host, and results that live where the inputs live."""

import importlib.util

import numpy as np
import pytest

from gpu import RiccatiError, care, lqe, lqr

pytestmark = pytest.mark.gpu
if importlib.util.find_spec("cupy") is None:
    pytest.skip("CuPy is not installed", allow_module_level=True)
import cupy  # noqa: E402

if not cupy.cuda.is_available():
    pytest.skip("no CUDA device", allow_module_level=True)


def problem(seed, n=40, m=3):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n)) / np.sqrt(n) - 0.8 * np.eye(n)
    B, C = rng.standard_normal((n, m)), rng.standard_normal((n, n))
    E = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
    return A, B, C.T @ C / n, np.diag(rng.uniform(0.5, 2.0, m)), 0.05 * C.T @ C @ B / n, E


@pytest.mark.parametrize("method", ["doubling", "newton"])
@pytest.mark.parametrize("seed", range(3))
def test_same_answer_on_both_sides(seed, method):
    A, B, Q, R, N, E = problem(seed)
    host = lqr(A, B, Q, R, N, E, method=method)
    device = lqr(*(cupy.asarray(M) for M in (A, B, Q, R, N, E)), method=method)
    assert isinstance(device.K, cupy.ndarray)
    assert isinstance(device.S, cupy.ndarray)
    assert device.converged
    np.testing.assert_allclose(device.K.get(), host.K, atol=1e-9 * np.abs(host.K).max())
    np.testing.assert_allclose(device.S.get(), host.S, atol=1e-9 * np.abs(host.S).max())


def test_riccati_equation_and_filter():
    A, B, Q, R, _, _ = (cupy.asarray(M) for M in problem(5))
    X = care(A, B, Q, R)
    residual = A.T @ X + X @ A - X @ B @ cupy.linalg.inv(R) @ B.T @ X + Q
    assert float(cupy.linalg.norm(residual)) <= 1e-12 * float(cupy.linalg.norm(X))
    L, P, _ = lqe(A.T, cupy.eye(len(A)), B.T, Q, R)
    assert float(cupy.linalg.norm(P - X)) <= 1e-10 * float(cupy.linalg.norm(X))
    assert L.shape == (40, 3)


def test_a_mode_without_input_is_named():
    A, B = cupy.diag(cupy.asarray([1.0, -1.0])), cupy.asarray([[0.0], [1.0]])
    with pytest.raises(RiccatiError, match="not stabilisable"):
        lqr(A, B, cupy.eye(2), 1.0)


def test_a_large_circulant():
    n = 2048
    A = np.roll(np.eye(n), 1, 0) + np.roll(np.eye(n), -1, 0) - 2 * np.eye(n)
    c = np.cos(2 * np.pi * np.arange(n) / n)
    column = np.fft.ifft(-2 + 2 * c + np.sqrt(5 - 8 * c + 4 * c * c)).real
    X = column[(np.arange(n)[:, None] - np.arange(n)) % n]
    S = lqr(cupy.asarray(A), cupy.eye(n), 1.0).S.get()
    assert np.linalg.norm(S - X) <= 1e-12 * np.linalg.norm(X)


@pytest.mark.parametrize("crossed", [False, True], ids=["", "N"])
@pytest.mark.parametrize("weight", ["factor", "diagonal"])
def test_sparse_matrices(weight, crossed):
    from cupyx.scipy import sparse as device
    from scipy import sparse

    n = 60
    lines = [np.full(n - 1, 40.0), np.full(n, -70.0), np.full(n - 1, 30.0)]
    A = sparse.csr_matrix(sparse.diags(lines, [-1, 0, 1]))
    B, C = np.zeros((n, 1)), np.zeros((1, n))
    B[20:25], C[0, 30:50] = 1.0, 3.0
    Q, factored = (C, True) if weight == "factor" else (np.linspace(1, 2, n), False)
    N = None if not crossed else 0.8 * C.T if factored else 0.3 * B
    host = lqr(A, B, Q, None, N, factored=factored)
    moved = [None if M is None else cupy.asarray(M) for M in (B, Q, N)]
    found = lqr(device.csr_matrix(A), *moved[:2], None, moved[2], factored=factored)
    assert isinstance(found.K, cupy.ndarray)
    assert found.stable
    np.testing.assert_allclose(found.K.get(), host.K, atol=1e-8 * np.abs(host.K).max())
