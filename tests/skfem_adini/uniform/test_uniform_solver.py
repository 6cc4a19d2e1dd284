"""The transform solver against sparse factorisations; its eigenvalues in any precision."""

from decimal import Decimal, localcontext
from itertools import product

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, cg
from skfem import Basis, BilinearForm, LinearForm, MeshHex, MeshQuad, condense, solve
from skfem.helpers import dot, grad
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, ElementQuadAdini, InputError, UniformSolver, essential_dofs
from skfem_adini.solvers.exact_matrices import exact_matrix


def grid_basis(shape, lengths, intorder=None):
    ticks = [np.linspace(0, l, n + 1) for l, n in zip(lengths, shape, strict=True)]
    if len(shape) == 2:
        return Basis(MeshQuad.init_tensor(*ticks), ElementQuadAdini(), intorder=intorder)
    return Basis(MeshHex.init_tensor(*ticks), ElementHexAdini(), intorder=intorder)


def operator(basis, k, c):
    dim = basis.mesh.dim()
    form = BilinearForm(
        lambda u, v, _: sum(k[i] * u.grad[i] * v.grad[i] for i in range(dim)) + c * u * v
    )
    return form.assemble(basis)


def fixed_dofs(basis, bc):
    """Find the fixed dofs from the coordinates, without the solver's bookkeeping."""
    if bc == "dirichlet":
        return essential_dofs(basis, basis.mesh.boundary_facets())
    p = basis.mesh.p
    ends = np.isclose(p, p.min(axis=1, keepdims=True)) | np.isclose(p, p.max(1, keepdims=True))
    return np.concatenate([row[end] for row, end in zip(basis.nodal_dofs[1:], ends, strict=True)])


@st.composite
def problems(draw):
    dim = draw(st.sampled_from([2, 2, 3]))
    number = st.floats(0.3, 3)
    shape = draw(st.lists(st.integers(2, 9 if dim == 2 else 3), min_size=dim, max_size=dim))
    lengths = draw(st.lists(number, min_size=dim, max_size=dim))
    k = draw(st.lists(number, min_size=dim, max_size=dim))
    return shape, lengths, k, draw(st.sampled_from([0.5, 7.0])), draw(st.integers(0, 99))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("bc", ["dirichlet", "neumann"])
