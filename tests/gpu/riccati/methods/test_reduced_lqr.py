"""Gains by projection and by eigenvectors of the inverse Hamiltonian, against dense solvers."""

import numpy as np
import pytest
from example_scripts import load
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, splu

from gpu import InputError, NotSupported, RiccatiError, dlqr, lqe, lqr
from gpu.riccati.methods import doubling
from gpu.riccati.methods.hamiltonian import solve as by_eigenvectors
from gpu.riccati.methods.reduced import Projected, proves_stable
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import check_lqr


@pytest.fixture(scope="module")
def heat_modes():
    return load("heat_model").heat_modes


def dense(A, B, Q, R, E=None, N=None):
    """Gain and value by SciPy, E inverted by hand: its own e is inaccurate where not symmetric."""
    E = np.eye(len(A)) if E is None else E
    N = np.zeros_like(B) if N is None else N
    moved, b = np.linalg.solve(E, A), np.linalg.solve(E, B)
    X = linalg.solve_continuous_are(moved, b, Q, R, s=N)
    S = np.linalg.solve(E.T, np.linalg.solve(E.T, X).T)
    return np.linalg.solve(R, b.T @ X + N.T), S


def dense_gain(*problem):
    return dense(*problem)[0]


def mass(n, seed=0):
    d = np.random.default_rng(seed).uniform(1, 2, n)
    return sparse.csr_array(sparse.diags(d) + 0.1 * sparse.eye(n, k=1))


def contraction(shape, size, seed=0):
    D = np.random.default_rng(seed).standard_normal(shape)
    return D * (size / np.linalg.norm(D, 2))


def apart(K, best):
    return np.linalg.norm(K - best) / np.linalg.norm(best)


def convection(k, wind=(10.0, 30.0)):
    """Convection and diffusion on the unit square, k^2 nodes, not symmetric."""
    h = 1 / (k + 1)
    D = sparse.diags([np.full(k, -2.0), np.ones(k - 1), np.ones(k - 1)], [0, 1, -1]) / h**2
    G = sparse.diags([np.ones(k - 1), -np.ones(k - 1)], [1, -1]) / (2 * h)
    one = sparse.eye(k)
    A = sparse.kron(D - wind[0] * G, one) + sparse.kron(one, D - wind[1] * G)
    B, C = np.zeros((k * k, 2)), np.zeros((2, k * k))
    B[k * 3 : k * 4, 0] = B[-k * 4 : -k * 3, 1] = 5.0
    C[0, : 2 * k] = C[1, k * 6 : k * 7] = 10.0
    return sparse.csr_array(A), B, C


def test_invariants_of_the_heat_model(heat_modes):
    """The value of the constant mode and the slowest pole."""
    A, B = heat_modes(4)
    S = linalg.solve_continuous_are(np.diag(A), B, np.eye(64), np.eye(2))
    assert S[0, 0] == pytest.approx(3.2015937, abs=1e-7)
    A, B = heat_modes(8)
    result = lqr(A, B, 1.0, np.eye(2))
    assert result.abscissa == pytest.approx(-0.312339868, abs=2e-9)
    assert result.stable


@pytest.mark.parametrize("dim", [2, 3])
def test_default_method_on_the_heat_equation(heat_modes, dim):
    A, B = heat_modes(5 if dim == 3 else 11, dim)
    R = np.array([[2.0, 0.3], [0.3, 1.0]])
    best = dense_gain(np.diag(A), B, 3.0 * np.eye(len(A)), R)
    for stored in (A, sparse.diags(A).tocsr()):
        found = reduced(check_lqr(stored, B, 3.0, R))
        assert apart(found.gain, best) < 1e-10
        assert found.info["rank"] <= 30
        assert found.value is None  # Q has full rank: the value is no low-rank matrix


