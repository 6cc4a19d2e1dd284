"""Shift and invert, pencils, operators, restarts, singular values, bad input; on the device too."""

import importlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator
from scipy.sparse.linalg import eigs as arpack

from gpu import GpuError, InputError, NotConverged, eigs, svds

N = 200


@pytest.fixture(autouse=True)
def iterate(monkeypatch):
    """Matrices from order 129 on go through the iteration, as larger ones do by default."""
    for name in ("gpu.eigenvalues.eigs", "gpu.eigenvalues.svds"):
        module = importlib.import_module(name)
        monkeypatch.setattr(module, "LIMITS", module.LIMITS._replace(dense=128))


def matrix(seed=0, dtype=float):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N)) / np.sqrt(N)
    if dtype is complex:
        A = A + 1j * rng.standard_normal((N, N)) / np.sqrt(N)
    return A + np.diag(np.r_[np.linspace(6, 3, 12), np.zeros(N - 12)])


def nearest(values, sigma, k):
    return values[np.argsort(np.abs(values - sigma))[:k]]


def same(found, wanted):
    """Sets of values agree within rounding of moderate condition; order is another matter."""
    assert len(found) == len(wanted)
    apart = np.abs(np.asarray(found)[:, None] - np.asarray(wanted)[None])
    assert apart.min(axis=0).max() < 1e-9
    assert apart.min(axis=1).max() < 1e-9


@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("restart", ["krylov-schur", "implicit"])
def test_restarts_agree_with_lapack(dtype, restart):
    A = matrix(1, dtype)
    w, v = eigs(A, 5, ncv=20, restart=restart)
    true = np.linalg.eigvals(A)
    same(w, true[np.argsort(-np.abs(true))[:5]])
    assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-11


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_matrix, sparse.csc_array])
@pytest.mark.parametrize("sigma", [4.1, 1.0 + 0.5j])
def test_shift_and_invert(stored, sigma):
    A = matrix(2)
    w, v = eigs(stored(A), 3, sigma=sigma)
    same(w, nearest(np.linalg.eigvals(A), sigma, 3))
    assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-10


@pytest.mark.parametrize("sigma", [None, 2.5])
def test_pencil(sigma):
    A = matrix(3)
    M = np.diag(np.linspace(1.0, 2.0, N)) + 0.01 * matrix(4)
    w, v = eigs(A, 3, M=M, sigma=sigma)
    true = linalg.eigvals(A, M)
    wanted = true[np.argsort(-np.abs(true))[:3]] if sigma is None else nearest(true, sigma, 3)
    same(w, wanted)
    assert np.linalg.norm(A @ v - M @ v * w, axis=0).max() < 1e-10


def test_operators_and_callables_give_what_the_matrix_gives():
    A = matrix(5)
    w = eigs(A, 4, return_eigenvectors=False)
    same(eigs(LinearOperator(A.shape, matvec=lambda x: A @ x, dtype=float), 4)[0], w)
    same(eigs(lambda x: A @ x, 4, v0=np.ones(N))[0], w)
    same(eigs(sparse.csr_array(A), 4)[0], w)


def test_order_and_shapes_are_those_of_scipy():
    A = matrix(6)
    w, v = eigs(A, 4)
    s, u = arpack(A, 4, v0=np.ones(N))
    assert w.shape == s.shape
    assert v.shape == u.shape
    same(w, s)
    assert np.all(np.diff(np.abs(w)) < 1e-12)


def test_not_converged_carries_what_converged():
    A = np.random.default_rng(7).standard_normal((400, 400))
    with pytest.raises(NotConverged) as caught:
        eigs(A, 10, ncv=24, maxiter=4)
    w, v = caught.value.eigenvalues, caught.value.eigenvectors
    assert len(w) < 10
    assert v.shape == (400, len(w))
    if len(w):
        assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-9 * np.linalg.norm(A, 2)


@pytest.mark.parametrize("shape", [(300, 200), (150, 260)])
@pytest.mark.parametrize("kind", ["real", "complex", "sparse", "low rank", "repeated"])
def test_singular_values(shape, kind):
    rng = np.random.default_rng(8)
    A = rng.standard_normal(shape)
    if kind == "complex":
        A = A + 1j * rng.standard_normal(shape)
    if kind == "low rank":
        A = rng.standard_normal((shape[0], 3)) @ rng.standard_normal((3, shape[1]))
    if kind == "repeated":
        U, s, V = np.linalg.svd(A, full_matrices=False)
        A = (U * np.r_[[9.0] * 4, s[4:] / s[4]]) @ V
    u, s, vh = svds(sparse.csr_array(A) if kind == "sparse" else A, 5)
    size = np.linalg.norm(A, 2)
    assert s == pytest.approx(np.linalg.svd(A, compute_uv=False)[:5][::-1], abs=1e-11 * size)
    assert np.abs(u.conj().T @ u - np.eye(5)).max() < 1e-12
    assert np.abs(vh @ vh.conj().T - np.eye(5)).max() < 1e-12
    assert np.linalg.norm(A @ vh.conj().T - u * s) < 1e-9 * size


