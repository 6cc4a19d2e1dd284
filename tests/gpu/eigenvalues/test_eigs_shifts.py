"""Shift and invert where it is delicate: graded spectra, sigma on an eigenvalue, pairs, copies."""

import importlib

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, splu

from gpu import InputError, NotConverged, eigs, svds


def limited(monkeypatch, **limits):
    module = importlib.import_module("gpu.eigenvalues.eigs")
    monkeypatch.setattr(module, "LIMITS", module.LIMITS._replace(**limits))


@pytest.fixture
def iterate(monkeypatch):
    """Nothing is decomposed fully, as for large matrices."""
    limited(monkeypatch, dense=0, products=0, fallback=0)


def graded(n):
    return 10.0 ** np.linspace(-10, 10, n)


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_array])
@pytest.mark.parametrize("sigma", [0.0, 3.0, 1e-7, 2e6])
def test_eigenvalues_over_twenty_decades(iterate, stored, sigma):
    """Pivots of a graded matrix are no rounding: a shift by 1e-9 |A| = 10 hid the smallest."""
    d = graded(300)
    w = eigs(stored(np.diag(d)), 3, sigma=sigma, return_eigenvectors=False)
    assert np.sort(w.real) == pytest.approx(np.sort(d[np.argsort(np.abs(d - sigma))[:3]]), rel=1e-9)


@pytest.mark.parametrize("place", [0, 100, 150, 299])
def test_sigma_on_an_eigenvalue_of_a_graded_matrix(iterate, place):
    d = graded(300)
    w = eigs(np.diag(d), 3, sigma=d[place], return_eigenvectors=False)
    wanted = d[np.argsort(np.abs(d - d[place]))[:3]]
    assert np.sort(w.real) == pytest.approx(np.sort(wanted), rel=1e-9)


def test_a_shift_beyond_the_wanted_is_no_answer(iterate):
    """Eigenvalues next to a singular block: what lies within the move of the shift is not known."""
    d = np.r_[0.0, 1e-9, 2e-9, -1e-9, np.linspace(1.0, 2.0, 296)]
    Q = np.linalg.qr(np.random.default_rng(0).standard_normal((300, 300)))[0]
    A = Q @ np.diag(d) @ Q.T
    try:
        w = eigs(A, 3, which="SM", return_eigenvectors=False)
    except NotConverged:
        return
    assert np.sort(np.abs(w)) == pytest.approx([0.0, 1e-9, 1e-9], abs=1e-13)


@pytest.mark.parametrize("sigma", [0.3, 0.5001, 5.0])
def test_imaginary_parts_of_an_inverse_lie_inside_its_spectrum(sigma):
    """Real eigenvalues next to sigma hide those off the real axis."""
    A = np.diag(np.linspace(0.0, 1.0, 300))
    for i in (0, 2):
        A[i : i + 2, i : i + 2] = [[0.0, 2.0], [-2.0, 0.0]]
    w = eigs(A, 4, sigma=sigma, which="LI", return_eigenvectors=False)
    assert w == pytest.approx([2j, -2j, 2j, -2j], abs=1e-9)


@pytest.mark.parametrize("mass", [False, True])
@pytest.mark.parametrize("sigma", [None, 0.31, -1.0])
@pytest.mark.parametrize("small", [0, 256])
def test_pairs_stand_together_and_plus_comes_first(monkeypatch, mass, sigma, small):
    """Also where an inverse turns their sign, and where there are copies of a pair."""
    limited(monkeypatch, dense=small, products=small)
    rng = np.random.default_rng(4)
    block = rng.standard_normal((5, 5))
    A = linalg.block_diag(*[block] * 4, rng.standard_normal((80, 80)))
    M = np.eye(100) + 0.02 * rng.standard_normal((100, 100)) if mass else None
    for k in range(1, 12):
        w = eigs(A, k, M, sigma, return_eigenvectors=False)
        place = 0
        while place < k:
            if w[place].imag != 0:
                assert w[place].imag > 0
                if place + 1 < k:
                    assert w[place + 1] == pytest.approx(w[place].conj(), rel=1e-9)
            place += 2 if w[place].imag else 1


@pytest.mark.parametrize("ncv", [240, 290, 298, 299, 400])
def test_spaces_of_nearly_all_vectors(ncv):
    """Copies and blocks, of which the challenge finds the rest."""
    D = np.diag(np.repeat(np.arange(1.0, 31.0), 10))
    A = D + np.diag(np.tile([0.5] * 9 + [0.0], 30)[:-1], 1)
    w, v = eigs(A, 15, ncv=ncv)
    assert np.linalg.norm(A @ v - v * w, axis=0).max() < 1e-9
    w = eigs(D, 15, ncv=ncv, return_eigenvectors=False)
    assert w.real == pytest.approx(np.repeat([30.0, 29.0], [10, 5]))


