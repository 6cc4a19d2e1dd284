"""The brick reproduces its 32-dimensional space, whatever the parallelepiped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval3d
from skfem import Basis, MeshHex
from skfem.refdom import RefHex

from skfem_adini import ElementHexAdini

SPACE = [e for e in np.ndindex(4, 4, 4) if sum(k > 1 for k in e) <= 1]
EPS = np.finfo(float).eps


def polynomial(coefficients):
    """Return the table of coefficients, scaled to a maximum of one on the cube [-1, 1]^3."""
    table = np.zeros((4, 4, 4))
    for e, c in zip(SPACE, coefficients, strict=True):
        table[e] = c
    return table / np.abs(polyval3d(*np.meshgrid(*[np.linspace(-1, 1, 15)] * 3), table)).max()


@given(
    coefficients=st.lists(st.integers(-9, 9), min_size=32, max_size=32).filter(any),
    log_size=st.floats(-6, 6),
    log_aspects=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    log_offset=st.floats(-2, 8),
    shear=st.tuples(*[st.floats(-1, 1)] * 3),
    seed=st.integers(0, 1000),
    mirrored=st.booleans(),
)
def test_polynomials_in_scaled_coordinates(
    coefficients, log_size, log_aspects, log_offset, shear, seed, mirrored
):
    """Interpolate p((F^-1 x)) on a parallelepiped of any size, aspects, place and direction."""
    p = polynomial(coefficients)
    lengths = 10.0**log_size * np.array([1.0, *(10.0 ** np.array(log_aspects))])
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    direction = rng.normal(size=3)
    upper = np.eye(3)
    upper[np.triu_indices(3, 1)] = shear
    DF = rotation @ upper @ np.diag(lengths) / 2
    if mirrored:
        DF = DF[:, ::-1]
    offset = 10.0**log_offset * lengths.min() * direction / np.linalg.norm(direction)
    corners = 2 * RefHex.p - 1
    mesh = MeshHex(offset[:, None] + DF @ corners, np.arange(8)[:, None])

    slopes = np.array([polyval3d(*corners, polyder(p, axis=axis)) for axis in range(3)])
    gradients = np.linalg.solve(DF.T, slopes)
    dofs = np.vstack([polyval3d(*corners, p), gradients]).T.ravel()

    points = np.random.default_rng(0).uniform(0, 1, (3, 50))
    element, mapping = ElementHexAdini(), mesh._mapping()
    u = sum(dofs[i] * np.array(element.gbasis(mapping, points, i)[0]) for i in range(32))
    error = np.abs(u[0] - polyval3d(*(2 * points - 1), p)).max()
    smallest = 2 * np.linalg.svd(DF, compute_uv=False).min()
    # The rounding of the vertices, over the thickness of the cell.
    assert error <= 1e-12 + 10 * EPS * np.abs(mesh.p).max() / smallest


@pytest.mark.parametrize("n", [2, 8])
def test_gradient_and_hessian(n, interpolate):
    x = np.linspace(0, 1, n + 1)
    basis = Basis(MeshHex.init_tensor(x, x, x), ElementHexAdini(derivatives=2), intorder=3)
    dofs = interpolate(
        basis,
        lambda x, y, z: x * y**3 * z,
        lambda x, y, z: y**3 * z,
        lambda x, y, z: 3 * x * y**2 * z,
        lambda x, y, z: x * y**3,
    )
    u = basis.interpolate(dofs)
    X, Y, Z = basis.global_coordinates()
    np.testing.assert_allclose(u, X * Y**3 * Z, rtol=0, atol=1e-14)
    exact = [Y**3 * Z, 3 * X * Y**2 * Z, X * Y**3]
    np.testing.assert_allclose(u.grad, exact, rtol=0, atol=1e-14 * n)
    exact = [
        [0 * X, 3 * Y**2 * Z, Y**3],
        [3 * Y**2 * Z, 6 * X * Y * Z, 3 * X * Y**2],
        [Y**3, 3 * X * Y**2, 0 * X],
    ]
    np.testing.assert_allclose(u.hess, exact, rtol=0, atol=1e-14 * n**2)


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)], ids=str)
def test_the_space_lacks_products_of_squares(axes, interpolate):
    basis = Basis(MeshHex(), ElementHexAdini())
    i, j = axes

    def slope(k):
        if k not in axes:
            return lambda *x: 0 * x[0]
        other = i + j - k
        return lambda *x: 2 * x[k] * x[other] ** 2

    dofs = interpolate(basis, lambda *x: (x[i] * x[j]) ** 2, *(slope(k) for k in range(3)))
    x = basis.global_coordinates()
    assert np.abs(basis.interpolate(dofs) - (x[i] * x[j]) ** 2).max() > 1e-2
