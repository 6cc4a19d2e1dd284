"""Noise on the coordinates of a boundary, as from a file or a transformation, of any size.

The weights of contact points sum to the boundary, and a uniform pressure stays one.
"""

import numpy as np
import pytest
from families import CURVED
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
    FacetBasis,
)

from contact import ContactProblem, ElasticBody, InputError
from contact.rows.discretise import contact_rows
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

OFFERED = {
    ElementTriP1: ["nodal"],
    ElementQuad1: ["nodal"],
    ElementTriP2: ["bernstein", "gauss"],
    ElementQuad2: ["bernstein", "gauss"],
    ElementQuadAdini: ["bernstein", "gauss", "centroid", "nodal", "thesis"],
    ElementQuadBFS: ["bernstein", "gauss", "nodal", "centroid"],
    ElementTetP1: ["nodal"],
    ElementTetP2: ["bernstein"],
    ElementHex1: ["nodal"],
    ElementHex2: ["bernstein", "gauss"],
    ElementHexAdini: ["centroid"],
}
CASES = [(element, name) for element, names in OFFERED.items() for name in names]


def noisy(make, element, rng, noise, size=1.0, angle=0.0):
    """Box of random cells, its lower side rough by `noise` of its length; turned by an angle."""
    dim = element().dim
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


def rough(make, element, rng, noise, curved, size, angle):
    """Box of random cells, all coordinates of its lower side noisy; of straight or curved cells."""
    dim = element().dim
    ticks = [
        np.sort(np.r_[0, rng.uniform(0.05, 0.95, 2 if dim == 3 else 5), 1]) for _ in range(dim - 1)
    ]
    ticks = [0.5 * (t + np.linspace(0, 1, t.size)) for t in ticks]
    rectangles = element is ElementQuadBFS  # takes no other cells
    mesh = make.box(element, *ticks, np.array([0.0, rng.uniform(0.4, 0.8), 1.0]))
    names = dict(mesh.boundaries)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    p = mesh.doflocs.copy()
    low = p[-1] == 0
    # Half of the lowest layer at most, and along it a fifth of the shortest facet.
    along = [min(noise, 0.2 * float(np.diff(t).min())) for t in ticks]
    for axis, largest in enumerate([*along, 2 * noise] if not rectangles else [0.0] * dim):
        p[axis, low] += 0.5 * largest * rng.uniform(-1, 1, int(low.sum())) * (0.3 if curved else 1)
    if rectangles:  # noise of files: every line of the mesh a little elsewhere
        for axis, t in enumerate([*ticks, np.unique(p[-1])]):
            shift = along[0] * rng.uniform(-1, 1, t.size)
            p[axis] = np.interp(p[axis], t, t + 0.5 * shift)
    else:
        first, last = p[0].copy(), p[-1].copy()
        p[0] = np.cos(angle) * first - np.sin(angle) * last
        p[-1] = np.sin(angle) * first + np.cos(angle) * last
    mesh = type(mesh)(size * p, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=100.0, nu=0.3)


def measure(body, facets):
    """Length or area: by the corners where facets are straight, else by scikit-fem's rule.

    Areas of warped faces and lengths of parabolas are no polynomials, so every rule has its own:
    here the one of the degree that contact integrates by.
    """
    x = body.mesh.p[:, body.mesh.facets[:, facets]]
    if body.mesh.doflocs.shape[1] == body.mesh.nvertices:
        if body.dim == 2:
            return np.linalg.norm(x[:, 1] - x[:, 0], axis=0).sum()
        if x.shape[1] == 3:
            a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
            return 0.5 * np.linalg.norm(np.cross(a, b, axis=0), axis=0).sum()
    degree = 2 * body.element.maxdeg + 2
    return FacetBasis(body.mesh, body.element, facets=facets, intorder=degree).dx.sum()


@pytest.mark.turns(4)
@given(
    case=st.sampled_from(CASES),
    curved=st.booleans(),
    seed=st.integers(0, 2**31),
    digits=st.floats(1, 16),
    angle=st.floats(-3, 3),
)
@settings(max_examples=2 * settings.default.max_examples)
def test_weights_sum_to_the_boundary(make, case, curved, seed, digits, angle):
    """Of straight and curved cells, under noise of a tenth to rounding, in any unit of length."""
    element, functional = case
    size, curved = 10.0 ** (seed % 7 - 3), curved and element in CURVED
    turn = 0.0 if element is ElementHexAdini else angle
    body = rough(make, element, np.random.default_rng(seed), 10**-digits, curved, size, turn)
    facets = body.facets("bottom")
    try:
        rows = contact_rows(body, facets, 0.0, functional)
    except InputError:  # refused on curves, with noise that makes one
        assert functional == "thesis"
        assert digits < 4
        return
    assert abs(rows.weights.sum() - measure(body, facets)) <= 1e-12 * rows.weights.sum()
    assert rows.weights.min() > 0


@pytest.mark.sampled(4)
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
    [
        c
        for c in CASES
        if c[0] is not ElementQuadBFS  # takes rectangles alone
        and (c[1] not in ("thesis", "nodal") or c[0] is not ElementQuadAdini)
    ],
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
