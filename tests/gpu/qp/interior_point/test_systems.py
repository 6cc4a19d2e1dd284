"""Systems of the interior point, whatever factors them, are solved to the accuracy of dense LU."""

import numpy as np
import pytest
from scipy import sparse

from gpu import solve_qp
from gpu.arrays.sparse_factor import PardisoFactor, SuperLUFactor, quasidefinite
from gpu.arrays.up_looking import UpLooking
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.data.standard_qp import StandardQP
from gpu.qp.interior_point.kkt_system import DenseSystem, SparseSystem
from gpu.qp.interior_point.minimise import minimise
from gpu.qp.interior_point.presolve import presolve
from skfem_adini.ground.pardiso import has_pardiso


def chain(stages, size, rng, shuffled=False):
    """What is above the diagonal of [[0, C'], [C, 0]] for rows that couple each stage to the next;
    and the signs of the diagonal."""
    C = sparse.kron(sparse.eye_array(stages), rng.standard_normal((size, 2 * size)))
    C = C + sparse.kron(sparse.eye_array(stages, k=-1), rng.standard_normal((size, 2 * size)))
    K = sparse.csr_array(sparse.block_array([[None, C.T], [C, None]]))
    order = rng.permutation(K.shape[0]) if shuffled else np.arange(K.shape[0])
    sign = np.repeat([1.0, -1.0], C.shape[::-1])
    return sparse.csc_array(sparse.triu(K[order][:, order], 1)), sign[order]


def grid(side):
    """The same of a Laplacian, in which columns of the factor become long."""
    line = sparse.diags_array([1.0, 1.0], offsets=[-1, 1], shape=(side, side))
    one = sparse.eye_array(side)
    return sparse.csc_array(-sparse.triu(sparse.kron(line, one) + sparse.kron(one, line), 1))


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize(("stages", "size"), [(1, 1), (40, 1), (60, 4)])
def test_chains_are_factored_row_by_row(stages, size, shuffled):
    rng = np.random.default_rng(stages)
    upper, sign = chain(stages, size, rng, shuffled)
    factors = quasidefinite(upper)
    assert isinstance(factors, UpLooking)
    n = upper.shape[0]
    for _ in range(2):  # the analysis serves every diagonal
        diagonal = 10.0 ** rng.uniform(-1.0, 1.0, n) * sign
        K = (upper + upper.T).toarray() + np.diag(diagonal)
        r = rng.standard_normal(n)
        factors.factor(diagonal)
        known = np.linalg.solve(K, r)
        np.testing.assert_allclose(factors.solve(r), known, atol=1e-11 * abs(known).max())


def test_other_matrices_have_dense_blocks():
    assert isinstance(quasidefinite(grid(80)), PardisoFactor if has_pardiso() else SuperLUFactor)
    assert isinstance(quasidefinite(grid(5)), UpLooking)
    full = sparse.csc_array(np.triu(np.ones((100, 100)), 1))
    assert not isinstance(quasidefinite(full), UpLooking)


def test_a_pivot_keeps_its_sign_and_numbers_must_be_finite():
    """[[1, 1], [1, 1 - 1e-16]]: rounding would leave no second pivot."""
    factors = quasidefinite(sparse.csc_array(np.array([[0.0, 1.0], [0.0, 0.0]])))
    factors.factor(np.array([1.0, 1.0]))
    assert np.isfinite(factors.solve(np.ones(2))).all()
    assert 1.0 / factors._D[1] > 0.0
    for wrong in (np.nan, np.inf, 0.0):
        with pytest.raises(np.linalg.LinAlgError, match="zero, or not finite"):
            factors.factor(np.array([wrong, 1.0]))


def dense_program(rng, n, m, rank=None):
    M = rng.standard_normal((n, rank or n)) / np.sqrt(n)
    C = rng.standard_normal((m, n)) / np.sqrt(n)
    side, free = np.full(m, np.inf), np.full(n, np.inf)
    return StandardQP(M @ M.T, rng.standard_normal(n), C, -side, np.ones(m), -free, free)


@pytest.mark.parametrize("stored", ["dense", "sparse"])
def test_systems_solve_their_matrix(stored):
    rng = np.random.default_rng(3)
    p = dense_program(rng, 30, 40)
    p = p if stored == "dense" else p.stored_sparsely()
    system = SparseSystem(p) if p.is_sparse else DenseSystem(p)
    D, E = 10.0 ** rng.uniform(-3, 1, 30), 10.0 ** rng.uniform(-3, 1, 40)
    E[::7] = 1e20  # such rows have no part in it
    system.factor(D, E)
    r, s = rng.standard_normal(30), rng.standard_normal(40)
    P, C = (M.toarray() if p.is_sparse else M for M in (p.P, p.C))
    K = np.block([[P + np.diag(D), C.T], [C, -np.diag(E)]])
    np.testing.assert_allclose(
        np.concatenate(system.solve(r, s)), np.linalg.solve(K, np.r_[r, s]), rtol=1e-9, atol=1e-11
    )
    assert system.accuracy <= 1e-12