@pytest.mark.parametrize(
    ("N", "rank"),
    [(11, 30), *(pytest.param(*c, marks=pytest.mark.slow) for c in ((16, 30), (21, 30), (64, 60)))],
)
def test_projection_and_newton_agree(heat_modes, N, rank):
    """Newton's step solves with A and Q themselves, and so is independent of the projection."""
    A, B = heat_modes(N)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    plain = reduced(problem)
    other = reduced(problem, refine=True) if N < 64 else reduced(problem, tol=1e-12)
    assert plain.info["rank"] <= rank
    assert apart(plain.gain, other.gain) < 1e-10


WEIGHT = np.array([[2.0, 0.5], [0.5, 1.0]]) * 1e-2
ROOT = np.linalg.cholesky(WEIGHT)


def stored_as(kind, A):
    """A matrix in some storage, and the inverse that operators need."""
    if kind != "operator":
        return (A if kind == "sparse" else A.toarray()), {}
    lu = splu(A.tocsc())
    pairs = {"matvec": lambda x: A @ x, "rmatvec": lambda x: A.T @ x}
    solves = {"matvec": lu.solve, "rmatvec": lambda x: lu.solve(x, "T")}
    inverse = LinearOperator(A.shape, **solves, dtype=float)
    return LinearOperator(A.shape, **pairs, dtype=float), {"inverse": inverse}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("crossed", [False, True], ids=["", "N"])
@pytest.mark.parametrize("with_mass", [False, True], ids=["", "E"])
@pytest.mark.parametrize(
    ("weight", "stored"),
    [
        *[(w, s) for w in ("number", "diagonal", "matrix", "factor") for s in ("sparse", "dense")],
        ("factor", "operator"),
    ],
)
def test_nonsymmetric_problems(weight, stored, with_mass, crossed):
    A, B, C = convection(9)
    n = len(B)
    E, M = (mass(n), mass(n).toarray()) if with_mass else (None, None)
    given, options = stored_as(stored, A)
    line = np.linspace(50, 200, n)
    Q, full = {
        "number": (200.0, 200.0 * np.eye(n)),
        "diagonal": (line, np.diag(line)),
        "matrix": (stored_as(stored, -A - A.T)[0], -(A + A.T).toarray()),
        "factor": (C, C.T @ C),
    }[weight]
    edge = (
        C.T @ contraction((2, 2), 1.0) @ ROOT.T
        if weight == "factor"
        else np.linalg.cholesky(full) @ contraction((n, 2), 1.0) @ ROOT.T
    )
    N = 0.8 * edge if crossed else None
    K, S = dense(A.toarray(), B, full, WEIGHT, M, N)
    options |= {"E": E, "method": "reduced", "factored": weight == "factor"}
    result = lqr(given, B, Q, WEIGHT, N, **options)
    assert apart(result.K, K) <= (1e-8 if crossed and weight == "factor" else 1e-10)
    assert result.stable
    assert result.abscissa < 0.0
    if weight == "factor":
        assert result.residual <= 1e-10
        X, M = result.S.toarray(), np.eye(n) if M is None else M
        assert apart(X, S) <= 1e-8
        # The residual of the whole equation is that of the matrices.
        matrix, cross = A.toarray(), M.T @ X @ B + (0.0 if N is None else N)
        left = matrix.T @ X @ M + M.T @ X @ matrix + full
        left -= cross @ np.linalg.solve(WEIGHT, cross.T)
        assert np.linalg.norm(left) / np.linalg.norm(full) < 1e-9
    if crossed:
        with pytest.raises(InputError, match="Q is not positive semidefinite"):
            lqr(given, B, Q, WEIGHT, 1.02 * edge, **options)


def test_low_rank_weight_is_recognised():
    A, B, _ = convection(9)
    Q = np.zeros(len(B))
    Q[5:8] = 100.0
    R = 0.01 * np.eye(2)
    found = reduced(check_lqr(A, B, Q, R))
    assert found.value.rank < 60
    assert apart(found.gain, dense_gain(A.toarray(), B, np.diag(Q), R)) < 1e-8


