"""Uniform states in closed form: any elements, orthotropic and heated bodies, one that floats."""

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS, SOLID
from scipy.spatial.transform import Rotation
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2

from contact import ContactProblem, ElasticBody, Orthotropic, Pair, Status
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

PRESSURE, E, NU = 0.7, 20.0, 0.3
BRICKS = [ElementQuad1, ElementQuad2, ElementQuadAdini, ElementHex1, ElementHex2, ElementHexAdini]
everything = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


def ticks(rng, low, high, n):
    """Ends of n facets, neighbours up to three times as long."""
    size = rng.uniform(1, 3, n)
    return low + (high - low) * np.r_[0.0, np.cumsum(size) / size.sum()]


def brick(make, element, counts, low, high, rng, turn=None, **material):
    """A rectangle or a box of unequal cells with named sides, turned."""
    mesh = make.box(
        element, *(ticks(rng, a, b, n) for a, b, n in zip(low, high, counts, strict=True))
    )
    if turn is not None:
        mesh = make.remesh(mesh, turn @ mesh.p)
    return ElasticBody.from_mesh(mesh, element(), **(material or {"E": E, "nu": NU}))


def smooth(body):
    """Between planes of symmetry at the left, and in front."""
    body.fix("left", "x")
    return body.fix("front", "y") if body.mesh.dim() == 3 else body


def uniform(result, bodies, sigma, tol):
    """The stress of each body at all points of its quadrature."""
    for body in bodies:
        off = result[body].stress() - sigma[:, :, None, None]
        assert np.abs(off).max() <= tol * np.abs(sigma).max()


def pairs_of_elements(seed, space):
    rng = np.random.default_rng(seed)
    known = SOLID if space else PLANE_AND_BFS
    return rng, *(known[k] for k in rng.integers(len(known), size=2))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("seed", range(24))
def test_random_pairs_of_elements_at_random_tilts(seed, space, make):
    """A uniform pressure along a random direction, facets that do not match, random friction."""
    rng, one, two = pairs_of_elements(seed, space)
    dim = 2 + space
    flat = ElementQuadBFS in (one, two)
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = Rotation.random(random_state=seed).as_matrix() if space else turn
    turn = np.eye(dim) if flat else turn
    most = 3 if space else 9
    upper, lower = (
        brick(
            make,
            element,
            (*rng.integers(1, most, dim - 1), 2),
            (*[0.0] * (dim - 1), base),
            (*[1.0] * (dim - 1), base + 1.0),
            rng,
            turn,
        )
        for element, base in ((one, 0.0), (two, -1.0))
    )
    n = turn @ np.eye(dim)[-1]
    sigma = -PRESSURE * np.outer(n, n)
    trace = np.trace(sigma) * (1 if space else 1 + NU)  # plane strain: sigma_zz = nu trace
    strain = ((1 + NU) * sigma - NU * trace * np.eye(dim)) / E
    for body, side in ((upper, "top"), (lower, "bottom")):
        for c in range(dim):
            body.fix(side, c, lambda x, c=c: np.tensordot(strain[c], x, 1))
    pair = Pair(
        upper,
        "bottom",
        lower,
        "top",
        friction=float(rng.choice([0.0, rng.uniform(0, 1.5)])),
        multipliers=str(rng.choice(["first", "second"])),
    )
    result = ContactProblem([upper, lower], [pair]).solve()
    assert np.abs(result.pressure / PRESSURE - 1).max() <= 1e-11
    assert np.abs(result.shear).max() <= 1e-11
    uniform(result, (upper, lower), sigma, 1e-10)


@pytest.mark.sampled(2)
@everything
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_body_that_floats_between_two_others(element, friction, make):
    """Only contact holds the middle body; its pressures are those of the load above."""
    rng, dim = np.random.default_rng(5), 3 if element in SOLID else 2
    top, middle, low = (
        brick(
            make,
            element,
            (*[n] * (dim - 1), 2),
            (*[0.0] * (dim - 1), base),
            (*[1.0] * (dim - 1), base + 1.0),
            rng,
        )
        for n, base in ((2, 2.0), (4 if dim == 2 else 3, 1.0), (3 if dim == 2 else 2, 0.0))
    )
    smooth(top).load("top", (*[0.0] * (dim - 1), -PRESSURE))
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
    sigma = np.zeros((dim, dim))
    sigma[-1, -1] = -PRESSURE
    uniform(result, (top, middle, low), sigma, 1e-10)
    assert np.abs(result[middle].resultant).max() <= 1e-12


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", BRICKS, ids=lambda e: e.__name__)
def test_a_floating_body_pressed_alike_from_both_sides(element, make):
    """Its plane of symmetry does not move: each half is a pair of a body and a held one."""
    dim = 3 if element in SOLID else 2
    n, m = (3, 2) if dim == 3 else (7, 5)
    across = [np.linspace(0.0, 1.0, n + 1)] * (dim - 2)
    wide, narrow = np.linspace(0.0, 1.0, n + 1), np.linspace(0.3, 0.9, m + 1)

    def made(xs, *heights):
        return ElasticBody.from_mesh(make.box(element, xs, *across, heights), element(), E=E, nu=NU)

    def pushed(body, side, sign):
        body.fix(side, "x", 0.002)
        if dim == 3:
            body.fix(side, "y", -0.001)
        return body.fix(side, dim - 1, lambda x: sign * (0.015 - 0.03 * x[0] + 0.01 * x[-2]))

    upper, half = pushed(made(narrow, 0.5, 0.8, 1.0), "top", -1), made(wide, 0.0, 0.25, 0.5)
    half.fix("bottom", dim - 1).fix("left", "x")
    expected = ContactProblem(upper, "bottom", half.surface("top"), friction=0.4).solve()
    upper = pushed(made(narrow, 0.5, 0.8, 1.0), "top", -1)
    middle = made(wide, -0.5, -0.25, 0.0, 0.25, 0.5).fix("left", "x")
    lower = pushed(made(narrow, -1.0, -0.8, -0.5), "bottom", 1)
    pairs = [
        Pair(upper, "bottom", middle, "top", friction=0.4),
        Pair(lower, "top", middle, "bottom", friction=0.4),
    ]
    result = ContactProblem([upper, middle, lower], pairs).solve()
    assert set(expected.status) >= {Status.OPEN, Status.SLIP}
    above, below = (along(result, result.part == side) for side in (0, 1))
    size = expected.pressure.max()
    assert np.abs(above - below).max() <= 1e-9 * size
    # Across the plane of symmetry u_x is even: Adini's derivative is 0 there, in halves weakly so.
    tol = 1e-4 if element in (ElementQuadAdini, ElementHexAdini) else 1e-9
    assert np.abs(above - along(expected)).max() <= tol * size


