"""Bores and spherical holes: exact gaps, and the closed forms of shrink and of clearance."""

import numpy as np
import pytest
from convergence import order
from hypothesis import assume, given
from hypothesis import strategies as st
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    MeshHex,
    MeshQuad,
    MeshQuad2,
    MeshTet,
)

from contact import (
    ClosestPoint,
    ContactProblem,
    ContactResult,
    Cylinder,
    ElasticBody,
    InputError,
    Rigid,
    SignedDistance,
    Sphere,
)

NU = 0.3
number, size = st.floats(-3.0, 3.0), st.floats(0.1, 3.0)


def unit(dim):
    vector = st.tuples(*(st.floats(-1.0, 1.0),) * dim).map(np.array)
    long = vector.filter(lambda v: np.linalg.norm(v) > 1e-2)
    return long.map(lambda v: v / np.linalg.norm(v))


@pytest.mark.parametrize("dim", [2, 3])
def test_gap_is_the_way_to_the_far_meeting(dim):
    """From within to where the ray leaves the hole; from the wall's inside back into the hole."""

    @given(st.tuples(*(number,) * dim).map(np.array), unit(dim), size)
    def check(x, n, radius):
        along = -x @ n
        nearest, length = np.linalg.norm(x + along * n), np.linalg.norm(x)
        # Not at grazing incidence, not on the surface: there rounding decides.
        assume(abs(nearest - radius) > 1e-3 and abs(length - radius) > 1e-3)
        outside = length > radius
        holes = [Sphere(np.zeros(dim), radius, hollow=True)]
        holes += [Cylinder((0.0, 0.0), radius, hollow=True)] if dim == 2 else []
        for hole in holes:
            d = float(hole(x[:, None], n[:, None])[0])
            if nearest > radius or (outside and along > 0):
                assert d == np.inf
            else:
                # Pythagoras, rounding over the grazing distance.
                assert abs(d - (along + np.sqrt(radius**2 - nearest**2))) < 1e-11
                assert (d < 0) == outside

    check()


@pytest.mark.parametrize("dim", [2, 3])
def test_closest_point_of_the_wall(dim):
    """As the signed distance radius - |x| has it."""
    x = np.random.default_rng(0).uniform(-1, 1, (dim, 40))
    hole = ClosestPoint(Sphere(np.zeros(dim), 0.9, hollow=True))
    numeric = ClosestPoint(SignedDistance(lambda x: 0.9 - np.linalg.norm(x, axis=0)))
    np.testing.assert_allclose(hole(x, x), numeric(x, x), atol=1e-14)
    # Central differences with a step of 1e-6.
    np.testing.assert_allclose(hole.direction(x), numeric.direction(x), atol=1e-8)


def test_a_cylinder_in_space_is_its_cross_section():
    rng = np.random.default_rng(1)
    x, n = rng.uniform(-0.5, 0.5, (3, 30)), rng.standard_normal((3, 30))
    n /= np.linalg.norm(n, axis=0)
    solid = Cylinder((0.1, 0.2, 5.0), 2.0, axis=(0.0, 0.0, -3.0), hollow=True)
    across = np.hypot(n[0], n[1])
    flat = Cylinder((0.1, 0.2), 2.0, hollow=True)(x[:2], n[:2] / across)
    np.testing.assert_allclose(solid(x, n), flat / across, rtol=1e-12)


def sector(inner, outer, angles, radii, element=ElementQuad2):
    """Part of a ring with curved sides, "rim" outside and "core" inside; angle 0 points down."""
    s = np.linspace(0, 1, radii + 1)
    straight = MeshQuad.init_tensor(inner + (outer - inner) * s**0.7, angles)
    mesh = straight if element is ElementQuad1 else MeshQuad2.from_mesh(straight)
    named = {
        "core": straight.facets_satisfying(lambda x: x[0] < inner + 1e-9),
        "rim": straight.facets_satisfying(lambda x: x[0] > outer - 1e-9),
        "low": straight.facets_satisfying(lambda x: x[1] < 1e-9),
        "side": straight.facets_satisfying(lambda x: x[1] > angles[-1] - 1e-9),
    }
    r, angle = mesh.doflocs
    places = np.array([r * np.sin(angle), -r * np.cos(angle)])
    return type(mesh)(places, mesh.t).with_boundaries(named), element()


@pytest.mark.parametrize("gap", [Cylinder, lambda *a, **k: ClosestPoint(Cylinder(*a, **k))])
def test_ring_shrunk_into_a_bore(gap, tmp_path):
    """Lame: d = p b / E ((b^2 + a^2) / (b^2 - a^2) - nu), plane stress; and the result is kept."""
    a, b, d = 1.0, 2.0, 0.01
    exact = d / b / ((b**2 + a**2) / (b**2 - a**2) - NU)
    worst = []
    for n in (4, 8, 16):
        mesh, element = sector(a, b, np.linspace(0, np.pi / 2, 2 * n + 1), n)
        body = ElasticBody.from_mesh(mesh, element, E=1.0, nu=NU, plane="stress")
        body.fix("low", "x").fix("side", "y")
        problem = ContactProblem(body, "rim", gap((0.0, 0.0), b - d, hollow=True), friction=0.3)
        result = problem.solve()
        worst.append(np.abs(result.pressure / exact - 1).max())
    # Of first order, as normals are.
    assert worst[-1] < 0.02
    assert order([4, 8, 16], worst) > 0.8
    again = ContactResult.load(result.save(tmp_path / "shrunk.npz"))
    np.testing.assert_array_equal(again.gap, result.gap)
    assert again.kkt == result.kkt


