"""Bodies of unlike materials that rub: normal and tangential tractions are coupled.

With Dundurs' constant b = E* / 2 [(1 - 2 n1)(1 + n1) / E1 - (1 - 2 n2)(1 + n2) / E2], a cylinder 2
that slides along x on body 1 under q = F p has

    (1/pi) int p(s) / (x - s) ds - b F p(x) = E* x / 2R,
    p(x0 + a t) = E* a / 2R cos(pi l) (1 + t)^(1/2 + l) (1 - t)^(1/2 - l),   tan(pi l) = -b F,

x0 = 2 l a and P = pi E* a^2 (1 - 4 l^2) / 4R, where l = 0 is Hertz. (J. Dundurs and M. S. Lee, J.
Elasticity 2 (1972), 109-112; K. L. Johnson, Contact Mechanics, Cambridge 1985, section 7.2.)
"""

import numpy as np
import pytest
from half_planes import block, pressed
from skfem import ElementQuad2

from contact import Status
from skfem_adini import ElementQuadAdini

RADIUS = 2000.0
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
    P = np.pi * star / (4 * RADIUS)
    upper.fix("top", "x", 0.02 * way).tie("top", "y").load("top", (0.0, -P / 200))
    return pressed(upper, lower, RADIUS, friction).solve(), P  # the top is as wide as 2 FAR


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
    a = np.sqrt(4 * P * RADIUS / (np.pi * star * (1 - 4 * l**2)))
    # The blocks lean a little under the push: the profile is compared from its centre of pressure.
    centre = result.mu @ result.x[0] / result.mu.sum() - 2 * l * a / 3
    t = (result.x[0] - centre) / a
    p0 = star * a / (2 * RADIUS) * np.cos(np.pi * l)
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


def pushed_together(element, cells, P, friction=0.6):
    """Half of the pair, under P alone: the surfaces drag each other and stick in the middle."""
    upper, lower = (
        block(element, n, up, *material, flat=0.5, half=True).fix("left", "x")
        for n, up, material in ((cells, True, SOFT), (cells / 1.37, False, STIFF))
    )
    upper.load("top", (0.0, -P / 200))
    return pressed(upper, lower.fix("bottom", "y"), RADIUS, friction).solve()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("element", [ElementQuad2, ElementQuadAdini], ids=lambda e: e.__name__)
def test_friction_of_pressed_bodies_beside_a_fine_mesh(element):
    """20 cells a half-width beside 60 of another element, both tractions; and the zones scale."""
    star, _ = constants(SOFT, STIFF)
    P = np.pi * star / (4 * RADIUS)
    other = ElementQuadAdini if element is ElementQuad2 else ElementQuad2
    result, fine = pushed_together(element, 20, P), pushed_together(other, 60, P)
    p0 = star / (2 * RADIUS)
    x, order = result.x[0], np.argsort(fine.x[0])
    stick = fine.x_nominal[0, fine.status == Status.STICK].max()
    inside = x < 0.9
    smooth = inside & (np.abs(x - stick) > 2 / 20)  # a vertical tangent
    for found, reference in (
        (result.pressure, fine.pressure),
        (result.shear[:, 0], fine.shear[:, 0]),
    ):
        off = np.abs(found - np.interp(x, fine.x[0][order], reference[order])) / p0
        assert np.sqrt(np.mean(off[inside] ** 2)) <= 0.01
        assert off[smooth].max() <= 0.015
    assert np.abs(fine.shear).max() > 0.5 * p0
    assert result.resultant[1] == pytest.approx(fine.resultant[1], rel=1e-9)
    # Four times the load: lengths double, and with them the stick zone (D. A. Spence, J. Elasticity
    # 5 (1975), 297-319).
    edges = []
    for load in (0.25, 1.0):
        found = pushed_together(element, 40, load * P)
        x, sticks = found.x_nominal[0], found.status == Status.STICK
        edges.append(x[sticks].max() / np.sqrt(load))
    assert 0.2 < edges[1] < 0.6
    assert edges[0] == pytest.approx(edges[1], abs=2 / 40)
