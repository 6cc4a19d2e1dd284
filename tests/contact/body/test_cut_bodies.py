"""Contact on a curve that cuts the cells: what must hold for every domain and every cut."""

import numpy as np
import pytest
from families import half_disk
from scipy.linalg import eigh
from skfem import MeshQuad

from contact import (
    ClosestPoint,
    ContactProblem,
    CutBody,
    InputError,
    NotConverged,
    Plane,
    Rigid,
    SignedDistance,
    Unbounded,
)
from contact.rows.contact_boundaries import arc_rows, hats_along
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


@pytest.mark.parametrize("name", DOMAINS)
def test_curves_and_hats(name):
    """G^T mu is the load of the traction -p n with p the piecewise linear pressure, p >= 0."""
    level_set, n, count = DOMAINS[name]
    arc = CutBody(grid(n), level_set, E=1.0, nu=0.3).arc()
    assert len(arc.curves) == count
    points = np.concatenate([curve.points for curve in arc.curves])
    np.testing.assert_array_equal(np.sort(points), np.arange(arc.weights.size))
    rows, _ = arc_rows(arc)
    assert rows.weights.sum() == pytest.approx(arc.weights.sum(), rel=1e-13)
    assert rows.weights.min() > 0.2 * np.median(rows.weights)
    np.testing.assert_allclose(rows.G.T @ rows.weights, arc.integral(arc.normals), atol=1e-14)
    hats, _ = hats_along(arc)
    assert hats.data.min() >= 0
    np.testing.assert_allclose(hats.sum(axis=0), 1, rtol=1e-14)


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


@pytest.mark.parametrize("e", [0.0, 1e-12, 1e-8, 1e-4, 1e-3, 0.01, 0.03, 0.0624, 0.1249])
def test_pressure_is_uniform_wherever_the_side_lies(e):
    """Without Poisson's effect it is E times the shortening over the height."""
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2).with_defaults()
    bottom = 0.25 - e
    body = CutBody(mesh, lambda x: bottom - x[1], E=1.0, nu=0.0)
    body.fix("top", "x").fix("top", "y", -0.01)
    P = body.constraint[0]
    A = (P.T @ body.stiffness @ P).toarray()
    scale = 1 / np.sqrt(A.diagonal())
    assert np.linalg.eigvalsh(scale[:, None] * A * scale)[0] > 1e-3
    plane = Plane((0.0, bottom), (0.0, 1.0))
    result = ContactProblem(body, body.arc(), plane, friction=0.3).solve()
    np.testing.assert_allclose(result.pressure, 0.01 / (1 - bottom), rtol=1e-10)


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
    body = half_disk((13, 6), q=6)
    body = body.fix("top", "x").body_force((0.0, -0.01))
    result = ContactProblem(body, body.arc(), Plane((0, -1), (0, 1)), friction=0.3).solve()
    assert result.resultant[1] == pytest.approx(0.01 * body.domain.area, rel=1e-9)
    assert np.abs(result.balance()["residual"]).max() < 1e-10
    assert max(result.kkt.values()) < 1e-10


def test_rotations_that_nothing_stops():
    """A free disk, and one between plates .002 nearer than it is wide."""
    body = CutBody(grid(9), circle(0, 0, R), E=1.0, nu=0.3, q=4).body_force((0.0, -0.01))
    with pytest.raises(Unbounded, match="rotation about"):
        ContactProblem(body, body.arc(), Plane((0, -0.8), (0, 1))).solve()
    body = CutBody(grid(12), circle(0.0, 0.0, 0.71), E=1.0, nu=0.3)
    body.body_force(lambda x: np.array([-x[1], x[0]]))
    plates = SignedDistance(lambda x: np.minimum(x[1] + 0.708, 0.708 - x[1]))
    with pytest.raises(NotConverged, match=r"rotation about \(0, 0\).*friction alone"):
        ContactProblem(body, body.arc(), plates, 0.3).solve("tresca_loop", max_iterations=3)


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