@pytest.mark.parametrize(
    ("rank", "weights", "single"), [(None, 1.0, True), (40, 1.0, True), (None, 1e9, False)]
)
def test_first_factors_have_single_precision_where_it_leaves_digits(rank, weights, single):
    rng = np.random.default_rng(4)
    n, m = 220, 500
    p = dense_program(rng, n, m, rank)
    system = DenseSystem(p)
    D, E = np.full(n, 1e-2), 1.0 / (weights * rng.uniform(0.1, 1.0, m))
    system.factor(D, E, rough=True)
    assert (system.L.dtype == np.float32) is single
    r, s = rng.standard_normal(n), rng.standard_normal(m)
    u, v = system.solve(r, s)
    top, low = p.P @ u + D * u + p.C.T @ v - r, p.C @ u - E * v - s
    error = max(abs(top).max(), abs(low).max()) / max(abs(r).max(), abs(s).max())
    assert error <= (1e-3 if single else 1e-6)  # condensed: products with the weights
    system.factor(D, E)  # a polish asks for all digits
    assert system.L.dtype == np.float64


def test_single_precision_is_given_up_where_it_fails():
    """Without curvature in most directions and next to nothing of proximal terms."""
    rng = np.random.default_rng(5)
    p = dense_program(rng, 220, 230)
    C = np.repeat(p.C[:23], 10, axis=0)  # 23 directions only
    p = StandardQP(np.eye(220) * 1e-2, p.q, C, p.row_low, p.row_high, p.lb, p.ub)
    system = DenseSystem(p)
    D, E = np.full(220, 1e-9), np.full(230, 1e-3)
    system.factor(D, E, rough=True)
    r = rng.standard_normal(220)
    u, v = system.solve(r, np.zeros(230), trusted=True)
    assert abs(p.P @ u + D * u + C.T @ v - r).max() <= max(system.rough, 1e-9) * abs(r).max()


@pytest.mark.parametrize("n", [200, 240])
def test_programs_that_begin_in_single_precision_end_in_double(n):
    """As the dual active set solves them, which factors P alone."""
    rng = np.random.default_rng(n)
    M, G = rng.standard_normal((n, n)), rng.standard_normal((3 * n, n))
    P, q = M @ M.T / n + 0.1 * np.eye(n), rng.standard_normal(n)
    h = G @ rng.standard_normal(n) + 0.3 * rng.random(3 * n)
    known = solve_qp(P, q, G, h)
    point = minimise(check_problem(P, q, G, h, *5 * (None,)).program, 1e-9)
    assert known.path == "active set"
    assert point.residuals.worst <= 1e-12
    np.testing.assert_allclose(point.x, known.x, atol=1e-10 * abs(known.x).max())
    np.testing.assert_array_equal(np.sign(point.y), known.active_rows)


def test_presolve_leaves_the_program_as_it_is():
    """Zeros that are stored go from a copy: the rows that remain were garbage."""
    C = sparse.csr_array(np.array([[0.0, 1.0, 2.0], [3.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    C.data[[0, 2]] = 0.0
    p = StandardQP(
        sparse.eye_array(3, format="csr"), np.ones(3), C, np.full(3, -1.0), np.ones(3),
        np.full(3, -9.0), np.full(3, 9.0),
    )  # fmt: skip
    before = C.copy()
    presolve(p)
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(p.C, name), getattr(before, name))


def test_superlu_keeps_the_first_order():
    """Later diagonals are factored in the order of the first, and solved as by a dense solver."""
    rng = np.random.default_rng(3)
    upper = grid(9)
    K = (upper + upper.T).toarray()
    factors = SuperLUFactor(sparse.csc_array(K + np.eye(81)))
    for seed in range(3):
        diagonal = 4.0 + rng.random(81)
        factors.factor(diagonal)
        r = rng.standard_normal((81, 1 + seed))
        full = K + np.diag(diagonal - K.diagonal())
        np.testing.assert_allclose(factors.solve(r), np.linalg.solve(full, r), atol=1e-13)
        assert (factors.pivots() > 0.0).all()
