"""Derivatives against differences of the order below, on every kind of cell."""

import numpy as np
import pytest
from skfem import Basis, MeshHex, MeshQuad

from skfem_adini import ElementHexAdini, ElementQuadAdini, InputError

# Places of value, gradient and Hessian in DiscreteField.get.
FIELD = [0, 1, 4]
NAMES = ["value", "grad", "hess", "grad3", "grad4", "grad5", "grad6"]
STEP = 1e-6


@pytest.mark.parametrize(
    ("element", "i"),
    [
        *((ElementQuadAdini(), i) for i in range(12)),
        *((ElementHexAdini(), i) for i in range(32)),
    ],
)
def test_reference_gradient(element, i):
    dim = element.refdom.p.shape[0]
    points = np.random.default_rng(i).uniform(0, 1, (dim, 20))
    gradient = element.lbasis(points, i)[1]
    for k, shift in enumerate(STEP * np.eye(dim)):
        forward, backward = (
            element.lbasis(points + sign * shift[:, None], i)[0] for sign in (1, -1)
        )
        np.testing.assert_allclose(gradient[k], (forward - backward) / (2 * STEP), atol=1e-8)


@pytest.mark.parametrize("order", [1, 2])
def test_physical_derivatives(any_cells, adini, order):
    element, mapping = adini(any_cells, derivatives=order), any_cells._mapping()
    dim = any_cells.dim()
    points = np.random.default_rng(0).uniform(0.1, 0.9, (dim, 12 // dim))
    tind = np.arange(any_cells.nelements)
    ends = [
        [mapping.invF(mapping.F(points) + s * shift, tind=tind) for s in (1, -1)]
        for shift in STEP * np.eye(dim)[:, :, None, None]
    ]
    for i in range(12) if dim == 2 else range(0, 32, 3):
        quotients = []
        for pair in ends:
            high, low = (element.gbasis(mapping, end, i, tind=tind)[0] for end in pair)
            quotients.append((high.get(FIELD[order - 1]) - low.get(FIELD[order - 1])) / (2 * STEP))
        computed = element.gbasis(mapping, points, i)[0].get(FIELD[order])
        scale = np.abs(computed).max()
        np.testing.assert_allclose(computed, quotients, rtol=0, atol=1e-7 * max(scale, 10.0**order))


def test_third_and_higher_derivatives_in_the_plane(interpolate):
    """On a sheared mesh, of x^3 y pulled through the shear."""
    mesh = MeshQuad().refined(2)
    mesh = MeshQuad(np.array([mesh.p[0] + 0.5 * mesh.p[1], mesh.p[1]]), mesh.t)
    basis = Basis(mesh, ElementQuadAdini(derivatives=5))
    x = interpolate(
        basis,
        lambda x, y: (x - y / 2) ** 3 * y,
        lambda x, y: 3 * (x - y / 2) ** 2 * y,
        lambda x, y: -1.5 * (x - y / 2) ** 2 * y + (x - y / 2) ** 3,
    )
    u = basis.interpolate(x)
    X, Y = basis.global_coordinates()
    X = X - Y / 2
    # The chain rule for u = X^3 Y with d/dy = d/dY - 1/2 d/dX.
    np.testing.assert_allclose(u.grad3[0, 0, 0], 6 * Y, atol=1e-10)
    np.testing.assert_allclose(u.grad3[0, 1, 0], 6 * X - 3 * Y, atol=1e-10)
    np.testing.assert_allclose(u.grad3[1, 1, 1], -0.75 * Y + 4.5 * X, atol=1e-10)
    np.testing.assert_allclose(u.grad4[0, 0, 1, 0], 6 + 0 * X, atol=1e-8)
    np.testing.assert_allclose(u.grad4[1, 0, 1, 0], -6 + 0 * X, atol=1e-8)
    np.testing.assert_allclose(u.grad5, 0, atol=1e-7)


def test_third_and_higher_derivatives_in_space(interpolate):
    """On a sheared mesh, of X^3 y z with X = x - y/2."""
    mesh = MeshHex().refined(1)
    mesh = MeshHex(np.array([mesh.p[0] + 0.5 * mesh.p[1], *mesh.p[1:]]), mesh.t)
    basis = Basis(mesh, ElementHexAdini(derivatives=6), intorder=2)
    dofs = interpolate(
        basis,
        lambda x, y, z: (x - y / 2) ** 3 * y * z,
        lambda x, y, z: 3 * (x - y / 2) ** 2 * y * z,
        lambda x, y, z: (-1.5 * (x - y / 2) ** 2 * y + (x - y / 2) ** 3) * z,
        lambda x, y, z: (x - y / 2) ** 3 * y,
    )
    u = basis.interpolate(dofs)
    X, Y, Z = basis.global_coordinates()
    X = X - Y / 2
    np.testing.assert_allclose(u.grad3[0, 0, 0], 6 * Y * Z, atol=1e-10)
    np.testing.assert_allclose(u.grad3[0, 1, 0], (6 * X - 3 * Y) * Z, atol=1e-10)
    np.testing.assert_allclose(u.grad3[2, 1, 1], 1.5 * X * Y - 3 * X**2, atol=1e-10)
    np.testing.assert_allclose(u.grad4[0, 2, 1, 0], 6 * X - 3 * Y, atol=1e-9)
    np.testing.assert_allclose(u.grad4[2, 2], 0, atol=1e-9)
    np.testing.assert_allclose(u.grad5[0, 1, 2, 0, 0], 6 + 0 * X, atol=1e-8)
    np.testing.assert_allclose(u.grad5[1, 1, 0, 2, 0], -6 + 0 * X, atol=1e-8)
    np.testing.assert_allclose(u.grad6, 0, atol=1e-6)


@pytest.mark.parametrize("derivatives", range(7))
@pytest.mark.parametrize(("mesh", "i"), [(MeshQuad(), 4), (MeshHex(), 9)], ids=["quad", "hex"])
def test_as_many_orders_as_asked_for(mesh, i, derivatives, adini):
    point = np.array([[0.3], [0.4], [0.7]])[: mesh.dim()]
    (field,) = adini(mesh, derivatives=derivatives).gbasis(mesh._mapping(), point, i)
    orders = [field.get(place) for place in (1, 4, 5, 6, 7, 8)]
    assert [order is not None for order in orders] == [k < derivatives for k in range(6)]
    for name in NAMES[derivatives + 1 :]:
        with pytest.raises(InputError, match=rf"derivatives={NAMES.index(name)}\)"):
            getattr(field, name)


def test_third_derivatives_need_parallelograms(convex_quads):
    element = ElementQuadAdini(derivatives=3)
    with pytest.raises(InputError, match="parallelogram"):
        element.gbasis(convex_quads._mapping(), np.array([[0.3], [0.4]]), 0)


def test_third_derivatives_need_parallelepipeds(warped_hexes):
    element = ElementHexAdini(derivatives=3)
    with pytest.raises(InputError, match=r"parallelepiped.*ElementHexAdini\(derivatives=2\)"):
        element.gbasis(warped_hexes._mapping(), np.full((3, 1), 0.3), 0)


def test_points_of_each_cell_or_shared(any_cells, adini):
    element, mapping, dim = adini(any_cells, derivatives=2), any_cells._mapping(), any_cells.dim()
    shared = np.random.default_rng(0).uniform(0, 1, (dim, 5))
    tind = np.arange(any_cells.nelements)[::2]
    own = np.repeat(shared[:, None], len(tind), axis=1)
    for i in range({2: 12, 3: 32}[dim]):
        (a,) = element.gbasis(mapping, shared, i, tind=tind)
        (b,) = element.gbasis(mapping, own, i, tind=tind)
        (c,) = element.gbasis(mapping, shared, i)
        for name in NAMES[1:3]:
            scale = np.abs(getattr(a, name)).max()
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-14 * scale)
            # A cell's values do not depend on which others are asked for: in the plane to the bit.
            rtol = {2: 0, 3: 1e-15}[dim]
            np.testing.assert_allclose(getattr(a, name), getattr(c, name)[..., tind, :], rtol=rtol)
        np.testing.assert_allclose(a, b, atol=1e-15)
