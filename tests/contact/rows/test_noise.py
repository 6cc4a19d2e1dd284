"""Noise of any size on the coordinates of a boundary, as from a file; planes of symmetry beside it.

The weights of contact points sum to the boundary, answers change by as much as the coordinates,
and half a body says what the whole one does.
"""

from itertools import pairwise

import numpy as np
import pytest
from families import CURVED, PLANE, SOLID
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2, FacetBasis

from contact import ContactProblem, ElasticBody, InputError
from contact.rows.discretise import contact_rows
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from tests.contact.rows.cases import OFFERED, turn

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")


def moved(mesh, p, size=1.0, angle=0.0):
    """The mesh with its nodes at p, turned in the plane of the first and the last axis, scaled."""
    p = p.copy()
    p[[0, -1]] = turn(angle) @ p[[0, -1]]
    kept = dict(mesh.boundaries)
    return type(mesh)(size * p, mesh.t, sort_t=False).with_boundaries(kept)


def ticks(rng, count):
    """Cells no thinner than a third of the mean, so that noise of a hundredth folds none."""
    t = np.sort(np.r_[0, rng.uniform(0.05, 0.95, count), 1])
    return 0.5 * (t + np.linspace(0, 1, t.size))


def rough(make, element, rng, noise, curved, size, angle):
    """Box of random cells, all coordinates of its lower side noisy; of straight or curved cells."""
    dim = element().dim
    along = [ticks(rng, 2 if dim == 3 else 5) for _ in range(dim - 1)]
    rectangles = element is ElementQuadBFS  # takes no other cells
    mesh = make.box(element, *along, np.array([0.0, rng.uniform(0.4, 0.8), 1.0]))
    names = dict(mesh.boundaries)
    mesh = (CURVED[element].from_mesh(mesh) if curved else mesh).with_boundaries(names)
    p = mesh.doflocs.copy()
    low = p[-1] == 0
    # Half of the lowest layer at most, and along it a fifth of the shortest facet.
    least = [min(noise, 0.2 * float(np.diff(t).min())) for t in along]
    for axis, largest in enumerate([*least, 2 * noise] if not rectangles else [0.0] * dim):
        p[axis, low] += 0.5 * largest * rng.uniform(-1, 1, int(low.sum())) * (0.3 if curved else 1)
    if rectangles:  # noise of files: every line of the mesh a little elsewhere
        for axis, t in enumerate([*along, np.unique(p[-1])]):
            shift = least[0] * rng.uniform(-1, 1, t.size)
            p[axis] = np.interp(p[axis], t, t + 0.5 * shift)
    mesh = moved(mesh, p, size, 0.0 if rectangles else angle)
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
    case=st.sampled_from(OFFERED),
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


FRICTION = {"tresca": 0.2, "coulomb": 0.3}
NOISES = [1e-12, 1e-8, 1e-5, 3e-5, 1e-4, 2e-4, 3e-4, 1e-3, 1e-2]


def halves(make, element, noise=0.0, whole=False, cells=3):
    """A block under a load that grows outwards, its lower side rough; the half, or all of it."""
    dim = element().dim
    side = np.linspace(0, 1, cells + 1) ** 1.2
    side = np.r_[-side[:0:-1], side] if whole else side
    ticks = [side] * (dim - 1) + [np.linspace(0, 1, cells + 1)]
    mesh = make.box(element, *ticks)
    p = mesh.p.copy()
    p[-1, p[-1] == 0] += noise * np.random.default_rng(7).uniform(-1, 1, int((p[-1] == 0).sum()))
    body = ElasticBody.from_mesh(make.remesh(mesh, p), element(), E=100.0, nu=0.3)
    if not whole:
        body.fix("left", "x")
    if dim == 3 and not whole:
        body.fix("front", "y")
    down = -np.eye(dim)[-1]
    return body.load("top", lambda x: down[:, None, None] * (1 + 0.5 * np.abs(x[0])))


def solved(body, law, functional=None):
    """Contact with what follows the lower side."""
    return ContactProblem(
        body, "bottom", lambda x: 0 * x[0], FRICTION[law], law, functional
    ).solve()


