"""Noise on the coordinates of a boundary, as from a file or a transformation, of any size.

The weights of contact points sum to the boundary, and a uniform pressure stays one.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import ContactProblem, ElasticBody, InputError
from contact.rows.discretise import contact_rows
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

OFFERED = {
    ElementTriP1: ["nodal"],
    ElementQuad1: ["nodal"],
    ElementTriP2: ["bernstein", "gauss"],
    ElementQuad2: ["bernstein", "gauss"],
    ElementQuadAdini: ["bernstein", "gauss", "centroid", "nodal", "thesis"],
    ElementTetP1: ["nodal"],
    ElementTetP2: ["bernstein"],
    ElementHex1: ["nodal"],
    ElementHex2: ["bernstein", "gauss"],
    ElementHexAdini: ["centroid"],
}
CASES = [(element, name) for element, names in OFFERED.items() for name in names]


def ids(value):
    return getattr(value, "__name__", str(value))


def noisy(make, element, rng, noise, size=1.0, angle=0.0):
    """Box of random cells, its lower side rough by `noise` of its length; turned by an angle."""
    dim = make.meshes[element]().dim()
    ticks = [
        np.sort(np.r_[0, rng.uniform(0.05, 0.95, 3 if dim == 3 else 5), 1]) for _ in range(dim)
    ]
    # Cells no thinner than a third of the mean, so that noise of a hundredth folds none.
    ticks = [0.5 * (t + np.linspace(0, 1, t.size)) for t in ticks]
    mesh = make.box(element, *ticks)
    p = mesh.p.copy()
    p[-1, p[-1] == 0] += noise * rng.uniform(-1, 1, int((p[-1] == 0).sum()))
    first, last = p[0].copy(), p[-1].copy()
    p[0] = np.cos(angle) * first - np.sin(angle) * last
    p[-1] = np.sin(angle) * first + np.cos(angle) * last
    mesh = make.remesh(mesh, size * p)
    return ElasticBody.from_mesh(mesh, element(), E=100.0, nu=0.3)


def measure(body, facets):
    """Length or area of the facets from their vertices, each quadrilateral by a fine rule."""
    x = body.mesh.p[:, body.mesh.facets[:, facets]]
    if body.dim == 2:
        return np.linalg.norm(x[:, 1] - x[:, 0], axis=0).sum()
    if x.shape[1] == 3:
        return (
            0.5
            * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], axis=0), axis=0).sum()
        )
    node, weight = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for s, ws in zip((node + 1) / 2, weight / 2, strict=True):
        for t, wt in zip((node + 1) / 2, weight / 2, strict=True):
            along = (1 - t) * (x[:, 1] - x[:, 0]) + t * (x[:, 2] - x[:, 3])
            across = (1 - s) * (x[:, 3] - x[:, 0]) + s * (x[:, 2] - x[:, 1])
            total += ws * wt * np.linalg.norm(np.cross(along, across, axis=0), axis=0).sum()
    return total


@given(
    case=st.sampled_from(CASES),
    seed=st.integers(0, 2**31),
    digits=st.floats(2, 16),
    angle=st.floats(-3, 3),
)
@settings(max_examples=2 * settings.default.max_examples)
def test_weights_sum_to_the_boundary(make, case, seed, digits, angle):
    element, functional = case
    size = 10.0 ** (seed % 7 - 3)
    flat = element in (ElementHexAdini,)
    body = noisy(
        make, element, np.random.default_rng(seed), 10**-digits, size, 0.0 if flat else angle
    )
    facets = body.facets("bottom")
    try:
        rows = contact_rows(body, facets, 0.0, functional)
    except InputError:  # refused on curves, with noise that makes one
        refused = True
        rows = None
    else:
        refused = False
    assert not refused or (functional == "thesis" and digits < 4)
    if refused:
        return
    exact = measure(body, facets)
    # Rounding; warped faces are integrated by Gauss points.
    warped = 1e-12 if body.dim == 2 or digits > 7 else 1e-7
    assert abs(rows.weights.sum() - exact) <= warped * exact
    assert rows.weights.min() > 0


@pytest.mark.parametrize(
    "exponent",
    [
        -11,
        -7,
        *(pytest.param(k, marks=pytest.mark.slow) for k in (None, -16, -13, -9, -6, -5, -4, -3)),
    ],
)
@pytest.mark.parametrize(
    ("element", "functional"),
    [c for c in CASES if c[1] not in ("thesis", "nodal") or c[0] is not ElementQuadAdini],
    ids=ids,
)
def test_uniform_pressure_and_friction(element, functional, exponent, make):
    """A block pressed on what follows its lower side: pressure one, friction as without noise."""
    clean, exact, _ = pressed(make, element, functional, 0.0)
    noise = 0.0 if exponent is None else 10.0**exponent
    rough, frictionless, size = pressed(make, element, functional, noise)
    # Facets turn by the noise over their length.
    allowed = 1e-9 + 10 * noise / size
    assert np.abs(exact.pressure - 1).max() < 1e-9
    assert np.abs(frictionless.pressure - 1).max() < allowed
    assert np.abs(rough.resultant - clean.resultant).max() < allowed
    if rough.mu.size == clean.mu.size:
        assert np.abs(rough.pressure - clean.pressure).max() < allowed
        assert np.abs(rough.shear - clean.shear).max() < allowed


def pressed(make, element, functional, noise):
    """With Tresca's friction, without friction, and the shortest facet."""
    body = noisy(make, element, np.random.default_rng(7), noise)
    body.fix("left", "x").load("top", -np.eye(body.dim)[-1])
    if body.dim == 3:
        body.fix("front", "y")
    rough = ContactProblem(body, "bottom", 0.0, 0.2, "tresca", functional).solve()
    smooth = ContactProblem(body, "bottom", 0.0, functional=functional).solve()
    x = body.mesh.p[:, body.mesh.facets[:, body.facets("bottom")]]
    return rough, smooth, np.linalg.norm(x[:, 1] - x[:, 0], axis=0).min()