def test_unstable_problem_is_stabilised(heat_modes):
    A, B = heat_modes(8, 2)
    A = A + 5.0  # one unstable mode
    found = reduced(check_lqr(A, B, 1.0, np.eye(2)))
    assert apart(found.gain, dense_gain(np.diag(A), B, np.eye(64), np.eye(2))) < 1e-9


def test_operator_with_an_inverse(heat_modes):
    A, B = heat_modes(5)
    A = A - 1.0
    operator, inverse = (
        LinearOperator((125, 125), lambda x, d=d: d * x, rmatvec=lambda x, d=d: d * x, dtype=float)
        for d in (A, 1 / A)
    )
    found = reduced(check_lqr(operator, B, 1.0, np.eye(2), inverse=inverse))
    assert apart(found.gain, dense_gain(np.diag(A), B, np.eye(125), np.eye(2))) < 1e-9


SLOW = pytest.mark.slow
ERRORS = {50: (1.0e-2, 5e-3), 100: (8.4e-3, 4e-3), 200: (4.6e-3, 2.5e-3)}


@pytest.mark.parametrize(
    ("modes", "stored"),
    [
        (50, np.array),
        pytest.param(50, np.diag, marks=SLOW),
        pytest.param(100, np.array, marks=SLOW),
        pytest.param(200, np.array, marks=SLOW),
        pytest.param(200, np.diag, marks=SLOW),
    ],
)
def test_algorithm_5_on_1331_modes(heat_modes, modes, stored):
    """The measured accuracy of the dissertation's gain, and that of its symmetric form.

    Copies of eigenvalues that rounding brings in, and no input reaches, take nobody's place.
    """
    A, B = heat_modes(11)
    plain = check_lqr(A, B, 1.0, np.eye(2))
    problem, best = check_lqr(stored(A), B, 1.0, np.eye(2)), reduced(plain).gain
    printed, symmetric = ERRORS[modes]
    if stored is np.array or modes == 200:
        found = by_eigenvectors(problem, modes=modes, pi="printed")
        assert apart(found.gain, best) == pytest.approx(printed, rel=0.1)
    found = by_eigenvectors(problem, modes=modes, pi="symmetric").gain
    assert apart(found, best) <= symmetric
    if stored is np.diag and modes == 50:
        assert apart(found, by_eigenvectors(plain, modes=50).gain) <= 1e-8


@pytest.mark.parametrize("pi", ["printed", "symmetric"])
def test_all_eigenvectors_give_the_optimal_gain(pi):
    rng = np.random.default_rng(1)
    n = 12
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    E = np.eye(n) + 0.2 * rng.standard_normal((n, n))
    R, G = np.diag([0.5, 2.0]), rng.standard_normal((n, n))
    Q = 100.0 * G @ G.T
    inner = np.diag(rng.uniform(1, 2, n)) if pi == "printed" else None
    problem = check_lqr(A, B, Q, R, E=E)
    found = by_eigenvectors(problem, modes=2 * n, pi=pi, inner=inner)
    assert apart(found.gain, dense_gain(A, B, Q, R, E)) < 1e-9


def test_closed_loop_keeps_the_captured_eigenvalues(heat_modes):
    """Beside them the compression of A to the complement of V, in exact arithmetic."""
    A, B = heat_modes(5)
    best = dense_gain(np.diag(A), B, np.eye(125), np.eye(2))
    optimal = np.linalg.eigvals(np.diag(A) - B @ best)
    for pi in ("printed", "symmetric"):
        result = lqr(A, B, 1.0, np.eye(2), method="hamiltonian", modes=20, pi=pi)
        assert result.abscissa == pytest.approx(optimal.real.max(), rel=1e-8)
        assert result.stable


def test_printed_compression_is_worse_than_galerkin(heat_modes):
    """On one basis: the inverse Hamiltonian compressed, and the matrices themselves compressed."""
    A, B = heat_modes(8)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    best = reduced(problem).gain
    W = B / np.linalg.norm(B, axis=0)
    for _ in range(10):
        W = np.hstack([W, W[:, -2:] / (A - 1.0)[:, None]])
        W = np.linalg.qr(W)[0]
    printed = apart(reduced(problem, basis=W, compression="printed").gain, best)
    galerkin = apart(reduced(problem, basis=W).gain, best)
    assert galerkin < 1e-6
    assert 10 * galerkin < printed < 1e-2


