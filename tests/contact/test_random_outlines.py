"""Random outlines, smooth, graded, kinked and noisy: fields as a user sees them, 0 wrong.

Two measures that know nothing of the functional: states of uniform stress, whose pressure is a
number, and Q2 on curved cells, twice as many.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    MeshHex2,
    MeshQuad2,
    MeshTet2,
    MeshTri2,
)

from contact import ContactProblem, Cylinder, ElasticBody, Plane
from contact.outline import Outline
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = [
    pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning"),
    pytest.mark.filterwarnings("ignore::contact.ContactWarning"),
]

PLANE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
SOLID = [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini]
CORNER = 0.9  # rad
ADINI = (ElementQuadAdini, ElementHexAdini)
SECOND = {  # of those elements that hold linear fields on curved cells
    ElementTriP2: MeshTri2,
    ElementQuad2: MeshQuad2,
    ElementTetP2: MeshTet2,
    ElementHex2: MeshHex2,
}


def outline(kind, bend):
    """Lower side of a body: places and outward normals as functions of s in [0, 1]."""

    def curve(s):
        angle = bend * (2 * s - 1)
        return {
            "line": lambda: (s, 0.0 * s),
            "arc": lambda: (np.sin(angle), 1 - np.cos(angle)),
            "ellipse": lambda: (1.3 * np.sin(angle), 0.7 * (1 - np.cos(angle))),
            "hollow": lambda: (1.5 * np.sin(angle), 1.5 * (np.cos(angle) - 1)),
            "wavy": lambda: (s, 0.008 * bend * np.cos(4 * np.pi * s)),
        }[kind]()

    def both(s):
        step = 1e-5
        ahead, behind = np.array(curve(s + step)), np.array(curve(s - step))
        tangent = (ahead - behind) / np.linalg.norm(ahead - behind, axis=0)
        return np.array(curve(s)), np.array([tangent[1], -tangent[0]])

    return both


def ticks(rng, n, grading):
    """Ends of facets in [0, 1], neighbours of ratios up to `grading`."""
    size = grading ** rng.uniform(0, 1, n) if grading > 1 else np.ones(n)
    return np.concatenate(([0.0], np.cumsum(size) / size.sum()))


def body_of(
    make, element, shape, s, layers, curved=False, noise=None, kink=(0, 0), size=1.0, E=1.0, nu=0.3
):
    """A body above the outline, as thick as .6; `noise` displaces vertices of the outline."""
    solid = element in SOLID
    r = np.linspace(0.0, 1.0, layers + 1)
    mesh = make.box(element, s, *([np.array([0.0, 0.3])] if solid else []), r)
    names = dict(mesh.boundaries)
    mesh = SECOND[element].from_mesh(mesh) if curved else mesh
    place = mesh.doflocs.copy()
    c, n = shape(place[0])
    place[0], place[-1] = c - 0.6 * place[-1] * n
    low = mesh.doflocs[-1] == 0.0
    if noise is not None:
        for axis, part in zip((0, -1), noise, strict=True):
            place[axis, low] += np.interp(mesh.doflocs[0, low], s, part)
    place[-1] += np.tan(kink[1]) * np.maximum(mesh.doflocs[0] - kink[0], 0.0)
    mesh = type(mesh)(size * place, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)


def turned(body, angle, shift):
    """The body rotated in the plane of its first and last axis, and shifted."""
    mesh, (c, s) = body.mesh, (np.cos(angle), np.sin(angle))
    place = mesh.doflocs.copy()
    first, last = place[0].copy(), place[-1].copy()
    place[0], place[-1] = c * first - s * last + shift[0], s * first + c * last + shift[1]
    mesh = type(mesh)(place, mesh.t, sort_t=False).with_boundaries(dict(mesh.boundaries))
    return ElasticBody.from_mesh(mesh, type(body.element)(), E=float(body.E), nu=float(body.nu))


def uniform_case(seed):
    """A body of any outline, straight or curved cells, noise and kinks of every size."""
    rng = np.random.default_rng([seed, 16])
    solid = rng.random() < 0.25
    element = (SOLID if solid else PLANE)[rng.integers(5)]
    kind = rng.choice(["line", "arc", "ellipse", "hollow", "wavy"])
    n = int(rng.integers(3, 7)) if solid else int(rng.integers(3, 17))
    grading = float(rng.choice([1.0, 3.0, 100.0 if not solid else 10.0]))
    s = ticks(rng, n, grading)
    curved = bool(element in SECOND and kind != "wavy" and rng.random() < 0.25)
    h = np.diff(s).min()
    noise = 10.0 ** rng.uniform(-14, -1) * h * rng.choice([0.0, 1.0, 1.0])
    move = noise * rng.standard_normal((2, n + 1))
    move[:, [0, -1]] = 0.0  # the sides stay straight
    kink = (0.0, 0.0)
    if kind == "line":
        turn = 10.0 ** rng.uniform(-12, np.log10(np.pi / 3)) * rng.choice([0.0, 1.0])
        kink = (s[rng.integers(1, n)], turn * rng.choice([-1.0, 1.0]))
    return SimpleNamespace(
        element=element,
        kind=kind,
        bend=rng.uniform(0.05, 1.0),
        s=s,
        curved=curved,
        move=move,
        noise=noise,
        kink=kink,
        size=10.0 ** rng.uniform(-6, 3),
        E=10.0 ** rng.uniform(-3, 12),
        nu=float(rng.choice([0.0, 0.2, 0.3, 0.4])),
        angle=rng.uniform(0, 2 * np.pi) * rng.choice([0.0, 1.0]),
        shift=rng.uniform(-3, 3, 2) * rng.choice([0.0, 1.0]),
        layers=int(rng.integers(1, 4)),
    )


def uniform_state(make, seed):
    """Errors of pressure and shear in a state of pressure alone, on all sides, and of sums."""
    q = uniform_case(seed)
    shape = outline(q.kind, q.bend)
    straight = body_of(
        make, q.element, shape, q.s, q.layers, q.curved, q.move, q.kink, q.size, q.E, q.nu
    )
    body = turned(straight, q.angle, q.size * q.shift)
    middle = body.mesh.p.mean(axis=1)
    strain = 1e-3
    lam, mu = q.E * q.nu / ((1 + q.nu) * (1 - 2 * q.nu)), q.E / (2 * (1 + q.nu))
    p = strain * (body.dim * lam + 2 * mu)
    for c in range(body.dim):
        body.fix("top", c, lambda x, c=c: -strain * (x[c] - middle[c]))
    if body.dim == 3:
        body.fix(["front", "back"], 1, lambda x: -strain * (x[1] - middle[1]))
    for side in ("left", "right"):
        body.load(side, tuple(-p * side_normal(body, side)))
    probe = ContactProblem(body, "bottom", 0.0)
    exact = linear_dofs(body, -strain, middle)
    result = ContactProblem(body, "bottom", probe.rows.G @ exact).solve()
    return q, result, p


def side_normal(body, side):
    """Outward normal of a straight side."""
    normals = Outline(body, body.facets(side)).at_corners.reshape(body.dim, -1)
    assert np.ptp(normals, axis=1).max() < 1e-9
    return normals[:, 0]


def linear_dofs(body, factor, middle):
    """Dofs of the displacement factor (x - middle)."""
    u = np.zeros(body.basis.N)
    where = body.basis.doflocs
    for i, dofs in enumerate(body.basis.element_dofs):
        c, kind = i % body.dim, body.basis.elem.elem
        if isinstance(kind, ADINI):
            derivative = (i // body.dim) % (1 + body.dim)
            u[dofs] = (
                factor * (where[c, dofs] - middle[c])
                if derivative == 0
                else factor * (derivative == 1 + c)
            )
        else:
            u[dofs] = factor * (where[c, dofs] - middle[c])
    return u


def middles(body):
    """Angles of the facets' middles about the body's middle, which grow along the outline."""
    away = body.mesh.p[:, body.mesh.facets[:, body.facets("bottom")]].mean(axis=1)
    away = away - body.mesh.p.mean(axis=1)[:, None]
    inward = -away.mean(axis=1)
    return np.arctan2(
        away[0] * inward[-1] - away[-1] * inward[0], -away[0] * inward[0] - away[-1] * inward[-1]
    )


def check_uniform_state(make, seed):
    q, result, p = uniform_state(make, seed)
    body, w, off = result.system.body, result.system.rows.weights, result.pressure / p - 1
    rms = float(np.sqrt(np.sum(w * off**2) / w.sum()))
    # Curved cells integrate normals that vary to their own order, at worst 65:1 graded. What fixes
    # a cubic along a kinked side is told apart by the kink alone, and loses as many digits.
    limit = 0.03 if q.curved else 1e-6 if q.element in ADINI else 1e-8
    normals = Outline(body, body.facets("bottom")).at_corners[:, :, 0]
    turns = np.linalg.norm(np.diff(normals[:, np.argsort(middles(body))], axis=1), axis=0)
    if not q.curved and turns.max() > 2 * np.sin(CORNER / 2):
        limit = 0.2  # a corner has one point, which cannot press both sides evenly
    assert (rms if q.curved else np.abs(off).max()) < limit, seed
    if not q.curved and body.dim == 2:
        x = body.mesh.p[:, body.mesh.facets[:, body.facets("bottom")]]
        measure = np.linalg.norm(x[:, 1] - x[:, 0], axis=0).sum()
        assert w.sum() == pytest.approx(measure, rel=1e-12), seed
    assert np.abs(result.balance()["residual"]).max() < 1e-9, seed


# The last: large facets beside small ones at a large turn, in the plane and in space.
@pytest.mark.parametrize("seed", [*range(30), 770, 714, 753])
def test_uniform_pressure(seed, make):
    """Every straight polygon, noisy, kinked or graded, is pressed evenly to round-off."""
    check_uniform_state(make, seed)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_uniform_pressure_of_one_thousand(part, make):
    for seed in range(100 * part, 100 * part + 100):
        try:
            check_uniform_state(make, seed)
        except Exception as error:  # scikit-fem's own inverse of strongly graded curved cells
            if "Newton iteration didn't converge" not in str(error):
                raise


def pressed_case(seed):
    """A smooth outline, an obstacle and a law, to be solved on any mesh."""
    rng = np.random.default_rng([seed, 17])
    element = PLANE[rng.integers(5)]
    law = rng.choice(["none", "tresca", "coulomb"])
    kind = rng.choice(["line", "arc", "ellipse", "hollow", "wavy"])
    obstacle = rng.choice(
        {"hollow": ["cylinder", "number"], "line": ["number"]}.get(
            kind, ["plane", "bore", "cylinder", "number"] if kind != "wavy" else ["number"]
        )
    )
    return SimpleNamespace(
        element=element,
        kind=kind,
        obstacle=obstacle,
        law=None if law == "none" else str(law),
        friction={"none": 0.0, "tresca": 0.02, "coulomb": rng.uniform(0.1, 0.8)}[law],
        bend=rng.uniform(0.4, 0.9),
        curved=bool(element in SECOND and rng.random() < 0.3),
        noise=10.0 ** rng.uniform(-14, -6) * rng.choice([0.0, 1.0]),
        push=rng.uniform(0.03, 0.06),
        slide=rng.uniform(-0.02, 0.02),
        size=10.0 ** rng.uniform(-6, 3),
        angle=rng.uniform(0, 2 * np.pi) * rng.choice([0.0, 1.0]),
        rng=rng,
    )


def pressed(make, q, element, n, curved, noise):
    """Result with n facets, and the arc lengths of its points along the curve, in [0, 1]."""
    s = np.linspace(0, 1, n + 1)
    move = noise * np.random.default_rng(n).standard_normal((2, n + 1))
    shape = outline(q.kind, q.bend)
    body = body_of(make, element, shape, s, max(6, n // 2), curved, move, size=q.size)
    body = turned(body, q.angle, (0.0, 0.0))
    c, sn = np.cos(q.angle), np.sin(q.angle)
    R = np.array([[c, -sn], [sn, c]])
    move = q.size * R @ np.array([q.slide, -q.push])
    body.fix("top", "x", move[0]).fix("top", "y", move[1])
    at = {"plane": (0, 0), "bore": (0, 2.0), "cylinder": (0, -1.0)}
    radius = 1.5 if q.kind == "hollow" else 1.0
    centre = (0.0, -1.5) if q.kind == "hollow" else at.get(q.obstacle, (0, 0))
    centre = q.size * R @ np.array(centre)
    against = {
        "plane": lambda: Plane(centre, R @ np.array([0.0, 1.0])),
        "bore": lambda: Cylinder(centre, 2.0 * q.size, hollow=True),
        "cylinder": lambda: Cylinder(centre, radius * q.size),
        "number": lambda: 0.0,
    }[q.obstacle]()
    laws = (q.friction, q.law) if q.law else (0.0,)
    return ContactProblem(body, "bottom", against, *laws).solve(), shape, R


def fields(found, q, bins=6):
    """Resultant and its parts along the outline, in the body's own frame."""
    result, shape, R = found
    x = R.T @ result.x / q.size
    s = np.linspace(-0.02, 1.02, 4001)
    c = shape(s)[0]
    at = s[np.argmin((x[0][:, None] - c[0]) ** 2 + (x[1][:, None] - c[1]) ** 2, axis=1)]
    # Forces spread by hats as wide as a bin, so that a point's own place matters little.
    knots = np.linspace(0, 1, bins + 1)
    hat = np.maximum(1 - np.abs(at[:, None] - knots) * bins, 0.0)
    force = np.array([hat.T @ result.mu, hat.T @ (-result.t[:, 0])])
    return R.T @ result.resultant / q.size, force / q.size


