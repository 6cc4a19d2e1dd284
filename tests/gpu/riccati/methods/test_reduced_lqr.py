"""Gains by projection and by eigenvectors of the inverse Hamiltonian, against dense solvers."""

import numpy as np
import pytest
from example_scripts import load
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator

from gpu import InputError, lqr
from gpu.errors import NotConverged, RiccatiError
from gpu.riccati.methods.hamiltonian import solve as by_eigenvectors
from gpu.riccati.methods.reduced import Projected, proves_stable
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import check_lqr


@pytest.fixture(scope="module")
def heat_modes():
    return load("heat_model").heat_modes


def dense_gain(A, B, Q, R, E=None):
    """SciPy's, with E inverted by hand: its own e is inaccurate where E is not symmetric."""
    E = np.eye(len(A)) if E is None else E
    B = np.linalg.solve(E, B)
    X = linalg.solve_continuous_are(np.linalg.solve(E, A), B, Q, R)
    return np.linalg.solve(R, B.T @ X)


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


def test_projection_and_newton_agree_on_1331_modes(heat_modes):
    """Newton's step solves with A and Q themselves, and so is independent of the projection."""
    A, B = heat_modes(11)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    plain, newton = reduced(problem), reduced(problem, refine=True)
    assert plain.info["rank"] <= 30
    assert apart(plain.gain, newton.gain) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(("N", "rank"), [(16, 30), (21, 30), (64, 60)])
def test_larger_heat_equations(heat_modes, N, rank):
    A, B = heat_modes(N)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    plain = reduced(problem)
    other = reduced(problem, refine=True) if N < 64 else reduced(problem, tol=1e-12)
    assert plain.info["rank"] <= rank
    assert apart(plain.gain, other.gain) < 1e-10


@pytest.mark.sampled(3)
@pytest.mark.parametrize("mass", [False, True])
@pytest.mark.parametrize("weight", ["number", "diagonal", "matrix", "factor"])
def test_nonsymmetric_problems(weight, mass):
    A, B, C = convection(9)
    n = len(B)
    rng = np.random.default_rng(0)
    E = sparse.diags(1 + rng.random(n)) + 0.1 * sparse.eye(n, k=1) if mass else None
    E = None if E is None else sparse.csr_array(E)
    R = np.array([[2.0, 0.5], [0.5, 1.0]]) * 1e-2
    Q, full = {
        "number": (2.0, 2.0 * np.eye(n)),
        "diagonal": (np.linspace(50, 200, n), np.diag(np.linspace(50, 200, n))),
        "matrix": (sparse.csr_array(-A - A.T), -(A + A.T).toarray()),
        "factor": (C, C.T @ C),
    }[weight]
    found = reduced(check_lqr(A, B, Q, R, E=E, factored=weight == "factor"))
    best = dense_gain(A.toarray(), B, full, R, None if E is None else E.toarray())
    assert apart(found.gain, best) < 1e-10
    if weight == "factor":
        # The residual of the whole equation, computed on the basis, is that of the matrices.
        X, M = found.value.toarray(), np.eye(n) if E is None else E.toarray()
        dense, K = A.toarray(), found.gain
        left = dense.T @ X @ M + M.T @ X @ dense - K.T @ R @ K + full
        assert np.linalg.norm(left) / np.linalg.norm(full) < 2e-10
        assert found.info["residual"] < 1e-10


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
    operator = LinearOperator(
        (125, 125), matvec=lambda x: A * x, rmatvec=lambda x: A * x, dtype=float
    )
    inverse = LinearOperator(
        (125, 125), matvec=lambda x: x / A, rmatvec=lambda x: x / A, dtype=float
    )
    found = reduced(check_lqr(operator, B, 1.0, np.eye(2), inverse=inverse))
    assert apart(found.gain, dense_gain(np.diag(A), B, np.eye(125), np.eye(2))) < 1e-9


ERRORS = {50: (1.0e-2, 5e-3), 100: (8.4e-3, 4e-3)}


@pytest.mark.parametrize("modes", [50, pytest.param(100, marks=pytest.mark.slow)])
def test_algorithm_5_on_1331_modes(heat_modes, modes):
    """The first measured accuracy of the dissertation's gain, and that of its symmetric form."""
    A, B = heat_modes(11)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    best = reduced(problem).gain
    printed, symmetric = ERRORS[modes]
    found = by_eigenvectors(problem, modes=modes, pi="printed")
    assert apart(found.gain, best) == pytest.approx(printed, rel=0.1)
    found = by_eigenvectors(problem, modes=modes, pi="symmetric")
    assert apart(found.gain, best) <= symmetric


