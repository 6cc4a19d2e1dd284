"""The transform solver gives what scikit-fem and a sparse factorisation give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.linalg import LinearOperator, cg
from skfem import Basis, BilinearForm, ElementQuad1, LinearForm, MeshHex, MeshQuad, condense, solve
from skfem.helpers import dot, grad
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, ElementQuadAdini, InputError, UniformSolver, essential_dofs


def grid_basis(shape, lengths):
    ticks = [np.linspace(0, l, n + 1) for l, n in zip(lengths, shape, strict=True)]
    if len(shape) == 2:
        return Basis(MeshQuad.init_tensor(*ticks), ElementQuadAdini())
    return Basis(MeshHex.init_tensor(*ticks), ElementHexAdini())


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


def test_any_numbering_in_three_dimensions():
    basis = Basis(MeshHex().refined(2), ElementHexAdini())
    f = LinearForm(lambda v, w: w.x[2] * v).assemble(basis)
    expected = solve(*condense(laplace.assemble(basis), f, D=fixed_dofs(basis, "dirichlet")))
    x = UniformSolver.from_basis(basis).solve(f)
    np.testing.assert_allclose(x, expected, atol=1e-13)


@pytest.mark.parametrize("bc", ["dirichlet", "neumann"])
def test_symmetries(bc):
    """The inverse is symmetric; exchange of x and y and reflection carry over."""
    solver = UniformSolver((6, 6), 1.5, bc, c=1.0)
    rng = np.random.default_rng(2)
    f, g = rng.uniform(-1, 1, (2, solver.size))
    assert f @ solver.solve(g) == pytest.approx(g @ solver.solve(f), rel=1e-12)

    load, u = solver.to_grid(f), solver.to_grid(solver.solve(f))
    exchanged = solver.from_grid(load[[0, 2, 1]].transpose(0, 2, 1))
    np.testing.assert_allclose(
        solver.to_grid(solver.solve(exchanged)), u[[0, 2, 1]].transpose(0, 2, 1), atol=1e-13
    )
    sign = np.array([1, -1, 1])[:, None, None]
    reflected = solver.from_grid(sign * load[:, ::-1])
    np.testing.assert_allclose(
        solver.to_grid(solver.solve(reflected)), sign * u[:, ::-1], atol=1e-13
    )


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


def solver():
    return UniformSolver((4, 4))


def stretched():
    mesh = MeshQuad.init_tensor(np.array([0, 0.4, 1.0]), np.array([0, 0.5, 1.0]))
    return Basis(mesh, ElementQuadAdini())


def without_cell(cell):
    mesh = MeshQuad.init_tensor(np.arange(5.0), np.arange(4.0))
    return Basis(mesh.remove_elements(np.array([cell])), ElementQuadAdini())


CASES = {
    "one cell": (lambda: UniformSolver((1, 4)), "shape"),
    "fractional shape": (lambda: UniformSolver((2.0, 4.0)), "shape"),
    "one direction": (lambda: UniformSolver((4,)), "shape"),
    "four directions": (lambda: UniformSolver((2, 2, 2, 2)), "shape"),
    "negative length": (lambda: UniformSolver((2, 2), (1, -1)), "lengths"),
    "three lengths": (lambda: UniformSolver((2, 2), (1, 1, 1)), "lengths"),
    "NaN length": (lambda: UniformSolver((2, 2), np.nan), "lengths"),
    "condition": (lambda: UniformSolver((2, 2), bc="robin"), "bc"),
    "k zero": (lambda: UniformSolver((2, 2), k=0.0), "k: expected positive"),
    "c negative": (lambda: UniformSolver((2, 2), c=-1.0), "c: expected not negative"),
    "load too short": (lambda: solver().solve(np.ones(5)), r"\(75,\)"),
    "NaN load": (lambda: solver().solve(np.full(75, np.nan)), "NaN"),
    "grid of wrong shape": (lambda: solver().from_grid(np.ones((3, 5))), "values"),
    "double dofs": (lambda: solver().as_linear_operator([1, 1]), "different"),
    "dof out of range": (lambda: solver().as_linear_operator([75]), "0 to 74"),
    "mode zero": (lambda: solver().eigenvalue(0, 1), "modes"),
    "one mode": (lambda: solver().eigenvalue(1), "modes"),
    "fractional mode": (lambda: solver().eigenvalue(1.5, 1), "modes"),
    "no digits": (lambda: solver().eigenvalue(1, 1, digits=0), "digits"),
    "constant": (lambda: UniformSolver((4, 4), bc="neumann").eigenvalue_error(0, 0), "zero"),
    "stretched grid": (lambda: UniformSolver.from_basis(stretched()), "uniform grid"),
    "hole in the grid": (lambda: UniformSolver.from_basis(without_cell(4)), "full box"),
    "corner cut off": (lambda: UniformSolver.from_basis(without_cell(0)), "full box"),
    "single cell": (lambda: UniformSolver.from_basis(Basis(MeshQuad(), ElementQuadAdini())), "at"),
    "another element": (
        lambda: UniformSolver.from_basis(Basis(MeshQuad().refined(1), ElementQuad1())),
        "Adini's element",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    attempt, message = CASES[case]
    with pytest.raises(InputError, match=message):
        attempt()
