"""Multigrid and its near-null spaces: what a factorisation gives, in few iterations, proved."""

import numpy as np
import pytest
from optional_packages import AMG
from scipy import sparse
from skfem import Basis, ElementVector, LinearForm, MeshHex, MeshQuad
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

import skfem_adini
from skfem_adini import ElementHexAdini, ElementQuadAdini, NotConverged, factorize, near_null_space
from skfem_adini.solvers import multigrid

pytestmark = AMG


def bricks(n, form, vector=False, lengths=(1.0, 1.0, 1.0), **fields):
    """A basis for loads, which need only be some loads, and the matrix of a form."""
    mesh = MeshHex.init_tensor(*[np.linspace(0, l, n + 1) for l in lengths])
    element = ElementVector(ElementHexAdini()) if vector else ElementHexAdini()
    return Basis(mesh, element, intorder=1), skfem_adini.assemble(form, mesh, element, **fields)


def held(basis, K, facets):
    """Return the matrix, a load and the near-null space of the free dofs."""
    free = basis.complement_dofs(skfem_adini.essential_dofs(basis, facets))
    if "^" in basis.elem.dofnames[0]:
        pull = np.arange(1.0, basis.mesh.dim() + 1)
        f = LinearForm(lambda v, w: dot(np.multiply.outer(pull, 1 + w.x[0]), v))
    else:
        f = LinearForm(lambda v, w: np.exp(w.x[0]) * v)
    return K[free][:, free], f.assemble(basis)[free], near_null_space(basis, free)


def poisson(n, form=laplace, **options):
    basis, K = bricks(n, form, **options)
    return held(basis, K, basis.mesh.boundary_facets())


def clamped_block(n, lengths=(1.0, 1.0, 1.0)):
    """Elastic body held at z = 0: the bending modes are those that need the rotations."""
    basis, K = bricks(n, linear_elasticity(1.0, 1.0), vector=True, lengths=lengths)
    return held(basis, K, basis.mesh.facets_satisfying(lambda x: x[2] == 0))


def plane(element):
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 13)] * 2), ElementVector(element))
    left = basis.mesh.facets_satisfying(lambda x: x[0] == 0)
    return held(basis, linear_elasticity(1.0, 1.0).assemble(basis), left)


def slanted():
    """Conditions on slanted edges, where the free dofs are no longer dofs of the mesh."""
    mesh = MeshQuad().refined(4)
    basis = Basis(MeshQuad([[1, -0.7], [0.7, 1]] @ mesh.p, mesh.t), ElementQuadAdini())
    T, x0 = skfem_adini.essential_constraints(basis, mesh.boundary_facets(), lambda x: x[0] ** 2)
    K = laplace.assemble(basis)
    return T.T @ K @ T, -T.T @ (K @ x0), near_null_space(basis, T)


PROBLEMS = {
    "slanted conditions": slanted,
    "poisson": lambda: poisson(6),
    "flat bricks": lambda: poisson(6, lengths=(1.0, 2.0, 0.5)),
    "elastic block": lambda: clamped_block(4),
    "elastic plate": lambda: plane(ElementQuadAdini()),
    "bicubic plate": lambda: plane(skfem_adini.ElementQuadBFS()),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_agrees_with_a_factorisation(problem):
    A, b, near_null = PROBLEMS[problem]()
    solver = factorize(A, solver="amg", near_null=near_null, tol=1e-12)
    x = solver.solve(b)
    expected = factorize(A).solve(b)
    np.testing.assert_allclose(x, expected, atol=1e-10 * np.abs(expected).max())
    assert 3 < solver.iterations < 60
    scale = 1 / np.sqrt(A.diagonal())
    assert np.linalg.norm(scale * (b - A @ x)) <= 1e-12 * np.linalg.norm(scale * b)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("make", "cells", "most"), [(poisson, (4, 6, 9), 12), (clamped_block, (3, 5, 7), 20)]
)
def test_iterations_do_not_grow(make, cells, most):
    counts = []
    for n in cells:
        A, b, near_null = make(n)
        solver = factorize(A, solver="amg", near_null=near_null)
        solver.solve(b)
        counts.append(solver.iterations)
    assert max(counts) <= most
    assert counts[2] <= counts[1] + 2


