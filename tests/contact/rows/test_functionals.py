"""Constraint functionals: rank, what they read off a field, weights, places, gaps, patch tests."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import ContactProblem, ElasticBody, Parabola, Plane
from contact.rows.discretise import contact_rows, tangent_frame
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from tests.contact.rows.cases import CUBIC, OFFERED, PATCH, turn

FULL_RANK = [c for c in OFFERED if c[0] not in CUBIC or c[1] in ("bernstein", "gauss")]
FULL_RANK += [(ElementQuadAdini, "nodal")]
THESIS = (ElementQuadAdini, "thesis")
HERMITE = (*CUBIC, ElementHexAdini)
BOXES = (ElementTetP1, ElementHex1, ElementTetP2, ElementHex2, ElementHexAdini, ElementQuadBFS)
pairs = pytest.mark.parametrize(("element", "functional"), FULL_RANK)


def turned(pairs):
    """The pairs at several angles of the body; boxes stay where they are."""
    return [(*pair, a) for pair in pairs for a in (0.0, 0.7, 3.0) if not a or pair[0] not in BOXES]


@pytest.fixture(scope="module")
def body_of(make):
    """Body on a graded box, without supports and loads; in 2-D optionally turned by an angle."""

    def build(element, angle=0.0, ticks=make.graded):
        dim = element().dim
        mesh = make.box(element, *(ticks if dim == 2 else ticks[[0, 2, 4, -1]],) * dim)
        if angle:
            mesh = make.remesh(mesh, turn(angle) @ mesh.p)
        return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)

    return build


def rows_of(body, functional, boundary="bottom", obstacle=0.0):
    return contact_rows(body, body.facets(boundary), obstacle, functional)


def interpolated(body, u):
    """Dofs of the vector field u(x) with u of shape (dim, ...); derivatives by exact complex step.

    Adini's gradient dofs come from a step of 1e-30 in the imaginary direction.
    """
    result = np.zeros(body.basis.N)
    names = dict.fromkeys(range(body.basis.N), "u")
    table = body.basis.dofs.nodal_dofs
    for row, name in zip(table, body.basis.elem.dofnames, strict=False):
        names |= dict.fromkeys(row.tolist(), name.split("^")[0])
    at = body.basis.doflocs.astype(complex)
    for dof in range(body.basis.N):
        x, name = at[:, dof].copy(), names[dof]
        if name == "u_xy":
            continue  # not in any trace
        if name in ("u_x", "u_y", "u_z"):
            x["xyz".index(name[-1])] += 1e-30j
            result[dof] = u(x)[dof % body.dim].imag / 1e-30
        else:
            result[dof] = u(x)[dof % body.dim].real
    return result


def quadratic(x):
    terms = [1 + x[0] - 2 * x[1] + x[0] ** 2, 0.5 - x[1] + x[0] * x[1] + x[1] ** 2, x[0] - x[1]]
    return np.array(terms[: x.shape[0]])


def affine(x):
    rows = [[1.0, 2.0, -1.0], [0.5, -0.3, 0.7], [-0.2, 0.9, 0.4]]
    return np.tensordot(np.array(rows)[: x.shape[0], : x.shape[0]], x, axes=1) + 0.1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("boundary", ["bottom", ["bottom", "left"]], ids=["flat", "corner"])
@pairs
def test_full_rank(element, functional, boundary, body_of):
    body = body_of(element)
    rows = rows_of(body, functional, boundary)
    B = np.vstack([rows.G.toarray(), rows.T.toarray()])
    B = B / np.linalg.norm(B, axis=1)[:, None]
    assert B.shape[0] == body.dim * rows.gap.size
    # Far from the 1e-16 of a dependent row.
    assert np.linalg.svd(B, compute_uv=False).min() > 1e-3


@pytest.mark.parametrize("N", [1, 2, 5, 10])
def test_thesis_points_are_dependent(N, body_of):
    """3N + 1 rows on a trace space of dimension 2N + 2; bernstein and gauss meet its size."""
    body = body_of(ElementQuadAdini, ticks=np.linspace(0, 1, N + 1))
    rows = {name: rows_of(body, name) for name in ("thesis", "bernstein", "gauss", "nodal")}
    counts = {name: found.gap.size for name, found in rows.items()}
    assert counts == {"thesis": 3 * N + 1, "bernstein": 2 * N + 2, "gauss": 2 * N, "nodal": N + 1}
    for name, rank in (("thesis", 2 * N + 2), ("bernstein", 2 * N + 2), ("gauss", 2 * N)):
        scaled = rows[name].G.toarray()
        assert np.linalg.matrix_rank(scaled, tol=1e-9 * np.abs(scaled).max()) == rank


@pytest.mark.parametrize(
    ("element", "functional", "angle"),
    turned(p for p in [*FULL_RANK, THESIS] if p[1] not in ("bernstein", "centroid")),
)
def test_point_values(element, functional, angle, body_of):
    """Nodal, Gauss and thesis rows are the normal and tangential displacement at x_nominal."""
    body = body_of(element, angle)
    u = affine if element in (ElementTriP1, ElementTetP1, ElementQuad1, ElementHex1) else quadratic
    rows = rows_of(body, functional)
    dofs = interpolated(body, u)
    expected = u(rows.x_nominal)
    # Rounding; the inverse mapping of facet points costs a few digits.
    assert np.abs(rows.G @ dofs - np.sum(expected * rows.normals, axis=0)).max() < 1e-12
    tangential = np.einsum("dm,djm->mj", expected, rows.tangents).ravel()
    assert np.abs(rows.T @ dofs - tangential).max() < 1e-12


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementQuad2])
def test_bernstein_coefficients_of_a_trace(element, body_of):
    """Of c(x): c(x_i) -+ h/3 c'(x_i) of a cubic, c(x_i) + h/2 c'(x_i) between of a quadratic."""
    body, cubic = body_of(element), element is ElementQuadAdini
    c = np.polynomial.Polynomial([0.3, -1.0, 2.0, 1.7 * cubic])
    dofs = interpolated(body, lambda x: np.array([0.0 * x[0], c(x[0])]))
    rows, x = rows_of(body, "bernstein"), np.unique(body.mesh.p[0])
    h = np.diff(x) / (3 if cubic else 2)
    first, last = c(x[:-1]) + h * c.deriv()(x[:-1]), c(x[1:]) - h * c.deriv()(x[1:])
    if cubic:  # inner nodes are dropped
        inner = np.column_stack((first, last)).ravel()
        expected = np.concatenate(([c(x[0])], inner, [c(x[-1])]))
        thirds = np.column_stack((x[:-1] + h, x[1:] - h)).ravel()
        np.testing.assert_allclose(rows.x_nominal[0], np.r_[0.0, thirds, 1.0], atol=1e-14)
    else:
        expected = np.insert(c(x), np.arange(1, x.size), first)
    # Rounding; u_n = -u_y.
    np.testing.assert_allclose(rows.G @ dofs, -expected, atol=1e-13)


@pytest.mark.parametrize(
    ("element", "functional"), [p for p in FULL_RANK if p[0] not in HERMITE or p[1] == "bernstein"]
)
def test_mean_places_carry_a_linear_pressure(element, functional, body_of):
    """G^T (w x_i) is the load of the traction x_i n."""
    body = body_of(element)
    rows = rows_of(body, functional)
    for axis in range(body.dim):
        body.f = np.zeros(body.basis.N)
        body.load("bottom", lambda x, axis=axis: -x[axis] * np.eye(body.dim)[-1][:, None, None])
        # Rounding of a boundary mass solve.
        assert np.abs(rows.G.T @ (rows.weights * rows.x[axis]) - body.f).max() < 1e-13


def test_centroid_is_the_vertex_on_a_uniform_mesh(body_of):
    rows = rows_of(body_of(ElementQuadAdini, ticks=np.linspace(0, 1, 11)), "centroid")
    h = 0.1
    # The mean of the slope function of one cell is h^2 / 12, that of the value h / 2.
    expected = np.linspace(0, 1, 11)
    expected[[0, -1]] += [h / 6, -h / 6]
    np.testing.assert_allclose(rows.x_nominal[0], expected, atol=1e-12)
    np.testing.assert_allclose(rows.weights, np.r_[h / 2, np.full(9, h), h / 2], rtol=1e-12)


@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
def test_points_run_along_the_boundary(functional, body_of):
    rows = rows_of(body_of(ElementQuadAdini, 0.7), functional, ["left", "bottom", "right"])
    along = np.linalg.norm(np.diff(rows.x_nominal, axis=1), axis=0)
    assert along.max() <= 0.26  # the largest cell
    assert np.all(along > 0)


@pairs
def test_corners(element, functional, body_of):
    """At a corner of two sides the normal is the mean; the weights sum to both lengths."""
    body = body_of(element)
    rows = rows_of(body, functional, ["left", "bottom"])
    assert np.allclose(np.linalg.norm(rows.normals, axis=0), 1.0, rtol=1e-15, atol=0)
    # The mean of the normals cannot load a corner like both sides: only the sum is asked for.
    assert abs(rows.weights.sum() - 2.0) < 1e-12
    corner = np.all(np.abs(rows.x_nominal[[0, -1]]) < 1e-12, axis=0)
    if functional in ("gauss", "centroid"):  # a centroid lies off the corner
        assert not corner.any()
        return
    along = np.unique(body.mesh.p[1]).size
    quadratic_edges = along - 1 if element in (ElementTetP2, ElementHex2) else 0
    assert corner.sum() == (1 if body.dim == 2 else along + quadratic_edges)
    if body.dim == 2:
        # Weighted by the adjacent facets, which are as long as each other here.
        expected = -np.sqrt(0.5) * np.ones((2, 1))
        assert np.abs(rows.normals[:, corner] - expected).max() < 1e-12


def beside_the_pole(distance):
    one, other = 0.6 * distance, 0.8 * distance
    normals = np.array([[0.0, one], [0.0, other], [-1.0, np.sqrt(1 - distance**2)]])
    return np.hstack((normals, np.repeat(normals[:, :1], 3, axis=1)))


@pytest.mark.parametrize("dim", [2, 3])
def test_tangent_frames_are_orthonormal(dim):
    normals = np.random.default_rng(0).standard_normal((dim, 200))
    normals[:, :2] = np.array([np.eye(dim)[-1], -np.eye(dim)[-1]]).T  # straight up, straight down
    away = [0.0, 1e-300, 1e-150, 1e-12, 1e-8, 1e-4] if dim == 3 else []
    for one in (normals / np.linalg.norm(normals, axis=0), *map(beside_the_pole, away)):
        frame = np.concatenate([one[:, None], tangent_frame(one)], axis=1)
        assert np.abs(np.einsum("dim,djm->mij", frame, frame) - np.eye(dim)).max() < 1e-14
    # On a bottom edge along x.
    assert tangent_frame(np.array([[0.0], [-1.0]]))[:, 0, 0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_tangent_frames_are_smooth_but_at_one_pole(up):
    """Across the equator, too, where rounding alone decides on the sign of n_z."""
    latitude = np.linspace(-1.4, 1.4, 141) * up
    for longitude in np.linspace(0, 6, 7):
        x = np.array([np.cos(longitude), np.sin(longitude), 0.0])[:, None]
        path = np.cos(latitude) * x + np.array([[0.0], [0.0], [1.0]]) * np.sin(latitude)
        # The boundary's mean normal decides: most of it lies on one side.
        pole = np.repeat([[0.0], [0.0], [up]], 500, axis=1)
        frames = tangent_frame(np.hstack((path, pole)))[:, :, :-500]
        # Steps of .02 radians; near the other pole, here .17 away, frames turn twice about it.
        assert np.linalg.norm(np.diff(frames, axis=2), axis=0).max() < 0.05
    wall = np.repeat([[1.0], [0.0], [0.0]], 8, axis=1)
    wall[2] = 1e-17 * (-1.0) ** np.arange(8)
    assert np.ptp(tangent_frame(wall), axis=2).max() < 1e-15


@pytest.mark.parametrize(("element", "functional"), [*FULL_RANK, THESIS])
def test_affine_gap_is_met_exactly(element, functional, body_of):
    """A tilted plane: the gap is what the functional reads off the displacement that closes it."""
    body = body_of(element)
    normal = np.array([0.1, 1.0]) if body.dim == 2 else np.array([0.1, -0.2, 1.0])
    height = 0.1
    rows = rows_of(body, functional, obstacle=Plane(-height * np.eye(body.dim)[-1], normal))

    def closing(x):
        u = np.zeros(x.shape, dtype=x.dtype)
        u[-1] = -height - np.tensordot(normal[:-1], x[:-1], axes=1) / normal[-1] - x[-1]
        return u

    assert np.abs(rows.G @ interpolated(body, closing) - rows.gap).max() < 1e-12


@pytest.mark.parametrize(
    ("element", "functional"), [*(c for c in PATCH if c[1] != "nodal"), THESIS, FULL_RANK[-1]]
)
def test_quadratic_gap_is_met_exactly(element, functional, body_of):
    body = body_of(element)
    flat = Parabola((0.3, 0.0), 1.7, 0.01)
    gap = flat if body.dim == 2 else lambda x: 0.01 + (x[0] - 0.3) ** 2 / 3.4
    rows = rows_of(body, functional, obstacle=gap)

    def closing(x):
        return np.array([0.0 * x[0]] * (body.dim - 1) + [-0.01 - (x[0] - 0.3) ** 2 / 3.4])

    assert np.abs(rows.G @ interpolated(body, closing) - rows.gap).max() < 1e-13


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("element", "functional"), PATCH)
@settings(max_examples=8, deadline=None)
@given(edge=st.floats(0.01, 0.99), turn=st.floats(0.0, 6.3), height=st.floats(1e-3, 1e6))
def test_no_mean_of_a_step_lies_outside_its_gaps(body_of, element, functional, edge, turn, height):
    body = body_of(element, ticks=np.linspace(0, 1, 6))
    across = np.array([np.cos(turn), np.sin(turn) if body.dim == 3 else 0.0])

    def step(x):
        return np.where(across[0] * x[0] + across[1] * x[1] > edge * across[0], height, 0.0)

    gap = rows_of(body, functional, obstacle=step).gap
    assert gap.min() >= -1e-12 * height
    assert gap.max() <= height * (1 + 1e-12)


@pytest.mark.parametrize(
    ("element", "functional", "holds"),
    [
        (ElementQuadAdini, "bernstein", True),
        (ElementTriP2, "bernstein", True),
        (ElementQuad2, "bernstein", True),
        (ElementQuadAdini, "gauss", False),
        (ElementTriP2, "gauss", False),
        (ElementQuadAdini, "nodal", False),
    ],
)
def test_no_penetration_between_the_points(element, functional, holds, make):
    """The trace lies in the convex hull of its Bernstein coefficients, the gap being quadratic."""
    body = make.block(6, element, sides=()).fix("top", "y", -0.1)
    gap = Parabola((0.42, 0.0), 1.5, 0.01)
    result = ContactProblem(body, "bottom", gap, 0.4, functional=functional).solve()
    assert 3 <= np.count_nonzero(result.mu) < result.mu.size  # part of the boundary touches
    x = np.linspace(0, 1, 2001)
    down = -result.sample(np.array([x, 0 * x]))[1]
    deepest = np.max(down - (0.01 + (x - 0.42) ** 2 / 3.0))
    # Rounding against the largest displacement, .4; the others miss by 1e-5 and more.
    assert deepest < 1e-14 if holds else deepest > 1e-6


E, NU, PRESSURE = 2.0, 0.3, 1.0


def graded(make, element, plane="strain", distorted=False):
    dim = element().dim
    ticks = make.graded if dim == 2 else make.graded[[0, 2, 3, 5, 7]]
    mesh = make.box(element, *(ticks,) * dim)
    if distorted:
        inside = np.all((mesh.p > 0) & (mesh.p < 1), axis=0)
        shake = np.random.default_rng(4).uniform(-1, 1, mesh.p.shape)
        mesh = make.remesh(mesh, mesh.p + 0.015 * shake * inside)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, plane=plane)


def exact(x, plane="strain"):
    """Displacement at points x of a block that is free to widen."""
    if x.shape[0] == 2 and plane == "strain":
        across, down = NU * (1 + NU) * PRESSURE / E, (1 - NU**2) * PRESSURE / E
    else:
        across, down = NU * PRESSURE / E, PRESSURE / E
    factors = np.full(x.shape[0], across)
    factors[-1] = -down
    return factors[:, None] * x


def errors(make, element, functional, plane="strain", distorted=False):
    """Of pressure and displacement of a block pressed evenly on a flat foundation at rest."""
    body = graded(make, element, plane, distorted)
    body.fix("left", "x").load("top", -PRESSURE * np.eye(body.dim)[-1])
    if body.dim == 3:
        body.fix("front", "y")
    result = ContactProblem(body, "bottom", 0.0, functional=functional).solve()
    basis = body.basis
    expected = exact(np.asarray(basis.global_coordinates()).reshape(body.dim, -1), plane)
    found = np.asarray(basis.interpolate(result.u)).reshape(expected.shape)
    return (
        np.abs(result.pressure - PRESSURE).max() / PRESSURE,
        np.abs(found - expected).max() / np.abs(expected).max(),
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("element", "functional", "plane", "distorted"),
    [
        *((*case, "strain", False) for case in PATCH),
        *((e, None, "stress", False) for e in (ElementQuadAdini, ElementTriP2, ElementQuad1)),
        *((*case, "strain", True) for case in PATCH if case[0] not in HERMITE),
    ],
)
def test_uniform_pressure(element, functional, plane, distorted, make):
    pressure, displacement = errors(make, element, functional, plane, distorted)
    # One factorisation of a matrix of condition 1e4.
    assert pressure < 1e-12
    assert displacement < 1e-12


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), PATCH)
def test_uniform_pressure_with_sliding_friction(element, functional, make):
    """Dragged along x by its top, with friction F below: a uniform shear F p besides."""
    F, body = 0.05, graded(make, element)
    dim = body.dim
    up = np.eye(dim)[-1]
    body.load("top", -PRESSURE * up)
    body.load("right", F * PRESSURE * up).load("left", -F * PRESSURE * up)  # conjugate shears
    angle = 2 * F * PRESSURE * (1 + NU) / E  # engineering shear strain
    widening = exact(np.eye(2)[:, :1])[0, 0]
    body.fix("top", "x", lambda x: 1.0 + angle + widening * x[0])
    if dim == 3:
        body.fix(["front", "back"], "y")  # plane strain: slip along x alone
    result = ContactProblem(body, "bottom", 0.0, F, functional=functional).solve()
    points = np.random.default_rng(1).uniform(0, 1, (dim, 200))
    expected = np.zeros_like(points)
    expected[[0, -1]] = exact(points[[0, -1]])
    expected[0] += 1.0 + angle * points[-1]
    # Newton's own tolerance, 1e-12 of forces that a slide of one would cause.
    assert np.abs(result.pressure - PRESSURE).max() < 1e-10
    along = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)
    assert np.abs(along + F * PRESSURE * np.eye(dim)[:, :1]).max() < 1e-10
    assert np.abs(result.sample(points) - expected).max() < 1e-12


def test_nodal_rows_of_adini_fail(make):
    """Nodal forces cannot carry a uniform pressure to the slope dofs (28 % here)."""
    pressure, displacement = errors(make, ElementQuadAdini, "nodal")
    assert pressure > 0.1
    assert displacement > 0.01
