"""Hertz' point contact of two elastic bodies of unlike materials, a quarter of both.

With 1/E* = sum of (1 - nu^2) / E and the gap r^2 / 2R,

    a^3 = 3 P R / 4 E*,   p = p0 sqrt(1 - r^2 / a^2),   p0 = 3 P / 2 pi a^2.

(H. Hertz, J. reine angew. Math. 92 (1882), 156-171; K. L. Johnson, Contact Mechanics, Cambridge
1985, section 4.2.)
"""

import numpy as np
import pytest
from skfem import ElementHex1, ElementHex2, MeshHex
from two_blocks import growing

from contact import ContactProblem, ElasticBody
from skfem_adini import ElementHexAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
RADIUS, UPPER, LOWER = 500.0, (1.0, 0.3), (3.0, 0.2)
STAR = 1 / sum((1 - nu**2) / E for E, nu in (UPPER, LOWER))
P = 4 * STAR / (3 * RADIUS)  # so that a = 1
P0 = 1.5 * P / np.pi


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


CASES = [
    (ElementHex1, 4, 15.0, 1.5, 0.0, 0.02),
    (ElementHex1, 4, 15.0, 1.5, 0.2, 0.02),
    pytest.param(ElementHex1, 8, 15.0, 1.5, 0.0, 0.01, marks=pytest.mark.slow),
    pytest.param(ElementHex2, 3, 12.0, 1.8, 0.0, 0.03, marks=pytest.mark.slow),
    pytest.param(ElementHexAdini, 4, 15.0, 1.5, 0.0, 0.04, marks=pytest.mark.slow),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "cells", "far", "ratio", "friction", "tol"), CASES)
def test_pressure(element, cells, far, ratio, friction, tol):
    upper = quarter(element, cells, True, UPPER, far, ratio)
    lower = quarter(element, cells / 1.3, False, LOWER, far, ratio).fix("bottom", "z")
    upper.load("top", (0.0, 0.0, -P / 4 / far**2))
    surface = lower.surface("top", lambda x: (x[0] ** 2 + x[1] ** 2) / (2 * RADIUS))
    result = ContactProblem(upper, "bottom", surface, friction=friction).solve()
    r, w = np.hypot(*result.x[:2]), result.system.rows.weights
    off, inside = result.pressure / P0 - np.sqrt(np.maximum(1 - r**2, 0)), r < 0.85
    assert np.sqrt(w[inside] @ off[inside] ** 2 / w[inside].sum()) <= tol
    assert np.abs(off[inside]).max() <= 2.5 * tol
    # The pressure's second moment is .4 a^2.
    a = np.sqrt(2.5 * (result.mu @ r**2) / result.mu.sum())
    assert a == pytest.approx(1, abs=tol)
    assert result.resultant[2] == pytest.approx(P / 4, rel=1e-9)
    # Along the plane of symmetry y = 0 nothing rubs across it, and shear points inwards or out.
    shear = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)
    on = result.x_nominal[1] < 1e-9
    assert np.abs(shear[1, on]).max() <= 1e-9 * P0
    assert max(result.kkt.values()) <= 1e-10