@given(problem=problems())
def test_equals_a_sparse_solve(bc, problem):
    shape, lengths, k, c, seed = problem
    basis = grid_basis(shape, lengths)
    f = np.random.default_rng(seed).uniform(-1, 1, basis.N)
    solver = UniformSolver(shape, lengths, bc, k, c)
    D = fixed_dofs(basis, bc)
    expected = solve(*condense(operator(basis, k, c), f, D=D))
    np.testing.assert_array_equal(solver.free, basis.complement_dofs(D))
    x = solver.solve(f)
    np.testing.assert_allclose(x, expected, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_array_equal(x[D], 0)


@pytest.mark.parametrize("shape", [(7, 4), (4, 2, 3)], ids=str)
def test_pure_neumann_problem_has_mean_zero(shape):
    basis = grid_basis(shape, shape)
    dofs = len(shape) + 1
    f = np.random.default_rng(0).uniform(-1, 1, basis.N)
    with pytest.raises(InputError, match="balance"):
        UniformSolver(shape, shape, "neumann").solve(f)
    f[::dofs] -= f[::dofs].mean() + 1e-11  # an imbalance that passes for rounding
    solver = UniformSolver(shape, shape, "neumann")
    x = solver.solve(f)
    residual = (laplace.assemble(basis) @ x - f)[solver.free]
    np.testing.assert_allclose(residual, 0, atol=1e-10)
    constant = np.zeros(basis.N)
    constant[::dofs] = 1
    assert constant @ mass.assemble(basis) @ x == pytest.approx(0, abs=2e-14)


@pytest.mark.turns(4)
def test_residual_on_a_fine_grid():
    """In the dofs u and h u_x; rounding of x alone leaves 1e-12 of a smooth load."""
    n = 256
    basis = grid_basis((n, n), (1, 1))
    h = np.tile([1, 1 / n, 1 / n], basis.N // 3)
    A, solver = laplace.assemble(basis), UniformSolver((n, n))
    I = solver.free
    rough = np.random.default_rng(0).uniform(-1, 1, basis.N) * h
    x = solver.solve(rough)
    assert np.linalg.norm(((A @ x - rough) / h)[I]) <= 1e-13 * np.linalg.norm((rough / h)[I])
    smooth = LinearForm(lambda v, w: np.exp(w.x[0]) * v).assemble(basis)
    x = solver.solve(smooth)
    terms = (abs(A) @ np.abs(x) / h)[I]
    assert np.abs(((A @ x - smooth) / h)[I]).max() <= 1e-15 * terms.max()


def test_grid_arrays_hold_the_coordinates():
    for shape in [(3, 5), (3, 4, 2)]:
        basis = grid_basis(shape, shape)
        solver = UniformSolver(shape, shape)
        x = np.random.default_rng(0).uniform(size=basis.N)
        np.testing.assert_array_equal(solver.from_grid(solver.to_grid(x)), x)
        for i in range(len(shape)):
            x = basis.zeros()
            x[basis.nodal_dofs[0]] = basis.mesh.p[i]
            x[basis.nodal_dofs[i + 1]] = 1.0
            grid = solver.to_grid(x)
            expected = np.indices([n + 1 for n in shape])[i]
            np.testing.assert_allclose(grid[0], expected, atol=1e-14)
            np.testing.assert_array_equal(grid[i + 1], 1.0)


@pytest.mark.parametrize("bc", ["dirichlet", "neumann"])
def test_any_numbering(bc):
    mesh = MeshQuad().refined(3)
    basis = Basis(MeshQuad(mesh.p * [[2.0], [0.5]] - 1, mesh.t), ElementQuadAdini())
    f = LinearForm(lambda v, w: (w.x[0] + w.x[1] ** 3) * v).assemble(basis)
    solver = UniformSolver.from_basis(basis, bc, k=(1.0, 3.0), c=2.0)
    assert solver.lengths == (2.0, 0.5)
    expected = solve(*condense(operator(basis, (1, 3), 2), f, D=fixed_dofs(basis, bc)))
    np.testing.assert_allclose(solver.solve(f), expected, atol=1e-13)
    if bc == "neumann":
        return
    basis = Basis(MeshHex().refined(2), ElementHexAdini())
    f = LinearForm(lambda v, w: w.x[2] * v).assemble(basis)
    expected = solve(*condense(laplace.assemble(basis), f, D=fixed_dofs(basis, "dirichlet")))
    x = UniformSolver.from_basis(basis).solve(f)
    np.testing.assert_allclose(x, expected, atol=1e-13)


def iterations(n, bc):
    """Count CG steps for a conductivity between 0.1 and 1.9 on an n x n grid."""
    basis = grid_basis((n, n), (1, 1))
    form = BilinearForm(
        lambda u, v, w: (1 + 0.9 * np.sin(3 * w.x[0] + 5 * w.x[1])) * dot(grad(u), grad(v))
    )
    solver = UniformSolver((n, n), 1.0, bc)
    I = solver.free if bc == "dirichlet" else np.arange(basis.N)
    A = form.assemble(basis)[I][:, I]
    f = LinearForm(lambda v, w: np.sin(5 * w.x[0]) * v).assemble(basis)[I]
    if bc == "neumann":
        f[::3] -= f[::3].mean()
    steps = []
    preconditioner = solver.as_linear_operator(I)
    x, info = cg(A, f, rtol=1e-9, M=preconditioner, callback=lambda _: steps.append(1))
    assert info == 0
    assert np.linalg.norm(A @ x - f) <= 1e-8 * np.linalg.norm(f)
    return len(steps)


@pytest.mark.parametrize(("bc", "most"), [("dirichlet", 55), ("neumann", 125)])
def test_preconditioned_iterations_do_not_grow(bc, most):
    """The Neumann problem is the natural one: its normal derivatives on the boundary are free."""
    counts = [iterations(n, bc) for n in (8, 16, 32)]
    assert max(counts) <= most
    assert counts[2] <= 1.15 * counts[1]


@pytest.mark.parametrize("bc", ["dirichlet", "neumann"])
def test_preconditioner_is_symmetric_and_definite(bc):
    solver = UniformSolver((3, 4), (1.0, 2.0), bc)
    P = solver.as_linear_operator() @ np.eye(solver.size)
    np.testing.assert_allclose(P, P.T, atol=1e-13)
    assert np.linalg.eigvalsh(P).min() > 1e-3
    assert isinstance(solver.as_linear_operator([0, 5]), LinearOperator)
    np.testing.assert_allclose(
        solver.as_linear_operator([5, 0]) @ np.eye(2), P[np.ix_([5, 0], [5, 0])], atol=1e-14
    )


# Discrete eigenvalues in any precision.


# Relative errors of the Dirichlet eigenvalue (1, 1), from an independent derivation of the symbol.
PUBLISHED = {4: 1.75202e-4, 8: 3.27816e-6, 16: 5.39657e-8, 32: 8.54733e-10}
PUBLISHED |= {64: 1.3401e-11, 128: 2.09571e-13, 256: 3.27525e-15}


def test_dirichlet_errors_order_six_and_its_constant():
    """The limit of the error over h^6 is (29 / 30240) pi^6, to the digits that n = 1024 gives."""
    for n, error in PUBLISHED.items():
        assert UniformSolver((n, n)).eigenvalue_error(1, 1) == pytest.approx(error, rel=6e-6)
    errors = [UniformSolver((n, n)).eigenvalue_error(1, 1) for n in (256, 512, 1024)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 6, atol=1e-4)
    assert errors[-1] * 1024**6 == pytest.approx(29 / 30240 * np.pi**6, rel=1e-5)


def test_imposed_normal_derivatives_are_less_accurate():
    """Errors with u_n = 0 imposed; the natural condition has 3.81e-6, 8.80e-8, 1.64e-9."""
    errors = [UniformSolver((n, n), bc="neumann").eigenvalue_error(1, 0) for n in (4, 8, 16)]
    np.testing.assert_allclose(errors, [6.350e-6, 1.149e-7, 1.869e-9], rtol=4e-4)


def test_a_finer_grid_with_more_waves_is_the_same_problem():
    coarse = UniformSolver((5, 7), (1, 2)).eigenvalue(2, 3, digits=60)
    fine = UniformSolver((10, 14), (1, 2)).eigenvalue(4, 6, digits=60)
    with localcontext(prec=80):
        assert abs(fine / coarse - 4) < Decimal("1e-58")


def test_digits_agree_with_multiple_precision_arithmetic():
    """The symbol written out for 2-D by sympy's matrices and mpmath's sines and roots."""
    n, k, l = 6, 2, 5
    value = UniformSolver((n, n)).eigenvalue(k, l, digits=50)
    with mpmath.workdps(70):
        theta = [mpmath.pi * k / n, mpmath.pi * l / n]
        blocks = []
        for matrices in ([exact_matrix(2, 0, 0), exact_matrix(2, 1, 1)], [exact_matrix(2)]):
            block = mpmath.zeros(3)
            for matrix in matrices:
                cell = matrix.numerators.reshape(4, 3, 4, 3)
                for (a, s), (b, t) in product(enumerate(product((0, 1), repeat=2)), repeat=2):
                    wave = mpmath.expj(
                        sum(w * (q - p) for w, p, q in zip(theta, s, t, strict=True))
                    )
                    part = mpmath.matrix(cell[a, :, b].tolist()) / matrix.denominator
                    block += wave * part
            blocks.append(block)
        K, M = blocks
        roots = mpmath.eig(M**-1 * K, left=False, right=False)
        expected = min(mpmath.re(root) for root in roots) * n**2
        assert abs(mpmath.mpf(str(value)) / expected - 1) < mpmath.mpf(10) ** -48


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 2)], ids=str)
@pytest.mark.parametrize("bc", ["dirichlet", "neumann"])
def test_every_block_has_its_eigenvalue_in_the_spectrum(shape, bc):
    dim = len(shape)
    lengths, k, c = [1.0, 1.5, 0.7][:dim], [1.0, 2.0, 0.4][:dim], 3.0
    basis = grid_basis(shape, lengths)
    solver = UniformSolver(shape, lengths, bc, k, c)
    I = np.ix_(solver.free, solver.free)
    A, M = operator(basis, k, c).toarray()[I], mass.assemble(basis).toarray()[I]
    spectrum = eigh(A, M, eigvals_only=True)
    first = 1 if bc == "dirichlet" else 0
    found = [
        float(solver.eigenvalue(*modes, digits=20))
        for modes in product(*(range(first, n + 1 - first) for n in shape))
    ]
    distances = np.abs(spectrum[:, None] - found).min(axis=0) / found
    assert distances.max() < 1e-12
    assert min(found) == pytest.approx(spectrum[0], rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_exact_matrices_are_those_of_the_elements(dim):
    """On one cell, with the dofs u and h_i u_i, for all products of derivatives."""
    sides = np.array([0.3, 0.8, 1.7])[:dim]
    basis = grid_basis((1,) * dim, sides, intorder=8)
    p = basis.mesh.p
    nodes = np.lexsort(p[::-1])
    dofs = basis.nodal_dofs[:, nodes].T.ravel()
    scale = np.tile([1, *(1 / sides)], 2**dim)
    for row, column in product([None, *range(dim)], repeat=2):
        form = BilinearForm(lambda u, v, _, i=row, j=column: part(v, i) * part(u, j))
        weight = np.prod(sides)
        weight /= np.prod([sides[i] for i in (row, column) if i is not None])
        exact = exact_matrix(dim, row, column)
        assembled = form.assemble(basis).toarray()[np.ix_(dofs, dofs)] * np.outer(scale, scale)
        np.testing.assert_allclose(
            assembled / weight, exact.numerators / exact.denominator, atol=1e-14
        )


def part(u, direction):
    return u if direction is None else u.grad[direction]
