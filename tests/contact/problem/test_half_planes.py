"""Two blocks so large that, where they touch, they are half planes: Cattaneo, Mindlin, Dundurs.

Cattaneo and Mindlin: equal bodies pressed by P, pushed by Q < F P, and pulled back. With the
half-width a = 1 and c = sqrt(1 - |Q| / F P), the shear over F p0 is

    sqrt(1 - x^2) - c sqrt(1 - x^2 / c^2)                   (second term for |x| < c),

and after Q has been reversed as far, its negative. (C. Cattaneo, Rend. Accad. Naz. Lincei 27
(1938); R. D. Mindlin, J. Appl. Mech. 16 (1949); K. L. Johnson, Contact Mechanics, Cambridge 1985,
sections 7.2 and 7.3.)

Unlike materials: normal and tangential tractions are coupled.
With Dundurs' constant b = E* / 2 [(1 - 2 n1)(1 + n1) / E1 - (1 - 2 n2)(1 + n2) / E2], a cylinder 2
that slides along x on body 1 under q = F p has

    (1/pi) int p(s) / (x - s) ds - b F p(x) = E* x / 2R,
    p(x0 + a t) = E* a / 2R cos(pi l) (1 + t)^(1/2 + l) (1 - t)^(1/2 - l),   tan(pi l) = -b F,

x0 = 2 l a and P = pi E* a^2 (1 - 4 l^2) / 4R, where l = 0 is Hertz. (J. Dundurs and M. S. Lee, J.
Elasticity 2 (1972), 109-112; K. L. Johnson, Contact Mechanics, Cambridge 1985, section 7.2.)
"""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad2, FacetBasis, LinearForm, MeshQuad
from two_blocks import growing

from contact import ContactProblem, ElasticBody, LoadStepper, Status
from skfem_adini import ElementQuadAdini

FAR = 100.0  # size of the blocks, in half-widths of contact


def block(element, cells, up, E, nu, flat=0.25):
    """Above or below y = 0, of `cells` cells a unit of length, `flat` times as high as wide."""
    x, y = (growing(s / cells, fine, FAR, 1.25) for s, fine in ((1, 1.4), (flat, flat / cells)))
    mesh = MeshQuad.init_tensor(np.r_[-x[:0:-1], x], y if up else -y[::-1]).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)


def pressed(upper, lower, radius, friction, **more):
    """Upper's multipliers; the gap of a cylinder between the two."""
    surface = lower.surface("top", clearance=lambda x: x[0] ** 2 / (2 * radius))
    return ContactProblem(upper, "bottom", surface, friction=friction, **more)


F, NU, E, ROUND, CELLS = 0.3, 0.3, 1.0, 50.0, 20
P = np.pi * E / (2 * (1 - NU**2)) / (4 * ROUND)  # so that a = 1
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
    stepper = LoadStepper(pressed(upper, lower, ROUND, F))
    push = (F * P / (2 * FAR), 0.0)
    stepper.load("top", push, lambda t: np.interp(t, [0, 1, 2], [0, 0.5, -0.5]), body=upper)
    return upper, stepper.run([0.0, 1.0, 2.0])


@pytest.mark.sampled(4)
def test_pressed_alone_equal_bodies_do_not_rub(run):
    """And the pressure is that of Hertz at every step."""
    result = run[1][0]
    inside = np.abs(result.x[0]) < 1
    assert np.sqrt(np.mean(result.shear[inside] ** 2)) <= 5e-3 * F * P0
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


FLAT = 2000.0
SOFT, STIFF = (1.0, 0.0), (5.0, 0.45)


def constants(one, two):
    """E* and Dundurs' constant of bodies 1, below, and 2."""
    star = 1 / sum((1 - nu**2) / E for E, nu in (one, two))
    below, above = ((1 - 2 * nu) * (1 + nu) / E for E, nu in (one, two))
    return star, 0.5 * star * (below - above)


def slid(element, one, two, friction, way):
    """Body 2 pushed down and along x by so much that all points slip."""
    upper = block(element, 16, True, *two, flat=0.5)
    lower = block(element, 16 / 1.37, False, *one, flat=0.5).fix("bottom", "xy")
    star, _ = constants(one, two)
    P = np.pi * star / (4 * FLAT)
    upper.fix("top", "x", 0.02 * way).tie("top", "y").load("top", (0.0, -P / 200))
    return pressed(upper, lower, FLAT, friction).solve(), P  # the top is as wide as 2 FAR


@pytest.mark.sampled(8)
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("one", "two"), [(SOFT, STIFF), (STIFF, SOFT)], ids=["on soft", "on stiff"]
)
@pytest.mark.parametrize("element", [ElementQuad2, ElementQuadAdini], ids=lambda e: e.__name__)
@pytest.mark.parametrize("friction", [0.3, 0.9])
def test_pressure_of_a_cylinder_that_slides(element, one, two, way, friction):
    result, P = slid(element, one, two, friction, way)
    star, beta = constants(one, two)
    l = np.arctan(-beta * friction * way) / np.pi
    a = np.sqrt(4 * P * FLAT / (np.pi * star * (1 - 4 * l**2)))
    # The blocks lean a little under the push: the profile is compared from its centre of pressure.
    centre = result.mu @ result.x[0] / result.mu.sum() - 2 * l * a / 3
    t = (result.x[0] - centre) / a
    p0 = star * a / (2 * FLAT) * np.cos(np.pi * l)
    inside = np.abs(t) < 1
    exact = np.zeros(t.size)
    exact[inside] = (1 + t[inside]) ** (0.5 + l) * (1 - t[inside]) ** (0.5 - l)
    off = result.pressure / p0 - exact
    touched = result.status != Status.OPEN
    assert set(result.status[touched]) == {Status.SLIP}
    np.testing.assert_allclose(
        result.shear[:, 0], -way * friction * result.pressure, atol=1e-9 * p0
    )
    assert result.resultant[1] == pytest.approx(P, rel=1e-9)
    # Beside the edges dual multipliers of few facets a half-width swing about the steep profile.
    assert np.abs(off)[np.abs(t) < 0.8].max() <= 5e-3
    hertz = np.sqrt(np.maximum(1 - t**2, 0))
    assert np.abs(exact - hertz)[np.abs(t) < 0.8].max() >= 0.04  # what is told apart
    assert centre == pytest.approx(2 * l * a, abs=0.02 * abs(2 * l * a))
