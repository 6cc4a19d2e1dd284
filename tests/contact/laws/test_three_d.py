"""Friction as a cone in three dimensions: methods agree, the law is met, frames do not matter."""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skfem import ElementHex1, ElementTetP1

from contact import ContactProblem, ElasticBody, Sphere, Status

ELEMENTS = [ElementHex1, ElementTetP1]
FRICTION = [0.1, 0.3, 0.9, 3.0]


@pytest.fixture(scope="module")
def reference(make):
    """Problems and results of the default method."""

    @functools.cache
    def solve(element, friction, law="coulomb"):
        problem = make.dome(element, friction=friction, law=law)
        return problem, problem.solve()

    return solve


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("law", "friction", "method", "tol"),
    [
        # Certificates at 1e-10; the fixed point is regularised by 1e-5 of the displacement.
        *(("coulomb", F, m, 1e-10) for F in FRICTION for m in ("pdas", "tresca_loop")),
        *(("coulomb", F, "fixed_point", 1e-4) for F in FRICTION),
        *(("tresca", bound, "pdas", 1e-10) for bound in (0.001, 0.01, 0.1)),
    ],
)
@pytest.mark.parametrize("element", ELEMENTS)
def test_methods_agree(law, friction, method, tol, element, reference):
    problem, expected = reference(element, friction, law)
    result = problem.solve(method)
    assert np.abs(result.u - expected.u).max() < tol * np.abs(expected.u).max()
    force = expected.mu.max()
    assert np.abs(result.mu - expected.mu).max() < 10 * tol * force
    assert np.abs(result.t - expected.t).max() < 100 * tol * force


@pytest.mark.parametrize("friction", [0.0, *FRICTION])
@pytest.mark.parametrize("element", ELEMENTS)
def test_law_is_met(element, friction, reference, make):
    """Slip and stick both occur at F = .3."""
    _, result = reference(element, friction)
    assert np.count_nonzero(result.mu) >= 5
    assert max(result.kkt.values()) < 1e-10
    # Newton's tolerance on the condensed problem is 1e-12.
    assert make.law_error(result) < 1e-11
    # Rounding; the body has 75 to 225 dofs.
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert np.abs(result.balance()["load"]).max() == 0.0
    assert result.resultant[2] > 0
    if (element, friction) == (ElementHex1, 0.3):
        assert {Status.OPEN, Status.STICK, Status.SLIP} == set(result.status)


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
