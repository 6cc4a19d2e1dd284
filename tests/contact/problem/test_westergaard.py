"""Westergaard's wave between two periodic bodies: light contact and full contact.

With the gap D (1 - cos(2 pi x / l)) of period l and 1/E* = sum of (1 - nu^2) / E, p* = pi E* D / l:

    p(x) = 2 pm / s cos(k) sqrt(s - sin(k)^2),   k = pi x / l,   s = pm / p* = sin(pi a / l)^2,
    p(x) = pm + p* cos(2 pi x / l)               where pm >= p*

under the mean pressure pm, which light contact of half-width a carries. (H. M. Westergaard, J.
Appl. Mech. 6 (1939), A49-A53; K. L. Johnson, Contact Mechanics, Cambridge 1985, section 13.2.)
"""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, ElementTriP2, MeshQuad, MeshTri

from contact import ContactProblem, ElasticBody, Pair
from skfem_adini import ElementQuadAdini

HEIGHT, DEPTH, SOFT, STIFF = 0.01, 1.5, (1.0, 0.3), (4.0, 0.2)
STAR = 1 / sum((1 - nu**2) / E for E, nu in (SOFT, STIFF))
WAVE = np.pi * STAR * HEIGHT  # p*, for a period of 1


def gap(x, unit=1.0):
    return unit * HEIGHT * (1 - np.cos(2 * np.pi * x[0] / unit))


def block(element, x, n, up, material, unit=1.0):
    """Ticks x along the wave, n cells a period; finer near the wavy side."""
    above = 0.25 + (DEPTH - 0.25) * np.linspace(0, 1, n // 4 + 1)[1:] ** 1.3
    y = np.r_[np.linspace(0, 0.25, n // 4 + 1), above]
    kind = MeshTri if element is ElementTriP2 else MeshQuad
    mesh = kind.init_tensor(unit * x, unit * (y if up else -y[::-1])).with_defaults()
    E, nu = material
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)


def pressed(element, mean, n=48, m=37, unit=1.0, multipliers="first"):
    upper, lower = (
        block(element, np.linspace(-0.5, 0.5, k + 1), k, up, material, unit)
        for k, up, material in ((n, True, SOFT), (m, False, STIFF))
    )
    lower.periodic("right", "left").fix("bottom", "xy")
    upper.periodic("right", "left").fix("top", "x").tie("top", "y").load("top", (0.0, -mean))
    facing = lower.surface("top", lambda x: gap(x, unit))
    pair = Pair(upper, "bottom", facing, multipliers=multipliers)
    return ContactProblem([upper, lower], [pair]).solve()


ELEMENTS = [ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
elements = pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.__name__)


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize(("share", "unit", "tol"), [(0.3, 1e-3, 0.012), (0.7, 1e3, 0.006)])
def test_light_contact(element, share, unit, tol, multipliers):
    """Pointwise within .8 a; the zone to the nearest contact point."""
    mean = share * WAVE
    result = pressed(element, mean, unit=unit, multipliers=multipliers)
    x, a = result.x[0] / unit, np.arcsin(np.sqrt(share)) / np.pi
    exact = np.sqrt(np.maximum(share - np.sin(np.pi * x) ** 2, 0.0))
    exact *= 2 * mean / share * np.cos(np.pi * x)
    assert result[0].resultant[1] == pytest.approx(mean * unit, rel=1e-9)
    off = np.abs(result.pressure - exact) / exact.max()
    assert off[np.abs(x) < 0.8 * a].max() <= tol
    assert off.max() <= 0.08  # beside the vertical tangent at the edge
    touched = np.abs(x[result.pressure > 0])
    assert abs(touched.max() - a) <= 1 / 37
    assert max(result.kkt.values()) <= 1e-10


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("mean", [1.0, 1.5])
def test_full_contact_between_planes_of_symmetry(element, multipliers, mean):
    """Half a period, between crest and trough; at pm = p* the trough is just touched."""
    upper, lower = (
        block(element, np.linspace(0, 0.5, n + 1), 2 * n, up, material).fix(["left", "right"], "x")
        for n, up, material in ((24, True, SOFT), (17, False, STIFF))
    )
    upper.load("top", (0.0, -mean * WAVE))
    lower.fix("bottom", "y")
    pair = Pair(upper, "bottom", lower.surface("top", gap), multipliers=multipliers)
    result = ContactProblem([upper, lower], [pair]).solve()
    off = np.abs(result.pressure / WAVE - mean - np.cos(2 * np.pi * result.x[0]))
    assert off.max() <= (0.02 if element is ElementQuad1 else 4e-3)
