"""Blocks so large that, where they touch, they are half spaces: Cattaneo, Mindlin, Dundurs, Hertz.

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

Hertz' point contact of a quarter of two unlike bodies, with 1/E* = sum of (1 - nu^2) / E and the
gap r^2 / 2R:

    a^3 = 3 P R / 4 E*,   p = p0 sqrt(1 - r^2 / a^2),   p0 = 3 P / 2 pi a^2.

(H. Hertz, J. reine angew. Math. 92 (1882), 156-171; K. L. Johnson, section 4.2.)
"""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import ElementHex1, ElementHex2, ElementQuad2, FacetBasis, LinearForm, MeshHex, MeshQuad
from two_blocks import growing

from contact import ContactProblem, ElasticBody, LoadStepper, Status
from skfem_adini import ElementHexAdini, ElementQuadAdini

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


RADIUS, UPPER, LOWER = 500.0, (1.0, 0.3), (3.0, 0.2)
MODULUS = 1 / sum((1 - nu**2) / E for E, nu in (UPPER, LOWER))
LOAD = 4 * MODULUS / (3 * RADIUS)  # so that a = 1
HERTZ = 1.5 * LOAD / np.pi


def quarter(element, cells, up, material, far, ratio):
    x, z = growing(1 / cells, 1.3, far, ratio), growing(0.5 / cells, 1 / cells, far, ratio)
    z = z if up else -z[::-1]
    mesh = MeshHex.init_tensor(x, x, z)
    sides = {"left": (0, 0.0), "front": (1, 0.0), "bottom": (2, z[0]), "top": (2, z[-1])}
    mesh = mesh.with_boundaries(
        {name: (lambda p, k=k, v=v: np.abs(p[k] - v) < 1e-9) for name, (k, v) in sides.items()}
    )
    E, nu = material
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)
    return body.fix("left", "x").fix("front", "y")


POINTS = [
    (ElementHex1, 4, 15.0, 1.5, 0.0, 0.02),
    (ElementHex1, 4, 15.0, 1.5, 0.2, 0.02),
    pytest.param(ElementHex1, 8, 15.0, 1.5, 0.0, 0.01, marks=pytest.mark.slow),
    pytest.param(ElementHex2, 3, 12.0, 1.8, 0.0, 0.03, marks=pytest.mark.slow),
    pytest.param(ElementHexAdini, 4, 15.0, 1.5, 0.0, 0.04, marks=pytest.mark.slow),
]


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "cells", "far", "ratio", "friction", "tol"), POINTS)
def test_point_contact(element, cells, far, ratio, friction, tol):
    upper = quarter(element, cells, True, UPPER, far, ratio)
    lower = quarter(element, cells / 1.3, False, LOWER, far, ratio).fix("bottom", "z")
    upper.load("top", (0.0, 0.0, -LOAD / 4 / far**2))
    surface = lower.surface("top", lambda x: (x[0] ** 2 + x[1] ** 2) / (2 * RADIUS))
    result = ContactProblem(upper, "bottom", surface, friction=friction).solve()
    r, w = np.hypot(*result.x[:2]), result.system.rows.weights
    off, inside = result.pressure / HERTZ - np.sqrt(np.maximum(1 - r**2, 0)), r < 0.85
    assert np.sqrt(w[inside] @ off[inside] ** 2 / w[inside].sum()) <= tol
    assert np.abs(off[inside]).max() <= 2.5 * tol
    # The pressure's second moment is .4 a^2.
    a = np.sqrt(2.5 * (result.mu @ r**2) / result.mu.sum())
    assert a == pytest.approx(1, abs=tol)
    assert result.resultant[2] == pytest.approx(LOAD / 4, rel=1e-9)
    # Along the plane of symmetry y = 0 nothing rubs across it, and shear points inwards or out.
    shear = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)
    on = result.x_nominal[1] < 1e-9
    assert np.abs(shear[1, on]).max() <= 1e-9 * HERTZ
    assert max(result.kkt.values()) <= 1e-10
