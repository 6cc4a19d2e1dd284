"""The dissertation's block (section 5.2): its numbers, its balance, its certificate."""

import numpy as np
import pytest

from contact import ContactProblem, ElasticBody, Status

FINE = [pytest.param(n, marks=pytest.mark.slow) for n in (64, 128)]


def test_numbers(make):
    _, result = make.solved()
    forces = [make.solved(n=n)[1].contact_force for n in (10, 20, 40)]
    # The digits printed.
    assert np.abs(np.array(forces) - [0.11864, 0.11892, 0.11894]).max() < 5e-6
    assert abs(make.solved(friction=0.0)[1].contact_force - 0.1292837) < 5e-8
    # The digits printed; min u_y is the converged value, a fixed point stopped early has -.3116.
    assert abs(result.contact_force - 0.1186442) < 5e-8
    assert abs(result.u[1::6].min() + 0.311533) < 2e-6
    assert abs(np.abs(result.u[::6]).max() - 0.073175) < 5e-7
    assert abs(result.pressure.max() - 0.221212) < 5e-7
    assert np.abs(result.zone[0] - [1 / 6, 5 / 6]).max() < 1e-12
    assert np.abs(result.zone[1]).max() < 1e-15
    # u_x is odd about x = 1/2, u_y, pressure and status even; friction opposes the slip.
    points = np.random.default_rng(0).uniform(0, 1, (2, 100))
    mirrored = np.array([1 - points[0], points[1]])
    off = result.sample(points) - [[-1], [1]] * result.sample(mirrored)
    assert np.abs(off).max() < 1e-12
    assert np.abs(result.pressure - result.pressure[::-1]).max() < 1e-12
    assert np.array_equal(result.status, result.status[::-1])
    assert set(result.status) == {Status.OPEN, Status.STICK, Status.SLIP}
    slipping = result.status == Status.SLIP
    assert np.all(result.slip[slipping] * result.shear[slipping] < 0)
    assert np.abs(result.slip[result.status == Status.STICK]).max() < 1e-14


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
    if n == 128 and friction and functional == "bernstein":
        assert abs(result.contact_force - 0.118944) < 5e-7  # the digits printed


def test_balance_names_its_parts(make):
    """The load is -1 along y; the sides carry the rest; friction and the top cancel along x."""
    _, result = make.solved()
    parts = result.balance()
    # Rounding.
    assert np.abs(parts["load"] - [0.0, -1.0]).max() < 1e-13
    assert np.abs(parts["contact"] - result.resultant).max() == 0.0
    assert np.abs(parts["support"] - [0.0, 1 - result.contact_force]).max() < 1e-12
    # Nothing but supports moves a body that touches nothing: what is left is rounding.
    body = ElasticBody.from_mesh(make.block(4).mesh, E=1.0, nu=0.3)
    body.fix("top", "x").fix("top", "y", 0.1)
    moved = ContactProblem(body, "bottom", make.foundation[2], 0.9).solve()
    assert np.abs(moved.u).max() > 0.09
    assert np.abs(moved.balance()["residual"]).max() < 1e-12


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
    body = make.block(10)
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


def test_many_points_at_once(make):
    """Points are located in parts: each value is that of the point alone, wherever it lies."""
    apart = ContactProblem(make.block(4), "bottom", 10.0).solve()
    assert np.all(np.isnan(apart.centre_of_pressure))
    _, result = make.solved()
    points = np.random.default_rng(8).uniform(0.01, 0.99, (2, 250))
    together, displaced = result.stress(points), result.sample(points)
    for i in (0, 99, 100, 125, 249):
        alone = points[:, i : i + 1]
        np.testing.assert_allclose(together[..., i : i + 1], result.stress(alone), atol=1e-13)
        np.testing.assert_allclose(displaced[:, i : i + 1], result.sample(alone), atol=1e-13)