def along(result, chosen=slice(None)):
    """Pressures in the order of their places on a horizontal side."""
    order = np.lexsort(np.round(result.x_nominal[:-1, chosen], 9))
    return result.pressure[chosen][order]


YOUNG, POISSON, SHEAR = (1.0, 2.5, 4.0), (0.25, 0.1, 0.2), (0.6, 0.8, 0.5)


@pytest.mark.sampled(5)
@everything
@pytest.mark.parametrize("scale", [1.0, 1e9])
def test_an_orthotropic_block_pressed_on_another(element, scale, make):
    """Smooth rigid walls at all sides: each has the stress C e_n of its own strain along n."""
    rng, dim = np.random.default_rng(6), 3 if element in SOLID else 2
    material = Orthotropic(
        tuple(scale * e for e in YOUNG), POISSON, tuple(scale * g for g in SHEAR)
    )
    quarter = Rotation.from_euler("z" if dim == 2 else "x", 90, degrees=True).as_matrix()
    turned = Orthotropic(
        tuple(scale * e for e in YOUNG), POISSON, tuple(scale * g for g in SHEAR), rotation=quarter
    )
    upper, lower = (
        brick(
            make,
            element,
            (*[n] * (dim - 1), 2),
            (*[0.0] * (dim - 1), base),
            (*[1.0] * (dim - 1), base + height),
            rng,
            material=given,
        )
        for n, base, height, given in ((3, 0.0, 0.5, material), (2, -1.0, 1.0, turned))
    )
    for body in (upper, lower):
        smooth(body).fix("right", "x")
        if dim == 3:
            body.fix("back", "y")
    upper.fix("top", dim - 1, -0.01)
    lower.fix("bottom", dim - 1)
    # Constrained moduli from the compliance, whose axes 1 and 2, or 2 and 3, change places below.
    S = np.diag(1 / np.array(YOUNG))
    for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), POISSON, strict=True):
        S[i, j] = S[j, i] = -nu / YOUNG[i]
    C = scale * np.linalg.inv(S)
    above, below = (C[1, 1], C[0, 0]) if dim == 2 else (C[2, 2], C[1, 1])
    pressure = 0.01 / (0.5 / above + 1.0 / below)
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    assert np.abs(result.pressure / pressure - 1).max() <= 1e-8
    assert np.abs(result.shear).max() <= 1e-8 * pressure


@pytest.mark.sampled(4)
@everything
def test_heated_bodies_between_walls(element, make):
    """Held at all sides but the one where they meet: p = sum of the free expansions over give."""
    rng, dim, alpha, heat = np.random.default_rng(7), 3 if element in SOLID else 2, 1e-3, (2.0, 5.0)
    young, nus, heights = (1.0, 3.0), (0.3, 0.2), (0.5, 1.0)
    upper, lower = (
        brick(
            make,
            element,
            (*[n] * (dim - 1), 2),
            (*[0.0] * (dim - 1), base),
            (*[1.0] * (dim - 1), base + height),
            rng,
            E=E,
            nu=nu,
        )
        for n, base, height, E, nu in zip((3, 2), (0.0, -1.0), heights, young, nus, strict=True)
    )
    for body, T in zip((upper, lower), heat, strict=True):
        smooth(body).fix("right", "x").heat(T, alpha)
        if dim == 3:
            body.fix("back", "y")
    upper.fix("top", dim - 1)
    lower.fix("bottom", dim - 1)
    grows = give = 0.0
    for h, E_, nu, T in zip(heights, young, nus, heat, strict=True):
        modulus = E_ * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
        grows += h * alpha * T * (1 + nu) / (1 - nu)
        give += h / modulus
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
    assert np.abs(result.pressure / (grows / give) - 1).max() <= 1e-8
    assert np.abs(result.shear).max() <= 1e-8 * grows / give
