"""A rounded die pressed into a softer slab and dragged along it: how smooth its forces are.

After M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004), 601-629."""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, MeshQuad

from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Pair

CELLS, LENGTH, BEND, PER_CELL, FRICTION = 20, 4.0, 1.5, 4, 0.3


def neo_hooke(E, nu=0.3):
    return NeoHooke(E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu)))


def ironed(element, multipliers):
    """Forces on the die (steps, 2) from the second cell of its way on, four steps a cell."""
    x = np.linspace(0.0, LENGTH, CELLS + 1)
    low = MeshQuad.init_tensor(x, np.linspace(-1.0, 0.0, 6)).with_defaults()
    slab = NonlinearBody.from_mesh(low, element(), stress=neo_hooke(1.0)).fix("bottom")
    high = MeshQuad.init_tensor(np.linspace(-0.5, 0.5, 11), np.linspace(0.0, 0.5, 4))
    names, p = high.with_defaults().boundaries, high.p.copy()
    p[1] += (BEND - np.sqrt(BEND**2 - p[0] ** 2)) * (1 - p[1] / 0.5)
    p[0] += 1.0
    high = MeshQuad(p, high.t, sort_t=False).with_boundaries(dict(names))
    die = NonlinearBody.from_mesh(high, element(), stress=neo_hooke(10.0)).fix("top").named("die")
    pair = Pair(die, "bottom", slab, "top", friction=FRICTION, multipliers=multipliers)
    stepper = NonlinearStepper(ContactProblem([die, slab], [pair]))
    stepper.move("top", "y", -0.2, lambda t: min(t, 1.0), body="die")
    stepper.move("top", "x", LENGTH / CELLS, lambda t: max(t - 1.0, 0.0), body="die")
    way = 1.0 + np.arange(1, 5 * PER_CELL + 1) / PER_CELL
    history = stepper.run(np.r_[0.5, 1.0, way])
    return history.curve("top", "die")[2 + PER_CELL + PER_CELL // 2 :]


def roughness(force):
    """Largest distance from the parabola through a curve, over its mean."""
    t = np.arange(force.size)
    trend = np.polyval(np.polyfit(t, force, 2), t)
    return np.abs(force - trend).max() / np.abs(force).mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "multipliers"), [(ElementQuad1, "second"), (ElementQuad2, "first")]
)
def test_forces_of_twenty_cells_are_smooth_to_one_per_cent(element, multipliers):
    forces = ironed(element, multipliers)
    assert max(roughness(forces[:, c]) for c in (0, 1)) <= 0.01
    assert np.allclose(np.abs(forces[:, 0]), FRICTION * np.abs(forces[:, 1]), rtol=0.05)


@pytest.mark.slow
def test_multipliers_on_the_rounded_side_of_linear_cells_are_rougher():
    """The control: this is what the choice is about."""
    assert roughness(ironed(ElementQuad1, "first")[:, 0]) > 0.015