def test_ball_shrunk_into_a_spherical_hole():
    """An eighth of it: p = E d / (b (1 - 2 nu)) all over."""
    ball = MeshTet.init_ball(3)
    corner = np.flatnonzero((ball.p[:, ball.t].mean(axis=1) > 0).all(axis=0))
    mesh = ball.restrict(corner)
    named = {
        name: mesh.facets_satisfying(lambda x, c=c: x[c] < 1e-9) for c, name in enumerate("xyz")
    }
    on_planes = np.concatenate(list(named.values()))
    named["rim"] = np.setdiff1d(mesh.boundary_facets(), on_planes)
    body = ElasticBody.from_mesh(mesh.with_boundaries(named), ElementTetP1(), E=1.0, nu=NU)
    for c, name in enumerate("xyz"):
        body.fix(name, c)
    d = 0.1  # more than the facets' sagitta
    result = ContactProblem(body, "rim", Sphere((0, 0, 0), 1 - d, hollow=True), 0.2).solve()
    exact = d / (1 - 2 * NU)
    # The facets lie up to 2 % of the radius within the sphere, a fifth of d.
    mean = result.contact_force / result.system.rows.weights.sum()
    assert mean == pytest.approx(exact, rel=0.15)
    # The force on an eighth: the pressure times the projected quarter disk.
    np.testing.assert_allclose(result.resultant, -exact * np.pi / 4, rtol=0.15)


def shaft(bore, core_moves, radius=1.05):
    fine = np.linspace(0, 0.25, 26)
    angles = np.concatenate((fine, 0.25 + 0.7 * np.linspace(0, 1, 9)[1:] ** 1.5))
    mesh, element = sector(0.3, 1.0, angles, 18)
    body = ElasticBody.from_mesh(mesh, element, E=1.0, nu=NU)
    body.fix("low", "x").fix("core", "x").fix("core", "y", -core_moves)
    return ContactProblem(body, "rim", bore(Cylinder((0.0, 0.05), radius, hollow=True))).solve()


def test_shaft_in_a_bore_with_clearance():
    """Hertz' line contact of radius R r / (R - r): peak pressure and half width from the force."""
    push = 7e-4
    result = shaft(lambda wall: wall, push)
    force, radius, stiff = 2 * result.resultant[1], 1.05 / 0.05, 1 / (1 - NU**2)
    half = 2 * np.sqrt(force * radius / (np.pi * stiff))
    assert 0.08 < half < 0.2  # narrow beside the shaft, wide beside a cell of .01
    x, p0 = result.x[0], np.sqrt(force * stiff / (np.pi * radius))
    exact = p0 * np.sqrt(np.maximum(1 - (x / half) ** 2, 0.0))
    # The shaft is no half plane: terms of order (half / radius)^2; cells of a tenth of `half`.
    assert np.abs(result.pressure - exact)[x < 0.9 * half].max() < 0.03 * p0
    assert result.x[0][result.pressure > 0].max() == pytest.approx(half, abs=0.015)
    # The wall moves up as far as the shaft moved down.
    moved = shaft(lambda wall: Rigid(wall, displacement=(0.0, push)), 0.0)
    # Rounding times the condition of the body.
    np.testing.assert_allclose(moved.pressure, result.pressure, atol=1e-9 * p0)


def test_bore_in_space_is_the_bore_in_the_plane():
    """An extruded ring held at both ends is in plane strain."""
    angles = np.linspace(0, np.pi / 2, 9)
    flat, element = sector(1.0, 2.0, angles, 4, ElementQuad1)
    body = ElasticBody.from_mesh(flat, element, E=1.0, nu=NU).fix("low", "x").fix("side", "y")
    planar = ContactProblem(body, "rim", Cylinder((0, 0), 1.95, hollow=True)).solve()
    s = np.linspace(0, 1, 5)
    tensor = MeshHex.init_tensor(1 + s**0.7, angles, np.linspace(0, 0.6, 3))
    r, angle, z = tensor.p
    mesh = MeshHex(np.array([r * np.sin(angle), -r * np.cos(angle), z]), tensor.t)
    sides = {
        "rim": tensor.facets_satisfying(lambda x: x[0] > 2 - 1e-9),
        "low": tensor.facets_satisfying(lambda x: x[1] < 1e-9),
        "side": tensor.facets_satisfying(lambda x: x[1] > np.pi / 2 - 1e-9),
        "ends": tensor.facets_satisfying(lambda x: np.abs(x[2] - 0.3) > 0.3 - 1e-9),
    }
    solid = ElasticBody.from_mesh(mesh.with_boundaries(sides), ElementHex1(), E=1.0, nu=NU)
    solid.fix("low", "x").fix("side", "y").fix("ends", "z")
    wall = Cylinder((0, 0, 7), 1.95, hollow=True)
    result = ContactProblem(solid, "rim", wall).solve()
    around = np.argsort(np.arctan2(*planar.x))
    for height in np.unique(np.round(result.x_nominal[2], 9)):
        at = np.flatnonzero(np.abs(result.x_nominal[2] - height) < 1e-6)
        at = at[np.argsort(np.arctan2(*result.x_nominal[:2, at]))]
        # Gauss rules of the plane and of space differ on rational integrands.
        np.testing.assert_allclose(result.pressure[at], planar.pressure[around], rtol=1e-6)


@pytest.mark.parametrize("hollow", [1.0, "yes", None, np.nan])
@pytest.mark.parametrize("kind", [Cylinder, Sphere])
def test_hollow_is_true_or_false(kind, hollow):
    with pytest.raises(InputError, match="hollow="):
        kind((0.0, 0.0), 1.0, hollow=hollow)(np.zeros((2, 1)), np.array([[0.0], [1.0]]))
