"""Discrete eigenvalues in any precision."""

from decimal import Decimal, localcontext
from itertools import product

import mpmath
import numpy as np
import pytest
from scipy.linalg import eigh
from skfem import Basis, BilinearForm, MeshHex, MeshQuad
from skfem.models.poisson import mass

from skfem_adini import ElementHexAdini, ElementQuadAdini, UniformSolver
from skfem_adini.solvers.exact_matrices import exact_matrix

# Relative errors of the Dirichlet eigenvalue (1, 1), from an independent derivation of the symbol.
PUBLISHED = {
    4: 1.75202e-4,
    8: 3.27816e-6,
    16: 5.39657e-8,
    32: 8.54733e-10,
    64: 1.3401e-11,
    128: 2.09571e-13,
    256: 3.27525e-15,
}


@pytest.mark.parametrize("n", PUBLISHED)
def test_dirichlet_errors(n):
    assert UniformSolver((n, n)).eigenvalue_error(1, 1) == pytest.approx(PUBLISHED[n], rel=6e-6)


def test_order_is_six_and_the_constant_is_known():
    """The limit of the error over h^6 is (29 / 30240) pi^6, to the digits that n = 1024 gives."""
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
    ticks = [np.linspace(0, l, n + 1) for l, n in zip(lengths, shape, strict=True)]
    if dim == 2:
        basis = Basis(MeshQuad.init_tensor(*ticks), ElementQuadAdini())
    else:
        basis = Basis(MeshHex.init_tensor(*ticks), ElementHexAdini())
    form = BilinearForm(
        lambda u, v, _: sum(k[i] * u.grad[i] * v.grad[i] for i in range(dim)) + c * u * v
    )
    solver = UniformSolver(shape, lengths, bc, k, c)
    I = np.ix_(solver.free, solver.free)
    spectrum = eigh(
        form.assemble(basis).toarray()[I], mass.assemble(basis).toarray()[I], eigvals_only=True
    )
    first = 1 if bc == "dirichlet" else 0
    found = [
        float(solver.eigenvalue(*modes, digits=20))
        for modes in product(*(range(first, n + 1 - first) for n in shape))
    ]
    distances = np.abs(spectrum[:, None] - found).min(axis=0) / found
    assert distances.max() < 1e-12
    assert min(found) == pytest.approx(spectrum[0], rel=1e-12)


def quad():
    corners = np.array([[0, 0.3, 0.3, 0], [0, 0, 0.8, 0.8]])
    return Basis(MeshQuad(corners, np.array([[0, 1, 2, 3]]).T), ElementQuadAdini(), intorder=8)


def cube():
    ticks = [np.array([0, l]) for l in (0.3, 0.8, 1.7)]
    return Basis(MeshHex.init_tensor(*ticks), ElementHexAdini(), intorder=8)


@pytest.mark.parametrize("make", [quad, cube])
def test_exact_matrices_are_those_of_the_elements(make):
    """On one cell, with the dofs u and h_i u_i, for all products of derivatives."""
    basis = make()
    dim, p = basis.mesh.dim(), basis.mesh.p
    sides = np.ptp(p, axis=1)
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