def test_whole_space_as_a_basis():
    rng = np.random.default_rng(2)
    A, B = rng.standard_normal((8, 8)), rng.standard_normal((8, 2))
    best = dense_gain(A, B, np.eye(8), np.eye(2))
    problem = check_lqr(A, B, 1.0, np.eye(2))
    for compression in ("galerkin", "printed"):
        found = reduced(problem, basis=rng.standard_normal((8, 8)), compression=compression)
        assert apart(found.gain, best) < 1e-9


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.integers(8, 30), st.integers(1, 3), st.booleans(), st.booleans())
def test_random_stable_sparse_problems(seed, n, m, low_rank, with_mass):
    """Dissipative matrices, with E or without, weights of every rank, against the dense solver."""
    rng = np.random.default_rng(seed)
    G = sparse.random_array((n, n), density=0.2, rng=rng).toarray()
    A = (G - G.T) - np.diag(rng.uniform(0.5, 5.0, n))
    F = np.diag(rng.uniform(1, 3, n)) if with_mass else None
    B, R = rng.standard_normal((n, m)), np.eye(m)
    C = rng.standard_normal((1, n))
    E, Q = None if F is None else sparse.csr_array(F), C if low_rank else 1.0
    problem = check_lqr(sparse.csr_array(A), B, Q, R, E=E, factored=low_rank)
    best = dense_gain(A, B, C.T @ C if low_rank else np.eye(n), R, F)
    assert apart(reduced(problem).gain, best) < 1e-7


@pytest.mark.filterwarnings("ignore")
def test_same_gain_as_radi_of_pymor():
    """On a pencil with a mass matrix; warnings of that package are its own."""
    pytest.importorskip("pymor")
    from pymor.core.logger import set_log_levels
    from pymor.solvers.matrix_equations.equations import RiccatiEquation
    from pymor.solvers.matrix_equations.radi import RADIRiccatiSolver

    set_log_levels({"pymor": "ERROR"})
    A, B, C = convection(20)
    n = len(B)
    E = sparse.diags([np.full(n, 4.0), np.ones(n - 1), np.ones(n - 1)], [0, 1, -1]) / 6
    matrices = [sparse.csc_matrix(M) for M in (A, E)]
    equation = RiccatiEquation.from_matrices(*matrices, B, C, trans=True)
    Z = RADIRiccatiSolver(radi_tol=1e-12).solve(equation).to_numpy()
    Z = Z if len(Z) == n else Z.T
    best = (B.T @ Z) @ (E.T @ Z).T
    assert apart(reduced(check_lqr(A, B, C, np.eye(2), E=E, factored=True)).gain, best) < 1e-8


