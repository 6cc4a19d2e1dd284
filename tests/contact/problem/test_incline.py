"""A block on an incline of slope .1, NAFEMS' sliding wedge CGS-4: held up to the limit of friction.

With the weight V and a horizontal force H the block sticks while the resultant lies in the cone of
friction, tan(alpha - phi) <= H / V <= tan(alpha + phi) with F = tan(phi).

Q. Feng and N. K. Prinja, Benchmark Tests for Finite Element Modelling of Contact, Gapping and
Sliding, NAFEMS R0081, 2001.
"""

import numpy as np
import pytest
from families import PLANE, SOLID
from skfem import ElementQuad1, ElementQuad2, ElementTriP2

from contact import ContactProblem, ElasticBody, Pair, Plane, Status, Unbounded
from skfem_adini import ElementQuadAdini

SLOPE, WEIGHT, E, NU = 0.1, 1.0, 1e3, 0.3
ALPHA = np.arctan(SLOPE)
elements = pytest.mark.parametrize("element", PLANE + SOLID, ids=lambda e: e.__name__)


def incline(dim):
    """Axes along the incline, across, and normal to it, as columns."""
    c, s = np.cos(ALPHA), np.sin(ALPHA)
    if dim == 2:
        return np.array([[c, -s], [s, c]])
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def bodies(make, element, p, tau):
    """Block and ground in the uniform state of pressure p and shear tau along the incline."""
    dim = 3 if element in SOLID else 2
    turn = incline(dim)
    sigma = np.zeros((dim, dim))
    sigma[0, -1] = sigma[-1, 0] = tau
    sigma[-1, -1] = -p
    sigma = turn @ sigma @ turn.T
    trace = np.trace(sigma) * (1 if dim == 3 else 1 + NU)
    strain = ((1 + NU) * sigma - NU * trace * np.eye(dim)) / E
    found = []
    for n, low, high, name in ((4, 0.0, 0.5, "block"), (3, -1.0, 0.0, "ground")):
        ticks = [np.linspace(0, 1, n + 1)] * (dim - 1)
        mesh = make.box(element, *ticks, np.linspace(low, high, 3))
        body = ElasticBody.from_mesh(make.remesh(mesh, turn @ mesh.p), element(), E=E, nu=NU)
        body.named(name)
        sides = {"left": (0, -1), "right": (0, 1)} | ({"top": (-1, 1)} if name == "block" else {})
        sides |= {"front": (1, -1), "back": (1, 1)} if dim == 3 else {}
        for side, (axis, sign) in sides.items():
            body.load(side, sign * sigma @ turn[:, axis])
        found.append(body)
    for k in range(dim):
        found[1].fix("bottom", k, lambda x, k=k: np.tensordot(strain[k], x, 1))
    return *found, sigma, turn


def acting(share, F, up):
    """Pressure and shear on the incline where H is this share of the way to the limit."""
    H = WEIGHT * np.tan(ALPHA + (1 if up else -1) * np.arctan(share * F))
    c, s = np.cos(ALPHA), np.sin(ALPHA)
    return WEIGHT * c + H * s, H * c - WEIGHT * s


@pytest.mark.sampled(9)
@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("F", [0.1, 0.3])
@elements
def test_held_below_the_limit_and_refused_above(element, F, up, make):
    p, tau = acting(0.999, F, up)
    assert abs(tau) == pytest.approx(0.999 * F * p, rel=1e-12)
    block, ground, sigma, turn = bodies(make, element, p, tau)
    result = ContactProblem(block, "bottom", ground.surface("top"), friction=F).solve()
    assert np.abs(result.pressure / p - 1).max() <= 1e-9
    # On the block's lower side, whose normal is against the incline's, acts -tau.
    rows = result.system.rows
    shear = np.einsum("mj,djm->dm", result.shear, rows.tangents)
    assert np.abs(shear + tau * turn[:, [0]]).max() <= 1e-9 * p
    assert set(result.status) == {Status.STICK}
    for body in (block, ground):
        assert np.abs(result[body].stress() - sigma[:, :, None, None]).max() <= 1e-9
    for acts, rubs in ((acting(1.001, F, up), F), ((WEIGHT, 1e-3), 0.0)):
        block, ground, *_ = bodies(make, element, *acts)
        words = r"translation along .* of 'block'" if rubs else "of 'block'"
        with pytest.raises(Unbounded, match=words):
            ContactProblem(block, "bottom", ground.surface("top"), friction=rubs).solve()


STIFFNESS, STROKE = 10.0, 0.01


@pytest.mark.sampled(4)
@pytest.mark.parametrize("F", [0.0, 0.1, 0.2, 0.3])
@pytest.mark.parametrize(
    "element",
    [ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini],
    ids=lambda e: e.__name__,
)
def test_wedge_pushed_up_against_a_spring(element, F, make):
    """H - k u = V tan(alpha + phi) while it slides; every point of contact is on its cone."""
    young = 1e8
    spring = STIFFNESS * (1 - SLOPE)
    push = WEIGHT * np.tan(ALPHA + np.arctan(F)) + spring * STROKE
    mesh = make.box(element, np.linspace(0, 1, 5), np.linspace(0, 1, 4))
    x, y = mesh.p
    wedge = make.remesh(mesh, np.array([x, y + SLOPE * x * (1 - y)]))
    wedge = ElasticBody.from_mesh(wedge, element(), E=young, nu=NU)
    mesh = make.box(element, np.linspace(-1, 2, 8), np.linspace(-1, 0, 3))
    x, y = mesh.p
    ground = make.remesh(mesh, np.array([x, y + SLOPE * x * (1 + y)]))
    ground = ElasticBody.from_mesh(ground, element(), E=young, nu=NU).fix("bottom", "xy")
    wedge.load("top", (0.0, -WEIGHT)).load("left", (push, 0.0))
    pairs = [
        Pair(wedge, "bottom", ground, "top", friction=F),
        Pair(wedge, "right", Plane((1.0, 0.0), (-1.0, 0.0))),
    ]
    result = ContactProblem([wedge, ground], pairs, overclosure=[None, STIFFNESS]).solve()
    below = result.part == 0
    assert np.abs(np.abs(result.shear[below, 0]) - F * result.pressure[below]).max() <= 1e-9
    wall = result.resultants[1]
    assert wall[0] == pytest.approx(-spring * STROKE, rel=1e-8)
    middle = result[wedge].sample([[0.5], [0.5]])[:, 0]
    assert middle[0] == pytest.approx(STROKE, rel=1e-5)
