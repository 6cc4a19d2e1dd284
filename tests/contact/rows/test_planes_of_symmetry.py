"""Contact beside planes of symmetry: as the whole body says, whatever the noise on coordinates."""

from itertools import pairwise

import numpy as np
import pytest
from families import PLANE, SOLID
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2

from contact import ContactProblem, ElasticBody
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

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
    rows, force = result.system.rows, shear(result)
    assert np.abs(force).max() > 1e-3
    for axis in range(body_dim(element, make) - 1):
        at = rows.x_nominal[axis] < 1e-9
        if element is ElementHexAdini:  # nominal places are means, on this side of the plane
            at = rows.x_nominal[axis] < 0.5 * np.sort(np.unique(result.system.body.mesh.p[axis]))[1]
        assert at.any()
        assert np.abs(force[axis, at]).max() < 1e-9


def body_dim(element, make):
    return element().dim


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
