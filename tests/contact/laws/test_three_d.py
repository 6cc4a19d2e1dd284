"""Friction as a cone in three dimensions: methods agree, the law is met, frames do not matter."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skfem import ElementHex1, ElementTetP1

from contact import ContactProblem, ElasticBody, Plane, Sphere, Status
from contact.rows.discretise import contact_rows

ELEMENTS = [ElementHex1, ElementTetP1]
FRICTION = [0.1, 0.3, 0.9, 3.0]


@pytest.fixture(scope="module")
def reference(make):
    """Results of the default method, one for each problem."""
    known = {}

    def solve(element, friction, law="coulomb"):
        key = (element, friction, law)
        if key not in known:
            problem = make.dome(element, friction=friction, law=law)
            known[key] = problem, problem.solve()
        return known[key]

    return solve


@pytest.mark.sampled(4)
@pytest.mark.parametrize("friction", FRICTION)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize(
    ("method", "tol"), [("pdas", 1e-10), ("tresca_loop", 1e-10), ("fixed_point", 1e-4)]
)
def test_coulomb_methods_agree(method, tol, element, friction, reference):
    problem, expected = reference(element, friction)
    result = problem.solve(method)
    # Certificates at 1e-10; the fixed point is regularised by 1e-5 of the displacement.
    assert np.abs(result.u - expected.u).max() < tol * np.abs(expected.u).max()
    force = expected.mu.max()
    assert np.abs(result.mu - expected.mu).max() < 10 * tol * force
    assert np.abs(result.t - expected.t).max() < 100 * tol * force


@pytest.mark.parametrize("bound", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("element", ELEMENTS)
def test_tresca_methods_agree(element, bound, reference):
    problem, expected = reference(element, bound, "tresca")
    result = problem.solve("pdas")
    # Certificates at 1e-10.
    assert np.abs(result.u - expected.u).max() < 1e-10 * np.abs(expected.u).max()


@pytest.mark.parametrize("friction", FRICTION)
@pytest.mark.parametrize("element", ELEMENTS)
def test_law_is_met(element, friction, reference):
    """Contact and cone, written out in the test; slip and stick both occur at F = .3."""
    _, result = reference(element, friction)
    assert make_sure(result)
    shear = np.linalg.norm(result.shear, axis=1)
    # Rounding relative to the largest pressure.
    assert np.all(shear <= friction * result.pressure + 1e-12 * result.pressure.max())
    slips = result.status == Status.SLIP
    along = np.sum(result.shear * result.slip, axis=1)[slips]
    product = (shear * np.linalg.norm(result.slip, axis=1))[slips]
    # Exactly opposite: to Newton's tolerance.
    np.testing.assert_allclose(along, -product, rtol=1e-9, atol=1e-14 * result.pressure.max())
    if (element, friction) == (ElementHex1, 0.3):
        assert {Status.OPEN, Status.STICK, Status.SLIP} == set(result.status)


def make_sure(result):
    """Some points touch and the certificate holds."""
    return np.count_nonzero(result.mu) >= 5 and max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("friction", FRICTION)
@pytest.mark.parametrize("element", ELEMENTS)
def test_law_error(element, friction, reference, make):
    # Newton's tolerance on the condensed problem is 1e-12.
    assert make.law_error(reference(element, friction)[1]) < 1e-11


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", ELEMENTS)
def test_balance(element, friction, reference):
    _, result = reference(element, friction)
    # Rounding; the body has 75 to 225 dofs.
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert np.abs(result.balance()["load"]).max() == 0.0
    assert result.resultant[2] > 0


def turned_problem(make, element, Q, law, friction):
    """A box pushed into a ball by its top, everything turned by the rotation Q."""
    ticks = np.linspace(-1.0, 1.0, 4)
    mesh = make.box(element, ticks, ticks, np.array([0.0, 0.4, 1.0]))
    mesh = make.remesh(mesh, Q @ mesh.p)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)

    def prescribed(x, c):
        y = np.tensordot(Q.T, x, axes=1)
        moved = np.array([0.01 - 0.03 * y[1], 0.03 * y[0], 0 * y[0] - 0.05])
        return np.tensordot(Q[c], moved, axes=1)

    for c in range(3):
        body.fix("top", c, lambda x, c=c: prescribed(x, c))
    body.load("right", Q @ np.array([0.01, -0.02, 0.03])).body_force(Q @ np.array([0, 0, -0.01]))
    obstacle = Sphere(Q @ np.array([0.2, 0.1, -4.0]), 4.0)
    return ContactProblem(body, "bottom", obstacle, friction, law)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("law", "friction"), [(None, 0.0), ("tresca", 0.01), ("coulomb", 0.3)])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("element", ELEMENTS)
def test_rotation(element, seed, law, friction, make):
    """A turned problem has the turned solution, whatever frame the tangents take."""
    Q = Rotation.random(random_state=seed).as_matrix()
    upright = turned_problem(make, element, np.eye(3), law, friction).solve()
    turned = turned_problem(make, element, Q, law, friction).solve()
    assert np.count_nonzero(upright.mu) >= 2
    u, v = upright.u.reshape(-1, 3), turned.u.reshape(-1, 3)
    # Newton's tolerance of 1e-12 times the condition of the condensed problem.
    assert np.abs(u @ Q.T - v).max() < 1e-10 * np.abs(u).max()
    assert np.abs(upright.pressure - turned.pressure).max() < 1e-9 * upright.pressure.max()
    shear = [np.einsum("mj,djm->dm", r.shear, r.system.rows.tangents) for r in (upright, turned)]
    assert np.abs(Q @ shear[0] - shear[1]).max() < 1e-9 * upright.pressure.max()
    assert np.abs(Q @ upright.resultant - turned.resultant).max() < 1e-10


def test_symmetry(make):
    """Pressed straight onto a paraboloid: invariant under the symmetries of the square."""
    ticks = np.linspace(-1.0, 1.0, 7)
    mesh = make.box(ElementHex1, ticks, ticks, np.array([0.0, 0.3, 0.8]))
    body = ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3)
    body.fix("top", "xy").fix("top", "z", -0.06)
    obstacle = lambda x: 0.03 * (x[0] ** 2 + x[1] ** 2)  # noqa: E731
    result = ContactProblem(body, "bottom", obstacle, 0.2).solve()
    place = {tuple(np.round(x, 9)): i for i, x in enumerate(result.x_nominal[:2].T)}
    shear = np.einsum("mj,djm->md", result.shear, result.system.rows.tangents)[:, :2]
    for Q in ([[-1, 0], [0, 1]], [[0, 1], [1, 0]], [[0, -1], [1, 0]]):
        Q = np.array(Q, dtype=float)
        image = [place[tuple(np.round(Q @ x, 9) + 0.0)] for x in result.x_nominal[:2].T]
        # Newton's tolerance.
        assert np.abs(result.pressure[image] - result.pressure).max() < 1e-10
        assert np.abs(shear[image] - shear @ Q.T).max() < 1e-10
    assert np.abs(result.resultant[:2]).max() < 1e-12
    assert {Status.STICK, Status.SLIP} <= set(result.status)


@pytest.mark.parametrize("element", ELEMENTS)
def test_plane_strain_is_the_two_dimensional_problem(element, make):
    """A slice of hexahedra held between two walls against quadrilaterals; Q1 in both."""
    from skfem import ElementQuad1

    ticks = np.linspace(0, 1, 7)
    planar = make.solved(n=6, element=ElementQuad1, friction=0.4)[1]
    mesh = make.box(element, ticks, np.array([0.0, 0.2]), ticks)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)
    body.fix("top", "x").fix(["left", "right"], "z").fix(["front", "back"], "y")
    body.load("top", (0.0, 0.0, -1.0))
    plane = Plane((0, 0, -0.03), (0, 0, 1))
    result = ContactProblem(body, "bottom", plane, 0.4).solve()
    # Hexahedra give the same field; tetrahedra are another, stiffer discretisation.
    tol = 1e-10 if element is ElementHex1 else 0.2
    assert abs(result.contact_force / 0.2 / planar.contact_force - 1) < tol
    if element is ElementHex1:
        x = planar.system.body.mesh.p
        at = result.sample(np.array([x[0], 0 * x[0] + 0.1, x[1]]))
        expected = planar.u[planar.system.body.basis.nodal_dofs]
        assert np.abs(at[[0, 2]] - expected).max() < 1e-10


@pytest.mark.parametrize("element", ELEMENTS)
def test_tangents_and_normals_of_a_whole_surface(element, make):
    """Rows on all sides of a box: u_n and both u_t are an orthonormal frame's components."""
    ticks = np.linspace(0, 1, 3)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks, ticks), element(), E=1, nu=0.3)
    rows = contact_rows(body, body.mesh.boundary_facets(), 0.0, None)
    u = np.random.default_rng(0).standard_normal(body.basis.N)
    length = (rows.G @ u) ** 2 + np.sum((rows.T @ u).reshape(-1, 2) ** 2, axis=1)
    at = {tuple(p): i for i, p in enumerate(body.mesh.p.T)}
    vertex = [at[tuple(x)] for x in np.round(rows.x_nominal, 12).T]
    # Rounding.
    np.testing.assert_allclose(length, np.sum(u.reshape(-1, 3)[vertex] ** 2, axis=1), rtol=1e-12)
