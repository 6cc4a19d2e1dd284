"""Contact on a curve that cuts the cells: what must hold for every domain and every cut."""

import numpy as np
import pytest
from scipy.linalg import eigh
from skfem import MeshQuad

from contact import (
    ContactProblem,
    CutBody,
    InputError,
    NotConverged,
    Plane,
    SignedDistance,
    Unbounded,
)
from contact.rows.arc_rows import arc_rows, hats_along
from skfem_adini import LevelSet, Polygon, refined_at_boundary

R = 0.83


def grid(n, low=-1.0, high=1.0):
    mesh = MeshQuad.init_tensor(*[np.linspace(low, high, n + 1)] * 2)
    return mesh.with_defaults()


def circle(x, y, r, squeeze=1.0):
    return LevelSet(lambda p: (p[0] - x) ** 2 + ((p[1] - y) / squeeze) ** 2 - r**2)


DOMAINS = {
    "disk": (circle(0.013, -0.02, 0.71), 12, 1),
    "flat ellipse": (circle(0, 0, 0.9, 0.35), 16, 1),
    "ring": (circle(0, 0, 0.9) & ~circle(0.1, 0.05, 0.4), 16, 2),
    "two disks": (circle(-0.5, 0, 0.4) | circle(0.5, 0.1, 0.37), 16, 2),
    "half disk": (circle(0.0, -1.0, 1.2), 12, 1),
    "sliver": (circle(0.0, 0.0, 0.75 + 1e-11), 16, 1),
    "triangle": (Polygon([[-0.8, 0.9, -0.1], [-0.7, -0.5, 0.85]]), 12, 3),
    "lens": (circle(0.4, 0, 0.9) & circle(-0.4, 0, 0.9), 12, 2),
}


@pytest.fixture(params=DOMAINS, scope="module")
def arc(request):
    level_set, n, curves = DOMAINS[request.param]
    arc = CutBody(grid(n), level_set, E=1.0, nu=0.3).arc()
    return arc, curves


def test_the_boundary_falls_into_its_smooth_curves(arc):
    arc, count = arc
    assert len(arc.curves) == count
    points = np.concatenate([curve.points for curve in arc.curves])
    np.testing.assert_array_equal(np.sort(points), np.arange(arc.weights.size))


def test_every_pressure_of_hats_is_a_load(arc):
    """G^T mu is the load of the traction -p n with p the piecewise linear pressure, p >= 0."""
    arc, _ = arc
    rows, _ = arc_rows(arc)
    assert rows.weights.sum() == pytest.approx(arc.weights.sum(), rel=1e-13)
    assert rows.weights.min() > 0.2 * np.median(rows.weights)
    np.testing.assert_allclose(rows.G.T @ rows.weights, arc.integral(arc.normals), atol=1e-14)
    hats, _ = hats_along(arc)
    assert hats.data.min() >= 0
    np.testing.assert_allclose(hats.sum(axis=0), 1, rtol=1e-14)


def test_places_along_a_circle_are_its_angles():
    arc = CutBody(grid(11), circle(0.02, 0.03, R), E=1.0, nu=0.3).arc()
    (curve,) = arc.curves
    x = arc.x[:, curve.points]
    angle = np.unwrap(np.arctan2(x[1] - 0.03, x[0] - 0.02))
    assert curve.closed
    unit = arc.size[curve.points]
    step = np.diff(curve.s) * 2 / (1 / unit[1:] + 1 / unit[:-1])
    np.testing.assert_allclose(step, R * np.diff(angle), rtol=1e-6)
    assert (np.diff(angle) > 0).all()


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("where", [(0.0, 0.0), (1e-9, 0.03), (0.043, 0.061)])
def test_patch_a_shrink_fit_is_exact(friction, where):
    """A quarter disk in a ring delta too small: u = -delta x / R, p = 2 (lambda + mu) delta / R."""
    delta, E, nu = 0.01, 3.0, 0.3
    mesh = MeshQuad.init_tensor(
        *[np.sort(np.append(np.linspace(0, 1, 9)[1:] + shift, 0)) for shift in where]
    ).with_defaults()
    level_set = circle(0, 0, R)
    body = CutBody(mesh, level_set, E, nu).fix("left", "x").fix("bottom", "y")
    result = ContactProblem(body, body.arc(), -delta, friction).solve()
    lam, mu = E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)
    np.testing.assert_allclose(result.pressure, 2 * (lam + mu) * delta / R, rtol=1e-8)
    np.testing.assert_allclose(result.u[body.basis.nodal_dofs[0]], -delta / R * body.mesh.p[0],
                               atol=1e-10 * delta)  # fmt: skip
    assert np.abs(result.t).max() < 1e-9 * result.mu.max()
    assert max(result.kkt.values()) < 1e-10