@pytest.mark.slow
def test_symmetric_form_of_a_dense_matrix(heat_modes):
    """Copies of eigenvalues that rounding brings in, and no input reaches, take nobody's place."""
    A, B = heat_modes(11)
    best = reduced(check_lqr(A, B, 1.0, np.eye(2))).gain
    dense = by_eigenvectors(check_lqr(np.diag(A), B, 1.0, np.eye(2)), modes=50).gain
    assert apart(dense, best) <= 5e-3
    assert apart(dense, by_eigenvectors(check_lqr(A, B, 1.0, np.eye(2)), modes=50).gain) <= 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("stored", [np.array, np.diag], ids=["diagonal", "dense"])
def test_algorithm_5_with_200_modes(heat_modes, stored):
    A, B = heat_modes(11)
    problem = check_lqr(stored(A), B, 1.0, np.eye(2))
    best = reduced(check_lqr(A, B, 1.0, np.eye(2))).gain
    found = by_eigenvectors(problem, modes=200, pi="printed")
    assert apart(found.gain, best) == pytest.approx(4.6e-3, rel=0.1)
    assert apart(by_eigenvectors(problem, modes=200).gain, best) <= 2.5e-3


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
    problem = check_lqr(
        sparse.csr_array(A),
        B,
        C if low_rank else 1.0,
        R,
        E=None if F is None else sparse.csr_array(F),
        factored=low_rank,
    )
    best = dense_gain(A, B, C.T @ C if low_rank else np.eye(n), R, F)
    assert apart(reduced(problem).gain, best) < 1e-7


def test_failures_are_errors(heat_modes):
    A, B = heat_modes(8)
    problem = check_lqr(A, B, 1.0, np.eye(2))
    with pytest.raises(NotConverged, match="rank"):
        reduced(problem, rank=6)
    with pytest.raises(RiccatiError, match="eigenvalue 0 of A"):
        reduced(check_lqr(np.array([0.0, -1.0, -2.0]), np.array([0.0, 1.0, 1.0]), 1.0, 1.0))
    with pytest.raises(InputError, match=r"^basis"):
        reduced(problem, basis=np.ones((512, 2)))
    with pytest.raises(InputError, match=r"^basis"):
        reduced(problem, basis=np.ones((5, 2)))
    for options in ({"compression": "x"}, {"compression": "printed"}, {"tol": 0.0}):
        with pytest.raises(InputError, match=next(iter(options))):
            reduced(problem, **options)
    for options in ({"pi": "x"}, {"modes": 1}, {"modes": 2.5}, {"start": "x"}):
        with pytest.raises(InputError, match=f"^{next(iter(options))}"):
            by_eigenvectors(problem, **options)
    with pytest.raises(InputError, match=r"^inner"):
        by_eigenvectors(problem, inner=np.eye(512))


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


@pytest.mark.parametrize("mass", [False, True], ids=["", "E"])
def test_public_entry_with_sparse_matrices_and_a_factored_weight(mass):
    """Gain, value and poles of `lqr` itself against the equation of the stored matrices."""
    A, B, C = convection(12)
    n = len(B)
    E = sparse.csr_array(sparse.eye(n) + 0.1 * sparse.eye(n, k=1)) if mass else None
    R = np.array([[2.0, 0.5], [0.5, 1.0]]) * 1e-2
    K, S, poles = lqr(A, B, sparse.csr_array(C), R, E=E, factored=True)
    dense, M, X = A.toarray(), np.eye(n) if E is None else E.toarray(), S.toarray()
    left = dense.T @ X @ M + M.T @ X @ dense - K.T @ R @ K + C.T @ C
    assert np.linalg.norm(left) <= 1e-9 * np.linalg.norm(C.T @ C)
    np.testing.assert_allclose(K, np.linalg.solve(R, B.T @ X @ M), atol=1e-9 * np.abs(K).max())
    values = np.linalg.eigvals(np.linalg.solve(M, dense - B @ K))
    assert values.real.max() < 0.0
    assert poles[0].real == pytest.approx(values.real.max(), rel=1e-6)
