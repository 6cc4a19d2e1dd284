"""The dissertation's block (section 5.2): its numbers, its balance, its certificate."""

import numpy as np
import pytest
from skfem import ElementQuad2, ElementTriP2

from contact import ContactProblem, Status
from skfem_adini import ElementQuadAdini

COARSE = 10
SIZES = [10, 20, 40]
FINE = [pytest.param(n, marks=pytest.mark.slow) for n in (64, 128)]


def test_frictionless_force(make):
    _, result = make.solved(friction=0.0)
    # The digits printed.
    assert abs(result.contact_force - 0.1292837) < 5e-8


def test_frictional_numbers(make):
    _, result = make.solved()
    # The digits printed; min u_y is the converged value, a fixed point stopped early has -.3116.
    assert abs(result.contact_force - 0.1186442) < 5e-8
    assert abs(result.u[1::6].min() + 0.311533) < 2e-6
    assert abs(np.abs(result.u[::6]).max() - 0.073175) < 5e-7
    assert abs(result.pressure.max() - 0.221212) < 5e-7
    assert np.abs(result.zone[0] - [1 / 6, 5 / 6]).max() < 1e-12
    assert np.abs(result.zone[1]).max() < 1e-15


def test_force_under_refinement(make):
    """.11864, .11892, .11894 at 10, 20, 40 cells a side: the value at 128 is near."""
    forces = [make.solved(n=n)[1].contact_force for n in SIZES]
    # The digits printed.
    assert np.abs(np.array(forces) - [0.11864, 0.11892, 0.11894]).max() < 5e-6


@pytest.mark.slow
def test_force_on_the_finest_mesh(make):
    # The digits printed.
    assert abs(make.solved(n=128)[1].contact_force - 0.118944) < 5e-7


@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
@pytest.mark.parametrize("friction", [0.0, 0.9])
@pytest.mark.parametrize("n", [10, 20, pytest.param(40, marks=pytest.mark.slow), *FINE])
def test_certificate(n, friction, functional, make):
    _, result = make.solved(n=n, friction=friction, functional=functional)
    # Rounding; equilibrium on fine meshes is the worst.
    assert max(result.kkt.values()) < 1e-12
    assert make.law_error(result) < 1e-12
    assert np.all(result.mu >= 0)
    rows = result.system.rows
    assert np.max(rows.G @ result.u - rows.gap) < 1e-12
    assert np.abs(result.balance()["residual"]).max() < 1e-12


def test_balance_names_its_parts(make):
    """The load is -1 along y; the sides carry the rest; friction and the top cancel along x."""
    _, result = make.solved()
    parts = result.balance()
    # Rounding.
    assert np.abs(parts["load"] - [0.0, -1.0]).max() < 1e-13
    assert np.abs(parts["contact"] - result.resultant).max() == 0.0
    assert abs(result.resultant[1] - result.contact_force) < 1e-13
    assert abs(parts["support"][1] - (1 - result.contact_force)) < 1e-12
    assert abs(parts["support"][0]) < 1e-12  # the shears of both halves cancel


def test_symmetry(make):
    """The block is symmetric about x = 1/2: u_x is odd, u_y and the pressure even."""
    _, result = make.solved()
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 1, (2, 100))
    mirrored = points.copy()
    mirrored[0] = 1 - points[0]
    u, v = result.sample(points), result.sample(mirrored)
    # Rounding times the condition of the body's stiffness.
    assert np.abs(u[0] + v[0]).max() < 1e-12
    assert np.abs(u[1] - v[1]).max() < 1e-12
    assert np.abs(result.pressure - result.pressure[::-1]).max() < 1e-12
    assert np.abs(result.shear + result.shear[::-1]).max() < 1e-12
    assert np.array_equal(result.status, result.status[::-1])


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad2, ElementTriP2])
def test_sampled_field(element, make):
    """`sample` agrees with nodal values and never passes the foundation; supports are seen."""
    _, result = make.solved(element=element)
    body = result.system.body
    nodal = body.basis.dofs.nodal_dofs
    step = nodal.shape[0] // 2
    at_vertices = result.sample(body.mesh.p)
    # Rounding of the inverse mapping.
    assert np.abs(at_vertices[0] - result.u[nodal[0]]).max() < 1e-13
    assert np.abs(at_vertices[1] - result.u[nodal[1]]).max() < 1e-13
    assert step >= 1
    s = np.linspace(0, 1, 501)
    assert result.sample(np.array([s, 0 * s]))[1].min() > -0.03 - 1e-12
    assert np.abs(result.sample(np.array([s, 0 * s + 1]))[0]).max() < 1e-13
    for side in (0, 1):
        assert np.abs(result.sample(np.array([0 * s + side, s]))[1]).max() < 1e-13


def test_stick_and_slip(make):
    """Stick in the middle, slip towards the ends, opposite on both sides; |shear| <= F p."""
    _, result = make.solved()
    touching = result.status != Status.OPEN
    assert np.array_equal(touching, result.mu > 0)
    assert {Status.STICK, Status.SLIP} <= set(result.status[touching])
    slipping = result.status == Status.SLIP
    slip, shear = result.slip[:, 0], result.shear[:, 0]
    assert np.all(slip[slipping] * shear[slipping] < 0)  # friction opposes the slip
    # Rounding.
    np.testing.assert_allclose(np.abs(shear[slipping]), 0.9 * result.pressure[slipping], rtol=1e-12)
    assert np.abs(slip[result.status == Status.STICK]).max() < 1e-14
    assert np.all(result.gap[~touching] > 0)


@pytest.mark.parametrize(("n", "force"), [(10, 0.7363), (20, 0.7361)])
def test_held_by_contact_alone(n, force, make):
    """Only the left side is held: a rotation about (0, 1) is stopped by the foundation."""
    _, result = make.solved(n=n, friction=0.0, sides=("left",))
    # The digits printed.
    assert abs(result.contact_force - force) < 5e-5
    # Moments about (0, 1): supports carry none along with them but by their own resultants.
    assert make.law_error(result) < 1e-12
    if n == 10:
        assert abs(result.u[1::6].min() + 0.570) < 5e-4
        assert np.abs(result.zone[0] - [2 / 15, 1.0]).max() < 1e-12


def test_thesis_points_reproduce_the_forces(make):
    """3N + 1 dependent rows: the displacement and the resultant are those of Bernstein rows."""
    body = make.block(COARSE)
    thesis = ContactProblem(body, "bottom", make.foundation[2], functional="thesis").solve()
    _, result = make.solved(friction=0.0)
    # Points at thirds may penetrate in between, Bernstein coefficients may not: per cent.
    assert abs(thesis.contact_force / result.contact_force - 1) < 0.02
    assert np.abs(thesis.u - result.u).max() < 0.02 * np.abs(result.u).max()


@pytest.mark.parametrize(
    ("E", "free", "rough"),
    [(1.0, 0.17078, 0.15545), (2.0, 0.12928, 0.11864), (5.0, 0.03989, 0.03721)],
)
def test_other_moduli(E, free, rough, make):
    """Values of an independent prototype."""
    # The digits printed; the prototype stopped its fixed point for friction at 3e-4.
    assert abs(make.solved(friction=0.0, E=E)[1].contact_force - free) < 5.1e-6
    assert abs(make.solved(friction=0.9, E=E)[1].contact_force / rough - 1) < 3e-4
