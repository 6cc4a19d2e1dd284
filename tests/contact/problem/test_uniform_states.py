"""Uniform states in closed form: any elements, orthotropic and heated bodies, one that floats."""

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS, SOLID
from scipy.spatial.transform import Rotation
from two_blocks import graded

from contact import ContactProblem, ElasticBody, Pair, Tie
from skfem_adini import ElementQuadBFS

PRESSURE, E, NU = 0.7, 20.0, 0.3
everything = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


def brick(make, element, counts, base, rng, height=1.0, turn=None, **material):
    """A unit square of `counts` unequal cells from `base` up, with named sides, turned."""
    dim = element().dim
    counts = [counts] * (dim - 1) if np.isscalar(counts) else counts
    across = [graded(rng, 0.0, 1.0, n) for n in counts]
    mesh = make.box(element, *across, graded(rng, base, base + height, 2))
    if turn is not None:
        mesh = make.remesh(mesh, turn @ mesh.p)
    return ElasticBody.from_mesh(mesh, element(), **(material or {"E": E, "nu": NU}))


def smooth(body, walls=()):
    """Between planes of symmetry at the left and in front, and others."""
    sides = {"left": "x", "front": "y", "right": "x", "back": "y"}
    for side in ("left", "front", *walls):
        if side in body.mesh.boundaries:
            body.fix(side, sides[side])
    return body


def uniform(result, bodies, sigma, tol=1e-10):
    """The stress of each body at all points of its quadrature."""
    for body in bodies:
        off = result[body].stress() - sigma[:, :, None, None]
        assert np.abs(off).max() <= tol * np.abs(sigma).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("seed", range(24))
def test_random_pairs_of_elements_at_random_tilts(seed, space, make):
    """A uniform pressure along a random direction, facets that do not match, random friction."""
    rng, dim, known = np.random.default_rng(seed), 2 + space, SOLID if space else PLANE_AND_BFS
    one, two = (known[k] for k in rng.integers(len(known), size=2))
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = Rotation.random(random_state=seed).as_matrix() if space else turn
    turn = np.eye(dim) if ElementQuadBFS in (one, two) else turn
    upper, lower = (
        brick(make, element, rng.integers(1, 3 if space else 9, dim - 1), base, rng, turn=turn)
        for element, base in ((one, 0.0), (two, -1.0))
    )
    n = turn @ np.eye(dim)[-1]
    sigma = -PRESSURE * np.outer(n, n)
    trace = np.trace(sigma) * (1 if space else 1 + NU)  # plane strain: sigma_zz = nu trace
    strain = ((1 + NU) * sigma - NU * trace * np.eye(dim)) / E
    for body, side in ((upper, "top"), (lower, "bottom")):
        for c in range(dim):
            body.fix(side, c, lambda x, c=c: np.tensordot(strain[c], x, 1))
    friction = float(rng.choice([0.0, rng.uniform(0, 1.5)]))
    side, functional = rng.choice(["first", "second"]), [None, "standard", "hat"][rng.integers(3)]
    options = {"friction": friction, "multipliers": str(side), "functional": functional}
    pair = Pair(upper, "bottom", lower, "top", **options)
    result = ContactProblem([upper, lower], [pair]).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-11
    assert np.abs(result.shear).max() <= 1e-11
    uniform(result, (upper, lower), sigma)


@pytest.mark.sampled(2)
@everything
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_body_that_floats_between_two_others(element, friction, make):
    """Only contact holds the middle body; its pressures are those of the load above."""
    rng, dim = np.random.default_rng(5), element().dim
    counts = (2, 4, 3) if dim == 2 else (2, 3, 2)
    top, middle, low = (
        brick(make, element, n, base, rng) for n, base in zip(counts, (2.0, 1.0, 0.0), strict=True)
    )
    smooth(top).load("top", -PRESSURE * np.eye(dim)[-1])
    smooth(low).fix("bottom", dim - 1)
    if not friction:  # nothing but friction keeps it from sliding out
        smooth(middle)
    pairs = [
        Pair(top, "bottom", middle, "top", friction=friction),
        Pair(middle, "bottom", low, "top", friction=friction, multipliers="second"),
    ]
    result = ContactProblem([top, middle, low], pairs).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-10
    assert np.abs(result.shear).max() <= 1e-10
    uniform(result, (top, middle, low), -PRESSURE * np.diag(np.eye(dim)[-1]))
    assert np.abs(result[middle].resultant).max() <= 1e-12


@pytest.mark.sampled(7)
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.parametrize(
    ("kinds", "friction"),
    [
        ((Pair, Pair, Pair), 0.0),
        ((Pair, Pair, Pair), 0.6),
        ((Pair, Tie, Pair), 0.6),
        ((Tie, Pair, Tie), 0.0),
    ],
)
@pytest.mark.parametrize("element", PLANE_AND_BFS + SOLID, ids=lambda e: e.__name__)
def test_three_bodies_that_meet_at_a_corner(element, kinds, friction, make):
    """Two beside each other, a third on both; the wall on the left is smooth, as is the floor."""
    space, across, down = element in SOLID, 0.3, 0.7
    n, m, k = (2, 3, 4) if space else (3, 2, 5)

    def box(count, rows, low, high, z):
        sides = [np.linspace(low, high, count + 1), *[np.linspace(0, 1, rows + 1)] * space]
        mesh = make.box(element, *sides, np.linspace(z, z + 1, rows + 1))
        body = ElasticBody.from_mesh(mesh, element(), E=50.0, nu=NU)
        return body.fix(["front", "back"], "y") if space else body

    left, right = box(n, 2, 0.0, 0.45, -1.0), box(m, 3, 0.45, 1.0, -1.0)
    top, up = box(k, 2, 0.0, 1.0, 0.0), np.eye(2 + space)
    for body in (left, right):
        body.fix("bottom", 1 + space)
    for body in (left, top):
        body.fix("left", "x")
    for body in (right, top):
        body.load("right", -across * up[0])
    top.load("top", -down * up[-1])
    facing = (left, "top", top, "bottom"), (right, "top", top, "bottom")
    facing = (*facing, (left, "right", right, "left"))
    pairs = [
        kind(*sides, **({"friction": friction} if kind is Pair else {}))
        for kind, sides in zip(kinds, facing, strict=True)
    ]
    result = ContactProblem([left, right, top], pairs).solve()
    normal = result.pressure + result.tie_pressure
    assert np.abs(normal - np.array([down, down, across])[result.part]).max() <= 1e-9
    sigma = [-across, -NU * (across + down), -down] if space else [-across, -down]
    uniform(result, (left, right, top), np.diag(sigma), 1e-9)
    assert max(result.kkt.values()) <= 1e-10
