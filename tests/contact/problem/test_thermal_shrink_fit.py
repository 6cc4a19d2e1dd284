"""A hot shaft in a cold ring, two elastic bodies of unlike materials: Lame's pressure and stresses.

The interference is the difference of the free expansions at the radius b where they meet. With E' =
E / (1 - n^2), n' = n / (1 - n) and a' = (1 + n) a in plane strain (E, n, a in plane stress),

    p = (a1' T1 - a2' T2) / [((b^2 + a^2) / (b^2 - a^2) - n1') / E1'
                             + ((c^2 + b^2) / (c^2 - b^2) + n2') / E2'].

(S. P. Timoshenko and J. N. Goodier, Theory of Elasticity, 3rd ed., McGraw-Hill 1970, articles 28
and 150.)
"""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, ElementTriP2
from two_blocks import block, ring

from contact import ContactProblem
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore:the cells are not parallelograms")
A, B, C = 1.0, 1.5, 2.2
SHAFT, RING = (3.0, 0.3, 1e-3, 1.5), (1.0, 0.2, 2e-3, -0.5)  # E, nu, alpha, T


def prime(plane, E, nu, alpha, T):
    """Modulus, Poisson's ratio and free strain in the plane."""
    if plane == "stress":
        return E, nu, alpha * T
    return E / (1 - nu**2), nu / (1 - nu), (1 + nu) * alpha * T


def lame(plane):
    (E1, n1, e1), (E2, n2, e2) = prime(plane, *SHAFT), prime(plane, *RING)
    give = ((B**2 + A**2) / (B**2 - A**2) - n1) / E1 + ((C**2 + B**2) / (C**2 - B**2) + n2) / E2
    return (e1 - e2) / give


def fitted(element, n, plane, curved=False, friction=0.0):
    """A quarter of both; facets of the ring a third longer; straight ones lie beside the circle."""
    bodies = []
    for low, high, count, (E, nu, alpha, T) in ((A, B, n, SHAFT), (B, C, round(1.37 * n), RING)):
        cells = max(2, round(count * 2 * (high - low) / (np.pi * low)))
        body = block(
            element,
            np.linspace(low, high, cells + 1),
            np.linspace(0, np.pi / 2, count + 1),
            place=ring(1.0, (0.0, 0.0), 0.0),
            curved=curved,
            E=E,
            nu=nu,
            plane=plane,
        )
        bodies.append(body.fix("bottom", "y").fix("top", "x").heat(T, alpha))
    shaft, hub = bodies
    surface = hub.surface("left", clearance=None if curved else 0.0)
    return ContactProblem(shaft, "right", surface, friction=friction).solve(), shaft, hub


CASES = [
    (ElementQuad1, False, 1e-3, 1.7),
    (ElementTriP2, False, 1e-3, 1.7),
    (ElementQuad2, False, 1e-3, 1.7),
    (ElementQuadAdini, False, 1e-3, 1.7),
    (ElementQuad2, True, 1e-5, 2.7),
    (ElementTriP2, True, 2e-5, 2.7),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize(("element", "curved", "bound", "order"), CASES)
def test_pressure(element, curved, bound, order, plane):
    found = []
    counts = (8, 16, 32)
    for n in counts:
        result, *_ = fitted(element, n, plane, curved)
        off, w = result.pressure / lame(plane) - 1, result.system.rows.weights
        found.append(np.sqrt(w @ off**2 / w.sum()))
    assert found[-1] <= bound
    assert np.abs(off).max() <= 3 * bound
    fitted_order = -np.polyfit(np.log(counts), np.log(found), 1)[0]
    assert order <= fitted_order <= order + 1.4


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_stresses_along_a_ray(plane, friction):
    """Radial and hoop stress at points of both; friction finds nothing to do."""
    result, shaft, hub = fitted(ElementQuad2, 16, plane, curved=True, friction=friction)
    p, ray = lame(plane), np.array([np.cos(0.7), np.sin(0.7)])
    for body, low, high, factor, other in (
        (shaft, A, B, -p * B**2 / (B**2 - A**2), A),
        (hub, B, C, p * B**2 / (C**2 - B**2), C),
    ):
        r = np.linspace(low + 0.02, high - 0.02, 15)
        sigma = result[body].stress(ray[:, None] * r)
        radial = np.einsum("i,ijn,j->n", ray, sigma, ray)
        hoop = np.trace(sigma) - radial
        assert np.abs(radial - factor * (1 - other**2 / r**2)).max() <= 0.01 * p
        assert np.abs(hoop - factor * (1 + other**2 / r**2)).max() <= 5e-3 * p
    assert np.abs(result.shear).max() <= 1e-5 * p
    assert max(result.kkt.values()) <= 1e-10
