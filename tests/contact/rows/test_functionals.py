"""Constraint functionals: rank, what they read off a field, weights, places and gaps."""

import copy
import functools

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshTri,
)

from contact import ContactProblem, ElasticBody, Parabola, Plane
from contact.rows.discretise import contact_rows, tangent_frame
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

FULL_RANK = [
    (ElementQuadAdini, "bernstein"),
    (ElementQuadAdini, "gauss"),
    (ElementQuadAdini, "nodal"),
    (ElementQuad1, "nodal"),
    (ElementTriP1, "nodal"),
    (ElementQuad2, "bernstein"),
    (ElementQuad2, "gauss"),
    (ElementTriP2, "bernstein"),
    (ElementTriP2, "gauss"),
    (ElementTetP1, "nodal"),
    (ElementHex1, "nodal"),
    (ElementQuadBFS, "bernstein"),
    (ElementQuadBFS, "gauss"),
    (ElementTetP2, "bernstein"),
    (ElementHex2, "bernstein"),
    (ElementHex2, "gauss"),
    (ElementHexAdini, "centroid"),
]
THESIS = [(ElementQuadAdini, "thesis")]
GAUSS = np.array([0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)])


SOLID = (ElementTetP1, ElementHex1, ElementTetP2, ElementHex2, ElementHexAdini, ElementQuadBFS)


def turned(pairs):
    """The pairs at several angles of the body; boxes stay where they are."""
    return [(*pair, a) for pair in pairs for a in (0.0, 0.7, 3.0) if not a or pair[0] not in SOLID]


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.fixture(scope="module")
def body_of(make):
    """Body on a graded box, without supports and loads; in 2-D optionally turned by an angle."""

    @functools.lru_cache
    def built(element, angle, ticks):
        dim = element().dim
        ticks = np.array(ticks)
        mesh = make.box(element, *(ticks if dim == 2 else ticks[[0, 2, 4, -1]],) * dim)
        if angle:
            mesh = make.remesh(mesh, turn(angle) @ mesh.p)
        return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)

    def build(element, angle=0.0, ticks=make.graded):
        return copy.deepcopy(built(element, angle, tuple(map(float, ticks))))

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
@pytest.mark.parametrize(("element", "functional"), FULL_RANK)
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
    turned(p for p in FULL_RANK + THESIS if p[1] not in ("bernstein", "centroid")),
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


def test_bernstein_coefficients_of_a_cubic_trace(body_of):
    """Of c(x): c(x_i) -+ h/3 c'(x_i) at the cell ends; inner nodes are dropped."""
    body = body_of(ElementQuadAdini)
    c = np.polynomial.Polynomial([0.3, -1.0, 2.0, 1.7])
    dofs = interpolated(body, lambda x: np.array([0.0 * x[0], c(x[0]) + x[1]]))
    rows = rows_of(body, "bernstein")
    x = np.unique(body.mesh.p[0])
    h = np.diff(x)
    first, last = c(x[:-1]) + h / 3 * c.deriv()(x[:-1]), c(x[1:]) - h / 3 * c.deriv()(x[1:])
    inner = np.column_stack((first, last)).ravel()
    expected = -np.concatenate(([c(x[0])], inner, [c(x[-1])]))  # u_n = -u_y
    # Rounding.
    np.testing.assert_allclose(rows.G @ dofs, expected, atol=1e-13)
    np.testing.assert_allclose(
        rows.x_nominal[0],
        np.concatenate(([0.0], np.column_stack((x[:-1] + h / 3, x[1:] - h / 3)).ravel(), [1.0])),
        atol=1e-14,
    )


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
def test_bernstein_coefficients_of_a_quadratic_trace(element, body_of):
    body = body_of(element)
    c = np.polynomial.Polynomial([0.3, -1.0, 2.0])
    dofs = interpolated(body, lambda x: np.array([0.0 * x[0], c(x[0])]))
    x = np.unique(body.mesh.p[0])
    middle = c(x[:-1]) + np.diff(x) / 2 * c.deriv()(x[:-1])
    expected = np.full(2 * x.size - 1, np.nan)
    expected[::2], expected[1::2] = c(x), middle
    # Rounding.
    np.testing.assert_allclose(rows_of(body, "bernstein").G @ dofs, -expected, atol=1e-13)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("element", "functional", "angle"),
    turned(p for p in FULL_RANK if p != (ElementQuadAdini, "nodal")),
)
def test_weights_carry_a_constant_pressure(element, functional, angle, body_of):
    """G^T w is the load of a unit traction along n, T^T w along the tangents; sum w the length."""
    body = body_of(element, angle)
    rows = rows_of(body, functional)
    assert np.all(rows.weights > 0)
    # Rounding of a boundary mass solve.
    assert abs(rows.weights.sum() - 1.0) < 1e-13
    directions = [(rows.G, rows.normals[:, 0])]
    for j in range(body.dim - 1):
        directions.append((rows.T[j :: body.dim - 1], rows.tangents[:, j, 0]))
    for matrix, direction in directions:
        body.f = np.zeros(body.basis.N)
        body.load("bottom", direction)
        assert np.abs(matrix.T @ rows.weights - body.f).max() < 1e-13


