"""What `refine_eigenpair` and `factorize` are given: bases, complex numbers, NaN."""

import numpy as np
import pytest
from scipy import sparse
from skfem import Basis, ElementVector, FacetBasis, InteriorFacetBasis, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementQuadAdini,
    InputError,
    UniformSolver,
    factorize,
    lowest_eigenpairs,
    refine_eigenpair,
)

MESH = MeshQuad.init_tensor(np.linspace(0, 2, 17), np.linspace(0, 1, 9))
BASIS = Basis(MESH, ElementQuadAdini())
LEFT = np.flatnonzero(MESH.p[0, MESH.t].mean(axis=0) < 1)


def modes(basis):
    return lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), 4)


def test_some_cells_of_a_mesh():
    """An IndexError came for a basis with elements=; the half is a domain of its own."""
    part = Basis(MESH, ElementQuadAdini(), elements=LEFT)
    alone = MESH.restrict(LEFT)
    values, x = modes(Basis(alone, ElementQuadAdini()))
    whole = part.zeros()
    of_place = {tuple(p): k for k, p in enumerate(MESH.p.T)}
    mine, its = part.nodal_dofs, Basis(alone, ElementQuadAdini()).nodal_dofs
    for k, p in enumerate(alone.p.T):
        whole[mine[:, of_place[tuple(p)]]] = x[its[:, k], 1]
    found = refine_eigenpair(part, whole)
    assert float(found.value) == pytest.approx(values[1], rel=1e-10)
    assert found.residual < 1e-8
    with pytest.raises(InputError, match="zero in all cells"):
        refine_eigenpair(Basis(MESH, ElementQuadAdini(), elements=[0]), np.eye(BASIS.N)[-1])


@pytest.mark.parametrize("kind", [FacetBasis, InteriorFacetBasis])
def test_bases_of_facets_are_refused(kind):
    """Anything passed as an eigenvector: the residual was NaN, and no NaN is above a tolerance."""
    basis = kind(MESH, ElementQuadAdini())
    for x in (np.ones(basis.N), modes(BASIS)[1][:, 1]):
        with pytest.raises(InputError, match="Basis of cells"):
            refine_eigenpair(basis, x)


def test_what_is_no_eigenvector():
    x = modes(BASIS)[1][:, 1]
    noise = np.random.default_rng(0).standard_normal(BASIS.N)
    bad = {
        "no eigenvector": [(BASIS, noise), (BASIS, x + 1e-3 * noise)],
        "x: expected a finite": [(BASIS, bad) for bad in (x * 0, x[:-1], x / np.nan)],
        "x: expected real": [(BASIS, x * (1 + 1j))],
        "x: expected": [(BASIS, "mode"), (BASIS, None)],
        "basis:": [(MESH, x), (Basis(MESH, ElementVector(ElementQuadAdini())), x), (None, x)],
    }  # fmt: skip
    for message, cases in bad.items():
        for basis, vector in cases:
            with pytest.raises(InputError, match=message):
                refine_eigenpair(basis, vector)
    for keys in ({"fixed": [10**6]}, {"fixed": [-1]}, {"fixed": [0.5]}, {"tol": np.nan}):
        with pytest.raises(InputError, match=next(iter(keys))):
            refine_eigenpair(BASIS, x, **keys)


@pytest.mark.parametrize("solver", ["auto", "superlu"])
def test_complex_loads_and_matrices(solver):
    """The imaginary part of a load was dropped, and that of a matrix."""
    rng = np.random.default_rng(1)
    A = sparse.diags_array(rng.uniform(1, 2, 9)).tocsr()
    b = rng.standard_normal((9, 2)) + 1j * rng.standard_normal((9, 2))
    factors = factorize(A, solver=solver)
    for load in (b, b[:, 0]):
        np.testing.assert_allclose(A @ factors.solve(load), load, rtol=1e-14)
    assert factors.solve(b.real).dtype == np.float64
    assert np.array_equal(factorize(A + 0j, solver=solver).solve(b.real), factors.solve(b.real))
    with pytest.raises(InputError, match="A: expected real numbers"):
        factorize(A + 1e-3j * sparse.eye_array(9), solver=solver)
    for bad in (np.nan, np.inf, np.inf * 1j):
        with pytest.raises(InputError, match="b: the load holds NaN"):
            factors.solve(np.full(9, bad))
    for bad in ("load", None, [None] * 9):
        with pytest.raises(InputError, match=r"b: (expected|the load)"):
            factors.solve(bad)


def test_uniform_solver_takes_real_numbers():
    solver = UniformSolver((4, 4))
    f = np.ones(solver.size)
    for bad in (f * 1j, "load", None):
        with pytest.raises(InputError, match="x: expected"):
            solver.solve(bad)
    assert np.array_equal(solver.solve(f + 0j), solver.solve(f))
    for bad in ([0.5], [solver.size], [-1], "all"):
        with pytest.raises(InputError, match="dofs: expected"):
            solver.as_linear_operator(bad)