def compliance(n, centre, spacing):
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 2 * n + 1), np.linspace(0, 0.5, n + 1))
    mesh = mesh.with_boundaries({"top": lambda x: np.abs(x[1] - 0.5) < 1e-9})
    body = CutBody(mesh, circle(*centre, 0.41), 1.0, 0.3).fix("top")
    rows = ContactProblem(body, body.arc(spacing=spacing), 0.0).rows
    B = np.vstack([rows.G.toarray(), rows.T.toarray()]) @ body.constraint[0].toarray()
    P = body.constraint[0]
    S = (P.T @ body.stiffness @ P).toarray()
    return B @ np.linalg.solve(S, B.T), rows.gap.size


@pytest.mark.sampled(3)
@pytest.mark.parametrize("centre", [(0.5, 0.5), (0.508, 0.486), (0.5, 0.41 + 1e-6)])
def test_multipliers_are_stable_whatever_the_cut(centre):
    """inf sup: W on these cells over W of the same hats on cells half the size, normal, shear.

    With a trace that controls all multipliers the least eigenvalue is near 1; with too many hats
    for the trace it would be near 0, as the last line shows.
    """
    least = {}
    for spacing in (1.5, 0.5):
        (coarse, m), (fine, m_fine) = (compliance(6 * k, centre, k * spacing) for k in (1, 2))
        assert m == m_fine
        parts = [slice(0, m), slice(m, None)]
        least[spacing] = [eigh(coarse[p, p], fine[p, p], eigvals_only=True)[0] for p in parts]
    assert min(least[1.5]) > 0.4
    assert max(least[0.5]) < 0.25


def test_a_body_held_by_contact_alone_in_one_direction():
    """A half disk that its weight presses on the floor: the floor carries it, whatever the cut."""
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 14), np.linspace(-1.1, 0, 7))
    body = CutBody(mesh.with_defaults(), circle(0.01, 0, 1.0), E=1.0, nu=0.3, q=6)
    body = body.fix("top", "x").body_force((0.0, -0.01))
    result = ContactProblem(body, body.arc(), Plane((0, -1), (0, 1)), friction=0.3).solve()
    assert result.resultant[1] == pytest.approx(0.01 * body.domain.area, rel=1e-9)
    assert np.abs(result.balance()["residual"]).max() < 1e-10
    assert max(result.kkt.values()) < 1e-10


def test_a_free_disk_is_refused_by_its_rotation():
    body = CutBody(grid(9), circle(0, 0, R), E=1.0, nu=0.3, q=4).body_force((0.0, -0.01))
    with pytest.raises(Unbounded, match="rotation about"):
        ContactProblem(body, body.arc(), Plane((0, -0.8), (0, 1))).solve()


def test_arc_and_mesh_line_in_one_problem_and_a_graded_mesh():
    """A foundation under the flat side, another beside the arc; weights follow the cells."""
    base = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(0, 1.1, 7))
    mesh = refined_at_boundary(base, circle(0, 0, 1.0), where=lambda x: x[1] > 0.6)
    mesh = mesh.with_boundaries({"flat": lambda x: (np.abs(x[1]) < 1e-9) & (np.abs(x[0]) < 0.7)})
    body = CutBody(mesh, circle(0, 0, 1.0), E=1.0, nu=0.3, q=5)
    above = body.arc(where=lambda x: x[1] > 0.7)
    rows, _ = arc_rows(body.arc(where=lambda x: x[1] > 0))
    assert rows.weights.max() > 1.7 * rows.weights[1:-1].min()
    wall = Plane((0.0, 0.98), (0.0, -1.0))
    result = ContactProblem(body, [above, "flat"], [wall, 0.0], [0.2, 0.5]).solve()
    assert result.resultants[0][1] == pytest.approx(-result.resultants[1][1], rel=1e-8)
    assert result.resultants[1][1] > 0


