"""The element reproduces its twelve-dimensional space, whatever the cell."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval2d
from skfem import Basis, MeshQuad

from skfem_adini import ElementQuadAdini

SPACE = [(i, j) for i in range(4) for j in range(4) if i + j <= 3 or (i, j) in ((3, 1), (1, 3))]
EPS = np.finfo(float).eps


def polynomial(coefficients):
    table = np.zeros((4, 4))
    for (i, j), c in zip(SPACE, coefficients, strict=True):
        table[i, j] = c
    S, T = np.meshgrid(*[np.linspace(-1, 1, 41)] * 2)
    return table / np.abs(polyval2d(S, T, table)).max()


@given(
    coefficients=st.lists(st.integers(-9, 9), min_size=12, max_size=12).filter(any),
    log_size=st.floats(-6, 6),
    log_aspect=st.floats(-4, 4),
    log_offset=st.floats(-2, 8),
    angle=st.floats(0, 6.28),
    shear=st.floats(-1, 1),
    direction=st.floats(0, 6.28),
    clockwise=st.booleans(),
)
def test_polynomials_in_scaled_coordinates(
    coefficients, log_size, log_aspect, log_offset, angle, shear, direction, clockwise
):
    """Interpolate p((F^-1 x)) on a parallelogram of any size, aspect, place and direction."""
    p = polynomial(coefficients)
    size, aspect = 10.0**log_size, 10.0**log_aspect
    lengths = size * np.array([1.0, aspect])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    DF = rotation @ np.array([[1.0, shear], [0.0, 1.0]]) @ np.diag(lengths) / 2
    if clockwise:
        DF = DF[:, ::-1]
    offset = 10.0**log_offset * lengths.min() * np.array([np.cos(direction), np.sin(direction)])
    corners = np.array([[-1.0, 1, 1, -1], [-1, -1, 1, 1]])
    mesh = MeshQuad(offset[:, None] + DF @ corners, np.array([[0, 1, 2, 3]]).T)

    values = polyval2d(*corners, p)
    gradients = np.linalg.solve(
        DF.T,
        np.array(
            [polyval2d(*corners, polyder(p, axis=0)), polyval2d(*corners, polyder(p, axis=1))]
        ),
    )
    dofs = np.vstack([values, gradients]).T.ravel()

    points = np.random.default_rng(0).uniform(0, 1, (2, 50))
    element, mapping = ElementQuadAdini(), mesh._mapping()
    u = sum(dofs[i] * np.array(element.gbasis(mapping, points, i)[0]) for i in range(12))
    error = np.abs(u[0] - polyval2d(*(2 * points - 1), p)).max()
    smallest = 2 * np.linalg.svd(DF, compute_uv=False).min()
    assert error <= 1e-12 + 10 * EPS * np.abs(mesh.p).max() / smallest


@pytest.mark.parametrize("n", [8, 64])
def test_gradient_and_hessian_on_a_fine_mesh(n, interpolate):
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    basis = Basis(mesh, ElementQuadAdini(derivatives=2))
    x = interpolate(
        basis, lambda x, y: x**3 * y, lambda x, y: 3 * x**2 * y, lambda x, y: x**3 + 0 * y
    )
    u = basis.interpolate(x)
    X, Y = basis.global_coordinates()
    np.testing.assert_allclose(u, X**3 * Y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(u.grad, [3 * X**2 * Y, X**3], rtol=0, atol=1e-14 * n)
    exact = [[6 * X * Y, 3 * X**2], [3 * X**2, 0 * X]]
    np.testing.assert_allclose(u.hess, exact, rtol=0, atol=1e-14 * n**2)


def test_the_space_lacks_the_biquadratic(interpolate):
    basis = Basis(MeshQuad(), ElementQuadAdini())
    x = interpolate(
        basis, lambda x, y: (x * y) ** 2, lambda x, y: 2 * x * y**2, lambda x, y: 2 * x**2 * y
    )
    X, Y = basis.global_coordinates()
    assert np.abs(basis.interpolate(x) - (X * Y) ** 2).max() > 1e-2