@pytest.mark.parametrize("seed", [13, 31])
def test_an_iteration_that_fills_the_space(monkeypatch, seed):
    """All had converged, and no vector was left for the challenge."""
    limited(monkeypatch, dense=1)
    rng = np.random.default_rng(seed)
    values, sizes = rng.integers(-3, 4, 40), rng.integers(1, 4, 40)
    blocks = [np.eye(b) * v + np.eye(b, k=1) for v, b in zip(values, sizes, strict=True)]
    A = linalg.block_diag(*blocks)[:40, :40]
    w = eigs(A, 15, ncv=35, sigma=0.3, return_eigenvectors=False)
    true = np.linalg.eigvals(A)
    nearest = np.sort(np.abs(true - 0.3))[:15]
    assert np.sort(np.abs(w - 0.3)) == pytest.approx(nearest, abs=1e-4)


@pytest.mark.parametrize("size", [1e-310, 5e-324 * 2**20, 1e305])
@pytest.mark.parametrize("n", [5, 300])
def test_the_smallest_and_largest_numbers_there_are(size, n):
    d = np.linspace(0.1, 1.0, n) * size
    w = eigs(np.diag(d), 2, return_eigenvectors=False)
    assert w.real == pytest.approx(d[:-3:-1], rel=1e-5, abs=5e-324)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("k", [2, 3, 6])
def test_copies_are_found_whatever_the_start_was_drawn_from(seed, k):
    """The challenge drew the very vector that many callers begin with, and saw nothing new."""
    C = np.roll(np.eye(300), 1, 0) + np.roll(np.eye(300), -1, 0)
    S = C[:-2] @ C[:-2].T
    v0 = np.random.default_rng(seed).standard_normal(298)
    w = eigs(S, k, v0=v0, return_eigenvectors=False)
    assert w.real == pytest.approx(np.linalg.eigvalsh(S)[::-1][:k], rel=1e-9)
    s = svds(C[:-2], k, return_singular_vectors=False)
    assert s == pytest.approx(np.sqrt(np.linalg.eigvalsh(S)[-k:]), rel=1e-9)


def test_operators_may_return_the_same_array_always():
    A = np.random.default_rng(5).standard_normal((300, 300))
    out = np.empty(300)
    operator = LinearOperator(A.shape, matvec=lambda x: np.dot(A, x, out=out), dtype=float)
    w = eigs(operator, 3, return_eigenvectors=False)
    assert w == pytest.approx(eigs(A, 3, return_eigenvectors=False), rel=1e-9)


def test_callables_take_lists_and_say_what_they_lack():
    d = np.arange(300.0)
    w = eigs(lambda x: d * x, 2, v0=[1.0] * 300, return_eigenvectors=False)
    assert w.real == pytest.approx([299.0, 298.0])
    for start in (None, 3.0, [], [[1.0]], ["a"]):
        with pytest.raises(InputError, match="pass v0"):
            eigs(lambda x: d * x, 2, v0=start)


def convection(n, c):
    """The tridiagonal matrix (-1, 2, -c) and its eigenvalues."""
    T = sparse.diags_array(
        [-np.ones(n - 1), 2 * np.ones(n), -c * np.ones(n - 1)], offsets=[-1, 0, 1]
    )
    k = np.arange(1, n + 1)
    return sparse.csr_array(T), 2 - 2 * np.sqrt(c + 0j) * np.cos(k * np.pi / (n + 1))


@pytest.mark.parametrize("stored", [sparse.csr_array, sparse.csr_array.toarray])
@pytest.mark.parametrize(
    ("n", "c"), [(300, 1.5), (1000, 1.05), (1000, 1.1), (3000, 1.1), (301, -2)]
)
def test_convection_is_nearly_normal_in_other_units(iterate, stored, n, c):
    """Entries differ across the diagonal by a factor that the units of the unknowns make up."""
    if stored is not sparse.csr_array and n > 1000:
        return
    T, exact = convection(n, c)
    w, v = eigs(stored(T), 6, sigma=0)
    exact = exact[np.argsort(np.abs(exact))]
    apart = np.abs(w[:, None] - exact[None, :8])
    assert apart.min(axis=1).max() < 1e-12
    assert np.abs(w).max() <= np.abs(exact[5]) + 1e-12
    assert np.linalg.norm(T @ v - v * w, axis=0).max() < 1e-12
    np.testing.assert_allclose(np.linalg.norm(v, axis=0), 1.0)