@pytest.mark.parametrize(
    ("element", "functional"),
    [p for p in FULL_RANK if p[0] not in (ElementQuadAdini, ElementQuadBFS, ElementHexAdini)]
    + [(ElementQuadAdini, "bernstein"), (ElementQuadBFS, "bernstein")],
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


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
def test_mean_places_of_gauss_points(element, body_of):
    """Two-point Gauss quadrature integrates x times a quadratic: the means are the points."""
    body = body_of(element)
    rows = rows_of(body, "gauss")
    x = np.unique(body.mesh.p[0])
    expected = (x[:-1, None] + np.diff(x)[:, None] * GAUSS).ravel()
    # Rounding of a boundary mass solve.
    np.testing.assert_allclose(rows.x[0], expected, atol=1e-12)
    np.testing.assert_allclose(rows.x_nominal[0], expected, atol=1e-14)
    np.testing.assert_allclose(rows.weights, np.repeat(np.diff(x) / 2, 2), atol=1e-12)


def test_adini_weights_in_the_interior_of_a_uniform_mesh(body_of):
    """h/2 each for Bernstein, shifted towards the node: x_i +- .133 h off the nominal thirds."""
    body = body_of(ElementQuadAdini, ticks=np.linspace(0, 1, 11))
    rows = rows_of(body, "bernstein")
    inner = slice(7, -7)  # the ends influence their neighbours, decaying
    # .0072^3 of the decay of a cubic spline's mass matrix remains there.
    np.testing.assert_allclose(rows.weights[inner], 0.05, atol=1e-3)
    shift = np.abs(rows.x[0] - rows.x_nominal[0])[inner]
    np.testing.assert_allclose(shift, 0.0133, atol=1e-3)


@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
def test_points_run_along_the_boundary(functional, body_of):
    rows = rows_of(body_of(ElementQuadAdini, 0.7), functional, ["left", "bottom", "right"])
    along = np.linalg.norm(np.diff(rows.x_nominal, axis=1), axis=0)
    assert along.max() <= 0.26  # the largest cell
    assert np.all(along > 0)


@pytest.mark.parametrize(("element", "functional"), FULL_RANK)
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


@pytest.mark.parametrize("element", [ElementTriP1, ElementTriP2])
def test_curved_outline(element):
    """A disk: weights sum to the polygon's length, normals at vertices are radial."""
    mesh = MeshTri.init_circle(3)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    facets = mesh.boundary_facets()
    rows = contact_rows(body, facets, 0.1, None)
    ends = mesh.p[:, mesh.facets[:, facets]]
    # Rounding.
    assert abs(rows.weights.sum() - np.linalg.norm(ends[:, 0] - ends[:, 1], axis=0).sum()) < 1e-12
    at_vertex = np.abs(np.hypot(*rows.x_nominal) - 1.0) < 1e-9
    assert at_vertex.sum() == facets.size
    radial = np.sum(rows.normals * rows.x_nominal, axis=0)[at_vertex]
    # The mean of two chords' normals; chords of unequal length tilt it a little.
    assert radial.min() > 0.995
    assert np.linalg.matrix_rank(np.vstack([rows.G.toarray(), rows.T.toarray()])) == (
        2 * rows.gap.size
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("dim", [2, 3])
def test_tangent_frames_are_orthonormal(dim, seed):
    normals = np.random.default_rng(seed).standard_normal((dim, 50))
    normals[:, :2] = np.array([np.eye(dim)[-1], -np.eye(dim)[-1]]).T  # straight up, straight down
    normals /= np.linalg.norm(normals, axis=0)
    frame = np.concatenate([normals[:, None], tangent_frame(normals)], axis=1)
    gram = np.einsum("dim,djm->mij", frame, frame)
    # Rounding.
    assert np.abs(gram - np.eye(dim)).max() < 1e-14


def test_tangent_on_a_bottom_edge_points_along_x():
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


@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-150, 1e-12, 1e-8, 1e-4])
def test_tangent_frames_at_the_pole(distance):
    normals = np.array(
        [[0.0, 0.6 * distance], [0.0, 0.8 * distance], [-1.0, np.sqrt(1 - distance**2)]]
    )
    normals = np.hstack((normals, np.repeat(normals[:, :1], 3, axis=1)))
    frame = np.concatenate([normals[:, None], tangent_frame(normals)], axis=1)
    products = np.einsum("dim,djm->mij", frame, frame)
    # Rounding.
    assert np.abs(products - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize(("element", "functional"), [*FULL_RANK, *THESIS])
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

    # Rounding.
    assert np.abs(rows.G @ interpolated(body, closing) - rows.gap).max() < 1e-12


@pytest.mark.parametrize(
    ("element", "functional"),
    [p for p in FULL_RANK + THESIS if p[0] in (ElementQuadAdini, ElementTriP2, ElementQuad2)],
)
def test_quadratic_gap_is_met_exactly(element, functional, body_of):
    body = body_of(element)
    rows = rows_of(body, functional, obstacle=Parabola((0.3, 0.0), 1.7, 0.01))

    def closing(x):
        return np.array([0.0 * x[0], -0.01 - (x[0] - 0.3) ** 2 / 3.4])

    # Rounding.
    assert np.abs(rows.G @ interpolated(body, closing) - rows.gap).max() < 1e-13


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


@pytest.mark.parametrize("element", [ElementTetP2, ElementHex2])
def test_quadratic_faces_do_not_penetrate_between_the_points(element, make):
    """The trace lies in the convex hull of its Bernstein coefficients; the gap is affine."""
    ticks = np.linspace(0, 1, 4)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks, ticks), element(), E=1, nu=0.3)
    body.fix("top", "xy").fix("top", "z", lambda x: -0.05 * x[0] * (0.5 + x[1]))
    result = ContactProblem(body, "bottom", 0.02, 0.3).solve()
    assert 3 <= np.count_nonzero(result.mu) < result.mu.size
    x = np.random.default_rng(2).uniform(0, 1, (2, 400))
    down = -result.sample(np.vstack((x, np.zeros(400))))[2]
    # Rounding.
    assert down.max() < 0.02 + 1e-14


