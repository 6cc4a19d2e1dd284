"""The brick's closed form against dual bases derived in exact arithmetic."""

from itertools import product

import numpy as np
import pytest
import sympy
from skfem import MeshHex

from skfem_adini import ElementHexAdini

X = sympy.symbols("x y z")
EXPONENTS = [e for e in product(range(4), repeat=3) if sum(k > 1 for k in e) <= 1]
SPACE = [X[0] ** i * X[1] ** j * X[2] ** k for i, j, k in EXPONENTS]
# Reference corners in the order of MeshHex.
CORNERS = [(1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)]
POINTS = [tuple(sympy.Rational(n, 7) for n in p) for p in product((0, 2, 5, 7), repeat=3)]
FLOATS = np.array(POINTS, dtype=float).T


def test_the_space_has_32_dimensions():
    cubics = [e for e in product(range(4), repeat=3) if sum(e) <= 3]
    assert len(cubics) == 20
    assert set(cubics) <= set(EXPONENTS)
    assert len(EXPONENTS) == 32


def dual_basis(corners):
    """Return, in exact arithmetic, the coefficients of the functions dual to u and gradient.

    Row i holds the coefficients of function i in the monomials of the reference coordinates. Also
    returned is the matrix that takes reference gradients to physical ones, at any point.
    """
    F = sympy.zeros(3, 1)
    for corner, place in zip(CORNERS, corners, strict=True):
        weight = sympy.prod(x if c else 1 - x for x, c in zip(X, corner, strict=True))
        F += weight * sympy.Matrix(place)
    jacobian = F.jacobian(X).T
    rows = []
    for corner in CORNERS:
        at = dict(zip(X, corner, strict=True))
        gradients = sympy.Matrix([[m.diff(x).subs(at) for m in SPACE] for x in X])
        rows += [[m.subs(at) for m in SPACE]]
        rows += (jacobian.subs(at).inv() * gradients).tolist()
    dofs = sympy.polys.matrices.DomainMatrix.from_Matrix(sympy.Matrix(rows)).to_field()
    return dofs.inv().to_Matrix().T, jacobian


CELLS = {
    "cube": CORNERS,
    "mirrored": [(y, x, 2 * z) for x, y, z in CORNERS],
    "sheared": [(2 * x + y, 1 + y - z, 3 * z + x) for x, y, z in CORNERS],
    "frustum": [(x * (4 - z), y * (4 - 2 * z), 3 * z) for x, y, z in CORNERS],
    "twisted": [(3 * x + y * z, 2 * y - x * z, 4 * z + x * y * z) for x, y, z in CORNERS],
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CELLS)
def test_functions_equal_the_symbolic_dual_basis(name):
    coefficients, jacobian = dual_basis(CELLS[name])
    mesh = MeshHex(np.array(CELLS[name], float).T, np.arange(8)[:, None])
    C = np.array(coefficients, dtype=float)
    monomials, *slopes = (
        np.array([np.broadcast_to(sympy.lambdify(X, m)(*FLOATS), FLOATS[0].shape) for m in row])
        for row in (SPACE, *([m.diff(x) for m in SPACE] for x in X))
    )
    DFT = np.array([[sympy.lambdify(X, entry)(*p) for entry in jacobian] for p in FLOATS.T])
    inverse = np.linalg.inv(DFT.reshape(-1, 3, 3).astype(float))
    gradients = np.einsum("pij,jfp->ifp", inverse, np.array([C @ slope for slope in slopes]))
    for i in range(32):
        (field,) = ElementHexAdini().gbasis(mesh._mapping(), FLOATS, i)
        np.testing.assert_allclose(np.array(field)[0], (C @ monomials)[i], rtol=0, atol=4e-14)
        np.testing.assert_allclose(field.grad[:, 0], gradients[:, i], rtol=0, atol=4e-14)
        if name == "cube":
            value, gradient = ElementHexAdini().lbasis(FLOATS, i)
            np.testing.assert_allclose(value, (C @ monomials)[i], rtol=0, atol=1e-14)
            np.testing.assert_allclose(gradient, gradients[:, i], rtol=0, atol=1e-14)


def test_the_origins_functions_are_the_ones_of_the_docstring():
    coefficients, _ = dual_basis(CORNERS)
    L, B, S = (
        [f(x) for x in X]
        for f in (lambda x: 1 - x, lambda x: x * (1 - x) * (1 - 2 * x), lambda x: x * (1 - x) ** 2)
    )
    expected = [
        L[0] * L[1] * L[2] + B[0] * L[1] * L[2] + L[0] * B[1] * L[2] + L[0] * L[1] * B[2],
        S[0] * L[1] * L[2],
        L[0] * S[1] * L[2],
        L[0] * L[1] * S[2],
    ]
    functions = coefficients[28:, :] * sympy.Matrix(SPACE)
    assert [sympy.expand(f - e) for f, e in zip(functions, expected, strict=True)] == [0, 0, 0, 0]
