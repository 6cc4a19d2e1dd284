"""Random outlines on planes, in bores, on shafts and by numbers: fields as a user sees them.

Two measures that know nothing of the functional: Q2 on curved cells, twice as many, in the plane,
where solids held between two planes are as well; and what the stresses of the body ask of it.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from families import PLANE, SOLID
from random_bodies import DEPTH, QUADRATIC, body_of, outline, ticks, turned
from skfem import ElementQuad2, ElementTetP1, ElementTriP1
from traction_of_the_body import mismatch

from contact import ContactProblem, Cylinder, Plane

pytestmark = [
    pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning"),
    pytest.mark.filterwarnings("ignore::contact.ContactWarning"),
]


def pressed_case(seed):
    """An outline, smooth or with a kink, an obstacle and a law, to be solved on any mesh."""
    rng = np.random.default_rng([seed, 17])
    element = PLANE[rng.integers(5)] if rng.random() < 0.75 else SOLID[rng.integers(5)]
    law = rng.choice(["none", "tresca", "coulomb"])
    kind = rng.choice(["line", "arc", "ellipse", "hollow", "wavy", "kinked"])
    obstacle = rng.choice(
        {"hollow": ["cylinder", "number"], "line": ["number"]}.get(
            kind,
            ["plane", "bore", "cylinder", "number"]
            if kind not in ("wavy", "kinked")
            else ["number"],
        )
    )
    return SimpleNamespace(
        element=element,
        kind=kind,
        obstacle=obstacle,
        law=None if law == "none" else str(law),
        friction={"none": 0.0, "tresca": 0.02, "coulomb": rng.uniform(0.1, 0.8)}[law],
        bend=rng.uniform(0.4, 0.9) if kind != "kinked" else rng.uniform(-0.6, 0.6),
        grading=float(rng.choice([1.0, 3.0])),
        curved=bool(element in QUADRATIC and rng.random() < 0.3),
        noise=10.0 ** rng.uniform(-14, -6) * rng.choice([0.0, 1.0]),
        push=rng.uniform(0.03, 0.06),
        slide=rng.uniform(-0.02, 0.02),
        size=10.0 ** rng.uniform(-6, 3),
        angle=rng.uniform(0, 2 * np.pi) * rng.choice([0.0, 1.0]),
        rng=rng,
    )


def pressed(make, q, element, n, curved, noise):
    """Result with n facets, and the arc lengths of its points along the curve, in [0, 1]."""
    solid, coarse = element in SOLID, np.random.default_rng(n)
    s = ticks(coarse, n // 2, q.grading)
    s = np.concatenate((0.5 * s, 0.5 + 0.5 * s[1:]))  # a vertex in the middle, where a kink may be
    move = noise * coarse.standard_normal((2, n + 1))
    shape = outline(q.kind, q.bend)
    body = body_of(make, element, shape, s, max(6, n // 2), curved, move, size=q.size)
    body = turned(body, q.angle, (0.0, 0.0))
    c, sn = np.cos(q.angle), np.sin(q.angle)
    R = np.array([[c, -sn], [sn, c]])
    move = q.size * R @ np.array([q.slide, -q.push])
    body.fix("top", 0, move[0]).fix("top", body.dim - 1, move[1])
    if solid:
        body.fix(["front", "back"], 1)
    at = {"plane": (0, 0), "bore": (0, 2.0), "cylinder": (0, -1.0)}
    radius = 1.5 if q.kind == "hollow" else 1.0
    centre = (0.0, -1.5) if q.kind == "hollow" else at.get(q.obstacle, (0, 0))
    centre, up = q.size * R @ np.array(centre), R @ np.array([0.0, 1.0])
    if solid:
        centre, up = (np.array([v[0], 0.0, v[1]]) for v in (centre, up))
    across = (0.0, 1.0, 0.0)
    against = {
        "plane": lambda: Plane(centre, up),
        "bore": lambda: Cylinder(centre, 2.0 * q.size, across, hollow=True),
        "cylinder": lambda: Cylinder(centre, radius * q.size, across),
        "number": lambda: 0.0,
    }[q.obstacle]()
    laws = (q.friction, q.law) if q.law else (0.0,)
    return ContactProblem(body, "bottom", against, *laws).solve(), shape, R


def fields(found, q, bins=6):
    """Resultant and its parts along the outline, in the body's own frame, of a unit's depth."""
    result, shape, R = found
    ends, rows = [0, -1], result.system.rows
    x = R.T @ result.x[ends] / q.size
    unit = q.size if result.x.shape[0] == 2 else q.size**2 * DEPTH
    along = np.array([-rows.normals[-1], rows.normals[0]])
    sheared = np.einsum("mj,cjm,cm->m", -result.t, rows.tangents[ends], along)
    s = np.linspace(-0.02, 1.02, 4001)
    c = shape(s)[0]
    at = s[np.argmin((x[0][:, None] - c[0]) ** 2 + (x[1][:, None] - c[1]) ** 2, axis=1)]
    # Forces spread by hats as wide as a bin, so that a point's own place matters little.
    knots = np.linspace(0, 1, bins + 1)
    hat = np.maximum(1 - np.abs(at[:, None] - knots) * bins, 0.0)
    force = np.array([hat.T @ result.mu, hat.T @ sheared])
    return R.T @ result.resultant[ends] / unit, force / unit


def errors(make, q, n):
    """Errors with n facets over their limits, against curved Q2 cells on twice as many."""
    found = pressed(make, q, q.element, n, q.curved, q.noise)
    force, parts = fields(found, q)
    finer, of_finer = fields(pressed(make, q, ElementQuad2, 2 * n, True, 0.0), q)
    assert np.abs(found[0].balance()["residual"]).max() < 1e-9
    normal, tangential = np.abs(parts - of_finer).sum(axis=1) / np.abs(of_finer[0]).sum()
    # Facets of constant strain across a narrow zone.
    linear = q.element in (ElementTriP1, ElementTetP1)
    # Means that reach from facet to facet; in space over the rims, at a kink around it as well.
    near = 0.1 if q.element in SOLID or q.kind == "kinked" else 0.05
    return np.array(
        [
            np.linalg.norm(force - finer) / np.linalg.norm(finer) / 0.06,
            normal / (0.15 if linear else 0.08),
            tangential / (0.15 if linear else 0.1),
            max(mismatch(found[0], "bottom")) / near,
        ]
    )


def check_pressed(make, seed):
    """Within the limits; a zone of three points out of sixteen may miss them, not of six."""
    q = pressed_case(seed)
    coarse = errors(make, q, 16)
    assert np.all(coarse < 2), (seed, coarse)
    if np.any(coarse >= 1):
        fine = errors(make, q, 32)
        assert np.all(fine < 1), (seed, coarse, fine)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(12))
def test_finer_meshes_agree(seed, make):
    """Outlines of all kinds on planes, in bores, on shafts and by numbers, under each law."""
    check_pressed(make, seed)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_finer_meshes_agree_on_one_thousand(part, make):
    for seed in range(100 * part, 100 * part + 100):
        check_pressed(make, seed)