def check_pressed(make, seed):
    """Against curved Q2 cells on twice as many facets."""
    q = pressed_case(seed)
    found = pressed(make, q, q.element, 16, q.curved, q.noise)
    force, parts = fields(found, q)
    finer, of_finer = fields(pressed(make, q, ElementQuad2, 32, True, 0.0), q)
    total = np.abs(of_finer[0]).sum()
    # What 16 facets leave of an approach of some hundredths: their height is a thousandth.
    assert np.linalg.norm(force - finer) < 0.06 * np.linalg.norm(finer), seed
    normal, tangential = np.abs(parts - of_finer).sum(axis=1) / total
    linear = q.element is ElementTriP1  # five facets of constant strain across a narrow zone
    assert normal < (0.15 if linear else 0.08), seed
    assert tangential < (0.15 if linear else 0.1), seed
    assert np.abs(found[0].balance()["residual"]).max() < 1e-9, seed


@pytest.mark.parametrize("seed", range(12))
def test_finer_meshes_agree(seed, make):
    """Smooth outlines on planes, in bores, on shafts and by numbers, under each law."""
    check_pressed(make, seed)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_finer_meshes_agree_on_four_hundred(part, make):
    for seed in range(40 * part, 40 * part + 40):
        check_pressed(make, seed)