def test_several_loads_and_none():
    A, b, near_null = poisson(3)
    solver = factorize(A, solver="amg", near_null=near_null)
    loads = np.column_stack([b, 0 * b, -2 * b])
    x = solver.solve(loads)
    np.testing.assert_array_equal(x[:, 1], 0)
    np.testing.assert_allclose(x[:, 2], -2 * x[:, 0], atol=1e-13)
    np.testing.assert_array_equal(x[:, 0], solver.solve(b))
    assert solver.solve(np.zeros((len(b), 0))).shape == (len(b), 0)


def test_results_repeat_and_no_global_state_moves():
    A, b, near_null = clamped_block(3)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    x, y = (factorize(A, solver="amg", near_null=near_null).solve(b) for _ in range(2))
    np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_too_few_iterations_are_no_result():
    A, b, near_null = poisson(4)
    solver = factorize(A, solver="amg", near_null=near_null, max_iterations=2)
    with pytest.raises(NotConverged, match=r"residual .* after 2 iterations, asked for 1e-10"):
        solver.solve(b)


@pytest.mark.turns(4)
def test_slender_body():
    """Its displacements are so large that no solver brings the residual to 1e-11 of the load."""
    A, b, near_null = clamped_block(4, lengths=(1.0, 1.0, 16.0))
    solver = factorize(A, solver="amg", near_null=near_null, tol=1e-13)
    x, expected = solver.solve(b), factorize(A).solve(b)
    scale = 1 / np.sqrt(A.diagonal())

    def residual(x):
        return np.linalg.norm(scale * (b - A @ x)) / np.linalg.norm(scale * b)

    assert residual(x) < 3 * residual(expected)
    assert residual(expected) > 1e-11
    np.testing.assert_allclose(x, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("vector", [False, True], ids=["poisson", "elasticity"])
def test_floating_bodies(vector):
    """Without supports there is a solution for balanced loads alone."""
    basis, K = bricks(4, linear_elasticity(1.0, 1.0) if vector else laplace, vector=vector)
    near_null = near_null_space(basis)
    solver = factorize(K, solver="amg", near_null=near_null)
    b = K @ np.random.default_rng(0).uniform(-1, 1, basis.N)
    scale = 1 / np.sqrt(K.diagonal())
    residual = scale * (b - K @ solver.solve(b))
    assert np.linalg.norm(residual) <= 2e-10 * np.linalg.norm(scale * b)
    with pytest.raises(NotConverged):
        solver.solve(b + 0.1 * np.linalg.norm(b) * near_null.modes[:, 0])


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("nu", "most"), [(0.45, 45), (0.49, 90)])
def test_nearly_incompressible(nu, most):
    basis, K = bricks(5, linear_elasticity(nu / (1 - 2 * nu), 0.5), vector=True)
    A, b, near_null = held(basis, K, basis.mesh.facets_satisfying(lambda x: x[2] == 0))
    solver = factorize(A, solver="amg", near_null=near_null)
    expected = factorize(A).solve(b)
    np.testing.assert_allclose(solver.solve(b), expected, atol=1e-8 * np.abs(expected).max())
    assert solver.iterations <= most


def test_a_residual_that_lies_is_found_out(monkeypatch):
    """Conjugate gradients that claim to be done are not believed."""
    A, b, near_null = poisson(3)
    monkeypatch.setattr(multigrid, "cg", lambda A, b, **_: (0.9 * b, 0))
    with pytest.raises(NotConverged):
        factorize(A, solver="amg", near_null=near_null).solve(b)


def test_indefinite_matrix_is_no_result():
    """Its diagonal is positive, its lowest eigenvalues are not."""
    A, b, near_null = poisson(3)
    size = 1 / np.sqrt(A.diagonal())
    D = sparse.diags_array(size)
    lowest = np.linalg.eigvalsh((D @ A @ D).toarray())[:4]
    shifted = A - np.mean(lowest[1:3]) * sparse.diags_array(A.diagonal())
    try:
        x = factorize(shifted, solver="amg", near_null=near_null).solve(b)
    except NotConverged:
        return
    assert np.linalg.norm(size * (b - shifted @ x)) <= 1e-10 * np.linalg.norm(size * b)