def test_convection_on_a_grid(iterate):
    """Two directions with velocities of their own, unknowns in any order, two parts."""
    (X, x), (Y, y) = convection(31, 3.0), convection(23, 1.4)
    K = sparse.kron(X, sparse.eye_array(23)) + sparse.kron(sparse.eye_array(31), Y)
    K = sparse.block_diag([K, 1.01 * K], format="csr")
    order = np.random.default_rng(0).permutation(K.shape[0])
    exact = np.sort((x[:, None] + y).real.ravel())
    exact = np.concatenate([exact, 1.01 * exact])
    exact = exact[np.argsort(np.abs(exact - 3.0))][:6]
    w = eigs(K[order][:, order], 6, sigma=3.0, return_eigenvectors=False)
    np.testing.assert_allclose(np.sort(w.real), np.sort(exact), atol=1e-11)


def test_ill_conditioned_eigenvalues_are_said_to_be():
    """No units make up for a one-sided matrix: all are computed, and few digits hold."""
    rng = np.random.default_rng(0)
    A = np.triu(rng.standard_normal((400, 400)), 1) + np.diag(rng.uniform(1.0, 2.0, 400))
    Q = np.linalg.qr(rng.standard_normal((400, 400)))[0]
    with pytest.warns(RuntimeWarning, match="condition numbers up to"):
        eigs(Q @ A @ Q.T, 4, sigma=1.5)


@pytest.mark.parametrize(
    ("kind", "n", "c", "true"),
    [
        ("sparse", 600, 1.1, 4.7e10),
        ("dense", 600, 1.1, 4.7e10),
        ("adjoint", 1000, 1.05, 8.2e8),
        ("operator", 1000, 1.05, 8.2e8),
        ("faulty", 1000, 1.05, 8.2e8),
    ],
)
def test_iterations_tell_of_ill_conditioned_eigenvalues(kind, n, c, true):
    """Convection and diffusion beside an entry that no units make up for, or behind an inverse."""
    T = convection(n, c)[0].tolil()
    T[0, n // 20] = 1e-3
    A, options = {"sparse": T.tocsr(), "dense": T.toarray()}.get(kind), {"sigma": 0}
    if A is None:
        factors = splu(T.tocsc())
        A, options = LinearOperator(
            T.shape, matvec=lambda x: factors.solve(x.ravel()), dtype=float,
            rmatvec={
                "adjoint": lambda y: factors.solve(y.ravel(), "T"),
                "faulty": lambda y: y.ravel()[:5],  # only a warning needs it: no reason to fail
            }.get(kind),
        ), {}  # fmt: skip
    with pytest.warns(RuntimeWarning, match="condition numbers up to") as caught:
        eigs(A, 6, **options)
    said = float(str(caught[0].message).split("up to ")[1].split(",")[0])
    assert true / (500 if kind in ("operator", "faulty") else 5) < said < 5 * true


@pytest.mark.parametrize("n", [100, 300])
@pytest.mark.parametrize("which", ["LM", "LI"])
def test_operators_that_say_real_and_are_not(n, which):
    """Half of each value was dropped."""
    d = 1 + 1j * np.arange(n)
    A = LinearOperator((n, n), matvec=lambda v: d * v.ravel(), dtype=float)
    with pytest.raises(InputError, match="give the operator dtype=complex"):
        eigs(A, 2, which=which)
    B = LinearOperator(
        (n, n), matvec=lambda v: d * v.ravel(), rmatvec=lambda v: d.conj() * v, dtype=float
    )
    with pytest.raises(InputError, match="give the operator dtype=complex"):
        svds(B, 2)
    true = LinearOperator((n, n), matvec=lambda v: d * v.ravel(), dtype=complex)
    w = eigs(true, 2, which="LI", return_eigenvectors=False)
    np.testing.assert_allclose(np.sort(w.imag), [n - 2, n - 1], atol=1e-9)


def test_rounding_in_imaginary_parts_is_no_reason_to_refuse():
    n = 256
    symbol = 2 - 2 * np.cos(2 * np.pi * np.arange(n) / n)
    A = LinearOperator(
        (n, n), matvec=lambda v: np.fft.ifft(symbol * np.fft.fft(v.ravel())), dtype=float
    )
    w = eigs(A, 3, return_eigenvectors=False)
    np.testing.assert_allclose(np.sort(w.real), np.sort(symbol)[-3:], atol=1e-12)
