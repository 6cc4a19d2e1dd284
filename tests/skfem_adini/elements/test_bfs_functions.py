"""The closed-form BFS element: oracle, duality, bicubics, continuity of the gradient."""

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval2d
from skfem import Basis, InteriorFacetBasis, MeshQuad
from symfem import create_element

from skfem_adini import ElementQuadBFS, InputError

X, Y = sympy.symbols("x y")
CORNERS = np.array([[0.0, 1, 1, 0], [0, 0, 1, 1]])
POINTS = [(sympy.Rational(a, 7), sympy.Rational(b, 5)) for a in range(8) for b in range(6)]
NAMES = ["value", "grad", "hess", "grad3", "grad4", "grad5", "grad6"]


def graded():
    return MeshQuad.init_tensor(np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0, 1.1]))


def mixed():
    mesh = MeshQuad().refined(2)
    t = mesh.t.copy()
    t[:, ::2] = t[::-1, ::2]
    t[:, ::3] = np.roll(t[:, ::3], 1, axis=0)
    return MeshQuad(mesh.p, t)


RECTANGLES = {"refined": lambda: MeshQuad().refined(2), "graded": graded, "mixed": mixed}


@pytest.fixture(params=RECTANGLES)
def rectangles(request):
    return RECTANGLES[request.param]()


def test_reference_functions_equal_symfem():
    """symfem numbers vertices (0,0), (1,0), (0,1), (1,1) and dofs u, u_x, u_y, u_xy."""
    oracle = create_element("quadrilateral", "BFS", 3).get_basis_functions()
    points = np.array(POINTS, dtype=float)
    for i in range(16):
        vertex = (0, 1, 3, 2)[i // 4]
        expression = oracle[4 * vertex + i % 4].as_sympy()
        value, gradient = ElementQuadBFS().lbasis(points.T, i)
        for computed, exact in (
            (value, expression),
            (gradient[0], sympy.diff(expression, X)),
            (gradient[1], sympy.diff(expression, Y)),
        ):
            expected = [float(exact.subs({X: a, Y: b})) for a, b in POINTS]
            np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-14)


def test_dofs_of_functions_are_the_identity(rectangles):
    mapping = rectangles._mapping()
    dofs = []
    for i in range(16):
        (f,) = ElementQuadBFS(derivatives=2).gbasis(mapping, CORNERS, i)
        own = np.array([np.array(f), *f.grad, f.hess[0, 1]])
        dofs.append(own.transpose(1, 2, 0).reshape(-1, 16))
        np.testing.assert_array_equal(f.hess[0, 1], f.hess[1, 0])
    identity = np.broadcast_to(np.eye(16)[:, None], np.shape(dofs))
    np.testing.assert_allclose(dofs, identity, rtol=0, atol=1e-12)


def test_value_functions_are_a_partition_of_unity():
    points = np.random.default_rng(0).uniform(0, 1, (2, 30))
    value = sum(ElementQuadBFS().lbasis(points, i)[0] for i in (0, 4, 8, 12))
    np.testing.assert_allclose(value, 1, rtol=0, atol=1e-15)


@pytest.mark.parametrize("i", [-1, 16])
def test_there_are_sixteen_functions(i):
    with pytest.raises(ValueError, match="Index larger"):
        ElementQuadBFS().lbasis(CORNERS, i)


@given(
    table=st.lists(st.integers(-9, 9), min_size=16, max_size=16).filter(any),
    log_size=st.floats(-6, 6),
    log_aspect=st.floats(-4, 4),
    log_offset=st.floats(-2, 8),
    direction=st.floats(0, 6.28),
    shift=st.integers(0, 3),
    clockwise=st.booleans(),
)
def test_bicubics_in_scaled_coordinates(
    table, log_size, log_aspect, log_offset, direction, shift, clockwise
):
    """On a rectangle of any size, aspect, place, first vertex and sense."""
    p = np.array(table, float).reshape(4, 4)
    S, T = np.meshgrid(*[np.linspace(-1, 1, 41)] * 2)
    p /= np.abs(polyval2d(S, T, p)).max()
    half = 10.0**log_size * np.array([1.0, 10.0**log_aspect]) / 2
    offset = 10.0**log_offset * 2 * half.min() * np.array([np.cos(direction), np.sin(direction)])
    corners = np.roll(2 * CORNERS - 1, shift, axis=1)[:, :: -1 if clockwise else 1]
    mesh = MeshQuad(offset[:, None] + half[:, None] * corners, np.array([[0, 1, 2, 3]]).T)

    d0, d1 = polyder(p, axis=0), polyder(p, axis=1)
    dofs = np.vstack(
        [
            polyval2d(*corners, p),
            polyval2d(*corners, d0) / half[0],
            polyval2d(*corners, d1) / half[1],
            polyval2d(*corners, polyder(d0, axis=1)) / half.prod(),
        ]
    ).T.ravel()
    points = np.random.default_rng(0).uniform(0, 1, (2, 50))
    scaled = corners[:, :1] * (1 - points.sum(0)) + corners[:, [1, 3]] @ points
    element, mapping = ElementQuadBFS(), mesh._mapping()
    u = sum(dofs[i] * np.array(element.gbasis(mapping, points, i)[0]) for i in range(16))
    error = np.abs(u[0] - polyval2d(*scaled, p)).max()
    # The rounding of the vertices, over the thinner side.
    rounding = np.finfo(float).eps * np.abs(mesh.p).max() / (2 * half.min())
    assert error <= 1e-12 + 10 * rounding


