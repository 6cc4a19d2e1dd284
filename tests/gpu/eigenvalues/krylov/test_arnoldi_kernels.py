"""The device's Arnoldi sweeps beside products and Gram-Schmidt in NumPy."""

import numpy as np
import pytest
from scipy import stats

from gpu import InputError
from gpu.eigenvalues.krylov.arnoldi import ArnoldiSteps

pytestmark = pytest.mark.gpu


@pytest.fixture(scope="module")
def cupy():
    import cupy as module

    return module


def start(cupy, A, size, seed=0):
    from gpu.eigenvalues.krylov.arnoldi import FusedSteps

    V = cupy.full((size + 1, len(A)), np.nan)
    v = np.random.default_rng(seed).standard_normal(len(A))
    V[0] = cupy.asarray(v / np.linalg.norm(v))
    rows = cupy.full((size, 2, size + 2), np.nan)
    return V, rows, FusedSteps(V, rows)


def hessenberg(rows, *ends):
    """From sweeps, and from single steps at the end, the last column's beta below."""
    rows = np.nan_to_num(rows.get())  # what lies beyond a step's own entries is not written
    H, first = np.zeros((ends[-1] + 1, ends[-1])), 0
    for last in ends:
        ArnoldiSteps.of(rows[first:last]).project(H, first, last)
        H[last, last - 1] = rows[last - 1, 0, -1]
        first = last
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
    basis, H = V.get(), hessenberg(rows, *sorted({middle or size, size}))
    # Sums of n terms of size one: rounding grows like the root of n at most.
    limit = 1e-14 * np.sqrt(n)
    assert np.abs(basis @ basis.T - np.eye(size + 1)).max() < limit
    assert np.abs(A @ basis[:-1].T - basis.T @ H).max() < limit


def test_sweeps_repeat_bit_by_bit_and_go_on(cupy):
    n, size = 500, 40
    A = cupy.asarray(np.random.default_rng(2).standard_normal((n, n)))
    V, rows, fused = start(cupy, A, size)
    fused.sweep(A, 0, size)
    once, coefficients = V.get(), rows.get()
    fused.sweep(A, 0, size)
    assert np.array_equal(V.get(), once)
    assert np.array_equal(rows.get(), coefficients, equal_nan=True)
    fused.sweep(A, 15, 30)
    fused.sweep(A, 30, size)
    assert np.abs(V.get() - once).max() < 1e-11
    assert np.abs(rows.get()[:, 0, -1] - coefficients[:, 0, -1]).max() < 1e-11 * np.sqrt(n)