def shear(result):
    """Tangential forces as vectors, shape (dim, m)."""
    return np.einsum("cjm,mj->cm", result.system.rows.tangents, result.t)


MIRRORED = [ElementQuad1, ElementQuad2, ElementQuadAdini, ElementHex1, ElementHex2, ElementHexAdini]
CASES = [
    *((element, None) for element in PLANE + SOLID),
    (ElementQuadAdini, "centroid"),
    (ElementQuadAdini, "gauss"),
]


def quick(element, law):
    """Bricks stand for the other solids where time is short."""
    return element in PLANE or (element is ElementHexAdini and law == "tresca")


@pytest.mark.sampled(7)
@pytest.mark.parametrize(
    ("element", "functional", "law"),
    [
        pytest.param(e, f, law, marks=() if quick(e, law) else pytest.mark.slow)
        for e, f in CASES
        for law in FRICTION
    ],
)
def test_noise_of_any_size(element, functional, law, make):
    """Answers change by what the coordinates do; more where the contact points are others."""
    cells = 2 if element in SOLID else 3
    last = solved(halves(make, element, cells=cells), law, functional)
    size = np.abs(last.u).max()
    for least, noise in pairwise([0.0, *NOISES]):
        rough = solved(halves(make, element, noise, cells=cells), law, functional)
        # Numbers between the vertices fall away where facets turn: an error of the mesh's size.
        allowed = 1e-9 + 5 * (noise - least) + 0.03 * (rough.mu.size != last.mu.size)
        assert np.abs(rough.resultant - last.resultant).max() < allowed
        if rough.mu.size == last.mu.size:
            assert np.abs(rough.u - last.u).max() < allowed * size * 10
            assert np.abs(rough.pressure - last.pressure).max() < 20 * allowed
            assert np.abs(rough.shear - last.shear).max() < 20 * allowed
        last = rough


@pytest.mark.sampled(5)
@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-2])
@pytest.mark.parametrize("element", PLANE + SOLID)
def test_nothing_rubs_across_a_plane_of_symmetry(element, noise, make):
    """The other half moves the other way: no slip, and no friction."""
    result = solved(halves(make, element, noise), "tresca")
    rows, force, body = result.system.rows, shear(result), result.system.body
    assert np.abs(force).max() > 1e-3
    for axis in range(body.dim - 1):
        at = rows.x_nominal[axis] < 1e-9
        if element is ElementHexAdini:  # nominal places are means, on this side of the plane
            at = rows.x_nominal[axis] < 0.5 * np.sort(np.unique(body.mesh.p[axis]))[1]
        assert at.any()
        assert np.abs(force[axis, at]).max() < 1e-9


@pytest.mark.sampled(4)
@pytest.mark.parametrize("law", FRICTION)
@pytest.mark.parametrize(("element", "functional"), [c for c in CASES if c[0] in MIRRORED])
def test_the_whole_body_says_the_same(element, functional, law, make):
    """Pressure and shear of the half, and of the whole without supports on its planes."""
    cells = 2 if element in SOLID else 4
    half = solved(halves(make, element, cells=cells), law, functional)
    body = halves(make, element, whole=True, cells=cells)
    whole = solved(body, law, functional)
    rows, own = whole.system.rows, half.system.rows
    assert abs(half.resultant[-1] - whole.resultant[-1] / 2 ** (body.dim - 1)) < 1e-9
    # Adini's slope across the plane is free in the half.
    limit = 0.02 if element in (ElementQuadAdini, ElementHexAdini) else 1e-9
    force, right = shear(whole)[:-1], rows.x_nominal[:-1] > 1e-9
    for axis in range(body.dim - 1):
        # By symmetry the other quarters bear as much, as far as they do not lie across.
        total = force[axis, right[axis]].sum() / 2 ** (body.dim - 2)
        assert abs(total - shear(half)[axis].sum()) < limit * np.abs(force).sum()
    assert abs(half.pressure.max() / whole.pressure.max() - 1) < limit
    assert own.weights.sum() * 2 ** (body.dim - 1) == pytest.approx(rows.weights.sum(), rel=1e-12)
