"""The device's Arnoldi sweeps beside products and Gram-Schmidt in NumPy."""

import numpy as np
import pytest
from scipy import stats

pytestmark = pytest.mark.gpu


@pytest.fixture(scope="module")
def cupy():
    module = pytest.importorskip("cupy", reason="no CuPy: pip install 'skfem-adini[cuda13]'")
    if not module.cuda.is_available():
        pytest.skip("no CUDA device")
    return module


def start(cupy, A, size, seed=0):
    from gpu.arnoldi_kernels import FusedSteps

    V = cupy.full((size + 1, len(A)), np.nan)
    v = np.random.default_rng(seed).standard_normal(len(A))
    V[0] = cupy.asarray(v / np.linalg.norm(v))
    rows = cupy.full((size, size + 2), np.nan)
    return V, rows, FusedSteps(V, rows)


def hessenberg(rows, count):
    H = np.zeros((count + 1, count))
    for j in range(count):
        H[: j + 1, j], H[j + 1, j] = rows[j, : j + 1], rows[j, -1]
    return H


# Below one row a block, odd and even, one row more than the warps of a block hold, several tiles.
@pytest.mark.parametrize("n", [30, 131, 400, 1001, 4400, 6400, 12801])
@pytest.mark.parametrize("way", ["sweep", "steps", "both"])
def test_decomposition(cupy, n, way):
    rng = np.random.default_rng(n)
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    device, size = cupy.asarray(A), 24
    V, rows, fused = start(cupy, A, size)
    assert fused.multiplies(device)
    middle = {"sweep": size, "steps": 0, "both": 11}[way]
    fused.sweep(device, 0, middle)
    for j in range(middle, size):
        fused(device @ V[j], j)
    basis, H = V.get(), hessenberg(rows.get(), size)
    # Sums of n terms of size one: rounding grows like the root of n at most.
    limit = 1e-14 * np.sqrt(n)
    assert np.abs(basis @ basis.T - np.eye(size + 1)).max() < limit
    assert np.abs(A @ basis[:-1].T - basis.T @ H).max() < limit


def test_sweep_goes_on_from_a_full_column(cupy):
    """After a restart the first column is not Hessenberg; what the kernel wrote is the same."""
    n, size = 500, 40
    A = cupy.asarray(np.random.default_rng(2).standard_normal((n, n)))
    V, rows, fused = start(cupy, A, size)
    fused.sweep(A, 0, size)
    once, coefficients = V.get(), rows.get()
    fused.sweep(A, 15, 30)
    fused.sweep(A, 30, size)
    # Bit by bit: sums have a fixed order.
    assert np.array_equal(V.get(), once)
    assert np.array_equal(rows.get()[:, -1], coefficients[:, -1])


def test_invariant_space_leaves_a_beta_of_round_off(cupy):
    A = cupy.asarray(np.diag(np.repeat([1.0, 2.0, 5.0], 100)))
    _, rows, fused = start(cupy, A, 10)
    fused.sweep(A, 0, 10)
    assert float(rows[1, -1]) > 0.1
    assert float(rows[2, -1]) < 1e-14


@pytest.mark.parametrize("n", [300, 70001])
def test_random_start(cupy, n):
    """Unit vectors orthogonal to those before them; normal entries, another seed another vector."""
    from gpu.arnoldi_kernels import FusedSteps

    V, rows = cupy.full((6, n), np.nan), cupy.full((5, 7), np.nan)
    fused = FusedSteps(V, rows)
    for place in range(6):
        fused.random_start(place, place)
    basis = V.get()
    assert np.abs(basis @ basis.T - np.eye(6)).max() < 1e-14
    first = np.sort(basis[0]) * np.sqrt(n)
    # Kolmogorov-Smirnov at a chance of 1e-6.
    assert np.abs(stats.norm.cdf(first) - np.arange(n) / n).max() < 2.7 / np.sqrt(n)


def test_zero_matrix(cupy):
    A = cupy.zeros((200, 200))
    V, rows, fused = start(cupy, A, 5)
    fused.sweep(A, 0, 5)
    assert not cupy.asnumpy(V[1:]).any()
    assert not hessenberg(rows.get(), 5).any()


def test_large_space_needs_more_shared_memory(cupy):
    """2,500 coefficients a step do not fit into the 48 KiB that need no asking."""
    n, size = 3000, 2500
    A = cupy.asarray(np.random.default_rng(3).standard_normal((n, n)) / np.sqrt(n))
    V, _, fused = start(cupy, A, size)
    fused.sweep(A, 0, 60)
    basis = V[:61].get()
    assert np.abs(basis @ basis.T - np.eye(61)).max() < 1e-12


def test_views_that_the_kernel_cannot_read(cupy):
    from gpu.arnoldi_kernels import FusedSteps

    A = cupy.zeros((40, 40))
    assert FusedSteps.multiplies(A)
    assert not FusedSteps.multiplies(A.T[:, ::2])
    assert not FusedSteps.multiplies(A.astype(np.float32))
    assert not FusedSteps.multiplies(cupy.zeros(1601)[1:].reshape(40, 40))