@pytest.mark.parametrize("element", [ElementTetP2, ElementHex2, ElementHexAdini])
def test_weights_are_positive_and_balance_a_uniform_pressure(element, body_of):
    body = body_of(element).load("bottom", (0.0, 0.0, 1.0))
    rows = rows_of(body, None)
    assert rows.weights.min() > 1e-3 * rows.weights.max()
    # G^T (w p) is the load of the pressure: rounding.
    assert np.abs(rows.G.T @ rows.weights + body.f).max() < 1e-14


def test_centroid_is_the_vertex_on_a_uniform_mesh(body_of):
    rows = rows_of(body_of(ElementQuadAdini, ticks=np.linspace(0, 1, 11)), "centroid")
    h = 0.1
    # The mean of the slope function of one cell is h^2 / 12, that of the value h / 2.
    expected = np.linspace(0, 1, 11)
    expected[[0, -1]] += [h / 6, -h / 6]
    np.testing.assert_allclose(rows.x_nominal[0], expected, atol=1e-12)
    np.testing.assert_allclose(rows.weights, np.r_[h / 2, np.full(9, h), h / 2], rtol=1e-12)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS, ElementHexAdini])
def test_quadratic_gap_under_centroids(element, body_of):
    """The gap is extrapolated from the vertex as the displacement is."""
    body = body_of(element)
    rows = rows_of(body, "centroid", obstacle=lambda x: 0.01 + (x[0] - 0.3) ** 2 + 0.2 * x[0])

    def closing(x):
        return np.array([0 * x[0]] * (body.dim - 1) + [-0.01 - (x[0] - 0.3) ** 2 - 0.2 * x[0]])

    # Rounding.
    assert np.abs(rows.G @ interpolated(body, closing) - rows.gap).max() < 1e-13