def test_smallest_singular_values_and_operators():
    A = np.random.default_rng(9).standard_normal((180, 150))
    true = np.linalg.svd(A, compute_uv=False)
    assert svds(A, 2, which="SM")[1] == pytest.approx(true[-2:][::-1], rel=1e-10)
    operator = LinearOperator(A.shape, matvec=lambda x: A @ x, rmatvec=lambda x: A.T @ x)
    assert svds(operator, 2)[1] == pytest.approx(true[:2][::-1], rel=1e-12)
    with pytest.raises(GpuError, match="k=151"):
        svds(A, 151)


def test_no_shift_of_a_singular_sparse_matrix_can_be_factored():
    """Empty rows, and entries over ten decades: all that is left is to decompose it."""
    scale = np.random.default_rng(3)
    A = sparse.random_array(
        (479, 479),
        density=0.008,
        rng=2,
        data_sampler=lambda size: 10.0 ** scale.uniform(-5, 5, size),
    ).tocsr()
    w, v = eigs(A, 4, which="SM")
    size = np.linalg.norm(A.toarray(), 2)
    assert np.abs(w).max() < 1e-12 * size
    assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-10 * size


@pytest.mark.gpu
@pytest.mark.parametrize("kind", ["dense", "complex", "sparse", "sigma", "pencil", "odd"])
def test_device_gives_what_the_host_gives(kind):
    import cupy

    A = matrix(10, complex if kind == "complex" else float)
    A = A[:-1, :-1] if kind == "odd" else A
    options, moved = {}, {}
    if kind == "sigma":
        options = moved = {"sigma": 3.3}
    if kind == "pencil":
        M = np.diag(np.linspace(1.0, 2.0, N))
        options, moved = {"M": M}, {"M": cupy.asarray(M)}
    device = cupy.asarray(A)
    if kind == "sparse":
        from cupyx.scipy.sparse import csr_matrix

        device = csr_matrix(device)
    w, v = eigs(device, 5, **moved)
    assert isinstance(w, cupy.ndarray)
    assert isinstance(v, cupy.ndarray)
    same(w.get(), eigs(A, 5, **options)[0])
    right = v if kind != "pencil" else moved["M"] @ v
    assert float(cupy.abs(device @ v - right * w).max()) < 1e-10


@pytest.mark.gpu
def test_device_singular_values():
    import cupy

    A = np.random.default_rng(11).standard_normal((400, 300))
    u, s, vh = svds(cupy.asarray(A), 4)
    assert s.get() == pytest.approx(np.linalg.svd(A, compute_uv=False)[:4][::-1], rel=1e-12)
    assert float(cupy.abs(u * s - cupy.asarray(A) @ vh.T).max()) < 1e-10


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([np.nan, np.inf, -np.inf]),
    st.integers(0, 299),
    st.integers(0, 299),
    st.booleans(),
    st.booleans(),
    st.sampled_from([None, 300]),
)
def test_one_wrong_entry_is_found_without_a_look(
    wrong, row, column, stored_sparsely, blind, maxiter
):
    """Products tell of it, also with a start vector that has zeros where it stands; with `maxiter`
    there is no decomposition that would come across it."""
    A = np.diag(np.arange(1.0, 301.0))
    A[row, column] = wrong
    v0 = np.eye(300)[(column + 7) % 300] if blind else None
    with pytest.raises(InputError, match="NaN or infinity"):
        eigs(sparse.csr_array(A) if stored_sparsely else A, 3, v0=v0, maxiter=maxiter)


@pytest.mark.parametrize("maxiter", [None, 300])
@pytest.mark.parametrize("power", [-310, -200, -158, -120, -90, 90, 120, 153, 200, 300])
@pytest.mark.parametrize("stored_sparsely", [False, True])
def test_entries_of_any_size(power, stored_sparsely, maxiter):
    values = 10.0**power * np.arange(1.0, 301.0) / 300.0
    A = sparse.diags_array(values, format="csr") if stored_sparsely else np.diag(values)
    w, v = eigs(A, 3, maxiter=maxiter)
    assert w.real == pytest.approx(values[:-4:-1], rel=1e-10 if power > -300 else 1e-4)
    assert np.abs(np.abs(v).max(axis=0) - 1.0).max() < 1e-8


@pytest.mark.gpu
@pytest.mark.parametrize("size", [np.nan, np.inf, 1e-200, 1e200])
def test_device_looks_at_entries_when_products_ask_for_it(size):
    import cupy

    A = np.diag(np.arange(1.0, 301.0))
    if not np.isfinite(size):
        A[5, 200] = size
        with pytest.raises(InputError, match="NaN or infinity"):
            eigs(cupy.asarray(A), 3)
    else:
        w = eigs(cupy.asarray(size * A), 3, return_eigenvectors=False)
        assert w.get().real / size == pytest.approx([300.0, 299.0, 298.0], rel=1e-12)


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