# Matrices whose products lie nearly in the space of those before, from noise.
NEARLY_INVARIANT = {
    "few and little": lambda noise: noise[:, :12] @ noise[:12] + 1e-9 * noise.T,
    "three and little": lambda noise: (
        np.diag(np.repeat([1.0, 2.0, 5.0], len(noise) // 3)) + 1e-12 * noise
    ),
    "graded": lambda noise: 10.0 ** -np.linspace(0, 30, len(noise))[:, None] * noise,
    "falling": lambda noise: np.diag(0.5 ** np.arange(len(noise))),
    "huge": lambda noise: 1e100 * noise,
    "tiny": lambda noise: 1e-100 * noise,
}


@pytest.mark.parametrize("name", NEARLY_INVARIANT)
def test_where_hardly_anything_is_left(cupy, name):
    """The basis stays orthogonal and ``A V = V H`` holds, by what is known of the second pass."""
    n, size = 300, 40
    A = NEARLY_INVARIANT[name](np.random.default_rng(7).standard_normal((n, n)))
    device = cupy.asarray(A)
    V, rows, fused = start(cupy, A, size)
    ends = (7, 25, size)
    for first, last in zip((0, *ends), ends, strict=False):
        fused.sweep(device, first, last)
    basis, H = V.get(), hessenberg(rows, *ends)
    assert np.abs(basis @ basis.T - np.eye(size + 1)).max() < 1e-14
    largest = np.abs(H).max()
    assert np.abs(A @ basis[:-1].T / largest - basis.T @ (H / largest)).max() < 1e-14


def test_invariant_spaces_and_zero_matrices(cupy):
    A = cupy.asarray(np.diag(np.repeat([1.0, 2.0, 5.0], 100)))
    _, rows, fused = start(cupy, A, 10)
    fused.sweep(A, 0, 10)
    assert float(rows[1, 0, -1]) > 0.1
    assert float(rows[2, 0, -1]) < 1e-14
    V, rows, fused = start(cupy, 0 * A, 5)
    fused.sweep(0 * A, 0, 5)
    assert not cupy.asnumpy(V[1:]).any()
    assert not hessenberg(rows, 5).any()


@pytest.mark.parametrize("n", [300, 70001])
def test_random_start(cupy, n):
    """Unit vectors orthogonal to those before them; normal entries, another seed another vector."""
    from gpu.eigenvalues.krylov.arnoldi import FusedSteps

    V, rows = cupy.full((6, n), np.nan), cupy.full((5, 2, 7), np.nan)
    fused = FusedSteps(V, rows)
    for place in range(6):
        fused.random_start(place, place)
    basis = V.get()
    assert np.abs(basis @ basis.T - np.eye(6)).max() < 1e-14
    first = np.sort(basis[0]) * np.sqrt(n)
    # Kolmogorov-Smirnov at a chance of 1e-6.
    assert np.abs(stats.norm.cdf(first) - np.arange(n) / n).max() < 2.7 / np.sqrt(n)


def test_large_space_needs_more_shared_memory(cupy):
    """2,500 coefficients a step do not fit into the 48 KiB that need no asking."""
    n, size = 3000, 2500
    A = cupy.asarray(np.random.default_rng(3).standard_normal((n, n)) / np.sqrt(n))
    V, _, fused = start(cupy, A, size)
    assert not fused.multiplies(A)
    for j in range(60):
        fused(A @ V[j], j)
    basis = V[:61].get()
    assert np.abs(basis @ basis.T - np.eye(61)).max() < 1e-12


@pytest.mark.parametrize(("near", "stay", "ahead"), [(0, 0, 300), (100, 77, 0), (2000, 0, 0)])
def test_what_a_block_keeps_changes_rounding_only(cupy, near, stay, ahead):
    n, size = 2000, 12
    A = cupy.asarray(np.random.default_rng(4).standard_normal((n, n)) / np.sqrt(n))
    V, rows, fused = start(cupy, A, size)
    fused.sweep(A, 0, size)
    expected = V.get()
    W, again, other = start(cupy, A, size)
    other.near, other.stay, other.ahead = min(near, other.near), stay, ahead
    other.sweep(A, 0, size)
    assert np.abs(W.get() - expected).max() < 1e-12
    assert np.abs(again[:, 0, -1].get() - rows[:, 0, -1].get()).max() < 1e-12


def test_views_that_the_kernel_cannot_read(cupy):
    A = cupy.zeros((40, 40))
    _, _, fused = start(cupy, A, 5)
    assert fused.multiplies(A)
    assert fused.multiplies(cupy.zeros(1601)[1:].reshape(40, 40))
    assert not fused.multiplies(A.T[:, ::2])
    assert not fused.multiplies(A.astype(np.float32))


@pytest.mark.parametrize(("n", "count", "kept"), [(1000, 40, 28), (33, 7, 1), (4001, 192, 190)])
def test_rotation_in_place(cupy, n, count, kept):
    from gpu.eigenvalues.krylov.ritz_pairs import rotate, turns

    rng = np.random.default_rng(n)
    V = rng.standard_normal((count + 1, n))
    Q = np.linalg.qr(rng.standard_normal((count, count)))[0][:, :kept]
    device = cupy.asarray(V)
    assert turns(count)
    rotate(device, Q, count)
    assert np.abs(device[:kept].get() - Q.T @ V[:count]).max() < 1e-12
    assert np.array_equal(device[kept].get(), V[count])


def test_vectors_and_residuals_of_pairs(cupy):
    """Real values, both members of a pair, a single member, and a mass matrix."""
    from gpu.eigenvalues.krylov.ritz_pairs import pairs_with_residuals

    rng = np.random.default_rng(5)
    n, c = 700, 6
    A, M = rng.standard_normal((2, n, n))
    V = np.ascontiguousarray(np.linalg.qr(rng.standard_normal((n, c)))[0].T)
    Y = rng.standard_normal((c, 4)) + 1j * rng.standard_normal((c, 4))
    Y[:, 0] = Y[:, 0].real
    Y[:, 2] = Y[:, 1].conj()
    values = np.array([1.5, 0.3 + 2j, 0.3 - 2j, -1 + 0.5j])
    for mass in (None, M):
        weight = None if mass is None else cupy.asarray(mass)
        arguments = cupy.asarray(V), Y, values, cupy.asarray(A), weight
        shown, X, squares = pairs_with_residuals(*arguments)
        expected = V.T @ Y
        assert np.abs(X.get() - expected).max() < 1e-13
        right = expected if mass is None else mass @ expected
        error = np.linalg.norm(A @ expected - right * values, axis=0)
        assert np.array_equal(shown.get(), values)
        norms = np.sqrt(squares.get())
        assert norms[0] == pytest.approx(error, rel=1e-12)
        assert norms[1] == pytest.approx(np.linalg.norm(A @ expected, axis=0), rel=1e-12)


def test_largest_modulus(cupy):
    from gpu.eigenvalues.operator import as_matrix

    A = np.random.default_rng(6).standard_normal((333, 333))
    A[17, 300] = -40.0
    assert as_matrix("A", cupy.asarray(A)).magnitude == 40.0
    for wrong in (np.nan, np.inf, -np.inf):
        A[332, 332] = wrong
        with pytest.raises(InputError, match="NaN or infinity"):
            _ = as_matrix("A", cupy.asarray(A)).magnitude
