"""A ring shrunk onto another, both cut into cells in space, beside Lame's pressure.

Held along their axis, the rings are in plane strain, with the pressure of `examples/shrink_fit.py`.
"""

import numpy as np
import pytest
from families import CURVED
from skfem import ElementHex1, ElementHex2, ElementTetP1, ElementTetP2

from contact import ContactProblem, ElasticBody, Pair
from skfem_adini import ElementHexAdini

pytestmark = [
    pytest.mark.filterwarnings("ignore::contact.ContactWarning"),
    pytest.mark.filterwarnings("ignore:the cells are not parallelepipeds"),
]
A, B, C, D, E, NU = 1.0, 1.5, 2.2, 1e-3, 3.0, 0.3


def lame():
    modulus, nu = E / (1 - NU**2), NU / (1 - NU)
    inner = (B**2 + A**2) / (B**2 - A**2) - nu
    return D / B * modulus / (inner + (C**2 + B**2) / (C**2 - B**2) + nu)


def ring(make, element, low, high, n, deep, curved):
    """A quarter, n cells round and `deep` along the axis y."""
    layers = max(1, round(n * 2 * (high - low) / (np.pi * low)))
    mesh = make.box(
        element,
        np.linspace(low, high, layers + 1),
        np.linspace(0, 0.4, deep + 1),
        np.linspace(0, np.pi / 2, n + 1),
    )
    names = dict(mesh.boundaries)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    r, y, angle = mesh.doflocs
    place = np.array([r * np.cos(angle), y, r * np.sin(angle)])
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(names)
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU)
    return body.fix("bottom", "z").fix("top", "x").fix("front", "y").fix("back", "y")


CASES = [  # with the error allowed at 12 facets a quarter
    (ElementHex1, False, 8e-3),
    (ElementTetP1, False, 5e-2),
    (ElementTetP2, False, 1.5e-3),
    (ElementHex2, False, 1e-3),
    (ElementHexAdini, False, 1e-3),
    (ElementTetP2, True, 5e-4),
    (ElementHex2, True, 1e-5),
]


@pytest.mark.sampled(5)
@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize(("element", "curved", "bound"), CASES)
def test_pressure(element, curved, bound, multipliers, make):
    """Friction finds little to do, but for what facets beside the circle give it."""
    errors, shears = [], []
    for n in (6, 12):
        shaft = ring(make, element, A, B, n, 1, curved)
        hub = ring(make, element, B, C, round(1.37 * n), 2, curved)
        pair = Pair(
            *(shaft, "right", hub, "left"),
            clearance=-D,
            friction=0.2,
            multipliers=multipliers,
        )
        result = ContactProblem([shaft, hub], [pair]).solve()
        off, w = result.pressure / lame() - 1, result.system.rows.weights
        errors.append(np.sqrt(w @ off**2 / w.sum()))
        shears.append(np.linalg.norm(result.shear, axis=1).max() / lame())
        assert max(result.kkt.values()) <= 1e-10
    assert errors[1] <= bound
    assert np.log2(errors[0] / errors[1]) >= 1.2
    assert shears[1] <= 0.05