def neumann(k):
    """Bilinear elements on the insulated square: stiffness, two heated edges, mass."""
    h, n = 1 / k, k + 1
    ends = np.r_[1.0, np.full(n - 2, 2.0), 1.0]
    one = np.ones(n - 1)
    K = sparse.diags([ends, -one, -one], [0, 1, -1]) / h
    M = sparse.diags([2 * ends, one, one], [0, 1, -1]) * h / 6
    A, E = -(sparse.kron(K, M) + sparse.kron(M, K)), sparse.kron(M, M)
    B = np.zeros((n, n, 2))
    B[0, : n // 2, 0] = B[-1, n // 3 :, 1] = h
    return sparse.csr_array(A), B.reshape(-1, 2), sparse.csr_array(E)


@pytest.mark.parametrize("moved", [-1.0, 0.0, 0.5], ids=["stable", "zero mode", "unstable"])
@pytest.mark.parametrize("kind", ["sparse", "diagonal"])
def test_stability_of_symmetric_problems_is_proved(kind, moved, heat_modes):
    """Without poles, for loops that are stable by their poles; the mean value moves freely."""
    if kind == "sparse":
        A, B, E = neumann(9)
        found = reduced(check_lqr(A + moved * E, B, 3.0 * E, np.eye(2), E=E))
        M, A = E.toarray(), (A + moved * E).toarray()
    else:
        A, B = heat_modes(5)
        d = np.random.default_rng(0).uniform(1.0, 2.0, A.size)
        A = d * (A + moved)
        found = reduced(check_lqr(A, B, 3.0 * d, np.eye(2), E=d))
        A, M = np.diag(A), np.diag(d)
    assert np.linalg.eigvals(np.linalg.solve(M, A - B @ found.gain)).real.max() < 0.0
    # Of sparse matrices only the constant mode may be free, and none unstable.
    assert found.proved == (kind == "diagonal" or moved <= 0.0)


def test_no_loop_is_proved_stable_that_is_not():
    """Projections on poor bases, gains far from optimal, unstable modes seen or not."""
    proofs = 0
    for seed in range(120):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(2, 12)), int(rng.integers(1, 3))
        d = -(10.0 ** rng.uniform(-2, 2, n))
        d[: rng.integers(0, 3)] *= -rng.uniform(0.0, 2.0)
        B = rng.standard_normal((n, m)) * 10.0 ** rng.uniform(-3, 1, (n, 1))
        problem = check_lqr(d, B, 1.0, np.eye(m))
        W = np.linalg.qr(rng.standard_normal((n, int(rng.integers(1, n + 1)))))[0]
        projected = Projected.of(problem, W)
        try:
            P = projected.solve()
        except RiccatiError:
            continue
        stable = np.linalg.eigvals(np.diag(d) - B @ projected.gain(P)).real.max() < 0.0
        proved = proves_stable(problem, projected, P, 1.0)
        assert stable or not proved
        proofs += proved
    assert proofs >= 10


def test_public_entry_proves_what_it_says(heat_modes):
    A, B = heat_modes(9)
    result = lqr(A, B, 1.0, np.eye(2))
    assert result.stable
    assert result.bound == 0.0
    assert len(result.E) == 12
    # A weight that is no multiple of the mass leaves a loop without a proof, with all its poles.
    other = lqr(A[:300], B[:300], np.linspace(1, 2, 300), np.eye(2))
    assert other.bound == other.abscissa < 0.0
    assert len(other.E) == 300


def test_diagonal_with_a_zero_mode():
    d = -(np.arange(40.0) ** 2)
    B = np.random.default_rng(2).standard_normal((40, 2))
    N = contraction((40, 2), 0.7, 2)
    K, S = dense(np.diag(d), B, np.eye(40), np.eye(2), None, N)
    assert apart(lqr(d, B, 1.0, None, N).K, K) <= 1e-10
    found = lqe(d, np.eye(40), B.T, np.eye(40), np.eye(2), N)
    assert apart(found.K.T, K) <= 1e-10
    for pi in ("printed", "symmetric"):
        for A in (d, np.diag(d)):
            result = lqr(A, B, 1.0, None, N, method="hamiltonian", modes=80, pi=pi)
            assert apart(result.K, K) <= 1e-10
            if pi == "symmetric":
                assert apart(result.S.toarray(), S) <= 1e-10


@pytest.mark.parametrize("stored", [sparse.csr_array, np.asarray], ids=["sparse", "dense"])
def test_value_by_eigenvectors_with_a_mass_matrix(stored):
    rng = np.random.default_rng(3)
    n = 12
    A, B = rng.standard_normal((n, n)) - 3 * np.eye(n), rng.standard_normal((n, 2))
    E, Q = np.eye(n) + 0.2 * rng.standard_normal((n, n)), np.diag(rng.uniform(1, 2, n))
    N = 0.5 * contraction((n, 2), 1.0) @ ROOT.T
    K, S = dense(A, B, Q, WEIGHT, E, N)
    result = lqr(
        stored(A), B, Q.diagonal(), WEIGHT, N, stored(E), method="hamiltonian", modes=2 * n
    )
    assert apart(result.K, K) <= 1e-9
    assert apart(result.S.toarray(), S) <= 1e-9