def test_value_and_gradient_are_continuous(rectangles):
    sides = [InteriorFacetBasis(rectangles, ElementQuadBFS(), side=k) for k in (0, 1)]
    x = np.random.default_rng(0).uniform(-1, 1, sides[0].N)
    u, v = (basis.interpolate(x) for basis in sides)
    assert np.abs(np.array(u) - np.array(v)).max() < 1e-13
    assert np.abs(u.grad - v.grad).max() < 1e-13 * np.abs(u.grad).max()


def test_second_derivatives_jump(rectangles):
    element = ElementQuadBFS(derivatives=2)
    sides = [InteriorFacetBasis(rectangles, element, side=k) for k in (0, 1)]
    x = np.random.default_rng(0).uniform(-1, 1, sides[0].N)
    u, v = (basis.interpolate(x) for basis in sides)
    assert np.abs(u.hess - v.hess).max() > 0.1 * np.abs(u.hess).max()


def test_derivatives_of_a_bicubic(interpolate):
    basis = Basis(graded(), ElementQuadBFS(derivatives=6), intorder=3)
    dofs = interpolate(
        basis,
        lambda x, y: x**3 * y**3,
        lambda x, y: 3 * x**2 * y**3,
        lambda x, y: 3 * x**3 * y**2,
        lambda x, y: 9 * x**2 * y**2,
    )
    u = basis.interpolate(dofs)
    X, Y = basis.global_coordinates()
    np.testing.assert_allclose(u, X**3 * Y**3, atol=1e-14)
    np.testing.assert_allclose(u.grad, [3 * X**2 * Y**3, 3 * X**3 * Y**2], atol=1e-12)
    np.testing.assert_allclose(u.hess[0, 1], 9 * X**2 * Y**2, atol=1e-11)
    np.testing.assert_allclose(u.grad3[0, 0, 1], 18 * X * Y**2, atol=1e-10)
    np.testing.assert_allclose(u.grad4[0, 1, 0, 1], 36 * X * Y, atol=1e-8)
    np.testing.assert_allclose(u.grad6[0, 1, 0, 1, 0, 1], 36 + 0 * X, atol=1e-5)


@pytest.mark.parametrize("derivatives", range(7))
def test_as_many_orders_as_asked_for(derivatives):
    (field,) = ElementQuadBFS(derivatives).gbasis(
        MeshQuad()._mapping(), np.array([[0.3], [0.4]]), 7
    )
    orders = [field.get(place) for place in (1, 4, 5, 6, 7, 8)]
    assert [order is not None for order in orders] == [k < derivatives for k in range(6)]
    for name in NAMES[derivatives + 1 :]:
        with pytest.raises(InputError, match=rf"derivatives={NAMES.index(name)}\)"):
            getattr(field, name)


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (1, 0.001), (0.999, 1.001), (-0.001, 1)],
        [(0, 0), (1, 0), (1.5, 1), (0.5, 1)],
        [(0, 0), (2, 0), (1, 1), (0, 1)],
        [(0, 0), (1, 1), (0, 2), (-1, 1)],
    ],
    ids=["turned", "sheared", "trapezoid", "diamond"],
)
def test_other_cells_are_refused(corners):
    mesh = MeshQuad(np.array(corners, float).T, np.array([[0, 1, 2, 3]]).T)
    with pytest.raises(InputError, match=r"1 of 1 cells are no rectangles.*turn the coordinates"):
        Basis(mesh, ElementQuadBFS())


def test_degenerate_cells_are_refused():
    mesh = MeshQuad(CORNERS * [[1.0], [0.0]], np.array([[0, 1, 2, 3]]).T, validate=False)
    with pytest.raises(InputError, match="cells are no"):
        ElementQuadBFS().gbasis(mesh._mapping(), CORNERS, 0)