def test_vtk_holds_the_part_inside():
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 12), np.linspace(0, 1, 6)).with_defaults()
    body = CutBody(mesh, circle(0.02, 0, R), E=1.0, nu=0.3, q=5).fix("bottom")
    arc = body.arc()
    body.load(arc, lambda x: 0.01 * arc.normals)
    result = ContactProblem(body, arc, 1e-3).solve()
    solid = result.to_pyvista()
    assert solid.compute_cell_sizes()["Area"].sum() == pytest.approx(np.pi * R**2 / 2, rel=2e-3)
    assert result.boundary_to_pyvista().n_points == result.mu.size


BAD = {
    "spacing": (lambda b: b.arc(spacing=0.0), "spacing"),
    "spacing nan": (lambda b: b.arc(spacing=np.nan), "spacing"),
    "empty": (lambda b: b.arc(where=lambda x: x[0] > 5), "where: holds on no point"),
    "not booleans": (lambda b: b.arc(where=lambda x: x[0]), "booleans"),
    "parts": (lambda b: b.arc(parts=7), "parts"),
    "functional": (lambda b: ContactProblem(b, b.arc(), 0.1, functional="gauss"), "hat"),
    "fix": (lambda b: b.fix(b.arc()), "mesh lines"),
    "cut facets": (lambda b: b.load("left", (1.0, 0.0)), "belongs to a cut cell"),
    "traction": (lambda b: b.load(b.arc(), (1.0, 0.0, 0.0)), "traction"),
    "traction nan": (lambda b: b.load(b.arc(), (np.nan, 0.0)), "traction"),
    "gaps": (lambda b: ContactProblem(b, b.arc(), [0.1, 0.2]), "gaps given"),
    "gap nan": (lambda b: ContactProblem(b, b.arc(), lambda x: x[0] * np.nan), "NaN"),
    "overlap": (lambda b: ContactProblem(b, [b.arc(), b.arc()], [0.1, 0.1]), "two contact"),
    "from_mesh": (lambda b: CutBody.from_mesh(b.mesh, E=1, nu=0), "CutBody"),
}


@pytest.fixture(scope="module")
def plain():
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 6)] * 2).with_defaults()
    return CutBody(mesh, circle(0, 0, R), E=1.0, nu=0.3, q=3)


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(plain, name):
    action, message = BAD[name]
    with pytest.raises(InputError, match=message):
        action(plain)


def test_bad_bodies_are_named(plain):
    for options, message in (
        ({"E": [1.0, 2.0], "nu": 0.3}, "E: expected a number or one value"),
        ({"E": -1.0, "nu": 0.3}, "modulus"),
        ({"E": 1.0, "nu": 0.5}, "ratio"),
    ):
        with pytest.raises(InputError, match=message):
            CutBody(grid(6), circle(0, 0, R), **options)
    with pytest.raises(InputError, match="inside"):
        CutBody(grid(6), lambda x: x[0] + 9, 1.0, 0.3)
    other = CutBody(grid(6), circle(0, 0, R), 1.0, 0.3, q=3)
    with pytest.raises(InputError, match="another body"):
        ContactProblem(plain, other.arc(), 0.1)


def test_a_torque_that_friction_may_not_hold():
    """A disk between plates .002 nearer than its diameter: the error says what turns it."""
    body = CutBody(grid(12), circle(0.0, 0.0, 0.71), E=1.0, nu=0.3)
    body.body_force(lambda x: np.array([-x[1], x[0]]))
    plates = SignedDistance(lambda x: np.minimum(x[1] + 0.708, 0.708 - x[1]))
    with pytest.raises(NotConverged, match=r"rotation about \(0, 0\).*friction alone"):
        ContactProblem(body, body.arc(), plates, 0.3).solve("tresca_loop", max_iterations=3)