A, B, SPACE = poisson(3)
BAD = [
    ("near_null", A, {"near_null": None}),
    ("definite matrix", A, {"definite": False}),
    ("the same dofs", A[1:][:, 1:], {}),
    ("tol", A, {"tol": 0.0}),
    ("max_iterations", A, {"max_iterations": 0}),
]


def test_bad_input():
    for words, matrix, options in BAD:
        with pytest.raises(skfem_adini.InputError, match=words):
            factorize(matrix, solver="amg", **{"near_null": SPACE} | options)
    factors = factorize(A, solver="amg", near_null=SPACE)
    for words, load in (("b: .*NaN", B * np.nan), ("b: expected", B[1:])):
        with pytest.raises(skfem_adini.InputError, match=words):
            factors.solve(load)


# Rigid motions and linear functions, in the dofs of these elements.


X = np.array([0, 0.3, 0.5, 1.1])


@pytest.mark.sampled(2)
def test_rigid_motions(space):
    mesh, kind = space
    dim = mesh.dim()
    basis = Basis(mesh, ElementVector(kind()), intorder=4 if dim == 3 else None)
    modes = near_null_space(basis).modes
    count = dim * (dim + 1) // 2
    assert modes.shape == (basis.N, count)
    assert np.linalg.matrix_rank(modes) == count
    K = linear_elasticity(1.0, 1.0).assemble(basis)
    np.testing.assert_allclose(K @ modes, 0, atol=1e-12 * abs(K).max())


def test_scalar_field_has_linear_functions(parallelepipeds):
    """Their energy is at the boundary alone, that of the constant nowhere."""
    basis = Basis(parallelepipeds, ElementHexAdini(), intorder=4)
    forces = laplace.assemble(basis) @ near_null_space(basis).modes
    assert forces.shape[1] == 4
    np.testing.assert_allclose(forces[:, 0], 0, atol=1e-12)
    inside = np.delete(np.arange(basis.N), basis.get_dofs().all())
    np.testing.assert_allclose(forces[inside], 0, atol=1e-12)


def test_unknowns_and_their_vertices():
    basis = Basis(MeshQuad.init_tensor(X, X), ElementQuadAdini())
    free = basis.complement_dofs(skfem_adini.essential_dofs(basis, basis.mesh.boundary_facets()))
    space, whole = near_null_space(basis, free), near_null_space(basis)
    np.testing.assert_array_equal(space.modes, whole.modes[free])
    for row in basis.nodal_dofs:
        np.testing.assert_array_equal(whole.vertex[row], np.arange(basis.mesh.nvertices))
    np.testing.assert_array_equal(space.vertex, whole.vertex[free])


def test_parametrised_unknowns():
    """T z is a mode again wherever the condition allows it."""
    turned = MeshQuad(
        np.array([[1, -1], [1, 1]]) @ MeshQuad().refined(2).p, MeshQuad().refined(2).t
    )
    basis = Basis(turned, ElementQuadAdini())
    T, _ = skfem_adini.essential_constraints(basis, turned.boundary_facets())
    space, modes = near_null_space(basis, T), near_null_space(basis).modes
    np.testing.assert_allclose(space.modes, T.T @ modes, atol=1e-12)
    assert space.vertex.shape == (T.shape[1],)
    inside = np.setdiff1d(np.arange(basis.N), basis.get_dofs().all())
    np.testing.assert_allclose((T @ space.modes)[inside], modes[inside], atol=1e-12)


def test_hanging_nodes_keep_the_modes():
    """Linear functions are continuous across hanging nodes, so nothing of them is lost."""
    mesh = MeshQuad().refined(2)
    coarse, fine = mesh.restrict(np.arange(8)), mesh.restrict(np.arange(8, 16)).refined()
    basis = Basis(coarse + fine, ElementVector(ElementQuadAdini()))
    T, _ = skfem_adini.hanging_constraints(basis)
    assert T.shape[1] < T.shape[0]
    space = near_null_space(basis, T)
    np.testing.assert_allclose(T @ space.modes, near_null_space(basis).modes, atol=1e-12)
