"""Cattaneo and Mindlin with two elastic bodies: pressed by P, pushed by Q < F P, and pulled back.

With the half-width a = 1 and c = sqrt(1 - |Q| / F P), the shear over F p0 is

    sqrt(1 - x^2) - c sqrt(1 - x^2 / c^2)                   (second term for |x| < c),

and after Q has been reversed as far, its negative. (C. Cattaneo, Rend. Accad. Naz. Lincei 27
(1938); R. D. Mindlin, J. Appl. Mech. 16 (1949); K. L. Johnson, Contact Mechanics, Cambridge 1985,
sections 7.2 and 7.3.)
"""

import numpy as np
import pytest
from half_planes import FAR, block, pressed
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad2, FacetBasis, LinearForm

from contact import LoadStepper, Status
from skfem_adini import ElementQuadAdini

F, NU, E, RADIUS, CELLS = 0.3, 0.3, 1.0, 50.0, 20
P = np.pi * E / (2 * (1 - NU**2)) / (4 * RADIUS)  # so that a = 1
P0, STICK = 2 * P / np.pi, np.sqrt(0.5)


def shear_of(x):
    stick = np.sqrt(np.maximum(1 - (x / STICK) ** 2, 0))
    return np.sqrt(np.maximum(1 - x**2, 0)) - STICK * stick


def averaged(result, body, traction):
    """Means of a traction along x that do its work on all displacements of the boundary."""
    T = result.system.rows.T.tocsc()[:, result.solid.slices[0]]
    basis = FacetBasis(body.mesh, body.basis.elem, facets=body.facets("bottom"), intorder=60)
    work = LinearForm(lambda v, w: traction(w.x[0]) * v[0]).assemble(basis)
    return spsolve((T @ T.T).tocsc(), T @ work) / result.system.rows.weights


@pytest.fixture(scope="module", params=[ElementQuad2, ElementQuadAdini], ids=lambda e: e.__name__)
def run(request):
    upper = block(request.param, CELLS, True, E, NU)
    lower = block(request.param, CELLS / 1.37, False, E, NU).fix("bottom", "xy")
    upper.tie("top", "x").tie("top", "y").load("top", (0.0, -P / (2 * FAR)))
    stepper = LoadStepper(pressed(upper, lower, RADIUS, F))
    push = (F * P / (2 * FAR), 0.0)
    stepper.load("top", push, lambda t: np.interp(t, [0, 1, 2], [0, 0.5, -0.5]), body=upper)
    return upper, stepper.run([0.0, 1.0, 2.0])


@pytest.mark.sampled(4)
def test_pressed_alone_equal_bodies_do_not_rub(run):
    result = run[1][0]
    inside = np.abs(result.x[0]) < 1
    assert np.sqrt(np.mean(result.shear[inside] ** 2)) <= 5e-3 * F * P0


@pytest.mark.turns(3)
def test_pressure_is_that_of_hertz_at_every_step(run):
    for result in run[1]:
        x = result.x[0]
        off = result.pressure / P0 - np.sqrt(np.maximum(1 - x**2, 0))
        assert np.abs(off)[np.abs(x) < 0.9].max() <= 5e-3
        assert np.abs(x[result.pressure > 0]).max() == pytest.approx(1, abs=1 / CELLS)


@pytest.mark.parametrize(("step", "sign"), [(1, -1), (2, 1)])
def test_shear_and_stick_zone(run, step, sign):
    """The shear on the upper body opposes the push."""
    upper, history = run
    result = history[step]
    x = result.x[0]
    shear = sign * result.shear[:, 0] / (F * P0)
    off = np.abs(shear - averaged(result, upper, shear_of))
    inside = np.abs(x) < 1
    assert np.sqrt(np.mean(off[inside] ** 2)) <= 5e-3
    # Two cells from the ends of stick, where the shear has a vertical tangent, point by point.
    smooth = inside & (np.abs(np.abs(x) - STICK) > 2 / CELLS) & (np.abs(x) < 1 - 2 / CELLS)
    assert np.abs(shear - shear_of(x))[smooth].max() <= 0.01
    sticks = inside & (result.status == Status.STICK)
    edge = np.abs(result.x_nominal[0, sticks]).max()
    assert edge == pytest.approx(STICK, abs=1 / CELLS)
    slips = result.status == Status.SLIP
    np.testing.assert_allclose(shear[slips], result.pressure[slips] / P0, atol=1e-9)
    assert result.resultant[0] == pytest.approx(sign * 0.5 * F * P, rel=1e-8)
    assert max(result.kkt.values()) <= 1e-10