# Places crowd where cells are cut: forces that reduce over places are refused. The mean was that of
# a batch of cells, points of weight zero counted: ``x - x.mean()`` was off by more than half of it.
REDUCTIONS = {
    "mean": lambda x: x - x.mean(),
    "mean of each": lambda x: x - x.mean(axis=tuple(range(1, x.ndim)), keepdims=True),
    "max": lambda x: x / x.max(),
    "sum": lambda x: x / x.sum(),
    "jump at the median": lambda x: np.where(x > np.median(x), 1.0, -1.0),
    "sort": lambda x: np.sort(x, axis=1),
    "norm": lambda x: x / np.linalg.norm(x),
    "number": lambda x: x / x.size,
    "constant": lambda x: x.reshape(2, -1).mean(axis=1),
}
ARGUMENTS = {"of nothing": lambda: 1.0, "of two": lambda x, y: x}


@pytest.fixture(scope="module", name="half_disk")
def of_a_disk():
    return half_disk((12, 6))


@pytest.mark.parametrize("name", [*REDUCTIONS, *ARGUMENTS])
def test_reductions_and_other_arguments_are_refused(half_disk, name):
    before, wrong = half_disk.f.copy(), (REDUCTIONS | ARGUMENTS)[name]
    words = ".* each place alone" if name in REDUCTIONS else "expected a function of one argument"
    with pytest.raises(InputError, match=f"force: {words}"):
        half_disk.body_force(wrong)
    with pytest.raises(InputError, match=f"traction: {words}"):
        half_disk.load(half_disk.arc(), wrong)
    np.testing.assert_array_equal(half_disk.f, before)


def test_ordinary_forces(half_disk):
    mean = np.array([0.0, -4 / (3 * np.pi)])  # of the half disk
    for force, total in (
        (lambda x: x - mean[:, None, None], [0.0, 0.0]),
        (lambda x: np.array([np.where(x[0] > 0, 2.0, 0.0), 0 * x[0]]), [np.pi / 2, 0.0]),
        (lambda x: np.array([0.0, -1.0]), [0.0, -np.pi / 2]),
        ((0.0, -1.0), [0.0, -np.pi / 2]),
    ):
        half_disk.f = 0 * half_disk.f
        half_disk.body_force(force)
        # A jump along a line of the mesh; rules of cut cells are exact to rounding here.
        np.testing.assert_allclose(half_disk.total(half_disk.f)[:2], total, atol=1e-9)
    half_disk.f = 0 * half_disk.f
    half_disk.load(half_disk.arc(), lambda x: np.array([0 * x[0], x[0] ** 2]))
    assert abs(half_disk.total(half_disk.f)[1] - np.pi / 2) < 1e-9


def test_a_whole_disk_between_two_plates():
    """Held on its line of symmetry: force and approach of K. L. Johnson, Contact Mechanics, 1985,
    section 5.6, delta = 2 P (2 log(4 R / a) - 1) / (pi E*), and Hertz' peak 2 P / (pi a)."""
    P, nu = 0.01, 0.3
    a = np.sqrt(4 * P * (1 - nu**2) / np.pi)
    disk, mesh = circle(0, 0, 1.0), MeshQuad.init_tensor(*[np.linspace(-1.1, 1.1, 23)] * 2)
    for reach in (0.4, 0.2):
        near = lambda x, r=reach: np.hypot(x[0], abs(x[1]) - 1) < r  # noqa: E731
        mesh = refined_at_boundary(mesh, disk, layers=3, where=near)
    line = {"middle": lambda x: abs(x[0]) < 1e-9}
    body = CutBody(mesh.with_boundaries(line, boundaries_only=False), disk, E=1.0, nu=nu)
    body.fix("middle", "x")
    low, high = (ClosestPoint(Plane((0, y), (0, -y))) for y in (-1, 1))
    arcs = [body.arc(where=lambda x, s=s: s * x[1] > 0.9) for s in (-1, 1)]
    result = ContactProblem(body, arcs, [low, Rigid(high, force=(None, -P))]).solve()
    below = result.x_nominal[1] < 0
    assert result.mu[below].sum() == pytest.approx(P, rel=1e-3)
    assert result.mu[~below].sum() == pytest.approx(P, rel=1e-3)
    assert -result.motion[1] == pytest.approx(a**2 / 2 * (2 * np.log(4 / a) - 1), rel=5e-3)
    assert result.pressure.max() == pytest.approx(2 * P / (np.pi * a), rel=2e-2)
