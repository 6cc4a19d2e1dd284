"""examples/plate.py: order 2 for deflections and frequencies, and a certified contact problem."""

import runpy
from pathlib import Path

import numpy as np
import pytest

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "plate.py"))
CLASSICAL = EXAMPLE["CLASSICAL"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    found = EXAMPLE["main"](["--floor-cells", "24", "--output", str(folder)])
    assert (folder / "plate.png").stat().st_size > 20_000
    return found


@pytest.mark.parametrize("support", CLASSICAL)
def test_order_two(results, support):
    np.testing.assert_allclose(results[f"{support}, orders"], 2, atol=0.1)


@pytest.mark.parametrize("support", CLASSICAL)
def test_frequencies_come_from_below(results, support):
    omega = results[support][:, 1]
    assert (np.diff(omega) > 0).all()
    assert omega[-1] < CLASSICAL[support][1]


def test_numbers(results):
    """Independent runs of the same discretisation gave these."""
    np.testing.assert_allclose(results["clamped"][:, 1], [35.45374, 35.84428, 35.94943], rtol=1e-5)
    assert results["simply supported"][0, 1] == pytest.approx(19.57898, rel=1e-5)
    errors = np.abs(results["clamped"][:, 0] / CLASSICAL["clamped"][0] - 1)
    np.testing.assert_allclose(errors, [3.05e-2, 7.79e-3, 1.96e-3], rtol=1e-2)


def test_floor(results):
    """The deflections obey the floor and solve the program; the picture is symmetric."""
    basis, x, forces, qp = results["floor"]
    gap, w = 1e-4, x[basis.nodal_dofs[0]]
    assert qp.kkt.worst < 1e-10
    assert w.max() <= gap
    assert forces.min() >= 0
    np.testing.assert_array_equal(w[forces > 0], gap)
    square = forces.reshape(25, 25)
    for image in (square.T, square[::-1], square[:, ::-1]):
        np.testing.assert_allclose(image, square, atol=1e-9 * forces.max())


def test_floor_carries_the_pressure_where_the_plate_is_flat(results):
    """Inside the zone of contact a force of q h^2, and more than that on the rim."""
    _, _, forces, _ = results["floor"]
    square = forces.reshape(25, 25) * 24**2
    np.testing.assert_allclose(square[10:15, 10:15], 1, atol=0.03)
    assert square.max() > 2.5
    assert forces.sum() == pytest.approx(0.364, abs=0.002)


def test_equilibrium_of_every_free_dof(results):
    """The residual of the assembled plate is the contact force, and nothing else."""
    basis, x, forces, _ = results["floor"]
    residual = EXAMPLE["unit_load"].assemble(basis) - EXAMPLE["bending"].assemble(basis) @ x
    residual[basis.nodal_dofs[0]] -= forces
    free = basis.complement_dofs(EXAMPLE["supports"](basis, "clamped"))
    np.testing.assert_allclose(residual[free], 0, atol=1e-12)