def test_random_problems_stored_in_every_way():
    """A sparse A, a dense one and Newton's method without projection tell the same gain."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(8, 25)), int(rng.integers(1, 4))
        G = sparse.random_array((n, n), density=0.2, rng=rng).toarray()
        A = (G - G.T) - np.diag(rng.uniform(0.5, 5.0, n))
        B, C = rng.standard_normal((n, m)), rng.standard_normal((2, n))
        N = C.T @ contraction((2, m), 0.95, seed)
        K, _ = dense(A, B, C.T @ C, np.eye(m), None, N)
        given = sparse.csr_array(A)
        assert apart(lqr(given, B, C, None, N, factored=True).K, K) <= 1e-7
        assert apart(lqr(given, B, C, None, N, factored=True, method="newton").K, K) <= 1e-9


def test_operators_that_the_cross_term_makes_singular():
    identity = LinearOperator((3, 3), matvec=lambda x: -x, rmatvec=lambda x: -x, dtype=float)
    # A - B N^T has a zero on its diagonal.
    b = np.array([1.0, 0.0, 0.0])
    with pytest.raises(NotSupported, match=r"^N"):
        lqr(identity, b, 2.0, None, -b, inverse=identity, method="reduced")
    # So few states have all their entries stored: -2 s - (s - 1)^2 + 2 = 0.
    K = lqr(identity, b, 2.0, None, -b, inverse=identity).K
    np.testing.assert_allclose(K, [[0.0, 0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("moved", [0.0, 1.0], ids=["", "shifted"])
def test_the_residual_is_that_of_the_equation(heat_modes, moved):
    """Each residual of the history, from all entries; a mass that is not symmetric."""
    A, B = heat_modes(7)
    n = A.size
    E, Q = mass(n), np.random.default_rng(1).standard_normal((3, n))
    A = sparse.csr_array(sparse.diags(A + moved))
    problem = check_lqr(A, B, Q, np.eye(2), E=E, factored=True)
    seen = []
    for tol in (1e-2, 1e-5, 1e-9):
        found = reduced(problem, tol=tol)
        S, A_, M = found.value.toarray(), A.toarray(), E.toarray()
        half, cost = M.T @ S @ A_, Q.T @ Q
        gain = B.T @ S @ M
        left = half + half.T - gain.T @ gain + cost
        want = np.linalg.norm(left) / np.linalg.norm(cost)
        rounding = 1e-15 * np.linalg.norm(half) / np.linalg.norm(cost)
        assert found.info["residual"] == pytest.approx(want, rel=1e-6, abs=10 * rounding)
        seen.append(found.info["rank"])
    assert seen[0] < seen[1] < seen[2]


def test_small_equations_by_doubling_and_by_qz(heat_modes, monkeypatch):
    A, B = heat_modes(7)
    problem = check_lqr(A, B, np.ones((1, A.size)), np.eye(2), factored=True)
    one = reduced(problem)
    monkeypatch.setattr("gpu.riccati.methods.reduced._by_doubling", lambda *_: None)
    two = reduced(problem)
    np.testing.assert_allclose(one.gain, two.gain, rtol=0, atol=1e-12 * np.abs(two.gain).max())


def test_the_log_says_beforehand_how_long_all_entries_take(caplog, monkeypatch):
    monkeypatch.setattr(doubling, "LIMITS", doubling.LIMITS._replace(announced=30))
    with caplog.at_level("INFO", "gpu.riccati"):
        lqr(-np.eye(29), np.ones((29, 1)), 1.0)
        assert not caplog.messages
        lqr(-np.eye(30), np.ones((30, 1)), 1.0)
        dlqr(0.5 * np.eye(30), np.ones((30, 1)), 1.0)
    assert [m.split(":")[0] for m in caplog.messages] == 2 * [
        "doubling with all entries of 30 states"
    ]
